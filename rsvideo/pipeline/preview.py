"""A frame, or a few, restored by themselves: at half size as a draft, or at full size.

At half size exposure and readout stay, lens and noise are those of the smaller picture. Frames are restored along a path that their
neighbours show too; neighbours lend them no detail.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from rsvideo import threads
from rsvideo.config import sidecar
from rsvideo.config.files import write_whole
from rsvideo.config.method import Method
from rsvideo.frame import Frame, FrameResult
from rsvideo.physics import tone
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.tone import Tone, Transfer
from rsvideo.pipeline import clip_frames, given_movement, methods
from rsvideo.pipeline.pieces import Outcome
from rsvideo.pipeline.prepare import Task
from rsvideo.progress import Observer, Progress
from rsvideo.restoration import clip_motion
from rsvideo.restoration.movement import Movement
from rsvideo.shooting import given_motion
from rsvideo.stills.codes import Codes
from rsvideo.stills.still import Format
from rsvideo.video import colour

HALVED = 400  # px of the shorter side, from which on a preview is of half the size
AROUND, FEWER_AROUND = 2, 1  # frames before and behind, that the motion is found with; at half size
MORE_AROUND = 3  # where they are to show their exposure, too: five frames are off by 0.35 in its logarithm, seven by 0.25
_NOISE = 0.5  # of a pixel that is the mean of four
_MOST_KEPT = 2  # sets of decoded frames: of half and of full size
_KEPT: dict[object, list[Frame]] = {}
_AS_STORED = (Transfer.SRGB, Transfer.BT709, Transfer.GAMMA22, Transfer.GAMMA28)  # curves near enough to a screen's own


def carry_out(task: Task, observe: Observer) -> Outcome:
    """Restore the photograph, or the middle frame of the clip's range, and write it as a picture of 8 bits."""
    begun, request = time.monotonic(), task.request
    small = min(task.rows, task.cols) < HALVED or request.motion.trajectory is not None
    shown = draft(task) if small else halved(task)
    middle = (task.first + task.last) // 2
    (result,) = restored(shown, task, middle, middle, observe)
    turns = task.stream.rotation // 90 if request.is_clip else 0
    codes = np.ascontiguousarray(np.rot90(on_screen(result.latent, transfer(task)), turns))
    write_whole({request.output: Format.of_output(request.output).module.encode(Codes(samples=codes))})
    which = f"frame {result.frame.index} " if request.is_clip else ""
    notes = (*task.notes, *_assumed(task, result), f"{which}as a draft of {codes.shape[1]} x {codes.shape[0]} px")
    return Outcome(notes=notes, seconds=time.monotonic() - begun, verdict=result.verdict)


def _assumed(task: Task, result: FrameResult) -> tuple[str, ...]:
    """Which timing a preview has that nobody states, and that it has no time to measure."""
    shutter, shown = task.shutter, result.timing
    exposure = "is assumed" if shown.exposure == shutter.timing.exposure else "is what its blur shows"
    words = (f"exposure {1e3 * shown.exposure:.3g} ms {exposure}",) if shutter.exposure.assumed else ()
    words += (f"readout {1e3 * shown.readout:.3g} ms is assumed",) if shutter.readout.assumed else ()
    return (f"{', '.join(words)}: a preview is not measured as a job is, by forty frames",) if words else ()


def alone(task: Task) -> Task:
    """The same task, but that a clip's frames get no help from their neighbours."""
    return replace(task, settings=replace(task.settings, frames="alone")) if task.settings.frames == "together" else task


def draft(task: Task) -> Task:
    """The same task with little work for a frame."""
    alike = alone(task)
    return replace(alike, settings=replace(alike.settings, prior="denoiser", quality="draft"))


def transfer(task: Task) -> Tone:
    """How the source's codes stand for light."""
    return task.stream.colour.transfer if task.request.is_clip else task.still.transfer


def on_screen(light: Float[np.ndarray, "rows cols channels"], stored: Tone | None) -> UInt8[np.ndarray, "rows cols channels"]:
    """Codes that a screen shows, by the source's own curve where a screen's is near to it."""
    curve = stored if isinstance(stored, Transfer) and stored in _AS_STORED else Transfer.SRGB
    codes = tone.encode(curve, np.clip(light, 0, 1).astype(np.float32))
    return np.clip(np.rint(255 * codes), 0, 255).astype(np.uint8)


def restored(shown: Task, task: Task, first: int, last: int, observe: Observer) -> Iterator[FrameResult]:
    """The photograph, or a clip's frames `first` to `last`, as `shown`: the task itself, or the same at half size."""
    if task.request.is_clip:
        yield from _clip(shown, task, first, last, observe)
    else:
        yield _photograph(shown, task, observe)


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
    return draft(replace(task, camera=camera, shutter=replace(task.shutter, timing=shutter)))


def _resized(frame: Frame, task: Task) -> Frame:
    if frame.pixels.shape[:2] == (task.rows, task.cols):
        return frame
    even = frame.pixels[: 2 * task.rows, : 2 * task.cols]
    pixels = cv2.resize(even, (task.cols, task.rows), interpolation=cv2.INTER_AREA).reshape(task.rows, task.cols, -1)
    clipped = frame.clipped[: 2 * task.rows, : 2 * task.cols]
    full = clipped[::2, ::2] | clipped[1::2, ::2] | clipped[::2, 1::2] | clipped[1::2, 1::2]
    return replace(frame, pixels=np.ascontiguousarray(pixels, np.float32), clipped=np.ascontiguousarray(full))


def _photograph(shown: Task, task: Task, observe: Observer) -> FrameResult:
    given, trajectory = task.request.motion.trajectory, None
    if given is not None:
        trajectory = given_motion.read(given, task.treatment.camera)
    frame = _resized(Frame(pixels=task.still.pixels, clipped=task.still.clipped), shown)
    return methods.photograph(shown.treatment, frame, trajectory, observe)


def _clip(shown: Task, task: Task, first: int, last: int, observe: Observer) -> Iterator[FrameResult]:
    around = AROUND if shown is task else FEWER_AROUND
    if task.shutter.exposure.assumed:
        around = MORE_AROUND
    frames = _decoded(shown, task, max(task.first, first - around), min(task.last, last + 1 + around))
    mine = [k for k, frame in enumerate(frames) if first <= frame.index <= last]
    if not mine:
        raise ValueError(f"frame {first} is not among those that are restored, {task.first} to {task.last - 1}; choose another")
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
    run = methods.run_of(treatment, frames, observe)
    observe(Progress(stage="blur", fraction=0.2))
    return clip_motion.movement(run, np.isin(np.arange(len(run.begins)), run.pictures[mine])).of_pictures(run.pictures)


def _decoded(shown: Task, task: Task, first: int, last: int) -> list[Frame]:
    """Frames in linear light at the size that is tried; those of the latest trial are kept, since another setting may be next."""
    stamp = task.request.source.stat().st_mtime_ns if task.request.source.is_file() else 0
    key = (task.request.source, stamp, repr(task.stream.colour), task.request.input, first, last, shown.rows, shown.cols)
    if key not in _KEPT:
        loaded = threads.begun(lambda: colour.load(task.stream.colour))  # while pictures are decoded
        pictures = list(clip_frames.pictures(task, first, last))
        loaded.result()
        held = threads.each(lambda picture: _resized(clip_frames.frame(task.stream.colour, picture), shown), pictures)
        while len(_KEPT) >= _MOST_KEPT:
            del _KEPT[next(iter(_KEPT))]
        _KEPT[key] = held
    return _KEPT[key]
