"""One continuous path through a run of frames, from the points that move between them and from the blur within them.

Points (restoration.camera_path) settle the slow part of the motion, and the direction of time, which blur shows badly; blur shows the
fast part, within an exposure. The path is one spline C, and

    tau (C - C_0)^T H (C - C_0) - sum_k s_k(C)

is minimised over it, with s_k the focus of frame k along the path (restoration.focus), and C_0, H the path that the tracks show and
its precision. Everything here is along the scanlines, but for the `Movement` that is handed on.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.linalg import solve_triangular
from scipy.optimize import minimize

from rsvideo import threads
from rsvideo.frame import Frame
from rsvideo.physics.camera import Camera
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.trajectory import Spline, Trajectory
from rsvideo.progress import Observer, Progress, ignore
from rsvideo.restoration.camera_path import (
    PATH_ERROR,
    CameraPath,
    blur_certainties,
    certainties,
    exposure_lengths,
    follow,
    polynomial,
    unexplained,
    windows,
    within,
)
from rsvideo.restoration.extent import longest
from rsvideo.restoration.focus import focus, focus_value
from rsvideo.restoration.matched_blur import Exposed, followed_again
from rsvideo.restoration.movement import Evidence, Movement, groups
from rsvideo.restoration.parallax import Flow, Points, concatenated, flows
from rsvideo.restoration.path_from_neighbours import Taken, corrected, small
from rsvideo.restoration.refinement import SCALE
from rsvideo.restoration.scanlines import to_scanlines
from rsvideo.restoration.scene import Scene, halved, reduced, scene_of, windowed
from rsvideo.restoration.settings import Effort, Settings
from rsvideo.restoration.tracks import Tracks, codes, displaced, track
from rsvideo.restoration.trust import SHORT, blur_share, run_share

TRUST = 2e-3  # tau; origin: by trial
SOONEST = 0.5  # of a frame's exposure, or of its readout, after which the next one may begin; a camera waits for either to end
MOVING = 1.0  # px from picture to picture, from which on a camera moves
STILL = 0.05  # of that before or behind it, below which the points of a picture that is shown again move; the codec moves them
BLURRED = 2.5  # px an exposure, from which on blur adds to what tracks show
SPARE = 4  # evaluations beyond one a step, for line searches
TOLERANCE = 1e-6  # relative fall of the objective that ends L-BFGS
AT_ONCE = 0.01  # of the exposure, a readout up to which scanlines are displaced alike
COLS = 480  # with most texture, from which a clip's blur is measured


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """Successive frames of one camera as estimation needs them, along their scanlines."""

    begins: Float[np.ndarray, " frames"]  # seconds of the clip, when each frame's first scanline opens if exposed as the camera states
    scenes: list[Scene]  # narrowed to the columns that serve; none where blur is not needed
    wide: list[Scene]  # all columns at half the resolution, or less, where long blurs show
    small: list[Frame]  # all columns in grey, in which neighbours are compared
    codes: list[UInt8[np.ndarray, "rows cols"]]  # each frame as its points are followed; none where blur is not needed
    links: list[Tracks]  # between neighbours
    camera: Camera  # along the scanlines
    source_camera: Camera  # as the frames are stored
    axes: int
    effort: Effort
    exposures: Float[np.ndarray, " frames"]  # s, of each frame; none is longer than the camera's
    pictures: Int[np.ndarray, " pictures"]  # which of the frames each picture of the clip shows: some repeat the one before
    exposure_shown: bool = False  # whether the clip's blur has shown its exposure
    seeming: Float[np.ndarray, " frames"] | None = None  # s, exposures with softness, with which frames come into focus; None: their own
    readout_guessed: bool = False  # whether the readout is no more than a guess; points show no tones then
    bits: float = np.inf  # that a codec spent on a picture: `Stream.bits`
    misfits: dict[int, Float[np.ndarray, " tried"]] = field(default_factory=dict)  # of frames, to exposures, whatever is believed
    compared: dict[tuple[int, int], Float[np.ndarray, "_ apart"]] = field(default_factory=dict)  # the same of pairs of frames

    @property
    def direction(self) -> Direction:
        """Of the readout over the stored frames."""
        return self.source_camera.timing.direction

    @property
    def tied(self) -> list[bool]:
        """Whether the next frame's points were followed."""
        return [*(len(t.before) > 0 for t in self.links), False]

    def timing(self, k: int) -> ShutterTiming:
        """Of frame k."""
        return self.camera.exposed(float(self.exposures[k])).timing

    def opens(self, k: int, exposure: float | None = None) -> float:
        """When the first scanline of frame k opens, or would with another exposure: the middle of its interval does not depend on that."""
        seconds = float(self.exposures[k]) if exposure is None else exposure
        return float(self.begins[k]) + (self.camera.timing.exposure - seconds) / 2

    def exposed(self, exposures: Float[np.ndarray, " frames"]) -> "Run":
        """The same frames, exposed so many seconds each about the same middles."""
        longest = float(exposures.max())
        before = self.camera.timing.exposure
        run = self.taken_by(self.source_camera.exposed(longest))

        def taken(scenes: list[Scene]) -> list[Scene]:
            return [replace(s, camera=s.camera.exposed(float(e))) for s, e in zip(scenes, exposures, strict=True)] if scenes else []

        begins = self.begins + (before - longest) / 2
        return replace(run, begins=begins, exposures=exposures, seeming=None, scenes=taken(run.scenes), wide=taken(run.wide))

    @property
    def judged(self) -> "Run":
        """The same frames, exposed as long as their blur seems: along that they come into focus."""
        return self if self.seeming is None else self.exposed(self.seeming)

    def taken_by(self, camera: Camera) -> "Run":
        """The same frames, if another camera of that size has taken them."""
        upright = smaller = camera.along_scanlines()
        while self.wide and smaller.timing.rows > self.wide[0].camera.timing.rows:
            smaller = smaller.halved()

        def narrowed(scene: Scene) -> Camera:
            lens = upright.intrinsics
            return replace(upright, intrinsics=replace(lens, cx=lens.cx - self.first_column(scene), cols=scene.camera.intrinsics.cols))

        return replace(
            self,
            scenes=[replace(scene, camera=narrowed(scene)) for scene in self.scenes],
            wide=[replace(scene, camera=smaller) for scene in self.wide],
            camera=upright,
            source_camera=camera,
            exposures=np.full(len(self.begins), camera.timing.exposure),
        )

    def first_column(self, scene: Scene) -> int:
        """Of the frame, that one of the narrow scenes begins with."""
        return round(self.camera.intrinsics.cx - scene.camera.intrinsics.cx)

    @property
    def followed(self) -> Bool[np.ndarray, " frames"]:
        """Whether points of a frame were followed at all, from the one before or to the next."""
        tied = self.tied
        return np.array([any(tied[max(k - 1, 0) : k + 1]) for k in range(len(tied))], bool)

    def displaced(self, k: int, j: int, places: Float[np.ndarray, "places 2"]) -> Float[np.ndarray, "places 2"]:
        """How far what is at these places of frame k has moved in a later frame j, px."""
        return displaced(self.links[k:j], places)


@dataclass(frozen=True, kw_only=True, eq=False)
class Followed:
    """A run whose points were followed in matched blur, and the path that they show."""

    run: Run
    path: CameraPath
    sharper: "Followed | None" = None  # with exposures that are not believed, but whose focus bears the path out

    @classmethod
    def of(cls, run: Run) -> "Followed":
        """A run some of whose points were followed."""
        matched = in_matched_blur(run)
        return cls(run=matched, path=path_from_tracks(matched))

    @cached_property
    def votes(self) -> list[float]:
        """The focus of each frame that is blurred enough, along the path."""
        return self.sharper.votes if self.sharper else votes(self.run.judged, self.path)


def movement(run: Run, frames: Bool[np.ndarray, " frames"] | None = None) -> Movement:
    """The motion that points and blur of a run show, in image axes; blur of those `frames` only, if they are given.

    So few do not tell whether the run is in focus: how far they are restored, each says for itself.
    """
    if not run.followed.any():
        return Movement.unfollowed(len(run.begins), run.axes)
    return movement_along(Followed.of(run), frames)


def movement_along(found: Followed, frames: Bool[np.ndarray, " frames"] | None = None) -> Movement:
    """The same of a run whose points were followed in matched blur."""
    run = found.run
    path = refined_by_blur(run, found.path, run.followed if frames is None else run.followed & frames)
    share = run_share(found.votes) if frames is None else 1.0
    if frames is not None or share == 0:
        return replace(movement_of(run, path.spline, run.followed), evidence=evidence(run, path, share=share))
    better = refined_by_neighbours(run, path)
    return replace(movement_of(run, better.spline, run.followed), evidence=evidence(run, better, share=share, focused=path.spline))


def in_matched_blur(run: Run) -> Run:
    """The same frames, gathered with their blur, their points followed once more in windows that are blurred alike along the path that
    they have shown."""
    path, lens = path_from_tracks(run).spline, run.camera.intrinsics
    frames = [Exposed(picture=p, path=path, opens=run.opens(k), timing=run.timing(k), intrinsics=lens) for k, p in enumerate(run.codes)]
    links = zip(run.links, pairwise(frames), strict=True)
    return replace(run, links=threads.each(lambda link: followed_again(link[0], *link[1]), links))


def gather(frames: Iterable[Frame], camera: Camera, settings: Settings, observe: Observer = ignore, *, blur: bool = True) -> Run:
    """Take frames in one by one. They are not kept, nor, without `blur`, what their blur is measured from.

    Where a picture repeats the one before, as after a change of the frame rate, the run holds the frame once.
    """
    begins: list[float] = []
    scenes: list[Scene] = []
    wide: list[Scene] = []
    smaller: list[Frame] = []
    followed: list[np.ndarray] = []
    links: list[Tracks] = []
    before = None
    for frame in frames:
        view = to_scanlines(frame, camera)
        scene = scene_of(view, settings)
        after = codes(scene.frame)
        if before is not None:
            links.append(_link(before, after, frame.time - begins[-1], camera.timing))
        before = after
        begins.append(frame.time)
        if blur:
            followed.append(after)
            scenes.append(windowed(scene, COLS))
            wide.append(reduced(halved(scene)))
            smaller.append(small(view))
        observe(Progress(stage="motion", fraction=0.0, frame=frame.index))
    again = repeats(links)
    first = np.array([True, *(not still for still in again)][: len(begins)], bool)
    return Run(
        begins=np.array(begins)[first],
        scenes=[scene for scene, new in zip(scenes, first, strict=False) if new],
        wide=[scene for scene, new in zip(wide, first, strict=False) if new],
        small=[one for one, new in zip(smaller, first, strict=False) if new],
        codes=[picture for picture, new in zip(followed, first, strict=False) if new],
        links=[link for link, still in zip(links, again, strict=True) if not still],
        camera=camera.along_scanlines(),
        source_camera=camera,
        axes=settings.axes,
        effort=settings.effort,
        exposures=np.full(int(first.sum()), camera.timing.exposure),
        pictures=np.cumsum(first) - 1,
    )


def repeats(links: Sequence[Tracks]) -> list[bool]:
    """Whether the later one of each two pictures repeats the former: all points stay where they were, though they move before or behind."""
    moved = [0.0, *(link.moved for link in links), 0.0]
    around = [max(before, behind) for before, behind in zip(moved[:-2], moved[2:], strict=True)]
    return [bool(near > MOVING and link.farthest < STILL * near) for link, near in zip(links, around, strict=True)]


def _link(before: UInt8[np.ndarray, "rows cols"], after: UInt8[np.ndarray, "rows cols"], elapsed: float, timing: ShutterTiming) -> Tracks:
    """The points that two frames share; none where their times cannot be, as of pictures that a clip says to be shown at one time."""
    if elapsed < SOONEST * max(timing.exposure, timing.readout):
        return Tracks(before=np.zeros((0, 2)), after=np.zeros((0, 2)))
    return track(before, after, timing.exposure / max(elapsed, timing.exposure))


def path_from_tracks(run: Run, about: CameraPath | None = None) -> CameraPath:
    """The path that the points between the frames show; with a path that is given already, the one `about` it."""
    return follow(run.links, run.begins, run.camera, run.axes, about=about, toned=not run.readout_guessed)


def refined_by_blur(run: Run, path: CameraPath, frames: Bool[np.ndarray, " frames"]) -> CameraPath:
    """The path refined by the blur of those of the `frames` that are blurred."""
    followed = np.flatnonzero(frames).tolist()
    lengths = {k: exposure_lengths(path.spline, np.array([run.opens(k)]), run.timing(k)).item() for k in followed}
    blurred = [k for k, length in lengths.items() if length > BLURRED]
    scenes = [scene_at(run, k, None, lengths[k]) for k in blurred]
    return refine(scenes, [run.opens(k) for k in blurred], path, steps=run.effort.blur_steps) if blurred else path


def refined_by_neighbours(run: Run, path: CameraPath) -> CameraPath:
    """The path as the frames show it together."""
    frames = [
        Taken.of(frame, run.camera.exposed(float(run.exposures[k])), run.opens(k), path, int(group), flow)
        for k, (frame, group, flow) in enumerate(zip(run.small, groups(run.tied), beside(run, path), strict=True))
    ]
    return corrected(path, frames, run.effort.neighbours)


def refine(scenes: Sequence[Scene], begins: Sequence[float], start: CameraPath, *, steps: int) -> CameraPath:
    """Minimise tau (C - C_0)^T H (C - C_0) less the scenes' focus by L-BFGS, in units of H's own spread."""
    path, shape = start.spline, start.spline.coefficients.shape
    root = np.linalg.cholesky(start.precision)
    local = [windows(path, t, s.camera.timing) for s, t in zip(scenes, begins, strict=True)]

    def at(z: np.ndarray) -> np.ndarray:
        return path.coefficients + solve_triangular(root, z, trans=1, lower=True).reshape(shape)

    def penalised(z: np.ndarray) -> tuple[float, np.ndarray]:
        coefficients, value, gradient = at(z), 0.0, np.zeros(shape)

        def sharpness(k: int) -> tuple[float, np.ndarray]:
            inside = local[k] @ coefficients
            inside[0] = 0  # a gauge
            return focus(scenes[k], polynomial(scenes[k].camera.timing, *inside.shape).with_coefficients(inside))

        for m, (sharp, slope) in zip(local, threads.each(sharpness, range(len(scenes))), strict=True):
            slope[0] = 0
            value -= sharp
            gradient -= m.T @ slope
        slope = solve_triangular(root, gradient.ravel(), lower=True)
        return SCALE * (value + TRUST * float(z @ z)), SCALE * (slope + 2 * TRUST * z)

    options = {"maxiter": steps, "maxfun": steps + SPARE, "ftol": TOLERANCE}
    found = minimize(penalised, np.zeros(root.shape[0]), jac=True, method="L-BFGS-B", options=options)
    return CameraPath(spline=path.with_coefficients(at(found.x)), precision=start.precision)


def movement_of(run: Run, path: Spline, frames: Bool[np.ndarray, " frames"]) -> Movement:
    """A path as the motion of those `frames` of a run that it holds for, in image axes."""
    inside = [within(path, run.opens(k), run.timing(k)) if held else None for k, held in enumerate(frames)]
    middles = path.at(run.begins + run.camera.timing.middle)
    steps = np.vstack([np.diff(middles, axis=0), np.zeros((1, middles.shape[1]))]) * np.array(run.tied)[:, None]
    return Movement(within=[*inside], steps=steps, tied=run.tied, exposures=[*map(float, run.exposures)]).in_image(run.direction)


def votes(run: Run, path: CameraPath, frames: Sequence[int] | None = None) -> list[float]:
    """The focus of each frame that is blurred enough, of all or of some `frames`, along a path that was found without blur."""
    cuts = [within(path.spline, run.opens(k), run.timing(k)) for k in range(len(run.begins))]
    return votes_along(run, cuts, beside(run, path), frames)


def votes_along(run: Run, paths: Sequence[Trajectory], flows: Sequence[Flow | None], frames: Sequence[int] | None = None) -> list[float]:
    """The same along a path of each frame's own, and the field beside it."""
    wanted = []
    for k in range(len(paths)) if frames is None else frames:
        if (length := longest(run.camera.exposed(float(run.exposures[k])), paths[k])) > SHORT:
            wanted.append((scene_at(run, k, flows[k], length), paths[k]))
    return threads.each(lambda each: focus_value(*each), wanted)


def evidence(run: Run, path: CameraPath, *, share: float, focused: Spline | None = None) -> list[Evidence]:
    """What the points of each frame do beyond a path, how sure that is, and how far the blur may depart from it.

    Focus has `focused` another path, if one is given.
    """
    judged, led = run.judged, focused or (None if run.seeming is None else path.spline)
    beyond = unexplained(path.spline, run.links, run.begins, run.camera)
    speeds = [float(np.median(np.linalg.norm(moved, axis=1) / elapsed)) if len(moved) else 0.0 for moved, elapsed in beyond]
    around = np.array([0.0, *speeds, 0.0])  # between the frames, and at both ends
    coherent = run.exposures * np.maximum(around[:-1], around[1:])
    certain = _certainties(run, path)
    of_blur = blur_certainties(path, run.begins, run.camera.timing)
    shares = share * blur_share(of_blur)
    return [
        Evidence(
            flow=flow,
            error=float(np.hypot(PATH_ERROR, departure)) if flow else PATH_ERROR,
            share=float(granted),
            certainty=float(certainty),
            blur_certainty=float(blurred),
            exposure_shown=run.exposure_shown,
            focused=led and within(led, judged.opens(k), judged.timing(k)),
            seeming=None if run.seeming is None else float(run.seeming[k]),
        )
        for k, (flow, departure, granted, certainty, blurred) in enumerate(
            zip(_flows(run, beyond), coherent, shares, certain, of_blur, strict=True)
        )
    ]


def _certainties(run: Run, path: CameraPath) -> Float[np.ndarray, " frames"]:
    """How surely each frame's scanlines are displaced as a path says; where they are exposed at once, surely unless that is a guess."""
    timing = run.camera.timing
    if timing.readout <= AT_ONCE * timing.exposure:
        return np.full(len(run.begins), 0.0 if run.readout_guessed else 1.0)
    return certainties(path, run.begins, run.tied, timing)


def beside(run: Run, path: CameraPath) -> list[Flow | None]:
    """The field of each frame that explains how far its points move beyond a path."""
    return _flows(run, unexplained(path.spline, run.links, run.begins, run.camera))


def scene_at(run: Run, k: int, flow: Flow | None, blur: float) -> Scene:
    """The scene of frame k, whose points move by a `flow` over the whole frame, at the resolution that shows so many px of blur."""
    scene, wide = run.scenes[k], run.wide[k]
    narrow = reduced(replace(scene, flow=flow and flow.from_column(run.first_column(scene))), blur)
    if narrow.scale > wide.scale:
        return narrow
    return reduced(replace(wide, flow=flow and flow.scaled(wide.scale)), blur)


def _flows(run: Run, beyond: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[Flow | None]:
    """The fields that explain how far the points of each pair move beyond the path, and in what time."""
    points: list[list[Points]] = [[] for _ in run.begins]
    for k, (link, (moved, elapsed)) in enumerate(zip(run.links, beyond, strict=True)):
        points[k].append(Points(at=link.before, moved=moved, elapsed=elapsed))
        points[k + 1].append(Points(at=link.after, moved=moved, elapsed=elapsed))
    lens = run.camera.intrinsics
    return flows([concatenated(parts) for parts in points], max(lens.rows, lens.cols))
