"""What several methods made of one picture or clip, decoded side by side, measured, and gathered for a report."""

import math
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, partial
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import av
import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

from rsvideo.config import sidecar
from rsvideo.config.files import UnreadableError
from rsvideo.config.sidecar import FrameRecord, Sidecar
from rsvideo.frame import Verdict
from rsvideo.physics import tone
from rsvideo.physics.blur import BlurOperator
from rsvideo.physics.tone import Transfer
from rsvideo.physics.trajectory import Spline, centred, fit
from rsvideo.pipeline import attempt, clip_job, process
from rsvideo.pipeline.attempt import Attempt
from rsvideo.pipeline.clip_job import ClipJob
from rsvideo.pipeline.job import Job
from rsvideo.report import metrics
from rsvideo.report.comparison import Comparison, Crop, Entry, Look, Measured, Role
from rsvideo.video import colour, decode, still
from rsvideo.video.clip import Matrix, Stream
from rsvideo.video.mosaic import Grid, Mosaic

MOST_LOOKS = 48  # frames that are shown
MOST_SIDE = 1920  # px of a picture on the page
_PICTURES_BYTES, _VIDEO_BYTES = 15_000_000, 4_500_000  # of a page, before they become text
_BYTES_A_PIXEL = 0.15  # of WebP, roughly
_QUALITY, _WORST_QUALITY = 88, 50
_VIDEO_FRAMES = 720
_GAIN = 8  # by which residuals are magnified
_TERMS = 20  # of the spline that stands for a sampled trajectory
_THUMB = 160  # px
_PLAIN = (Transfer.SRGB, Transfer.BT709, Transfer.GAMMA22, Transfer.GAMMA28)  # may be shown as they are

Light = tuple[Float32[np.ndarray, "rows cols"], Bool[np.ndarray, "rows cols"]]  # luminance, and where it is valid


@dataclass(frozen=True, kw_only=True, eq=False)
class Shot:
    """One picture of an entry: codes in [0, 1] to be measured, and what is shown of it."""

    codes: Float32[np.ndarray, "rows cols 3"]
    shown: UInt8[np.ndarray, "r c 3"]  # as people see it: turned upright, in a screen's curve
    light: Callable[[], Light]


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


@dataclass(frozen=True, kw_only=True, eq=False)
class _Plan:
    """What both kinds of input have in common."""

    kind: Literal["still", "clip"]
    rows: int  # as shown
    cols: int
    rate: Fraction
    first: int
    last: int
    times: Sequence[float]
    reel: Callable[[Path, bool], Iterator[Shot]]  # of a file; whether it is a whole clip, not only the part

    @property
    def scale(self) -> float:
        """Of the pictures on the page."""
        return min(1.0, MOST_SIDE / max(self.rows, self.cols))


def settled(jobs: Sequence[Job | ClipJob], truth: Path | None, crops: Sequence[tuple[int, int, int, int]]) -> None:
    """Answer every question before the work; raises ValueError or UnreadableError for what cannot be."""
    first = jobs[0]
    if not first.source.exists() and not any(mark in first.source.name for mark in "#%*"):
        raise UnreadableError(f"{first.source} does not exist; is its name mistyped?")
    for job in jobs:
        attempt.settle(job)
    if truth is not None:
        _check_truth(first, truth)
    if crops:
        _check_crops(crops, first)


def _check_truth(job: Job | ClipJob, truth: Path) -> None:
    """Refuse a truth that is of another size or length than the input."""
    if isinstance(job, Job):
        ours, theirs = (_still_shape(path, job.transfer) for path in (job.source, truth))
        if ours != theirs:
            raise ValueError(f"the truth must be of the input's size, {ours}, {truth} is {theirs}")
        return
    stream, other = decode.probe(job.source, job.pictures_a_second, on_damage=job.on_damage), decode.probe(truth, job.pictures_a_second)
    if (stream.rows, stream.cols) != (other.rows, other.cols):
        raise ValueError(f"the truth must be of the input's size, {stream.cols} x {stream.rows}, {truth} is {other.cols} x {other.rows}")
    first, last = clip_job.span(job, stream)
    if other.frames not in (stream.frames, last - first):
        raise ValueError(f"the truth must have as many frames as the input, {stream.frames}, {truth} has {other.frames}")


def _still_shape(path: Path, transfer: Transfer | None) -> str:
    rows, cols = still.read(path, transfer).pixels.shape[:2]
    return f"{cols} x {rows}"


def _check_crops(crops: Sequence[tuple[int, int, int, int]], job: Job | ClipJob) -> None:
    """Refuse crops that reach beyond the picture as it is shown."""
    plan = _plan(job)
    for x, y, w, h in crops:
        if min(w, h) < 8 or min(x, y) < 0 or x + w > plan.cols or y + h > plan.rows:
            raise ValueError(
                f"crop must lie within the picture of {plan.cols} x {plan.rows} px and be 8 px or more a side, got {x},{y},{w},{h}"
            )


def compared(
    job: Job | ClipJob,
    attempts: Sequence[Attempt],
    *,
    truth: Path | None,
    crops: Sequence[tuple[int, int, int, int]],
    show: Callable[[str, float], None],
) -> Comparison:
    """Decode what the methods made of the job's source, all at once, and measure it."""
    plan = _plan(job)
    reels = _reels(job, attempts, truth, plan)
    count = plan.last - plan.first
    wanted = _looks(count, len(reels), plan.rows * plan.cols * plan.scale**2)
    grid = Grid.fitting(len(reels), plan.rows, plan.cols)
    mosaic = None
    if plan.kind == "clip" and count > 1:
        mosaic = Mosaic(grid, plan.rate, most_bytes=_VIDEO_BYTES, frames=min(count, _VIDEO_FRAMES))
    measured: dict[str, list[Measured]] = {reel.name: [] for reel in reels}
    before: dict[str, tuple[int, np.ndarray]] = {}
    looks: list[Look] = []
    key, area, left = 0, np.zeros((0, 0)), float(_PICTURES_BYTES)
    with ThreadPoolExecutor(process.cores()) as pool:
        for n, (index, shots) in enumerate(_together(reels, plan)):
            show(f"measuring frame {index}", n / count)
            seen = [reel for reel in reels if reel.name in shots]
            lumas = {name: metrics.luma(shot.codes) for name, shot in shots.items()}
            earlier = {name: luma for name, (at, luma) in before.items() if at == index - 1}
            before = {name: (index, luma) for name, luma in lumas.items()}
            found = list(pool.map(partial(_measures, shots=shots, lumas=lumas, earlier=earlier), seen))
            residuals = {}
            for reel, values in zip(seen, found, strict=True):
                if n in wanted and (residual := _residual(reel, index, shots, reels[0].name)):
                    values["whiteness"] = metrics.whiteness(*residual)
                    residuals[reel.name] = _drawn(residual, plan.scale)
                measured[reel.name].append(_measured(reel, index, plan.times[n], values))
            if mosaic is not None and n < _VIDEO_FRAMES:
                mosaic.write([shots[reel.name].shown if reel.name in shots else None for reel in reels])
            if n in wanted:
                look = _look(seen, index, plan.times[n], shots, residuals, plan.scale, left / (len(wanted) - len(looks)), pool)
                left -= sum(map(len, (*look.pictures.values(), *residuals.values())))
                difference = _difference([shots[reel.name].shown for reel in seen if reel.role != "truth"])
                if not looks or difference.sum() > area.sum():
                    key, area = len(looks), difference
                looks.append(look)
    entries = _entries(reels, attempts, measured)
    return Comparison(
        title=job.source.name,
        source=str(job.source),
        kind=plan.kind,
        rows=plan.rows,
        cols=plan.cols,
        rate=float(plan.rate) if plan.kind == "clip" else 0.0,
        entries=entries,
        looks=tuple(looks),
        key=key,
        crops=(*(Crop(x=x, y=y, w=w, h=h, chosen=True) for x, y, w, h in crops), *_crops(area, plan.rows, plan.cols)),
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


def _look(
    seen: Sequence[_Reel],
    index: int,
    time_s: float,
    shots: Mapping[str, Shot],
    residuals: Mapping[str, bytes],
    scale: float,
    most: float,
    pool: ThreadPoolExecutor,
) -> Look:
    """Pictures at the best quality at which they take about `most` bytes."""
    used, quality = sum(map(len, residuals.values())), _QUALITY
    while True:
        pictures = list(pool.map(lambda reel, quality=quality: _webp(shots[reel.name].shown, scale, quality), seen))
        if used + sum(map(len, pictures)) <= 1.2 * most or quality <= _WORST_QUALITY:
            break
        quality -= 10
    first = shots[seen[0].name].shown
    return Look(
        index=index,
        time_s=time_s,
        pictures={reel.name: picture for reel, picture in zip(seen, pictures, strict=True)},
        residuals=residuals,
        records={reel.name: reel.records[index] for reel in seen if index in reel.records},
        thumbnail=_webp(first, _THUMB / max(first.shape[:2]), 70),
    )


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


def shots(path: Path) -> Iterator[Shot]:
    """All pictures of a still or a clip."""
    if path.suffix.lower() in (".mp4", ".mov", ".mkv"):
        stream = decode.probe(path)
        return _clip_shots(stream, 0, stream.frames)
    return iter([_still_shot(path, None)])


def _plan(job: Job | ClipJob) -> _Plan:
    if isinstance(job, Job):
        rows, cols = still.read(job.source, job.transfer).pixels.shape[:2]

        def one(path: Path, _: bool) -> Iterator[Shot]:
            yield _still_shot(path, job.transfer)

        return _Plan(kind="still", rows=rows, cols=cols, rate=Fraction(1), first=0, last=1, times=(0.0,), reel=one)
    stream = decode.probe(job.source, job.pictures_a_second, on_damage=job.on_damage)
    first, last = clip_job.span(job, stream)
    turned = stream.rotation // 90 % 2

    def many(path: Path, whole: bool) -> Iterator[Shot]:
        its = decode.probe(path, job.pictures_a_second, on_damage=job.on_damage)
        begin, end = (first, last) if whole and its.frames == stream.frames else (0, its.frames)
        return _clip_shots(its, begin, end, transfer=job.transfer, on_damage=job.on_damage, turns=stream.rotation // 90)

    return _Plan(
        kind="clip",
        rows=stream.cols if turned else stream.rows,
        cols=stream.rows if turned else stream.cols,
        rate=stream.rate,
        first=first,
        last=last,
        times=[stream.seconds(k) for k in range(first, last)],
        reel=many,
    )


def _reels(job: Job | ClipJob, attempts: Sequence[Attempt], truth: Path | None, plan: _Plan) -> list[_Reel]:
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
        reels.insert(0, _Reel(name="recorded", role="recorded", shots=zip(part, plan.reel(job.source, True), strict=False)))
    if truth is not None:
        reels.append(_Reel(name="truth", role="truth", shots=zip(part, plan.reel(truth, True), strict=False)))
    return reels


def _together(reels: Sequence[_Reel], plan: _Plan) -> Iterator[tuple[int, dict[str, Shot]]]:
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


def _clip_shots(
    stream: Stream, first: int, last: int, *, transfer: str | None = None, on_damage: decode.OnDamage = "fail", turns: int = 0
) -> Iterator[Shot]:
    own = stream.colour
    if transfer:
        own = replace(own, transfer=Transfer(transfer))
    rgb = replace(own, matrix=Matrix.RGB, full_range=True, depth=8, subsampling="4:4:4", pixel_format="gbrp", chroma_shift=(0, 0))
    screen = rgb if own.transfer in _PLAIN or not isinstance(own.transfer, Transfer) else replace(rgb, transfer=Transfer.SRGB)
    if own.floating:
        rgb = screen
    for picture in decode.pictures(stream, first, last, on_damage=on_damage):
        codes = np.stack(colour.relaid(picture, own, rgb).planes, axis=-1)
        shown = codes if screen is rgb else np.stack(colour.relaid(picture, own, screen).planes, axis=-1)

        def light(picture=picture) -> Light:
            pixels, clipped = colour.light(picture, own)
            return metrics.luma(pixels), np.asarray(~clipped.any(axis=2))

        yield Shot(codes=codes.astype(np.float32) / np.float32(255), shown=np.ascontiguousarray(np.rot90(shown, turns)), light=light)


def _still_shot(path: Path, transfer: Transfer | None) -> Shot:
    photograph = still.read(path, transfer)
    codes = tone.encode(photograph.transfer, photograph.pixels)
    shown = codes if photograph.transfer in _PLAIN else tone.encode(Transfer.SRGB, photograph.pixels)
    if codes.shape[2] == 1:
        codes, shown = (np.repeat(x, 3, axis=2) for x in (codes, shown))
    return Shot(
        codes=np.ascontiguousarray(codes),
        shown=np.clip(np.rint(255 * shown), 0, 255).astype(np.uint8),
        light=lambda: (metrics.luma(photograph.pixels), np.asarray(~photograph.clipped.any(axis=2))),
    )


def _looks(count: int, entries: int, pixels: float) -> frozenset[int]:
    """Which frames are shown: as many as a page can carry, evenly spread."""
    most = max(1, min(count, MOST_LOOKS, int(_PICTURES_BYTES / (1.4 * entries * pixels * _BYTES_A_PIXEL))))
    return frozenset(np.linspace(0, count - 1, most).round().astype(int).tolist()) if most > 1 else frozenset({count // 2})


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


def _residual(reel: _Reel, index: int, shots: Mapping[str, Shot], recorded: str) -> tuple[np.ndarray, np.ndarray] | None:
    """b - K l in luminance, and where it is known; None where the method does not say how it explains the frame."""
    record = reel.records.get(index)
    if reel.sidecar is None or record is None or reel.name == recorded or recorded not in shots:
        return None
    if record.verdict != Verdict.RESTORED or reel.name.startswith(("rectify", "vidstab")):  # what was moved is not what the camera saw
        return None
    b, valid = shots[recorded].light()
    latent, _ = shots[reel.name].light()
    if b.shape != latent.shape:
        return None
    if record.psfs is not None:
        again, border = _convolved(latent, np.asarray(record.psfs, np.float32))
    elif np.any(record.trajectory.poses()):
        again, border = _moved(latent, record, reel.sidecar)
    else:
        return None
    inside = np.zeros_like(valid)
    if min(b.shape) <= 2 * border:
        return None
    inside[border:-border, border:-border] = True
    return b - again, valid & inside


def _moved(latent: np.ndarray, record: FrameRecord, said: Sidecar) -> tuple[np.ndarray, int]:
    """K l of the trajectory that was found, and how many pixels of the border it does not know."""
    t, poses = np.array(record.trajectory.t_s), record.trajectory.poses()
    if not poses[:, 2].any():
        poses = poses[:, :2]
    timing = said.timing(record)
    blank = Spline(t0=float(t[0]), t1=float(t[-1]), coefficients=np.zeros((min(_TERMS, len(t)), poses.shape[1])))
    path = centred(fit(blank, t, poses), timing.middle)
    operator = BlurOperator.covering(path, timing=timing, intrinsics=said.settings.camera.intrinsics, samples=16, slack=0)
    down, right = operator.margin
    padded = cv2.copyMakeBorder(latent, down, down, right, right, cv2.BORDER_REPLICATE)
    return operator.forward(padded), max(down, right)


def _convolved(latent: np.ndarray, psfs: np.ndarray) -> tuple[np.ndarray, int]:
    """Kernels over a grid of the frame, mixed linearly between their places, applied to the latent image."""
    down, across, k, _ = psfs.shape
    rows, cols = latent.shape
    weights = [
        np.stack([np.interp(np.arange(n), (np.arange(m) + 0.5) * n / m - 0.5, np.eye(m)[i]) for i in range(m)])
        for n, m in ((rows, down), (cols, across))
    ]
    out = np.zeros_like(latent)
    for i in range(down):
        for j in range(across):
            blurred = cv2.filter2D(latent, -1, psfs[i, j, ::-1, ::-1], borderType=cv2.BORDER_REPLICATE)
            out += (weights[0][i][:, None] * weights[1][j][None]).astype(np.float32) * blurred
    return out, k // 2 + 1


def _drawn(residual: tuple[np.ndarray, np.ndarray], size: float) -> bytes:
    """Grey where the frame is explained; brighter and darker by eight times what is not."""
    r, valid = residual
    grey = np.clip(np.rint(128 + 255 * _GAIN * np.where(valid, r, 0)), 0, 255).astype(np.uint8)
    return _webp(np.repeat(grey[..., None], 3, axis=2), 0.5 * size, 65)


def _webp(picture: np.ndarray, size: float, quality: int) -> bytes:
    if size < 1:
        cols, rows = (max(1, round(size * n)) for n in picture.shape[1::-1])
        picture = cv2.resize(picture, (cols, rows), interpolation=cv2.INTER_AREA)
    done, data = cv2.imencode(".webp", picture[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, quality])
    if not done:
        raise ArithmeticError("a picture could not be encoded as WebP")
    return data.tobytes()


def _difference(pictures: Sequence[np.ndarray]) -> np.ndarray:
    """By how much pictures differ, pixel by pixel."""
    alike = [metrics.luma(picture / np.float32(255)) for picture in pictures if picture.shape == pictures[0].shape]
    return cv2.GaussianBlur(np.std(np.stack(alike), axis=0), (0, 0), 2.0)


def _crops(area: np.ndarray, rows: int, cols: int, most: int = 4) -> Iterator[Crop]:
    """Parts in which the entries differ most, apart from each other."""
    w = min(cols, max(96, cols // 6))
    h = min(rows, round(0.75 * w))
    if not area.any():
        yield Crop(x=(cols - w) // 2, y=(rows - h) // 2, w=w, h=h, chosen=False)
        return
    edge = min(metrics.BORDER, min(rows, cols) // 8) // 2
    kept = area.copy()
    kept[:edge], kept[-edge:], kept[:, :edge], kept[:, -edge:] = 0, 0, 0, 0
    for _ in range(most):
        sums = cv2.integral(kept)
        box = sums[h:, w:] - sums[:-h, w:] - sums[h:, :-w] + sums[:-h, :-w]
        y, x = (int(n) for n in np.unravel_index(int(box.argmax()), box.shape))
        if box[y, x] <= 0:
            return
        yield Crop(x=x, y=y, w=w, h=h, chosen=False)
        kept[max(0, y - h // 4) : y + h + h // 4, max(0, x - w // 4) : x + w + w // 4] = 0


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
