"""A case from a clip: the frames of a sharp one filmed anew by a rolling-shutter camera, with their truth, as a folder."""

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np

from rsvideo.config import memory, placing
from rsvideo.config.quantity import frame_rate
from rsvideo.config.request import Camera
from rsvideo.config.simulation import Simulation
from rsvideo.physics.filming import Pace, filmed
from rsvideo.physics.noise import USUAL_NOISE, Noise
from rsvideo.physics.scene_between import SMALLEST, Light
from rsvideo.pipeline import clip_frames
from rsvideo.pipeline.simulated_case import shutter_facts
from rsvideo.progress import Observer, Progress, ignore
from rsvideo.shooting import timing
from rsvideo.shooting.timing import Sources
from rsvideo.video import colour, cuts, decode
from rsvideo.video.output_format import Encoding
from rsvideo.video.stream import Picture, Stream
from rsvideo.video.writer import Writer

CLIP, TRUTH, FACTS = "clip.mp4", "truth.mp4", "case.json"
_TRUTH_CRF = 4.0  # constant rate factor: finer than the clip's own, which is a camera's
_ASTRAY = 0.25  # of a frame's points, from which on its interpolation is poor; at full trust it is what motion covers
_BYTES_A_PIXEL, _BYTES_A_SOURCE_PIXEL = 700, 100  # of a frame that is made, with two encoders' lookahead; and of one that is decoded


@dataclass(frozen=True, kw_only=True)
class Filming:
    """How a sharp clip is filmed anew. Everything that is not stated is the source's own."""

    source: Path
    camera: Camera  # exposure, readout or row_time, and direction
    last_exposure: float | None = None  # s, of the last frame; those between change evenly in its logarithm. None: as the first
    speed: float = 1.0  # source frames a frame
    rate: Fraction | None = None  # frames a second
    first: int = 0  # of the source's frames
    frames: int | None = None  # that are made; None: as many as the source has, up to a cut
    largest_side: int | None = None  # px, to which a larger source is averaged down
    noise: float = USUAL_NOISE  # standard deviation at half of white, in linear light
    seed: int = 0

    @staticmethod
    def of(source: Path, simulation: Simulation) -> "Filming":
        """What a request states."""
        film, grain = simulation.film, simulation.grain
        return Filming(
            source=source,
            camera=simulation.camera,
            last_exposure=film.last_exposure,
            speed=film.speed,
            rate=None if film.rate is None else frame_rate(film.rate),
            first=film.first,
            frames=film.frames,
            largest_side=film.largest_side,
            noise=USUAL_NOISE if grain.noise is None else grain.noise,
            seed=grain.seed,
        )

    def __post_init__(self) -> None:
        if self.frames is not None and self.frames < 1:
            raise ValueError(f"frames must be at least 1, got {self.frames}")
        if self.first < 0:
            raise ValueError(f"first must be at least 0, the source's first frame, got {self.first}")
        if self.largest_side is not None and self.largest_side < SMALLEST:
            raise ValueError(f"largest-side must be at least {SMALLEST} px, got {self.largest_side}")
        if self.camera.exposure is None:
            raise ValueError("exposure must be given to simulate; --exposure 1/50 is a time")
        if self.camera.readout is None and self.camera.row_time is None:
            raise ValueError("the shutter needs either --readout or --row-time, got neither")


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """What was made."""

    frames: int
    rows: int
    cols: int
    blur: float  # px, of the middle one of all frames
    notes: tuple[str, ...]  # what the user should know


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """A filming with all questions answered."""

    filming: Filming
    output: Path  # the folder
    source: Stream
    target: Stream  # what is written
    scale: tuple[int, int]  # rows and columns of the source's frames once they are averaged down
    pace: Pace
    noise: Noise
    last: int  # of the source's frames, the one that is not needed any more
    notes: tuple[str, ...]


def prepare(filming: Filming, output: Path, *, overwrite: bool = False) -> Plan:
    """Answer every question before the work.

    Raises UnreadableError for a source that is no clip, ValueError for a filming that cannot be meant or that the source is too short
    for, FileExistsError where the folder `output` holds files of these names.
    """
    _check(output, filming.source, overwrite=overwrite)
    source = decode.probe(filming.source, filming.rate)
    scale = _scaled(source.rows, source.cols, filming.largest_side)
    rows, cols = (side // 2 * 2 for side in scale)  # H.264 with 4:2:0 has no odd ones
    if min(rows, cols) < SMALLEST:
        raise ValueError(f"the clip must be at least {SMALLEST} px wide and high, it would be {cols} x {rows}; raise --largest-side")
    needed = _BYTES_A_PIXEL * rows * cols + _BYTES_A_SOURCE_PIXEL * source.rows * source.cols
    memory.check(filming.source, f"its pictures are {source.cols} x {source.rows}", needed)
    rate = filming.rate or source.rate
    shutter = timing.resolve(filming.camera, Sources(rows=rows, cols=cols, fps=float(rate))).timing
    pace = Pace(timing=shutter, period=float(1 / rate), speed=filming.speed)
    noise = Noise.at_half(filming.noise)
    frames, notes = _frames(filming, source, pace)
    pace = _with_automatic_exposure(pace, filming.last_exposure, frames)
    target = _target(source, rows, cols, rate, frames)
    last = filming.first + pace.needed(frames)
    return Plan(filming=filming, output=output, source=source, target=target, scale=scale, pace=pace, noise=noise, last=last, notes=notes)


def carry_out(plan: Plan, observe: Observer = ignore) -> Simulated:
    """Make the folder with the clip, its truth and its facts; it appears whole or not at all."""
    with placing.aside(plan.output.parent) as own:
        folder = own / plan.output.name
        folder.mkdir()
        blur, astray, notes = _made(plan, folder, observe)
        (folder / FACTS).write_text(json.dumps(_facts(plan, blur), indent=1) + "\n", encoding="utf-8")
        placing.place([placing.Made(at=folder, path=plan.output)])
    if poor := int((astray > _ASTRAY).sum()):
        notes += (
            f"the scene between the source's frames is poor in {poor} of {len(blur)} frames: up to {astray.max():.0%} of their points are"
            " not found again; does the source move too fast, or is it blurred or dark?",
        )
    target = plan.target
    return Simulated(frames=target.frames, rows=target.rows, cols=target.cols, blur=float(np.median(blur)), notes=notes)


def _check(output: Path, source: Path, *, overwrite: bool) -> None:
    if not output.parent.is_dir():
        raise ValueError(f"the folder {output.parent} must exist; make it first, or is its name mistyped?")
    if output.exists() and not output.is_dir():
        raise ValueError(f"{output} must be the name of a folder, it is a file")
    placing.check([output / name for name in (CLIP, TRUTH, FACTS)], [source], overwrite=overwrite)


def _target(source: Stream, rows: int, cols: int, rate: Fraction, frames: int) -> Stream:
    """What is written: the source's colour, the shape of its pixels and how it is turned, and nothing else of it."""
    return replace(
        source,
        codec="h264",
        rows=rows,
        cols=cols,
        rate=rate,
        time_base=1 / rate,
        times=np.arange(frames),
        end=frames,
        keys=np.zeros(0, np.int64),
        tracks=(),
        metadata={},
        tags={},
        timecode=None,
        created=None,
        files=(source.path,),  # pictures that no container holds: there is nothing beside them to be carried over
    )


def _frames(filming: Filming, source: Stream, pace: Pace) -> tuple[int, tuple[str, ...]]:
    """How many frames are made, and what to know of that."""
    if filming.first >= source.frames:
        raise ValueError(f"first must be one of the source's frames 0 to {source.frames - 1}, got {filming.first}")
    there = source.frames - filming.first
    wanted = there if filming.frames is None else min(there, pace.needed(filming.frames))
    shown = decode.pictures(source, filming.first, filming.first + wanted)
    cut = next(iter(cuts.cuts(shown, source.colour)), None)
    end = f"the source ends after its frame {source.frames - 1}"
    if cut is not None:
        there, end = cut - filming.first, f"the source cuts to another scene at its frame {cut}"
    most = pace.frames(there)
    if most < (least := filming.frames or 1):
        raise ValueError(
            f"{least} frame{'s' if least > 1 else ''} at a speed of {filming.speed:g} must have {pace.needed(least)} of the source's, from"
            f" {filming.first} on there are {there}: {end}; "
            + (f"--first {cut} begins behind it" if cut is not None else "a lower --speed needs fewer")
        )
    notes = (end,) if cut is not None and filming.frames is None else ()
    if source.variable:
        notes += ("the source's frames do not follow each other evenly, and are filmed as if they did",)
    return filming.frames or most, notes


def _with_automatic_exposure(pace: Pace, last: float | None, frames: int) -> Pace:
    """The pace at whose last frame the exposure has come to `last` seconds."""
    if last is None or frames < 2:
        return pace
    if not 0 < last <= pace.period:
        raise ValueError(f"last-exposure must lie in (0, {1e3 * pace.period:.4g}] ms, a frame's period, got {1e3 * last:.4g} ms")
    return replace(pace, growth=(last / pace.timing.exposure) ** (1 / (frames - 1)))


def _scaled(rows: int, cols: int, largest: int | None) -> tuple[int, int]:
    factor = min(1.0, largest / max(rows, cols)) if largest else 1.0
    return max(1, round(factor * rows)), max(1, round(factor * cols))


def _sharp(plan: Plan) -> Iterator[Light]:
    """The source's frames as they are filmed, one after the other."""
    rows, cols = plan.scale
    for frame in clip_frames.decoded(plan.source, plan.filming.first, plan.last):
        pixels = frame.pixels
        if pixels.shape[:2] != plan.scale:
            pixels = cv2.resize(pixels, (cols, rows), interpolation=cv2.INTER_AREA).reshape(rows, cols, -1)
        yield np.ascontiguousarray(pixels[: plan.target.rows, : plan.target.cols])


def _made(plan: Plan, folder: Path, observe: Observer) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Write the clip and its truth; of each frame the blur in px and the share of points astray, and what could not be kept."""
    count, rng = plan.target.frames, np.random.default_rng([plan.filming.seed, 1])  # a photograph's noise has the same stream
    film = filmed(_sharp(plan), plan.pace, frames=count, noise=plan.noise, rng=rng)
    clip = Writer(folder / CLIP, plan.target, Encoding(codec="h264"))
    truth = Writer(folder / TRUTH, plan.target, Encoding(codec="h264", crf=_TRUTH_CRF))
    blur, astray = np.zeros(count), np.zeros(count)
    with clip, truth:
        for k, shot in enumerate(film):
            picture = Picture(planes=(), index=k, pts=k, duration=1, time=k * plan.pace.period)
            clip.write(colour.encoded(shot.blurred, picture, clip.colour))
            truth.write(colour.encoded(shot.truth, picture, truth.colour))
            blur[k], astray[k] = shot.blur, shot.astray
            observe(Progress(stage="filming", fraction=(k + 1) / count))
    return blur, astray, clip.notes


def _facts(plan: Plan, blur: np.ndarray) -> dict[str, object]:
    target, filming = plan.target, plan.filming
    return {
        "kind": "clip",
        "source": filming.source.name,
        **shutter_facts(plan.pace.timing),
        **({"exposures_s": [plan.pace.shutter(k).exposure for k in range(target.frames)]} if plan.pace.growth != 1 else {}),
        "rows": target.rows,
        "cols": target.cols,
        "fps": float(target.rate),
        "frames": target.frames,
        "focal_px": None,
        "transfer": target.colour.transfer.value,
        "blur_extent_px": round(float(np.median(blur)), 3),
        "blur_px": [round(float(each), 3) for each in blur],
        "noise_sigma_linear": filming.noise,
        "first": filming.first,
        "speed": filming.speed,
        "seed": filming.seed,
        "rsvideo": version("rsvideo"),
    }
