"""A frame, or a few, restored for a page: at half size first, then at full size, with all that explains the result.

At half size exposure and readout stay, lens and noise are those of the smaller picture, and the result is a draft.
Frames are restored by themselves, along a path that their neighbours show too; in a job, neighbours also lend them detail.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np

from rsvideo.comparison import residual
from rsvideo.config import sidecar
from rsvideo.config.method import Method
from rsvideo.config.request import Measured, Request
from rsvideo.config.sidecar import Sidecar
from rsvideo.frame import Frame, FrameResult
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.pipeline import clip_facts, clip_frames, demand, given_movement, measuring, methods, output
from rsvideo.pipeline.prepare import Task, prepare
from rsvideo.progress import Observer, Progress, within
from rsvideo.report import charts, metrics
from rsvideo.restoration import clip_motion
from rsvideo.restoration.movement import Movement
from rsvideo.shooting import given_motion, timing
from rsvideo.stills.still import Still
from rsvideo.view import drawing, glance
from rsvideo.view.glance import Facts

Size = Literal["half", "full"]

MOST_FRAMES = 12  # of a range that is tried
AROUND, FEWER_AROUND = 2, 1  # frames before and behind, that the motion is found with; at half size
HALVED = 1000  # px of the longer side, from which on a half-size preview comes first
_FEW_STEPS = 2  # of the refinement by blur, at half size
_NOISE = 0.5  # of a pixel that is the mean of four
_MOST_KEPT = 2  # sets of decoded frames: of half and of full size
_KEPT: dict[object, list[Frame]] = {}


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What a page wants to see."""

    request: Request
    first: int  # frame
    last: int

    @property
    def measured_key(self) -> object:
        """Of what is measured in the clip, whatever exposure is typed in."""
        camera = self.request.camera.model_copy(update={"exposure": None, "shutter_angle": None})
        source = self.request.source
        return source, source.stat().st_mtime_ns, repr(camera), repr(self.request.input)


@dataclass(frozen=True, kw_only=True)
class Measuring:
    """What a clip's own frames show of its shutter is wanted."""

    facts: Facts


@dataclass(frozen=True, kw_only=True, eq=False)
class Tried:
    """What became of the frames at one size."""

    size: Size
    facts: dict[str, Any]  # plain values for the page
    pictures: dict[str, tuple[str, bytes]]  # media type and file, by names such as `12-after`
    measured: Measured | None = None  # what the clip's frames showed, to be handed in with the next trial


def carry_out(order: Trial | Measuring, observe: Observer) -> Iterator[Tried]:
    """Yield what became of the frames, the quick size first; raises ValueError and UnreadableError."""
    if isinstance(order, Measuring):
        observe(Progress(stage="measuring", fraction=0.0))
        (facts,) = glance.carry_out(order.facts, observe)
        yield Tried(size="full", facts=facts, pictures={})
        return
    yield from _tried(order, observe)


def _tried(trial: Trial, observe: Observer) -> Iterator[Tried]:
    begun = time.monotonic()
    observe(Progress(stage="opening", fraction=0.0))
    wanted, measured = trial.request, trial.request.measured
    if wanted.deblur.frames == "together":
        wanted = wanted.replaced(deblur={"frames": "alone"})
    if wanted.is_clip:
        measured = measured or _measured(wanted, observe)
        wanted = wanted.replaced(measured=_as_typed(wanted, measured))
    task = prepare(wanted)
    demand.check(task)
    sizes: tuple[Size, ...] = ("half", "full")
    if max(task.rows, task.cols) < HALVED or wanted.motion.trajectory is not None:
        sizes = ("full",)
    for size in sizes:
        part = within(observe, 0.0, 1.0, f"{size} size: ")
        shown = halved(task) if size == "half" else task
        results = list(_clip(shown, task, trial, part) if wanted.is_clip else _photograph(shown, task, part))
        tried = _explained(shown, results, size, turns=task.stream.rotation // 90 if wanted.is_clip else 0)
        facts = tried.facts | {"notes": list(task.notes), "seconds": time.monotonic() - begun}
        yield replace(tried, facts=facts, measured=measured)


def _measured(wanted: Request, observe: Observer) -> Measured:
    """What the clip's frames show of what nobody states; nothing where all is stated."""
    given = wanted.camera
    take = clip_facts.opened(wanted)
    stated = given.exposure is not None or given.shutter_angle is not None or timing.exposure_of(given, take.shutter)[0] is not None
    if wanted.deblur.method is not Method.RSVIDEO or (stated and not measuring.readout_unknown(given, take.shutter)):
        return Measured()
    assert not isinstance(take.source, Still)
    observe(Progress(stage="measuring the clip's exposure and readout", fraction=0.0))
    first, last = clip_facts.frame_range(take.source, wanted.input.range)
    return measuring.of_take(take, given, first, last, wanted.input.on_damage) or Measured()


def _as_typed(wanted: Request, measured: Measured) -> Measured:
    """The same without an exposure where one is typed in: a trial shows what that does, and the job checks it."""
    typed = wanted.camera.exposure is not None or wanted.camera.shutter_angle is not None
    return measured.model_copy(update={"exposure": None}) if typed else measured


def halved(task: Task) -> Task:
    """The same task for pictures of half the size, restored as a draft: the full size shows what the chosen prior does."""
    rows, cols = task.rows // 2, task.cols // 2
    noise = task.camera.sensor_noise
    if noise is not None:
        noise = Noise(read=_NOISE * noise.read, shot=_NOISE**2 * noise.shot)
    full = task.timing
    shutter = ShutterTiming.from_readout(
        exposure=full.exposure, readout=full.readout, rows=rows if full.direction.by_row else cols, direction=full.direction
    )
    camera = sidecar.Camera.of(task.camera.intrinsics.scaled(rows, cols), task.camera.source, noise)
    settings = replace(task.settings, prior="draft")
    return replace(task, camera=camera, shutter=replace(task.shutter, timing=shutter), settings=settings)


def _resized(frame: Frame, task: Task) -> Frame:
    if frame.pixels.shape[:2] == (task.rows, task.cols):
        return frame
    even = frame.pixels[: 2 * task.rows, : 2 * task.cols]
    pixels = cv2.resize(even, (task.cols, task.rows), interpolation=cv2.INTER_AREA).reshape(task.rows, task.cols, -1)
    clipped = frame.clipped[: 2 * task.rows, : 2 * task.cols]
    full = clipped[::2, ::2] | clipped[1::2, ::2] | clipped[::2, 1::2] | clipped[1::2, 1::2]
    return replace(frame, pixels=np.ascontiguousarray(pixels, np.float32), clipped=np.ascontiguousarray(full))


def _photograph(shown: Task, task: Task, observe: Observer) -> Iterator[FrameResult]:
    given, trajectory = task.request.motion.trajectory, None
    if given is not None:
        trajectory = given_motion.read(given, task.timing, task.camera.intrinsics)
    frame = _resized(Frame(pixels=task.still.pixels, clipped=task.still.clipped), shown)
    yield methods.photograph(shown.treatment, frame, trajectory, observe)


def _clip(shown: Task, task: Task, trial: Trial, observe: Observer) -> Iterator[FrameResult]:
    around = AROUND if shown is task else FEWER_AROUND
    first, last = max(task.first, trial.first - around), min(task.last, trial.last + 1 + around)
    frames = _decoded(shown, task, first, last)
    mine = [k for k, frame in enumerate(frames) if trial.first <= frame.index <= trial.last]
    if not mine:
        raise ValueError(f"frame {trial.first} is not among those that are restored, {task.first} to {task.last - 1}; choose another")
    observe(Progress(stage="motion", fraction=0.1))
    moving = _movement(shown, task, frames, mine, observe).part(mine[0], mine[-1] + 1)
    yield from methods.run(shown.treatment, [frames[k] for k in mine], moving, observe)


def _movement(shown: Task, task: Task, frames: Sequence[Frame], mine: Sequence[int], observe: Observer) -> Movement:
    """How the camera moved; where blur refines the path, that of the wanted frames does, and not that of those around them."""
    treatment, given = shown.treatment, task.request.motion.trajectory
    if given is not None:
        times = [(frame.index, frame.time) for frame in frames]
        return given_movement.of_pictures(given, treatment.camera, times)
    if treatment.method is not Method.RSVIDEO or treatment.settings.frames == "cold":
        return methods.movement(treatment, frames, np.array([frame.time for frame in frames]), observe)
    run = clip_motion.gather(frames, treatment.camera, treatment.settings, observe)
    if not run.followed.any():
        return Movement.unfollowed(len(run.begins), run.axes)
    wanted = run.followed & np.isin(np.arange(len(frames)), mine)
    tracked = clip_motion.path_from_tracks(run)
    observe(Progress(stage="blur", fraction=0.2))
    steps = clip_motion.STEPS if shown is task else _FEW_STEPS
    path = clip_motion.refined_by_blur(run, tracked, wanted, steps=steps)
    evidence = clip_motion.evidence(run, path, share=clip_motion.share(run, tracked))
    return replace(clip_motion.movement_of(run, path.spline, run.followed), evidence=evidence)


def _decoded(shown: Task, task: Task, first: int, last: int) -> list[Frame]:
    """Frames in linear light at the size that is tried; those of the latest trial are kept, since another setting may be next."""
    stamp = task.request.source.stat().st_mtime_ns if task.request.source.is_file() else 0
    key = (task.request.source, stamp, repr(task.stream.colour), task.request.input, first, last, shown.rows, shown.cols)
    if key not in _KEPT:
        pictures = clip_frames.pictures(task, first, last)
        held = [_resized(clip_frames.frame(task.stream.colour, picture), shown) for picture in pictures]
        while len(_KEPT) >= _MOST_KEPT:
            del _KEPT[next(iter(_KEPT))]
        _KEPT[key] = held
    return _KEPT[key]


def _explained(task: Task, results: Sequence[FrameResult], size: Size, *, turns: int) -> Tried:
    """The pictures and facts of results."""
    transfer = task.still.transfer if not task.request.is_clip else task.stream.colour.transfer
    frames, pictures = [], dict[str, tuple[str, bytes]]()
    settings = output.settings_record(task, str(getattr(transfer, "value", "its own")))
    for result in results:
        record = output.frame_record(result)
        held = Sidecar(input=task.request.source.name, settings=settings, frames=[record])
        index = result.frame.index
        pictures[f"{index}-before"] = drawing.shown(result.frame.pixels, transfer, turns)
        pictures[f"{index}-after"] = drawing.shown(result.latent, transfer, turns)
        moved = bool(np.any(record.trajectory.poses()))
        facts: dict[str, Any] = {"index": index, "time": record.time_s, "verdict": record.verdict, "seconds": record.seconds}
        if moved:
            overlay, facts["magnified"] = drawing.motion(held, record, turns)
            pictures[f"{index}-motion"] = overlay
            facts["blur_px"] = drawing.blur_length(held, record)
            pictures[f"{index}-path"] = drawing.styled(charts.trajectory(held, record))
        light = metrics.luma(result.frame.pixels), np.asarray(~result.frame.clipped.any(axis=2))
        left = residual.of(record, held, light, (metrics.luma(result.latent), light[1])) if moved else None
        if left is not None:
            pictures[f"{index}-residual"], facts["unexplained"] = drawing.heat(left, turns)
        frames.append(facts)
    shutter = task.shutter
    return Tried(
        size=size,
        facts={
            "size": size,
            "rows": task.cols if turns % 2 else task.rows,
            "cols": task.rows if turns % 2 else task.cols,
            "exposure_s": shutter.timing.exposure,
            "exposure_source": shutter.exposure.source,
            "readout_s": shutter.timing.readout,
            "readout_source": shutter.readout.source,
            "frames": frames,
        },
        pictures=pictures,
    )


def somewhere(folder: Path, source: Path, *, is_clip: bool) -> Path:
    """A name that a request may write to, though nothing is written: in a folder of our own."""
    return folder / ("preview" + (source.suffix if is_clip and source.suffix else ".mkv" if is_clip else ".png"))
