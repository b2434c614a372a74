"""What several methods made of one picture or clip, as values, and which method each measure calls the best."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rsvideo.config.sidecar import FrameRecord, Sidecar
from rsvideo.report.measures import BY_KEY, MEASURES, Measure

Role = Literal["recorded", "method", "truth"]


@dataclass(frozen=True, kw_only=True)
class FrameMeasures:
    """What was measured of one frame of one entry."""

    index: int  # in the source
    time_s: float  # since the source's first picture
    verdict: str  # what became of the frame; empty where nothing was tried
    seconds: float  # of work
    values: Mapping[str, float]  # by the measures' keys; those that could not be taken are absent or nan

    def value(self, key: str) -> float:
        """Of a measure; nan where it could not be taken."""
        return self.values.get(key, math.nan)


@dataclass(frozen=True, kw_only=True, eq=False)
class Entry:
    """The recording, a method or the truth, and what was measured of it."""

    name: str
    role: Role
    frames: tuple[FrameMeasures, ...] = ()
    seconds: float = math.nan  # of work on all frames
    peak_bytes: int = 0  # of memory; 0 where it was not measured
    fault: str | None = None  # why there is no result
    notes: tuple[str, ...] = ()
    sidecar: Sidecar | None = None

    def values(self, key: str) -> list[float]:
        """Of a measure, of the frames that have it."""
        return [value for frame in self.frames if math.isfinite(value := frame.value(key))]

    def mean(self, key: str) -> float:
        """Of a measure over the frames that have it; nan where none has."""
        values = self.values(key)
        return float(np.mean(values)) if values else math.nan

    def worst(self, key: str) -> float:
        """Of a measure over the frames that have it; nan where none has."""
        return (min if BY_KEY[key].more_is_better else max)(self.values(key), default=math.nan)

    @property
    def verdicts(self) -> dict[str, list[int]]:
        """Frames by what became of them."""
        out: dict[str, list[int]] = {}
        for frame in self.frames:
            out.setdefault(frame.verdict, []).append(frame.index)
        return out


@dataclass(frozen=True, kw_only=True, eq=False)
class KeyFrame:
    """A frame that is shown: its picture by entry, and what explains it."""

    index: int  # in the source
    time_s: float  # since the source's first picture
    pictures: Mapping[str, bytes]  # WebP
    residuals: Mapping[str, bytes]  # WebP, of the methods that explain the frame
    records: Mapping[str, FrameRecord]
    thumbnail: bytes  # WebP of the recording


@dataclass(frozen=True, kw_only=True)
class Crop:
    """A part of the picture as shown, in its pixels, and who chose it."""

    x: int
    y: int
    w: int
    h: int
    chosen: bool  # by the user


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """All that a report shows of one input."""

    title: str
    source: str
    kind: Literal["still", "clip"]
    rows: int  # as shown
    cols: int
    rate: float  # pictures a second; 0 of a still
    entries: tuple[Entry, ...]
    key_frames: tuple[KeyFrame, ...]
    first_shown: int  # of `key_frames`, the one in which the methods differ most
    crops: tuple[Crop, ...]
    timing: str  # in words, with its source
    truth: str | None
    video: bytes | None = None  # MP4, all entries side by side
    video_cols: int = 1  # entries side by side in it
    provenance: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def methods(self) -> tuple[Entry, ...]:
        """The methods that were tried."""
        return tuple(entry for entry in self.entries if entry.role == "method")

    @property
    def shown(self) -> tuple[Entry, ...]:
        """Entries that have pictures."""
        return tuple(entry for entry in self.entries if entry.fault is None)


def measures_of(comparison: Comparison) -> tuple[Measure, ...]:
    """The measures that at least one entry has."""
    return tuple(m for m in MEASURES if any(math.isfinite(entry.mean(m.key)) for entry in comparison.entries))


def best(comparison: Comparison, key: str) -> frozenset[str]:
    """The methods with the best mean, as it is written; none where fewer than two methods have one.

    Where the truth has a value of its own, the nearest to it is best: edges can be sharper than the world's. The recording itself
    competes only for nearness to the truth, because blur rings least and hides flicker.
    """
    measure = BY_KEY[key]
    truth = next((entry.mean(key) for entry in comparison.entries if entry.role == "truth"), math.nan)
    costs: dict[str, float] = {}
    for entry in comparison.methods:
        mean = round(entry.mean(key), measure.digits)
        if math.isfinite(mean) and (entry.name != "none" or key in ("psnr", "ssim")):
            off = abs(mean - round(truth, measure.digits)) if math.isfinite(truth) else -mean if measure.more_is_better else mean
            costs[entry.name] = round(off, measure.digits)
    if len(costs) < 2:
        return frozenset()
    least = min(costs.values())
    return frozenset(name for name, cost in costs.items() if cost == least)
