"""What nobody states of a clip's shutter and lens, measured from some of its frames.

How points move from frame to frame shows the readout and the focal length, and blur along their motion the exposure.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from calibration.intrinsics.from_motion import VAGUE, Focal, focal_length
from calibration.timing.cannot_tell import CannotTellError, Likeliest, StabilisedError, TooFewPointsError
from calibration.timing.pair_motion import Pair
from calibration.timing.self_calibration import ASTRAY, LESS_ASTRAY, explain
from rsvideo.config.request import Camera as Stated
from rsvideo.config.request import Measured
from rsvideo.frame import Frame
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.pipeline import clip_frames, overlaid
from rsvideo.pipeline.take import Opened, Take, Taken
from rsvideo.restoration import clip_motion, exposure
from rsvideo.restoration.clip_motion import Run
from rsvideo.restoration.overlay import PICTURES, Overlay
from rsvideo.restoration.settings import Settings
from rsvideo.shooting import timing, usual
from rsvideo.shooting.fact import Fact
from rsvideo.shooting.timing import Sources
from rsvideo.video.decode import OnDamage
from rsvideo.video.stream import Stream

FRAMES = 40  # from the middle of what is restored
CONTRARY = 0.25  # of the longer one of a stated readout and one that motion plainly shows, by which they differ if one is wrong
LEAST_CONTRARY = 0.05  # of a frame's period, the same, and the least that tells a direction; plain ones were off by 0.04 of it at most
SURELY = 6.0  # deviations from 0, by which a readout that is likeliest and too uncertain for an answer runs in the opposite direction:
# of upside-down clips 9 and more, of stabilised ones 3 to 4
_READOUTS = 2001  # steps of a frame's period, in which the density of a readout is averaged
DECIMALS = 6  # of seconds, and of px, so that a clip that is measured again gives the same


def needed(given: Stated, sources: Sources) -> bool:
    """Whether a clip's exposure or readout is stated by nobody, or one of them is typed in, and not to be forced.

    ValueError where a time that is stated cannot be.
    """
    typed = given.exposure is not None or given.shutter_angle is not None or timing.readout_typed(given)
    return unstated(given, sources) or (typed and not given.force)


def unstated(given: Stated, sources: Sources) -> bool:
    """Whether nobody states the exposure, or nobody the readout; ValueError where a time that is stated cannot be."""
    (exposure, _), unknown = timing.exposure_of(given, sources), readout_unknown(given, sources)
    return exposure is None or unknown


def readout_unknown(given: Stated, sources: Sources) -> bool:
    """Whether nobody states the readout: a frame's period is only its upper bound."""
    readout, _ = timing.readout_of(given, sources)
    return readout is None or readout.within == (0.0, readout.value)


def of_take(take: Opened, given: Stated, first: int, last: int, on_damage: OnDamage = "fail") -> Measured | None:
    """What the frames [first, last) of a clip show of its shutter and lens; None where all is stated and nothing is to be checked."""
    return of_frames(take, given, lambda: frames_of(take, first, last, on_damage))


def of_frames(take: Take, given: Stated, frames: Callable[[], Iterable[Frame]]) -> Measured | None:
    """The same of a clip from anywhere; `frames` opens those of its `middle`, and is called only where they are needed."""
    focal, open_questions = _stated_focal(take, given), needed(given, take.shutter)
    if focal is not None and not open_questions:
        return None
    overlay = Overlay.of(islice(frames(), PICTURES))
    found = measured(overlaid.cleared(frames(), overlay), given, take.shutter, focal)
    if found.direction is None or not timing.direction_of(given, take.shutter).assumed:
        return found
    turned = given.model_copy(update={"direction": found.direction})
    return measured(overlaid.cleared(frames(), overlay), turned, take.shutter, focal).model_copy(update={"direction": found.direction})


def middle(first: int, last: int) -> tuple[int, int]:
    """Which frames of [first, last) are measured."""
    begin = max(first, (first + last - FRAMES) // 2)
    return begin, min(last, begin + FRAMES)


def frames_of(take: Opened, first: int, last: int, on_damage: OnDamage) -> Iterator[Frame]:
    """The frames of a clip's `middle`, in linear light."""
    assert isinstance(take.source, Stream)
    return clip_frames.decoded(take.source, *middle(first, last), on_damage=on_damage)


def _stated_focal(take: Take, given: Stated) -> float | None:
    lens = take.profile.intrinsics if take.profile else None
    return given.focal_px or (lens.fx if lens else take.focal.value if take.focal else None)


def with_measured(take: Opened, given: Stated) -> Opened:
    """The take with what its frames show, and in its notes what they do not show."""
    assert isinstance(take.source, Stream)
    found = of_take(take, given, 0, take.source.frames)
    unclear = tuple(f"not measured: {reason}" for reason in found.unclear) if found else ()
    return settled(replace(take, notes=(*take.notes, *unclear)), found)


def settled(take: Taken, found: Measured | None) -> Taken:
    """The take with what its frames have shown."""
    focal = take.focal
    if focal is None and found and found.focal:
        vague = found.focal_deviation > VAGUE
        source = "the likeliest by the clip's motion" if vague else "measured from the clip's motion"
        spread = math.exp(2 * found.focal_deviation)
        focal = Fact(value=found.focal, source=source, within=(found.focal / spread, found.focal * spread), assumed=vague)
    return replace(take, shutter=replace(take.shutter, measured=found), focal=focal)


def measured(frames: Iterable[Frame], given: Stated, sources: Sources, focal: float | None = None) -> Measured:
    """The exposure, and where they are unknown the readout and the focal length, of successive frames of a clip.

    Where motion plainly shows another direction of the readout than the one that is assumed, there is nothing else: all depends on it.
    """
    assert sources.fps is not None
    period, rows, cols = 1 / sources.fps, sources.rows, sources.cols
    direction = (assumed := timing.direction_of(given, sources)).value
    half = usual.READOUT * period  # with which points are followed until both are measured

    def camera(readout: float, focal: float) -> Camera:
        scanlines = rows if direction.by_row else cols
        shutter = ShutterTiming.from_readout(exposure=half, readout=readout, rows=scanlines, direction=direction)
        return Camera(timing=shutter, intrinsics=Intrinsics.centred(focal=focal, rows=rows, cols=cols))

    run = clip_motion.gather(frames, camera(half, focal or usual.FOCAL * max(rows, cols)), Settings())
    run = replace(run, bits=sources.bits)
    if not run.followed.any():
        return Measured(unclear=("no points could be followed from frame to frame",))
    shown = _readout(run, period, direction)
    if assumed.assumed and shown.direction is not None:
        return Measured(direction=shown.direction)
    pairs, unclear = _pairs(run), list[str]()
    lens = Focal(pixels=focal, deviation=0.0) if focal else focal_length(pairs, run.camera.intrinsics.rows, run.camera.intrinsics.cols)
    if lens.deviation > VAGUE:
        unclear.append(f"focal length: its motion shows only that it is about {lens.pixels:.0f} px, give or take {lens.deviation:.0%}")

    def taken(readout: float | None) -> Run:
        by = camera(half if readout is None else readout, lens.pixels)
        return replace(run.taken_by(by), readout_guessed=readout is None, misfits={}, compared={})

    stated = None if readout_unknown(given, sources) else timing.readout_of(given, sources)[0]
    contrary = _contrary(shown, stated.value, period) if stated else None
    if contrary is not None and not (timing.readout_typed(given) or given.force):
        stated = None
    readout = _Readout(seconds=stated.value) if stated else shown
    exposed = taken(readout.seconds)
    found = exposure.measured(exposed, period)
    if stated is None and readout.seconds is not None:
        readout, rough = _in_matched_blur(exposed, readout, found, period, direction), readout
        exposed = taken(readout.seconds)
        if rough.unclear and not readout.unclear:
            found = exposure.measured(exposed, period)
    unclear += readout.unclear
    answer = Measured(
        readout=readout.taken,
        readout_deviation=readout.deviation,
        direction=shown.direction,
        stabilised=shown.stabilised,
        contrary=contrary,
        focal=None if focal else round(lens.pixels, 1),
        focal_deviation=round(lens.deviation, 4),
        least=round(found.least, DECIMALS),
        unclear=tuple(unclear),
    )
    return _unless_in_focus(_with_exposure(answer, found), exposed, given, sources)


def _with_exposure(answer: Measured, found: exposure.Exposure | exposure.Unclear) -> Measured:
    """The same with what blur shows of the exposure."""
    if isinstance(found, exposure.Unclear):
        most = found.most and round(found.most, DECIMALS)
        return answer.model_copy(update={"most": most, "unclear": (*answer.unclear, timing.UNCLEAR_EXPOSURE + found.reason)})
    of_blur = {"exposure": found.value, "deviation": found.deviation, "sharp": found.sharp, "blur": found.blur}
    return answer.model_copy(update={name: round(value, DECIMALS) for name, value in of_blur.items()})


def _unless_in_focus(shown: Measured, run: Run, given: Stated, sources: Sources) -> Measured:
    """The same without an exposure, or a bound of it, that contradicts what is typed in, if the clip's focus bears that out."""
    typed, checked = (timing.exposure_of(given, replace(sources, measured=each))[0] for each in (None, shown))
    if typed is None or checked is None or typed.value == checked.value:
        return shown
    if not exposure.in_better_focus(run, typed.value, shown.exposure or checked.value):
        return shown
    reason = f"{timing.UNCLEAR_EXPOSURE}its blur shows another one than {1e3 * typed.value:.4g} ms, but its frames are in focus with that"
    nothing = {"exposure": None, "deviation": 0.0, "sharp": None, "blur": None, "most": None, "least": 0.0}
    return shown.model_copy(update={**nothing, "unclear": (*shown.unclear, reason)})


def with_usual(shown: Likeliest | None, period: float) -> tuple[float | None, float]:
    """The readout that vague motion and what is usual of cameras make likeliest, and its deviation, s; None where the motion shows less
    than what is usual, or rather that there is none, as of a clip whose rows were put straight already.

    It is the mean of both Gaussians' product between 0 and the frame's period, for no camera reads longer.
    """
    mean, spread = usual.READOUT * period, usual.READOUT_SPREAD * period
    if shown is None or shown.readout <= 0 or shown.std > spread:
        return None, 0.0
    if _surprise(shown.readout, shown.std) < _surprise(shown.readout - mean, math.hypot(spread, shown.std)):
        return None, 0.0
    readouts = np.linspace(0, period, _READOUTS)
    density = np.exp(-(((readouts - shown.readout) / shown.std) ** 2 + ((readouts - mean) / spread) ** 2) / 2)
    readout = np.average(readouts, weights=density)
    deviation = np.sqrt(np.average((readouts - readout) ** 2, weights=density))
    return round(float(readout), DECIMALS), round(float(deviation), DECIMALS)


def _surprise(error: float, std: float) -> float:
    """Minus the logarithm of a Gaussian's density at an error, but for a constant."""
    return 0.5 * (error / std) ** 2 + math.log(std)


def _pairs(run: Run) -> list[Pair]:
    begins = run.begins.tolist()
    return [Pair(before=t.before, after=t.after, begins=(a, b)) for t, a, b in zip(run.links, begins, begins[1:], strict=False)]


@dataclass(frozen=True, kw_only=True)
class _Readout:
    """What a clip's motion says of its readout."""

    seconds: float | None  # None where it says nothing, or shows that there is none
    deviation: float = 0.0  # s, where it is no more than what is usual of cameras and motion together make likeliest, or shows none
    unclear: tuple[str, ...] = ()  # why that is so
    direction: Direction | None = None  # where it plainly is another one than scanlines were counted in
    stabilised: bool = False  # whether the frames were shifted after they were read

    @property
    def none(self) -> bool:
        """Whether the motion shows that there is none."""
        return self.seconds is None and self.deviation > 0

    @property
    def taken(self) -> float | None:
        """The same, s: 0 where there is none."""
        return 0.0 if self.none else self.seconds


def _readout(run: Run, period: float, direction: Direction, near: float | None = None, astray: float = ASTRAY) -> _Readout:
    lens, downwards = run.camera.intrinsics, (direction, direction.opposite)
    try:
        found = explain(_pairs(run), rows=lens.rows, cols=lens.cols, period=period, downwards=downwards, near=near, astray=astray)
    except CannotTellError as error:
        seconds, deviation = with_usual(error.likeliest, period)
        backwards = error.likeliest is not None and error.likeliest.readout < -max(SURELY * error.likeliest.std, LEAST_CONTRARY * period)
        if seconds is None and not (backwards or isinstance(error, TooFewPointsError)):
            deviation = usual.READOUT * period
        return _Readout(
            seconds=seconds,
            deviation=deviation,
            unclear=(f"readout: {error}",),
            direction=direction.opposite if backwards else None,
            stabilised=isinstance(error, StabilisedError),
        )
    if found.direction is None:
        return _Readout(seconds=0.0)
    if found.direction is direction or found.readout < LEAST_CONTRARY * period:
        return _Readout(seconds=round(found.readout, DECIMALS))
    return _Readout(seconds=None, unclear=(f"readout: its motion shows that it runs {found.direction}",), direction=found.direction)


def _contrary(shown: _Readout, stated: float, period: float) -> float | None:
    """The readout in s that a clip's motion plainly shows against a stated one; 0 where it shows none, as of a clip that was stabilised."""
    least = LEAST_CONTRARY * period
    if shown.none:
        return 0.0 if stated > least else None
    if shown.unclear or shown.seconds is None:
        return None
    allowed = max(CONTRARY * max(shown.seconds, stated), least)
    return shown.seconds if abs(shown.seconds - stated) > allowed else None


def _in_matched_blur(
    run: Run, rough: _Readout, exposed: exposure.Exposure | exposure.Unclear, period: float, direction: Direction
) -> _Readout:
    """The readout once more, from points in windows that a rough one displaces and blurs alike: as they are found first, those of blurred
    frames show too short a readout."""
    mild = usual.MILD * period
    seconds = exposed.value if isinstance(exposed, exposure.Exposure) else min(mild, exposed.most or mild)
    run = run.exposed(np.full(len(run.begins), seconds))
    better = _readout(clip_motion.in_matched_blur(run), period, direction, None if rough.unclear else rough.seconds, LESS_ASTRAY)
    return rough if better.unclear and not rough.unclear else better
