"""Readout times that owners of cameras published: what is typical of a camera, and how far they disagree.

`readout_times.csv` holds the frame readout times of 1094 lens profiles of Gyroflow (github.com/gyroflow/lens_profiles), which its
authors gave to the public domain (CC0 1.0, `readout_times.LICENSE`), reduced to camera, mode and time. They are crowd-sourced: a time
below 1 ms is a slip of some unit and one longer than a frame cannot be, so both are passed over; a negative one stands for a readout from
the bottom up, or for a camera that hung upside down, so one alone turns no direction. Trust the median, and its spread.
"""

import csv
import difflib
import re
from dataclasses import dataclass
from importlib import resources

import numpy as np

from rsvideo.config.quantity import same_rate
from rsvideo.physics.shutter import Direction

SHORTEST = 1e-3  # seconds
PERIOD_SLACK = 0.01  # of a frame's period, by which clocks and rounding may let an exposure or a readout exceed it
_ENOUGH = 3  # owners who agree that a camera reads upwards
_SIMILAR = 3  # names that are suggested for one that is not in the table
_LOW, _HIGH = 0.05, 0.95  # quantiles of what owners measured, between which nine of ten lie


@dataclass(frozen=True, kw_only=True)
class Entry:
    """What one owner found."""

    maker: str
    model: str
    rows: int
    cols: int
    fps: float | None  # where the profile says it
    readout: float  # seconds
    direction: Direction


@dataclass(frozen=True, kw_only=True)
class Readout:
    """What owners of one camera found; seconds."""

    median: float
    low: float  # nine of ten lie between these two
    high: float
    n: int
    direction: Direction  # of most of them
    mode: str  # which of the camera's modes these are, in words


def table() -> tuple[Entry, ...]:
    """All usable entries."""
    text = resources.files("rsvideo.shooting").joinpath("readout_times.csv").read_text(encoding="utf-8")
    return tuple(entry for line in csv.DictReader(text.splitlines()) if (entry := _entry(line)) is not None)


def typical(camera: str, *, rows: int | None = None, cols: int | None = None, fps: float | None = None) -> Readout | None:
    """What is typical of a camera (maker and model, or model alone), from the narrowest mode that anyone measured.

    Entries of the same size and rate are taken where there are any, else of the same size, of the same rate, of any mode;
    none that is longer than a frame at `fps`.
    """
    entries = [entry for entry in table() if _same_camera(camera, f"{entry.maker} {entry.model}") and _fits(entry.readout, fps)]
    for size, rate in ((True, True), (True, False), (False, True), (False, False)):
        if (size and rows is None) or (rate and fps is None):
            continue
        found = [
            entry for entry in entries if (not size or (entry.rows, entry.cols) == (rows, cols)) and (not rate or _same(entry.fps, fps))
        ]
        if found:
            return _readout(found, " at ".join([f"{cols} x {rows}"] * size + [f"{fps or 0:.5g} fps"] * rate) or "any of its modes")
    return None


def similar(camera: str) -> tuple[str, ...]:
    """Cameras in the table whose names are near."""
    names = {key: f"{entry.maker} {entry.model}" for entry in table() for key in _keys(f"{entry.maker} {entry.model}")}
    near = [key for wanted in _keys(camera) for key in difflib.get_close_matches(wanted, names, n=_SIMILAR)]
    return tuple(dict.fromkeys(names[key] for key in near))


def _entry(line: dict[str, str]) -> Entry | None:
    fps, readout = float(line["fps"]) if line["fps"] else None, float(line["readout_ms"]) * 1e-3
    if abs(readout) < SHORTEST or not _fits(abs(readout), fps):
        return None
    return Entry(
        maker=line["maker"],
        model=line["model"],
        rows=int(line["rows"]),
        cols=int(line["cols"]),
        fps=fps,
        readout=abs(readout),
        direction=Direction.BOTTOM_TO_TOP if readout < 0 else Direction.TOP_TO_BOTTOM,
    )


def _fits(readout: float, fps: float | None) -> bool:
    return 0 < readout * (fps or 1.0) <= 1 + PERIOD_SLACK


def _same(fps: float | None, other: float | None) -> bool:
    return fps is not None and other is not None and same_rate(fps, other)


def _readout(entries: list[Entry], mode: str) -> Readout:
    low, median, high = np.quantile([entry.readout for entry in entries], [_LOW, 0.5, _HIGH]).tolist()
    upwards = sum(entry.direction is Direction.BOTTOM_TO_TOP for entry in entries)
    direction = Direction.BOTTOM_TO_TOP if upwards >= _ENOUGH and 2 * upwards > len(entries) else Direction.TOP_TO_BOTTOM
    return Readout(median=median, low=low, high=high, n=len(entries), direction=direction, mode=mode)


_MAKERS = re.compile(
    r"^(apple|blackmagic( design)?|bmd|caddx|canon|dji|foxeer|fujifilm|fuji|google|gopro|hawkeye|huawei|insta360|arashi vision|kinefinity"
    r"|leica( camera ag)?|nikon( corporation)?|olympus|oneplus|oppo|panasonic|poco|realme|red|runcam|samsung|sigma|sony|xiaomi|xtu|z cam)\b"
)
_FAMILIES = re.compile(r"^(eos|lumix|digital|galaxy|pocket cinema camera|cinema pocket camera|cinema camera)\b|\b(camera|cam)$")
_MARKS = {"iii": "3", "ii": "2", "iv": "4"}


def _same_camera(one: str, other: str) -> bool:
    makers = {found[1][:4] for name in (one, other) if (found := _MAKERS.match(name.lower()))}
    return len(makers) < 2 and bool(_keys(one) & _keys(other))


def _keys(name: str) -> set[str]:
    """Names are equal if they share a key: makers' and families' names, blanks, case and spellings of `mark II` do not count."""
    return {key for part in name[:200].split("/") if (key := _key(part))}


def _key(name: str) -> str:
    name = " ".join(re.sub(r"[^\w]+|_", " ", name.lower().replace("α", "a")).split())
    name = re.sub(r"^(ilce|ilme|dsc|dmc|dc)(?![a-z]) ?", lambda code: "a" if code[1] == "ilce" else "", _MAKERS.sub("", name).strip())
    for _ in range(2):  # `eos` and `digital` may follow each other, a maker may be named twice
        name = _FAMILIES.sub("", _MAKERS.sub("", name).strip()).strip()
    key = re.sub(r"mark|mk", "m", name.replace(" ", ""))
    key = re.sub(r"^(z[5-9])([23])$", r"\1m\2", key)  # Nikon's own spelling
    key = re.sub(r"m?(iii|ii|iv)$", lambda mark: "m" + _MARKS[mark[1]], key)
    return re.sub(r"^(a7[rs]?)v$", r"\1m5", re.sub(r"(?<=\d)m(1|i)$", "", key))
