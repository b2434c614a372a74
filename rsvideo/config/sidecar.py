"""The record beside a restored picture: what was done, with which timing, and the motion that was found.

It is written, and where one line holds one frame also read, frame by frame: memory does not grow with the length of a clip.
"""

import json
import math
import os
import re
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import numpy as np
from jaxtyping import Float
from pydantic import (
    BeforeValidator,
    Field,
    JsonValue,
    ValidationError,
    model_serializer,
    model_validator,
)

from rsvideo.config.files import UnreadableError, opened, read_whole
from rsvideo.config.found_motion import Finite, Found, Middle, Record
from rsvideo.config.printable import in_unicode
from rsvideo.physics import distortion
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import LONGEST_MODELLED, Direction, ShutterTiming

MOST_BYTES = 100_000_000
MOST_ITEMS = 2_000_000  # values that are parsed at a time; each takes up to a hundred bytes of memory, however short it is written
_LONGEST_LINE = 16_000_000
_FRAMES, _END = b',"frames":[\n', b"]}\n"  # of the first line; the last line
_INDEX = re.compile(rb'\{"index":(\d{1,12}),')
_STEP = 0.25e-3  # seconds from one sample of a trajectory to the next
_FEWEST = 64  # samples
LEAST_STEP = 1e-9  # seconds; over less, no curve through the samples stays finite

Seconds = Annotated[float, Field(allow_inf_nan=False, ge=-1000, le=1000)]  # within a frame's interval, which is shorter than 20
Shift = Annotated[float, Field(allow_inf_nan=False, ge=-1e5, le=1e5)]  # px
Turn = Annotated[float, Field(allow_inf_nan=False, ge=-100, le=100)]  # rad
Side = Annotated[int, Field(gt=0, le=100_000)]  # px
Focal = Annotated[float, Field(allow_inf_nan=False, ge=1, le=1e7)]  # px
Words = Annotated[str, BeforeValidator(lambda name: in_unicode(name) if isinstance(name, str) else name), Field(max_length=5000)]


_Kind = TypeVar("_Kind", bound=Record)


class Timing(Record):
    """When the scanlines of a frame collect light, and where that is from."""

    exposure_s: Annotated[float, Field(gt=0, lt=LONGEST_MODELLED, allow_inf_nan=False)]
    row_time_s: Annotated[float, Field(ge=0, lt=LONGEST_MODELLED, allow_inf_nan=False)]
    source: Words


class Sampled(Record):
    """A trajectory in image coordinates, sampled over the frame's whole interval; 0 opens the first scanline."""

    t_s: Annotated[list[Seconds], Field(fail_fast=True, min_length=2)]
    x_px: Annotated[list[Shift], Field(fail_fast=True)]
    y_px: Annotated[list[Shift], Field(fail_fast=True)]
    roll_rad: Annotated[list[Turn], Field(fail_fast=True)]

    @model_validator(mode="after")
    def _check(self) -> "Sampled":
        lengths = {name: len(getattr(self, name)) for name in ("t_s", "x_px", "y_px", "roll_rad")}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"t_s, x_px, y_px and roll_rad must be equally long, they hold {', '.join(map(str, lengths.values()))}")
        if np.any(np.diff(self.t_s) < LEAST_STEP):
            raise ValueError(f"t_s must rise from each sample to the next, by {LEAST_STEP:g} s or more")
        return self

    @staticmethod
    def times(t0: float, t1: float) -> Float[np.ndarray, " n"]:
        """When a trajectory from t0 to t1 is sampled: at most a quarter of a millisecond apart."""
        return np.linspace(t0, t1, max(_FEWEST, math.ceil((t1 - t0) / _STEP) + 1))

    @classmethod
    def of(cls, t: Float[np.ndarray, " n"], poses: Float[np.ndarray, "n axes"]) -> "Sampled":
        """The poses (x, y, and roll where there is a third axis) at the times `t`."""
        roll = poses[:, 2] if poses.shape[1] > 2 else np.zeros(len(t))
        return cls(t_s=t.tolist(), x_px=poses[:, 0].tolist(), y_px=poses[:, 1].tolist(), roll_rad=roll.tolist())

    def poses(self) -> Float[np.ndarray, "n 3"]:
        """(samples, 3): x in px, y in px, roll in rad."""
        return np.stack([self.x_px, self.y_px, self.roll_rad], axis=1)


class FrameRecord(Record):
    """What became of one frame."""

    index: Annotated[int, Field(ge=0, le=10**12)]
    time_s: Finite
    timing: Timing
    trajectory: Sampled
    to_next: Annotated[list[Shift], Field(min_length=3, max_length=3)] | None = None
    """Of a clip: from the pose at this frame's middle to that at the next one's, x and y in px, roll in rad; None at a cut."""
    verdict: Words
    seconds: Annotated[Finite, Field(ge=0)]
    convergence: Annotated[list[Finite], Field(fail_fast=True, max_length=10_000)] = Field(default_factory=list)
    """The objective after each step of the last refinement of the trajectory."""
    psfs: Annotated[list[list[list[list[Finite]]]], Field(fail_fast=True, min_length=1, max_length=64)] | None = None
    """PSFs over a grid of the frame, (down, across, k, k), of methods that know no trajectory."""
    overlaid: Annotated[Finite, Field(ge=0, le=1)] = 0.0
    """Share of the picture that graphics cover, which are left as they were."""
    found: Found | None = None
    """By `rsvideo track`: `trajectory` as it was found, and what else a restoration needs."""

    @model_validator(mode="after")
    def _check(self) -> "FrameRecord":
        if self.psfs is not None:
            try:
                rows, cols = np.array(self.psfs).shape[2:]
            except ValueError as error:
                raise ValueError("psfs must be a grid of squares, all of one size") from error
            if rows != cols or not rows:
                raise ValueError(f"psfs must be a grid of squares, all of one size, they are {rows} x {cols}")
        return self

    def encode(self) -> bytes:
        """One line of JSON, without what there is nothing to say of."""
        unsaid = {name for name in ("to_next", "convergence", "psfs", "overlaid", "found") if not getattr(self, name)}
        return self.model_dump_json(exclude=unsaid).encode()


class Lens(Record):
    """How the lens bends rays, in OpenCV's models and order of coefficients."""

    model: distortion.Model
    coefficients: Annotated[list[Finite], Field(fail_fast=True, max_length=20)]


class SensorNoise(Record):
    """The variance of a pixel at light L in [0, 1]: read^2 + shot * L."""

    read: Finite
    shot: Finite


class Camera(Record):
    """The camera that was assumed, in pixels, and where its focal length came from."""

    fx: Focal
    fy: Focal
    cx: Middle
    cy: Middle
    rows: Side
    cols: Side
    source: Words  # "explicit", "EXIF", "assumed", or the profile or metadata that states it
    distortion: Lens | None = None  # None: a pinhole camera
    noise: SensorNoise | None = None  # None: measured in each frame

    @model_validator(mode="after")
    def _check(self) -> "Camera":
        _ = self.intrinsics, self.sensor_noise  # which say what a lens and a noise cannot be
        return self

    @classmethod
    def of(cls, intrinsics: Intrinsics, source: str, noise: Noise | None = None) -> "Camera":
        """The record of a camera, and of its sensor's noise where that is given."""
        lens = intrinsics.distortion
        return cls(
            fx=intrinsics.fx,
            fy=intrinsics.fy,
            cx=intrinsics.cx,
            cy=intrinsics.cy,
            rows=intrinsics.rows,
            cols=intrinsics.cols,
            source=source,
            distortion=Lens(model=lens.model, coefficients=list(lens.coefficients)) if lens else None,
            noise=SensorNoise(read=noise.read, shot=noise.shot) if noise else None,
        )

    @property
    def intrinsics(self) -> Intrinsics:
        """The camera itself."""
        lens = self.distortion
        bends = distortion.Distortion(model=lens.model, coefficients=tuple(lens.coefficients)) if lens else None
        return Intrinsics(fx=self.fx, fy=self.fy, cx=self.cx, cy=self.cy, rows=self.rows, cols=self.cols, distortion=bends)

    @property
    def sensor_noise(self) -> Noise | None:
        """What the noise is at each light, where the camera's profile gives it."""
        return Noise(read=self.noise.read, shot=self.noise.shot) if self.noise else None

    @model_serializer(mode="wrap")
    def _without_what_is_not_given(self, write: Callable[["Camera"], dict[str, JsonValue]]) -> dict[str, JsonValue]:
        return {key: value for key, value in write(self).items() if value is not None}


class Settings(Record):
    """All that steered the work, so that it can be repeated."""

    rsvideo: Words  # the program's version
    camera: Camera
    direction: Direction
    transfer: Annotated[str, Field(max_length=100)]  # the curve's name
    trajectory_from: Words | None  # the file, where the motion was given
    restoration: dict[str, JsonValue]  # the core's own settings, under their names
    input_sha256: str | None = None
    encoding: dict[str, JsonValue] = Field(default_factory=dict)  # of a clip


class Mark(Record):
    """By which a job knows its results again; paths are relative to the sidecar's folder."""

    job: str
    input: str
    settings: str  # fingerprints
    source: str


class Written(Record):
    """What was written with the sidecar, and what became of it."""

    sha256: dict[Words, str]  # of files by their names; of a folder, over its files' names and hashes
    restored: Annotated[int, Field(ge=0)]
    left: Annotated[int, Field(ge=0)]
    failed: Annotated[int, Field(ge=0)]
    seconds: Annotated[float, Field(ge=0)]
    notes: tuple[Words, ...]
    mark: Mark | None = None  # None: by no job


class _Head(Record):
    """The whole file but for its frames."""

    version: Literal[1] = 1
    input: Words
    settings: Settings
    written: Written | None = None  # None: by a program that did not state it


class Sidecar(_Head):
    """The whole file."""

    frames: Annotated[list[FrameRecord], Field(fail_fast=True, min_length=1)]

    @model_validator(mode="after")
    def _check(self) -> "Sidecar":
        for frame in self.frames:
            _ = self.timing(frame)  # which says what a readout cannot be
        return self

    def encode(self) -> bytes:
        """The JSON file."""
        return b"".join(encoded(self.input, self.settings, self.frames, self.written))

    def timing(self, frame: FrameRecord) -> ShutterTiming:
        """The shutter of one frame."""
        camera, direction = self.settings.camera, self.settings.direction
        scanlines = camera.rows if direction.by_row else camera.cols
        return ShutterTiming(exposure=frame.timing.exposure_s, row_time=frame.timing.row_time_s, rows=scanlines, direction=direction)


def encoded(source: str, settings: Settings, frames: Iterable[FrameRecord], written: Written | None = None) -> Iterator[bytes]:
    """The JSON file piece by piece: a line for what concerns all frames, and one for each frame."""
    files = "" if written is None else f',"written":{written.model_dump_json(exclude_none=True)}'
    yield f'{{"version":1,"input":{json.dumps(in_unicode(source))},"settings":{settings.model_dump_json()}{files},"frames":['.encode()
    for number, frame in enumerate(frames):
        yield (b",\n" if number else b"\n") + frame.encode()
    yield b"\n" + _END


def written(path: Path) -> Written | None:
    """What a sidecar states of the files beside it; None where it does not, or is not whole."""
    try:
        with opened(path) as file:
            line = file.readline(_LONGEST_LINE)
            file.seek(-len(_END), os.SEEK_END)
            whole = line.endswith(_FRAMES) and file.read() == _END
        return Written.model_validate(json.loads(line.removesuffix(_FRAMES) + b"}").get("written")) if whole else None
    except (OSError, ValueError, RecursionError):
        return None


def read(path: Path, *, most_frames: int | None = None) -> Sidecar:
    """The sidecar in a file, with its first frames or all of them; the first fault is named with its key."""
    lines = _lines(path)
    if not (first := next(lines, b"")):  # it was written by others
        return _whole(path, most_frames)
    head = _understood(_Head, path, first.removesuffix(_FRAMES) + b"}")
    records: list[FrameRecord] = []
    left = MOST_BYTES
    while (line := next(lines, b"")) != _END and len(records) != most_frames:
        left -= len(line)
        if left < 0 or not _INDEX.match(line):
            return _whole(path, most_frames)
        records.append(_understood(FrameRecord, path, line.rstrip(b",\n"), "frames", str(len(records))))
    try:
        return Sidecar(version=head.version, input=head.input, settings=head.settings, written=head.written, frames=records)
    except ValidationError as error:
        raise _refused(path, error) from error


def _whole(path: Path, most_frames: int | None) -> Sidecar:
    """The same of a file in any layout."""
    held = _understood(Sidecar, path, read_whole(path, most=MOST_BYTES))
    return held.model_copy(update={"frames": held.frames[:most_frames]})


def frames(path: Path, wanted: Collection[int]) -> dict[int, FrameRecord]:
    """The frames of these indices, as far as the file holds them; others are not kept."""
    lines = _lines(path)
    found: dict[int, FrameRecord] = {}
    next(lines, b"")
    while (line := next(lines, b"")) != _END:
        if not (begins := _INDEX.match(line)):  # it was written by others
            return {frame.index: frame for frame in read(path).frames if frame.index in wanted}
        if (index := int(begins[1])) in wanted:
            found[index] = _understood(FrameRecord, path, line.rstrip(b",\n"), f"the frame of index {index}")
    return found


def one_by_one(path: Path) -> Iterator[FrameRecord]:
    """All frames in order; none is kept where the file is as `encoded` writes it."""
    lines = _lines(path)
    if not next(lines, b""):
        yield from read(path).frames
    for number, line in enumerate(lines):
        if line != _END:
            yield _understood(FrameRecord, path, line.rstrip(b",\n"), "frames", str(number))


def _lines(path: Path) -> Iterator[bytes]:
    """The lines that `encoded` writes; none where the file was not written by it."""
    with opened(path) as file:
        first = file.readline(_LONGEST_LINE)
        if first.endswith(_FRAMES):
            yield first
            while (line := file.readline(_LONGEST_LINE)).endswith(b"\n"):
                yield line


def _understood(kind: type[_Kind], path: Path, data: bytes, *within: str) -> _Kind:
    """What a piece of JSON holds that stands `within` these keys of the file."""
    if (items := sum(data.count(mark) for mark in (b",", b"[", b"{"))) > MOST_ITEMS:
        raise UnreadableError(f"{path} must hold at most {MOST_ITEMS} values, it holds {items}; is it a sidecar that rsvideo wrote?")
    try:
        return kind.model_validate_json(data)
    except ValidationError as error:
        raise _refused(path, error, *within) from error


def _refused(path: Path, error: ValidationError, *within: str) -> UnreadableError:
    first = error.errors(include_url=False, include_input=False)[0]
    key = ".".join([*within, *map(str, first["loc"])])
    words = str(first["msg"]).removeprefix("Value error, ")
    return UnreadableError(f"{path}: {key + ': ' if key else ''}{words}; is it a sidecar that rsvideo wrote?")
