"""A frame, or a few, restored for a page: at half size first, then at full size, with all that explains the result.

At half size exposure and readout stay, lens and noise are those of the smaller picture, and the result is a draft.
Frames are restored by themselves, along a path that their neighbours show too; in a job, neighbours also lend them detail.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from rsvideo.comparison import residual
from rsvideo.config.request import Camera, Measured, Request
from rsvideo.config.sidecar import Sidecar
from rsvideo.frame import FrameResult
from rsvideo.physics.channels import any_channel
from rsvideo.pipeline import clip_facts, demand, measuring, output, preview
from rsvideo.pipeline.prepare import Task, measurable, prepare
from rsvideo.progress import Observer, Progress, within
from rsvideo.report import charts, metrics
from rsvideo.stills.still import Still
from rsvideo.view import drawing, glance
from rsvideo.view.glance import Facts

Size = Literal["half", "full"]

MOST_FRAMES = 12  # of a range that is tried
HALVED = 1000  # px of the longer side, from which on a half-size preview comes first


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What a page wants to see."""

    request: Request
    first: int  # frame
    last: int

    @property
    def measured_key(self) -> object:
        """Of what is measured in the clip, whatever exposure is typed in."""
        source = self.request.source
        return source, source.stat().st_mtime_ns, repr(_unexposed(self.request.camera)), repr(self.request.input)


def _unexposed(camera: Camera) -> Camera:
    """What is stated of a camera but for its exposure."""
    return camera.model_copy(update={"exposure": None, "shutter_angle": None})


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
    if wanted.is_clip:
        measured = measured or _measured(wanted, observe)
        wanted = wanted.replaced(measured=_as_typed(wanted, measured))
    task = preview.alone(prepare(wanted))
    demand.check(task)
    sizes: tuple[Size, ...] = ("half", "full")
    if max(task.rows, task.cols) < HALVED or wanted.motion.trajectory is not None:
        sizes = ("full",)
    for size in sizes:
        part = within(observe, 0.0, 1.0, f"{size} size: ")
        shown = preview.halved(task) if size == "half" else task
        results = list(preview.restored(shown, task, trial.first, trial.last, part))
        tried = _explained(shown, results, size, turns=task.stream.rotation // 90 if wanted.is_clip else 0)
        facts = tried.facts | {"notes": list(task.notes), "seconds": time.monotonic() - begun}
        yield replace(tried, facts=facts, measured=measured)


def _measured(wanted: Request, observe: Observer) -> Measured:
    """What the clip's frames show of what nobody states; nothing where all is stated."""
    given = wanted.camera
    take = clip_facts.opened(wanted)
    if not measurable(wanted) or not measuring.unstated(given, take.shutter):
        return Measured()
    assert not isinstance(take.source, Still)
    observe(Progress(stage="measuring the clip's exposure and readout", fraction=0.0))
    first, last = clip_facts.frame_range(take.source, wanted.input.range)
    return measuring.of_take(take, _unexposed(given), first, last, wanted.input.on_damage) or Measured()


def _as_typed(wanted: Request, measured: Measured) -> Measured:
    """The same without an exposure where one is typed in: a trial shows what that does, and the job checks it."""
    typed = wanted.camera.exposure is not None or wanted.camera.shutter_angle is not None
    return measured.model_copy(update={"exposure": None, "most": None}) if typed else measured


def _explained(task: Task, results: Sequence[FrameResult], size: Size, *, turns: int) -> Tried:
    """The pictures and facts of results."""
    transfer = preview.transfer(task)
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
        light = metrics.luma(result.frame.pixels), ~any_channel(result.frame.clipped)
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
