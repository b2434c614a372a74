"""Gyroscope logs as Gyroflow reads them (.gcsv): the motion that was found written as if a gyroscope had measured it, and logs read.

Axes. The columns that are written hold pitch, yaw and roll rates about the camera's x (right), y (down) and z (forward), as in README's
"Conventions". Gyroflow maps columns to its axes X, Y and Z by `orientation` (small letters for the opposite sense), and turns the camera
by (-Y, X, Z) about x (right), y (up) and z (backward). So X = -yaw, Y = -pitch and Z = -roll rate: the orientation "yxz".

Time. Gyroflow takes a frame's timestamp for the middle of its readout and exposure, where ours is the opening of the scanline that is
read first; and it lets a log begin at the first frame's timestamp, whatever its first time says. So logs are written from that middle
on, as time 0.
"""

import enum
import math
from array import array
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from rsvideo.config.files import UnreadableError, lines
from rsvideo.physics.gyro import MOST_SAMPLES, GyroLog, check_axes
from rsvideo.physics.shutter import Direction, ShutterTiming

MOST_BYTES = 256_000_000
FIRST_LINES = ("GYROFLOW IMU LOG", "CAMERA IMU LOG")
_MOST_KEYS = 50
_MOST_CHARACTERS = 80  # of a value that is written; Gyroflow searches the header in the first 500 bytes
_TICK = 1e-6  # seconds, in which times are written
_ORIENTATION = "yxz"
_DEFAULT_ORIENTATION = "xzY"  # of a log that does not say it
_SMALL = 1e-2  # rad; below, the series is exact to 2e-12 and the closed form loses digits
_FEWEST_SAMPLES = 4  # of angles, for a cubic spline through them


class ReadoutCode(enum.IntEnum):
    """How the format counts the directions of a readout; other formats count otherwise."""

    TOP_TO_BOTTOM = 0
    BOTTOM_TO_TOP = 1
    LEFT_TO_RIGHT = 2
    RIGHT_TO_LEFT = 3

    @classmethod
    def of(cls, direction: Direction) -> "ReadoutCode":
        """The code of a direction."""
        return cls[direction.name]

    @property
    def direction(self) -> Direction:
        """The direction of a code."""
        return Direction[self.name]


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """What a log holds."""

    log: GyroLog  # in the camera's axes; time 0 is the log's first sample
    readout: float | None  # seconds
    direction: Direction | None
    header: Mapping[str, str]  # all that stands above the samples


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """Part of a path that is to be written: angles (pitch, yaw, roll) in rad at rising times, before and behind what they are for."""

    t_s: Float[np.ndarray, " n"]
    angles: Float[np.ndarray, "n 3"]
    until: float  # s, where the next part takes over


def rates(t_s: Float[np.ndarray, " n"], angles: Float[np.ndarray, "n 3"], at: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 3"]:
    """The camera's turning about its own axes in rad/s at the times `at`, of a cubic spline through sampled rotation vectors.

    With R = exp([v]_x) and dR/dt = R [w]_x, the rate is w = v' - (1 - cos a) / a^2 v x v' + (a - sin a) / a^3 v x (v x v'), a = |v|.
    """
    curve = CubicSpline(t_s, angles)
    v, dv = curve(at), curve(at, 1)
    a = np.linalg.norm(v, axis=1, keepdims=True)
    first = 0.5 * np.sinc(a / (2 * np.pi)) ** 2  # (1 - cos a) / a^2
    small = a < _SMALL
    second = np.where(small, 1 / 6 - a * a / 120, (a - np.sin(a)) / np.where(small, 1.0, a) ** 3)
    cross = np.cross(v, dv)
    return dv - first * cross + second * np.cross(v, cross)


def encode(
    t_s: Float[np.ndarray, " n"], angles: Float[np.ndarray, "n 3"], *, timing: ShutterTiming, video: str = "", model: str = "virtual gyro"
) -> bytes:
    """The log of angles (pitch, yaw, roll) in rad at rising times; 0 s opens the first frame's first scanline.

    Samples stand as far apart as those given, from the middle of the first frame's interval on.
    """
    return b"".join(encoded([Part(t_s=t_s, angles=angles, until=float(t_s[-1]))], timing=timing, video=video, model=model))


def encoded(parts: Iterable[Part], *, timing: ShutterTiming, video: str = "", model: str = "virtual gyro") -> Iterator[bytes]:
    """The same of a path that comes in parts, one after the other: memory does not grow with its length."""
    step = number = 0
    for part in parts:
        t_s = part.t_s
        if len(t_s) < _FEWEST_SAMPLES or not np.all(np.diff(t_s) > 0) or not (np.isfinite(t_s).all() and np.isfinite(part.angles).all()):
            raise ValueError(f"a log needs at least {_FEWEST_SAMPLES} finite samples at rising times, got {len(t_s)}")
        if not step:
            if not t_s[0] <= timing.middle < t_s[-1]:
                raise ValueError(
                    f"samples must cover the middle of the first frame, {timing.middle:g} s, they cover {t_s[0]:g} to {t_s[-1]:g} s;"
                    " is their time 0 the opening of its first scanline?"
                )
            step = max(1, round(float(np.median(np.diff(t_s))) / _TICK))
            yield _header_of(timing, video, model)
        ticks = np.arange(number * step, (part.until - timing.middle) / _TICK, step)
        number += len(ticks)
        turning = rates(t_s, part.angles, np.clip(timing.middle + ticks * _TICK, t_s[0], t_s[-1]))
        lines = [f"{tick:.0f},{x:.9g},{y:.9g},{z:.9g}\n" for tick, (x, y, z) in zip(ticks.tolist(), turning.tolist(), strict=True)]
        yield "".join(lines).encode()


def _header_of(timing: ShutterTiming, video: str, model: str) -> bytes:
    header = {
        "version": "1.3",
        "id": _plain(model),
        "orientation": _ORIENTATION,
        "note": "found in the pictures by rsvideo",
        "vendor": "rsvideo",
        **({"videofilename": _plain(video)} if video else {}),
        "frame_readout_time": f"{timing.readout * 1e3:.6g}",
        "frame_readout_direction": str(int(ReadoutCode.of(timing.direction))),
        "tscale": f"{_TICK:f}",
        "gscale": "1.0",
    }
    return "\n".join([FIRST_LINES[0], *(f"{key},{value}" for key, value in header.items()), "t,gx,gy,gz", ""]).encode()


def read(path: Path) -> Recording:
    """The log in a file, its rates in the camera's axes."""
    numbered = enumerate(lines(path, most=MOST_BYTES), 1)
    _, first = next(numbered)
    if first.strip() not in FIRST_LINES:
        raise UnreadableError(f"{path}:1: must be {FIRST_LINES[0]}, got {first[:40]!r}; is it another kind of log?")
    header = _header(path, numbered)
    try:
        orientation = header.get("orientation", _DEFAULT_ORIENTATION)
        check_axes(orientation)
        times, columns = _samples(path, numbered)
        turned = np.stack([columns[:, "XYZ".index(axis.upper())] * (1 if axis.isupper() else -1) for axis in orientation], axis=1)
        x, y, z = (turned * _number(header, "gscale", 1.0)).T
        log = GyroLog(times=(times - times[0]) * _number(header, "tscale", 1e-3), rates=np.stack([-y, -x, -z], axis=1))
        readout = _number(header, "frame_readout_time", math.nan) * 1e-3
        direction = _direction(header.get("frame_readout_direction", "0"))
    except UnreadableError:
        raise
    except ValueError as error:
        raise UnreadableError(f"{path}: {error}") from error
    stated = math.isfinite(readout)
    return Recording(log=log, readout=readout if stated else None, direction=direction if stated else None, header=header)


def _header(path: Path, numbered: Iterator[tuple[int, str]]) -> dict[str, str]:
    """What stands above the samples."""
    header: dict[str, str] = {}
    for _, line in islice(numbered, _MOST_KEYS + 1):
        key, _, value = (part.strip() for part in line.partition(","))
        if key in ("t", "time"):
            return header
        header[key[:_MOST_CHARACTERS]] = value[:_MOST_CHARACTERS]
    raise UnreadableError(f"{path} must name its columns, t,gx,gy,gz, within {_MOST_KEYS} lines; is it cut short?")


def _samples(path: Path, numbered: Iterator[tuple[int, str]]) -> tuple[np.ndarray, np.ndarray]:
    samples = array("d")
    for number, line in numbered:
        if not line.strip():
            continue
        try:
            t, x, y, z = map(float, line.split(",", 4)[:4])
            if len(samples) >= 4 * MOST_SAMPLES:
                raise ValueError
        except ValueError as error:
            raise UnreadableError(f"{path}:{number}: must be t,gx,gy,gz (at most {MOST_SAMPLES} samples), got {line[:40]!r}") from error
        samples.extend((t, x, y, z))
    if not samples:
        raise UnreadableError(f"{path} must hold samples below its header, it holds none; is it cut short?")
    table = np.frombuffer(samples).reshape(-1, 4)
    return table[:, 0], table[:, 1:]


def _number(header: Mapping[str, str], key: str, default: float) -> float:
    try:
        return float(header[key]) if key in header else default
    except ValueError:
        raise ValueError(f"{key} must be a number, got {header[key]!r}") from None


def _direction(text: str) -> Direction:
    if text not in {str(int(code)) for code in ReadoutCode}:
        raise ValueError(f"frame_readout_direction must be 0 to 3, got {text!r}")
    return ReadoutCode(int(text)).direction


def _plain(text: str) -> str:
    """Text without what would end a field of the header."""
    return "".join(letter if letter.isprintable() and letter not in ',"' else "_" for letter in text)[:_MOST_CHARACTERS]
