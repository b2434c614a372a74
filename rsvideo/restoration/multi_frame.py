"""One continuous path through a run of frames, from the points that move between them and from the blur within them.

Points (restoration.camera_path) settle the slow part of the motion, and the direction of time, which blur shows badly; blur shows the
fast part, within an exposure. The path is one spline C, and

    sum_k f_k(C) + tau (C - C_0)^T H (C - C_0)

is minimised over it, with f_k the sparsity of frame k's latent image (restoration.sparsity), and C_0, H what the tracks say.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import solve_triangular
from scipy.optimize import minimize

from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.trajectory import Spline, Trajectory
from rsvideo.restoration import sparsity
from rsvideo.restoration.camera_path import Path, exposure_length, follow, polynomial, unexplained, windows, within
from rsvideo.restoration.fusion import Seen, fused
from rsvideo.restoration.parallax import Flow, Points, flows, together
from rsvideo.restoration.single_frame import (
    Settings,
    View,
    along_scanlines,
    intrinsics_along,
    longest,
    observed,
    restore,
    tiled_frame,
    windowed,
)
from rsvideo.restoration.sparsity import Scene
from rsvideo.restoration.tracks import Tracks, codes, track

TRUST = 2e-3  # tau
BLURRED = 6.0  # px an exposure, from which on blur adds to what tracks say
STEPS = 6  # of the refinement
SAMPLE = 1e-3  # s, of a path over all frames
NEIGHBOURS = 3  # frames on either side that a frame is restored with
STILL = 0.25  # px that the pose moves within a frame; below, the frame is left as it was
MOVING = 1.0  # and from here on it is fully restored
COLS = 480  # with most texture, which serve it


def refine(scenes: Sequence[Scene], begins: Sequence[float], known: Path, *, steps: int) -> Path:
    """Minimise the sum of the scenes' f and tau (C - C_0)^T H (C - C_0) by L-BFGS, in units of H's own spread."""
    path, shape = known.spline, known.spline.coefficients.shape
    root = np.linalg.cholesky(known.precision)
    local = [windows(path, t, s.timing) for s, t in zip(scenes, begins, strict=True)]

    def at(z: np.ndarray) -> np.ndarray:
        return path.coefficients + solve_triangular(root, z, trans=1, lower=True).reshape(shape)

    def penalised(z: np.ndarray) -> tuple[float, np.ndarray]:
        coefficients = at(z)
        value, gradient = 0.0, np.zeros(shape)
        for scene, m in zip(scenes, local, strict=True):
            inside = m @ coefficients
            inside[0] = 0  # a gauge
            f, slope = sparsity.objective(scene, polynomial(scene.timing, shape[1]).with_coefficients(inside), 3 * scene.ridge)
            slope[0] = 0
            value += f
            gradient += m.T @ slope
        slope = solve_triangular(root, gradient.ravel(), lower=True)
        return 100 * (value + TRUST * float(z @ z)), 100 * (slope + 2 * TRUST * z)

    options = {"maxiter": steps, "maxfun": steps + 4, "ftol": 1e-6}
    found = minimize(penalised, np.zeros(root.shape[0]), jac=True, method="L-BFGS-B", options=options)
    return Path(spline=path.with_coefficients(at(found.x)), precision=known.precision)


@dataclass(frozen=True, kw_only=True, eq=False)
class Movement:
    """How the camera moved within each frame of a run, and from each to the next; in image axes."""

    within: list[Trajectory | None]  # None where no point could be followed: such a frame stands alone
    steps: Float[np.ndarray, "frames axes"]  # from the pose at the middle of a frame's interval to that of the next
    tied: list[bool]  # whether the next frame's points were followed; else its step is 0
    flows: list[Flow | None] = field(default_factory=list)  # what points do beyond that, along the scanlines; none where not asked for

    def part(self, first: int, last: int) -> "Movement":
        """That of frames first, ..., last - 1."""
        return Movement(
            within=self.within[first:last], steps=self.steps[first:last], tied=self.tied[first:last], flows=self.flows[first:last]
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """Successive frames of one camera as estimation sees them, along their scanlines."""

    begins: Float[np.ndarray, " frames"]  # seconds of the clip, when each frame's first scanline opens
    scenes: list[Scene]  # narrowed to the columns that serve; none where blur is not asked for
    links: list[Tracks]  # between neighbours
    timing: ShutterTiming
    intrinsics: Intrinsics
    axes: int

    @property
    def tied(self) -> list[bool]:
        """Whether the next frame's points were followed."""
        return [*(len(t.before) > 0 for t in self.links), False]

    @property
    def known(self) -> Bool[np.ndarray, " frames"]:
        """Whether points of a frame were followed at all, from the one before or to the next."""
        tied = self.tied
        return np.array([any(tied[max(k - 1, 0) : k + 1]) for k in range(len(tied))], bool)


def seen(
    frames: Iterable[Frame],
    timing: ShutterTiming,
    intrinsics: Intrinsics,
    settings: Settings,
    observe: Callable[[int], None],
    *,
    blur: bool = True,
) -> Run:
    """Take frames in; `observe` is told of each. They are not kept, nor, without `blur`, what their blur is measured from."""
    begins: list[float] = []
    scenes: list[Scene] = []
    links: list[Tracks] = []
    before = None
    for frame in frames:
        scene = observed(frame, timing, intrinsics, settings)
        after = codes(scene.frame)
        if before is not None:
            links.append(track(before, after))
        before = after
        begins.append(frame.time)
        if blur:
            scenes.append(windowed(scene, COLS))
        observe(frame.index)
    axes = 3 if settings.motion == "rotation" else 2
    return Run(begins=np.array(begins), scenes=scenes, links=links, timing=timing, intrinsics=intrinsics, axes=axes)


def tracked(run: Run, known: Path | None = None) -> Path:
    """The path that the points between the frames show, along the scanlines; about a `known` one if there is."""
    camera = intrinsics_along(run.intrinsics, run.timing)
    return follow(run.links, run.begins, _upright(run.timing), camera, run.axes, known=known)


def own(run: Run, path: Path) -> list[Flow | None]:
    """What the points of each frame do beyond the path that the tracks show."""
    camera, upright = intrinsics_along(run.intrinsics, run.timing), _upright(run.timing)
    said: list[list[Points]] = [[] for _ in run.begins]
    for k, (link, (moved, elapsed)) in enumerate(
        zip(run.links, unexplained(path.spline, run.links, run.begins, upright, camera), strict=True)
    ):
        said[k].append(Points(at=link.before, moved=moved, elapsed=elapsed))
        said[k + 1].append(Points(at=link.after, moved=moved, elapsed=elapsed))
    return flows([together(points) for points in said], max(camera.rows, camera.cols))


def sharpened(run: Run, path: Path, known: Bool[np.ndarray, " frames"]) -> Path:
    """The path refined by the blur of those known frames that are blurred."""
    upright = _upright(run.timing)
    blurred = [k for k in np.flatnonzero(known) if exposure_length(path.spline, run.begins[k], upright) > BLURRED]
    return refine([run.scenes[k] for k in blurred], [float(run.begins[k]) for k in blurred], path, steps=STEPS) if blurred else path


def told(
    path: Spline, begins: Float[np.ndarray, " frames"], timing: ShutterTiming, known: Bool[np.ndarray, " frames"], tied: list[bool]
) -> Movement:
    """A path along the scanlines as the motion of frames, in image axes."""
    upright, axes = _upright(timing), path.coefficients.shape[1]
    turn = timing.direction.pose_from_scanlines[:axes, :axes]
    inside = [within(path, float(t), upright) if k else None for t, k in zip(begins, known, strict=True)]
    middles = path.at(begins + timing.middle) @ turn.T
    steps = np.vstack([np.diff(middles, axis=0), np.zeros((1, axes))]) * np.array(tied)[:, None]
    return Movement(within=[p and p.with_coefficients(p.coefficients @ turn.T) for p in inside], steps=steps, tied=tied)


def unknown(frames: int, axes: int) -> Movement:
    """That of frames of which none could be followed."""
    return Movement(within=[None] * frames, steps=np.zeros((frames, axes)), tied=[False] * frames)


def movement(
    frames: Iterable[Frame], timing: ShutterTiming, intrinsics: Intrinsics, settings: Settings, observe: Callable[[int], None]
) -> Movement:
    """The motion of successive frames of one camera; `observe` is told of each frame taken in. Frames are not kept."""
    run = seen(frames, timing, intrinsics, settings, observe)
    if not run.known.any():
        return unknown(len(run.begins), run.axes)
    path = sharpened(run, tracked(run), run.known)
    return told(path.spline, run.begins, timing, run.known, run.tied)


def _upright(timing: ShutterTiming) -> ShutterTiming:
    return replace(timing, direction=Direction.TOP_TO_BOTTOM)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Waiting:
    """A frame restored by itself, until its neighbours are there too."""

    result: FrameResult
    view: View
    seen: Seen | None  # None where it cannot serve others, nor they it
    share: float  # of the restoration in what is shown


def restored(
    frames: Iterable[Frame],
    movement: Movement,
    timing: ShutterTiming,
    intrinsics: Intrinsics,
    settings: Settings,
    *,
    timing_source: str = "explicit",
    observe: Callable[[int, float], None] = lambda *_: None,
) -> Iterator[FrameResult]:
    """Each frame's latent image at the pose of the middle of its interval, with the help of its neighbours.

    A frame whose motion is not known is restored by itself, blindly. A frame that moves by less than STILL px is left as it was,
    and up to MOVING px it is mixed with its restoration, so that nothing flickers. At most 2 NEIGHBOURS + 1 frames are kept.
    """
    reach = NEIGHBOURS if settings.frames == "together" else 0
    poses = np.vstack([np.zeros((1, movement.steps.shape[1])), np.cumsum(movement.steps[:-1], axis=0)])
    group = np.cumsum([0, *(not t for t in movement.tied[:-1])])
    poses = poses @ timing.direction.pose_from_scanlines[: poses.shape[1], : poses.shape[1]]
    waiting: dict[int, _Waiting] = {}

    def ready(k: int) -> FrameResult:
        others = [w.seen for j, w in waiting.items() if j != k and abs(j - k) <= reach and group[j] == group[k] and w.seen]
        done = _together(waiting[k], others, timing, settings)
        waiting.pop(k - reach, None)
        observe(done.frame.index, 1.0)
        return done

    count = 0
    for k, (frame, way) in enumerate(zip(frames, movement.within, strict=True)):
        waiting[k] = _alone(frame, way, poses[k], timing, intrinsics, settings, timing_source)
        observe(frame.index, 0.6)
        count = k + 1
        if k >= reach:
            yield ready(k - reach)
    for k in range(max(0, count - reach), count):
        yield ready(k)


def _alone(
    frame: Frame, way: Trajectory | None, pose: np.ndarray, timing: ShutterTiming, intrinsics: Intrinsics, settings: Settings, source: str
) -> _Waiting:
    """The frame restored by itself, along its way if that is known."""
    share, moved = 1.0, np.inf
    if way is not None:
        moved = float(np.linalg.norm(np.ptp(way.at(np.linspace(*timing.interval, 33))[:, :2], axis=0)))
        share = float(np.clip((moved - STILL) / (MOVING - STILL), 0, 1))
    view = along_scanlines(frame, timing, intrinsics)
    if way is not None and share == 0:
        result = FrameResult(
            frame=frame, timing=timing, timing_source=source, trajectory=way, latent=frame.pixels, verdict=Verdict.SHARP, seconds=0.0
        )
    else:
        result = restore(frame, timing, intrinsics, settings, timing_source=source, trajectory=way)
    if way is None:
        return _Waiting(result=result, view=view, seen=None, share=1.0)
    latent = np.ascontiguousarray(timing.direction.scanlines(np.clip(result.latent, 0, 1)), np.float32)
    return _Waiting(result=result, view=view, seen=Seen(latent=latent, pose=pose, length=longest(timing, way)), share=share)


def _together(waiting: _Waiting, others: Sequence[Seen], timing: ShutterTiming, settings: Settings) -> FrameResult:
    """The frame restored with its neighbours."""
    result, own, view = waiting.result, waiting.seen, waiting.view
    if own is None or result.verdict is not Verdict.RESTORED:
        return result
    started = time.monotonic()
    turn = timing.direction.pose_from_scanlines
    path = result.trajectory
    axes = path.coefficients.shape[1]
    path = path.with_coefficients(path.coefficients @ turn[:axes, :axes])
    latent = fused(tiled_frame(view, path, settings), own, others, view.intrinsics, view.noise)
    latent = view.frame.pixels + np.float32(waiting.share) * (np.clip(latent, 0, 1) - view.frame.pixels)
    return replace(
        result,
        latent=np.ascontiguousarray(timing.direction.image(latent)),
        seconds=result.seconds + time.monotonic() - started,
    )


def joined(
    begins: Float[np.ndarray, " frames"],
    within: Sequence[tuple[Float[np.ndarray, " samples"], Float[np.ndarray, "samples axes"]]],
    steps: Float[np.ndarray, "frames axes"],
    timing: ShutterTiming,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n axes"]]:
    """One path over all frames, from the motion within each and from each to the next: neighbours fade into each other."""
    at = np.vstack([np.zeros((1, steps.shape[1])), np.cumsum(steps[:-1], axis=0)])
    t = np.arange(begins[0], begins[-1] + timing.interval[1], SAMPLE)
    ends = begins + timing.interval[1]
    total, poses = np.zeros(len(t)), np.zeros((len(t), steps.shape[1]))
    for k, (times, path) in enumerate(within):
        # from where the frame before has ended, or this one begins, to where the next one begins, or this one ends; and across gaps
        rise = sorted((ends[k - 1], begins[k])) if k else (t[0] - 1, t[0] - 0.5)
        fall = sorted((ends[k], begins[k + 1])) if k + 1 < len(begins) else (t[-1] + 0.5, t[-1] + 1)
        weight = np.interp(t, [rise[0], rise[1] + 1e-9, fall[0], fall[1] + 1e-9], [0, 1, 1, 0])
        near = np.flatnonzero(weight)
        total[near] += weight[near]
        for a in range(steps.shape[1]):
            poses[near, a] += weight[near] * (at[k, a] + np.interp(t[near] - begins[k], times, path[:, a]))
    return t, poses / np.maximum(total, 1e-9)[:, None]
