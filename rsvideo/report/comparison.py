"""What several methods made of one picture or clip, as values: measured, ranked, and told in words, CSV and JSON."""

import csv
import io
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rsvideo.config.sidecar import FrameRecord, Sidecar

Role = Literal["recorded", "method", "truth"]


@dataclass(frozen=True, kw_only=True)
class Measure:
    """A number that is told of every frame, and which way it is better."""

    key: str
    name: str
    unit: str
    more_is_better: bool
    digits: int
    words: str  # what it is, for who wonders
    praise: str  # what the better one has

    def written(self, value: float) -> str:
        """As people read it; a dash where there is nothing."""
        return f"{value:.{self.digits}f}" if math.isfinite(value) else "–"


MEASURES = (
    Measure(
        key="psnr",
        name="PSNR",
        unit="dB",
        more_is_better=True,
        digits=2,
        words="Nearness to the truth, after the best shift and the best scale of brightness, which no single blurred frame can tell.",
        praise="a higher PSNR",
    ),
    Measure(
        key="ssim",
        name="SSIM",
        unit="",
        more_is_better=True,
        digits=3,
        words="Likeness of structure to the truth, after the same shift and scale; 1 is the truth itself.",
        praise="a higher SSIM",
    ),
    Measure(
        key="edge_width",
        name="Edge width",
        unit="px",
        more_is_better=False,
        digits=2,
        words="Sharpness: the distance over which the strongest edges rise from 10 to 90 % of their height.",
        praise="the better edge width",
    ),
    Measure(
        key="ringing",
        name="Ringing",
        unit="%",
        more_is_better=False,
        digits=2,
        words="What shows where the recording is flat, in % of white. Blurred pictures ring least; the truth's own value is what is there.",
        praise="the better ringing",
    ),
    Measure(
        key="whiteness",
        name="Residual",
        unit="",
        more_is_better=False,
        digits=3,
        words="How much the recording and the result, blurred again by the motion found, differ by more than noise: RMS correlation of"
        " their difference between neighbouring pixels, 0 for white noise.",
        praise="a whiter residual",
    ),
    Measure(
        key="straightness",
        name="Bent lines",
        unit="px",
        more_is_better=False,
        digits=2,
        words="RMS distance of long edges from straight lines, where at least three are found. What is curved in the world counts for all.",
        praise="the better lines",
    ),
    Measure(
        key="flicker",
        name="Flicker",
        unit="",
        more_is_better=False,
        digits=3,
        words="Difference between neighbouring frames once motion is undone, relative to their fine detail.",
        praise="the better flicker",
    ),
)
NAMED = {measure.key: measure for measure in MEASURES}


@dataclass(frozen=True, kw_only=True)
class Measured:
    """One frame of one entry."""

    index: int
    time_s: float
    verdict: str
    seconds: float
    values: Mapping[str, float]  # by the measures' keys; those that could not be taken are absent or nan


@dataclass(frozen=True, kw_only=True, eq=False)
class Entry:
    """The recording, a method or the truth, and what was measured of it."""

    name: str
    role: Role
    frames: tuple[Measured, ...] = ()
    seconds: float = math.nan
    peak_bytes: int = 0
    fault: str | None = None  # why there is no result
    notes: tuple[str, ...] = ()
    sidecar: Sidecar | None = None

    def mean(self, key: str) -> float:
        """Of a measure over the frames that have it."""
        values = [v for frame in self.frames if math.isfinite(v := frame.values.get(key, math.nan))]
        return float(np.mean(values)) if values else math.nan

    def worst(self, key: str) -> float:
        """Of a measure over the frames that have it."""
        values = [v for frame in self.frames if math.isfinite(v := frame.values.get(key, math.nan))]
        return (min if NAMED[key].more_is_better else max)(values, default=math.nan)

    @property
    def verdicts(self) -> dict[str, list[int]]:
        """Frames by what became of them."""
        out: dict[str, list[int]] = {}
        for frame in self.frames:
            out.setdefault(frame.verdict, []).append(frame.index)
        return out


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """A frame that is shown: its picture by entry, and what explains it."""

    index: int
    time_s: float
    pictures: Mapping[str, bytes]  # WebP
    residuals: Mapping[str, bytes]  # WebP
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
    looks: tuple[Look, ...]
    key: int  # of `looks`, where the methods differ most
    crops: tuple[Crop, ...]
    timing: str  # in words, with who said so
    truth: str | None
    video: bytes | None = None  # MP4, all entries side by side
    video_cols: int = 1  # entries side by side in it
    provenance: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def methods(self) -> tuple[Entry, ...]:
        """Those that were tried."""
        return tuple(entry for entry in self.entries if entry.role == "method")

    @property
    def shown(self) -> tuple[Entry, ...]:
        """Entries that have pictures."""
        return tuple(entry for entry in self.entries if entry.fault is None)

    @property
    def faults(self) -> int:
        """Methods without a result."""
        return sum(entry.fault is not None for entry in self.methods)


def measures(comparison: Comparison) -> tuple[Measure, ...]:
    """Those that at least one entry has."""
    return tuple(m for m in MEASURES if any(math.isfinite(entry.mean(m.key)) for entry in comparison.entries))


def best(comparison: Comparison, key: str) -> frozenset[str]:
    """The methods whose mean, as it is written, no other betters; none where only one has it.

    Where the truth has a value of its own, the nearest to it is best: edges can be sharper than the world's. The recording itself
    competes only for nearness to the truth, for blur rings least and hides what flickers.
    """
    measure = NAMED[key]
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


def summary(comparison: Comparison, ours: str = "rsvideo") -> list[str]:
    """Who wins, in sentences; where a baseline does, it says so."""
    done = [entry for entry in comparison.methods if entry.fault is None]
    told = []
    if any(math.isfinite(entry.mean("psnr")) for entry in done):
        told = _against_truth(comparison, done, ours)
    elif len(done) > 1:
        told = ["There is no truth to compare with: the numbers below tell what the pictures tell of themselves, and eyes decide."]
    told += _better_elsewhere(comparison, done, ours)
    if failed := [entry for entry in comparison.methods if entry.fault is not None]:
        told.append(f"{_and([entry.name for entry in failed])} gave no result; why stands below.")
    return told


def _against_truth(comparison: Comparison, done: Sequence[Entry], ours: str) -> list[str]:
    ranked = sorted((entry for entry in done if math.isfinite(entry.mean("psnr"))), key=lambda entry: -entry.mean("psnr"))
    first, *others = ranked
    recorded = next((entry for entry in comparison.entries if entry.role == "recorded" or entry.name == "none"), None)
    words = f"{first.name} comes closest to the truth, {first.mean('psnr'):.2f} dB"
    if len(first.frames) > 1:
        words += f" on average over {len(first.frames)} frames"
    gains = []
    if recorded and recorded is not first:
        gains.append(f"{first.mean('psnr') - recorded.mean('psnr'):.2f} dB more than the recording")
    if rivals := [entry for entry in others if entry is not recorded]:
        gains.append(f"{first.mean('psnr') - rivals[0].mean('psnr'):.2f} dB more than {rivals[0].name}, the next best")
    told = [words + (f": {_and(gains)}." if gains else ".")]
    mine = next((entry for entry in ranked if entry.name == ours), None)
    if mine and mine is not first:
        told.append(f"{ours} is {first.mean('psnr') - mine.mean('psnr'):.2f} dB behind {first.name} here.")
    if mine and len(mine.frames) > 1:
        beaten = {frame.index for frame in mine.frames}
        lost = [
            f.index
            for f in mine.frames
            if f.index in beaten
            and any(
                other.values.get("psnr", -math.inf) > f.values.get("psnr", math.inf) + 0.01
                for entry in done
                if entry is not mine
                for other in entry.frames
                if other.index == f.index
            )
        ]
        if lost and mine is first:
            told.append(f"Another method is closer on {_some(len(lost), 'frame')}: {_list(lost)}.")
    return told


def _better_elsewhere(comparison: Comparison, done: Sequence[Entry], ours: str) -> list[str]:
    """Measures but PSNR in which a method other than ours is best, a sentence for each that is."""
    mine = next((entry for entry in done if entry.name == ours), None)
    truth = next((entry for entry in comparison.entries if entry.role == "truth"), None)
    wins: dict[str, list[str]] = {}
    for measure in measures(comparison):
        names = best(comparison, measure.key)
        if mine is None or measure.key == "psnr" or not names or ours in names or not math.isfinite(mine.mean(measure.key)):
            continue
        winners = [entry for entry in done if entry.name in names]
        own = math.nan if truth is None else truth.mean(measure.key)
        unit = f" {measure.unit}" if measure.unit else ""
        words = f"{measure.written(winners[0].mean(measure.key))}{unit} against {measure.written(mine.mean(measure.key))}"
        words += f", the truth {measure.written(own)}" if math.isfinite(own) else ""
        wins.setdefault(_and([entry.name for entry in winners]), []).append(f"{measure.praise} ({words})")
    return [f"{who} {'have' if ' and ' in who else 'has'} {_and(which)}." for who, which in wins.items()]


def _and(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _some(number: int, thing: str) -> str:
    return f"{number} {thing}{'' if number == 1 else 's'}"


def _list(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers[:12])) + (", …" if len(numbers) > 12 else "")


def as_csv(comparison: Comparison) -> bytes:
    """A line for each entry and frame."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["entry", "role", "frame", "time_s", *(m.key for m in MEASURES), "seconds", "verdict"])
    for entry in comparison.entries:
        for frame in entry.frames:
            values = [f"{v:.6g}" if math.isfinite(v := frame.values.get(m.key, math.nan)) else "" for m in MEASURES]
            rows.writerow([entry.name, entry.role, frame.index, f"{frame.time_s:.6f}", *values, f"{frame.seconds:.4g}", frame.verdict])
    return text.getvalue().encode()


def all_csv(comparisons: Sequence[Comparison]) -> bytes:
    """The lines of several comparisons, each beginning with its title."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    for n, comparison in enumerate(comparisons):
        header, *lines = csv.reader(io.StringIO(as_csv(comparison).decode()))
        rows.writerows(([["input", *header]] if n == 0 else []) + [[comparison.title, *line] for line in lines])
    return text.getvalue().encode()


def all_json(comparisons: Sequence[Comparison]) -> bytes:
    """Several comparisons in one file."""
    return (json.dumps({"version": 1, "inputs": [_told(each) for each in comparisons]}, indent=1, ensure_ascii=False) + "\n").encode()


def as_json(comparison: Comparison) -> bytes:
    """The same numbers, their means, and where they come from."""
    return (json.dumps(_told(comparison), indent=1, ensure_ascii=False) + "\n").encode()


def _told(comparison: Comparison) -> dict[str, object]:

    def entry(each: Entry) -> dict[str, object]:
        return {
            "name": each.name,
            "role": each.role,
            "fault": each.fault,
            "seconds": _number(each.seconds),
            "peak_bytes": each.peak_bytes or None,
            "notes": each.notes,
            "verdicts": each.verdicts,
            "mean": _numbers({m.key: each.mean(m.key) for m in MEASURES}.get, MEASURES),
            "worst": _numbers({m.key: each.worst(m.key) for m in MEASURES}.get, MEASURES),
            "frames": [
                {"frame": f.index, "time_s": f.time_s, "verdict": f.verdict, "seconds": f.seconds, **_numbers(f.values.get, MEASURES)}
                for f in each.frames
            ],
        }

    return {
        "version": 1,
        "source": comparison.source,
        "truth": comparison.truth,
        "kind": comparison.kind,
        "rows": comparison.rows,
        "cols": comparison.cols,
        "rate": comparison.rate or None,
        "timing": comparison.timing,
        "summary": summary(comparison),
        "measures": {m.key: {"unit": m.unit, "more_is_better": m.more_is_better, "words": m.words} for m in MEASURES},
        "best": {m.key: sorted(best(comparison, m.key)) for m in measures(comparison)},
        "entries": [entry(each) for each in comparison.entries],
        "crops": [[crop.x, crop.y, crop.w, crop.h] for crop in comparison.crops],
        "provenance": dict(comparison.provenance),
        "notes": comparison.notes,
    }


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else value


def _numbers(value: Callable[[str], float | None], over: Sequence[Measure]) -> dict[str, float | None]:
    return {m.key: _number(value(m.key)) for m in over}
