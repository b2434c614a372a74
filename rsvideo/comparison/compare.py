"""What several methods made of one picture or clip, side by side, measured, and gathered for a report."""

import math
import platform
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from importlib.metadata import version
from pathlib import Path

import av
import cv2
import numpy as np

from rsvideo.comparison import decoded as shots_of
from rsvideo.comparison import key_frames, method_run, residual
from rsvideo.comparison.decoded import Light, Plan, Shot
from rsvideo.comparison.method_run import Attempt
from rsvideo.config import sidecar
from rsvideo.config.files import UnreadableError
from rsvideo.config.media import is_pattern
from rsvideo.config.request import Request
from rsvideo.config.sidecar import FrameRecord, Sidecar
from rsvideo.frame import Verdict
from rsvideo.physics.tone import Transfer
from rsvideo.pipeline import processes
from rsvideo.pipeline.clip_facts import frame_range
from rsvideo.progress import Observer, Progress
from rsvideo.report import metrics
from rsvideo.report.comparison import Comparison, Crop, Entry, Look, Measured, Role
from rsvideo.stills import still
from rsvideo.video import decode
from rsvideo.video.mosaic import Grid, Mosaic

_VIDEO_BYTES = 4_500_000  # of a page, before they become text
_VIDEO_FRAMES = 720


@dataclass(frozen=True, kw_only=True, eq=False)
class _Reel:
    """The pictures of one entry, in order, under the indices of the recording's frames."""

    name: str
    role: Role
    shots: Iterator[tuple[int, Shot]]
    made: Attempt | None = None
    sidecar: Sidecar | None = None

    @cached_property
    def records(self) -> Mapping[int, FrameRecord]:
        """Of frames, by their index."""
        return {} if self.sidecar is None else {record.index: record for record in self.sidecar.frames}


def settled(requests: Sequence[Request], truth: Path | None, crops: Sequence[tuple[int, int, int, int]]) -> list[Request]:
    """The requests, with every question answered before the work; raises ValueError or UnreadableError for what cannot be."""
    first = requests[0]
    if not first.source.exists() and not is_pattern(first.source):
        raise UnreadableError(f"{first.source} does not exist; is its name mistyped?")
    answered = [method_run.settled(request) for request in requests]
    if truth is not None:
        _check_truth(first, truth)
    if crops:
        _check_crops(crops, first)
    return answered


def _check_truth(request: Request, truth: Path) -> None:
    """Refuse a truth that is of another size or length than the input."""
    if not request.is_clip:
        ours, theirs = (_still_shape(path, request.camera.transfer) for path in (request.source, truth))
        if ours != theirs:
            raise ValueError(f"the truth must be of the input's size, {ours}, {truth} is {theirs}")
        return
    rate = request.input.frame_rate
    stream, other = decode.probe(request.source, rate, on_damage=request.input.on_damage), decode.probe(truth, rate)
    if (stream.rows, stream.cols) != (other.rows, other.cols):
        raise ValueError(f"the truth must be of the input's size, {stream.cols} x {stream.rows}, {truth} is {other.cols} x {other.rows}")
    first, last = frame_range(stream, request.input.range)
    if other.frames not in (stream.frames, last - first):
        raise ValueError(f"the truth must have as many frames as the input, {stream.frames}, {truth} has {other.frames}")


def _still_shape(path: Path, transfer: Transfer | None) -> str:
    rows, cols = still.read(path, transfer).pixels.shape[:2]
    return f"{cols} x {rows}"


def _check_crops(crops: Sequence[tuple[int, int, int, int]], request: Request) -> None:
    """Refuse crops that reach beyond the picture as it is shown."""
    plan = shots_of.plan(request)
    for x, y, w, h in crops:
        if min(w, h) < 8 or min(x, y) < 0 or x + w > plan.cols or y + h > plan.rows:
            raise ValueError(
                f"crop must lie within the picture of {plan.cols} x {plan.rows} px and be 8 px or more a side, got {x},{y},{w},{h}"
            )


def compared(
    request: Request,
    attempts: Sequence[Attempt],
    *,
    truth: Path | None,
    crops: Sequence[tuple[int, int, int, int]],
    observe: Observer,
) -> Comparison:
    """Decode what the methods made of the request's source, all at once, and measure it."""
    plan = shots_of.plan(request)
    scale = key_frames.scale(plan.rows, plan.cols)
    reels = _reels(request, attempts, truth, plan)
    count = plan.last - plan.first
    wanted = key_frames.chosen(count, len(reels), plan.rows * plan.cols * scale**2)
    grid = Grid.fitting(len(reels), plan.rows, plan.cols)
    mosaic = None
    if plan.kind == "clip" and count > 1:
        mosaic = Mosaic(grid, plan.rate, most_bytes=_VIDEO_BYTES, frames=min(count, _VIDEO_FRAMES))
    measured: dict[str, list[Measured]] = {reel.name: [] for reel in reels}
    before: dict[str, tuple[int, np.ndarray]] = {}
    shown: list[Look] = []
    key, area, left = 0, np.zeros((0, 0)), float(key_frames.PICTURES_BYTES)
    with ThreadPoolExecutor(processes.cores()) as pool:
        for n, (index, shots) in enumerate(_together(reels, plan)):
            observe(Progress(stage=f"measuring frame {index}", fraction=n / count, frame=index))
            seen = [reel for reel in reels if reel.name in shots]
            lumas = {name: metrics.luma(shot.codes) for name, shot in shots.items()}
            earlier = {name: luma for name, (at, luma) in before.items() if at == index - 1}
            before = {name: (index, luma) for name, luma in lumas.items()}
            found = list(pool.map(partial(_measures, shots=shots, lumas=lumas, earlier=earlier), seen))
            residuals = {}
            for reel, values in zip(seen, found, strict=True):
                if n in wanted and (unexplained := _residual(reel, index, shots, reels[0].name)):
                    values["whiteness"] = metrics.whiteness(*unexplained)
                    residuals[reel.name] = key_frames.drawn(unexplained, scale)
                measured[reel.name].append(_measured(reel, index, plan.times[n], values))
            if mosaic is not None and n < _VIDEO_FRAMES:
                mosaic.write([shots[reel.name].shown if reel.name in shots else None for reel in reels])
            if n in wanted:
                records = {reel.name: reel.records[index] for reel in seen if index in reel.records}
                look = key_frames.look(index, plan.times[n], shots, records, residuals, scale, left / (len(wanted) - len(shown)), pool)
                left -= sum(map(len, (*look.pictures.values(), *residuals.values())))
                difference = key_frames.difference([shots[reel.name].shown for reel in seen if reel.role != "truth"])
                if not shown or difference.sum() > area.sum():
                    key, area = len(shown), difference
                shown.append(look)
    entries = _entries(reels, attempts, measured)
    return Comparison(
        title=request.source.name,
        source=str(request.source),
        kind=plan.kind,
        rows=plan.rows,
        cols=plan.cols,
        rate=float(plan.rate) if plan.kind == "clip" else 0.0,
        entries=entries,
        looks=tuple(shown),
        key=key,
        crops=(*(Crop(x=x, y=y, w=w, h=h, chosen=True) for x, y, w, h in crops), *key_frames.crops(area, plan.rows, plan.cols)),
        timing=_timing(entries),
        truth=None if truth is None else str(truth),
        video=None if mosaic is None else mosaic.close(),
        video_cols=grid.across,
        provenance=_provenance(entries),
        notes=(f"the video shows the first {_VIDEO_FRAMES} frames",) if mosaic is not None and count > _VIDEO_FRAMES else (),
    )


def _measured(reel: _Reel, index: int, time_s: float, values: Mapping[str, float]) -> Measured:
    record = reel.records.get(index)
    verdict = "" if reel.role != "method" else record.verdict if record else Verdict.UNTOUCHED.value
    return Measured(index=index, time_s=time_s, verdict=verdict, seconds=record.seconds if record else 0.0, values=values)


def _entries(reels: Sequence[_Reel], attempts: Sequence[Attempt], measured: Mapping[str, Sequence[Measured]]) -> tuple[Entry, ...]:
    """The recording, the methods in the order they were asked for, and the truth."""
    there = {
        reel.name: Entry(
            name=reel.name,
            role=reel.role,
            frames=tuple(measured[reel.name]),
            seconds=math.nan if reel.made is None else reel.made.seconds,
            peak_bytes=0 if reel.made is None else reel.made.peak_bytes,
            notes=() if reel.made is None else reel.made.notes,
            sidecar=reel.sidecar,
        )
        for reel in reels
    }
    failed = {
        a.method: Entry(name=a.method, role="method", seconds=a.seconds or math.nan, peak_bytes=a.peak_bytes, fault=a.fault, notes=a.notes)
        for a in attempts
        if a.fault is not None
    }
    everyone = {**there, **failed}
    return tuple(everyone[name] for name in dict.fromkeys(["recorded", *(a.method for a in attempts), "truth"]) if name in everyone)


def _reels(request: Request, attempts: Sequence[Attempt], truth: Path | None, plan: Plan) -> list[_Reel]:
    """The recording first, unless the method `none` stands for it; the truth last."""
    reels = []
    for each in attempts:
        if each.fault is None:
            record = sidecar.read(each.record) if each.record.exists() else None
            indices = range(plan.first, plan.last) if record is None else [frame.index for frame in record.frames]
            shots = zip(indices, plan.reel(each.output, False), strict=False)
            reels.append(_Reel(name=each.method, role="method", shots=shots, made=each, sidecar=record))
    reels.sort(key=lambda reel: reel.name != "none")
    part = range(plan.first, plan.last)
    if not reels or reels[0].name != "none":
        reels.insert(0, _Reel(name="recorded", role="recorded", shots=zip(part, plan.reel(request.source, True), strict=False)))
    if truth is not None:
        reels.append(_Reel(name="truth", role="truth", shots=zip(part, plan.reel(truth, True), strict=False)))
    return reels


def _together(reels: Sequence[_Reel], plan: Plan) -> Iterator[tuple[int, dict[str, Shot]]]:
    """The shots of all entries that have one, frame by frame."""
    heads = {reel.name: next(reel.shots, None) for reel in reels}
    for index in range(plan.first, plan.last):
        shots = {}
        for reel in reels:
            while (head := heads[reel.name]) is not None and head[0] < index:
                heads[reel.name] = next(reel.shots, None)
            if head is not None and head[0] == index:
                shots[reel.name] = head[1]
                heads[reel.name] = next(reel.shots, None)
        yield index, shots


def _measures(
    reel: _Reel, *, shots: Mapping[str, Shot], lumas: Mapping[str, np.ndarray], earlier: Mapping[str, np.ndarray]
) -> dict[str, float]:
    """All but the residual's, which is of shown frames only: compiled loops do not run in several threads."""
    mine, recorded = lumas[reel.name], next(iter(lumas.values()))
    values = {"edge_width": metrics.edge_width(mine), "straightness": metrics.straightness(mine)[0]}
    if recorded.shape == mine.shape:
        values["ringing"] = metrics.ringing(mine, recorded)
    if reel.role != "truth" and "truth" in shots and shots["truth"].codes.shape == shots[reel.name].codes.shape:
        pair = metrics.aligned(shots[reel.name].codes, shots["truth"].codes)
        values |= {"psnr": metrics.psnr_of(pair), "ssim": metrics.ssim_of(pair)}
    if reel.name in earlier:
        values["flicker"] = metrics.flicker(earlier[reel.name], mine)
    return values


def _residual(reel: _Reel, index: int, shots: Mapping[str, Shot], recorded: str) -> Light | None:
    """Of a frame that a method restored where it was."""
    record = reel.records.get(index)
    if reel.sidecar is None or record is None or reel.name == recorded or recorded not in shots:
        return None
    if record.verdict != Verdict.RESTORED or reel.name.startswith(("rectify", "vidstab")):  # what was moved is not what the camera saw
        return None
    return residual.of(record, reel.sidecar, shots[recorded].light(), shots[reel.name].light())


def _timing(entries: Sequence[Entry]) -> str:
    for entry in entries:
        if entry.sidecar is not None and entry.name != "none":
            timing = entry.sidecar.timing(entry.sidecar.frames[0])
            source = entry.sidecar.frames[0].timing.source
            return f"exposure {1e3 * timing.exposure:.4g} ms, readout {1e3 * timing.readout:.4g} ms {timing.direction.value} ({source})"
    return ""


def _provenance(entries: Sequence[Entry]) -> dict[str, str]:
    said = next((entry.sidecar for entry in entries if entry.sidecar is not None and entry.name != "none"), None)
    told = {"rsvideo": version("rsvideo"), "Python": platform.python_version(), "system": f"{platform.system()} {platform.machine()}"}
    told |= {"NumPy": np.__version__, "OpenCV": cv2.__version__, "PyAV": av.__version__}
    if said is not None:
        camera = said.settings.camera
        told["camera"] = f"focal length {camera.fx:.0f} px ({camera.source}), {camera.cols} x {camera.rows} px"
        told["settings"] = ", ".join(
            f"{name} {value}" for name, value in said.settings.restoration.items() if not isinstance(value, dict | list)
        )
        if said.settings.input_sha256:
            told["SHA-256 of the input"] = said.settings.input_sha256
    return told
