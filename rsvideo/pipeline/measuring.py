"""What nobody states of a clip's shutter, measured from some of its frames: how points move shows the readout, blur the exposure."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from calibration.timing.cannot_tell import CannotTellError, Likeliest
from calibration.timing.pair_motion import Pair
from calibration.timing.readout_measurement import directions
from calibration.timing.self_calibration import explain
from rsvideo.config.request import Camera as Stated
from rsvideo.config.request import Measured
from rsvideo.frame import Frame
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.pipeline import clip_frames
from rsvideo.pipeline.take import Take
from rsvideo.restoration import clip_motion, exposure
from rsvideo.restoration.clip_motion import Run
from rsvideo.restoration.settings import Settings
from rsvideo.shooting import timing
from rsvideo.shooting.timing import Sources
from rsvideo.video.decode import OnDamage
from rsvideo.video.stream import Stream

FRAMES = 40  # from the middle of what is restored
USUAL_FOCAL = 0.85  # of the longer side: most phones and cameras have 0.7 to 1.0
DECIMALS = 6  # of seconds, and of px, so that a clip that is measured again gives the same


def needed(given: Stated, sources: Sources) -> bool:
    """Whether a clip's exposure or readout is stated by nobody, or its exposure is typed in, and not to be forced."""
    typed = (given.exposure is not None or given.shutter_angle is not None) and not given.force
    return typed or timing.exposure_of(given, sources)[0] is None or readout_unknown(given, sources)


def unstated(given: Stated, sources: Sources) -> bool:
    """Whether nobody states the exposure, or nobody the readout."""
    exposure = given.exposure is not None or given.shutter_angle is not None or timing.exposure_of(given, sources)[0] is not None
    return not exposure or readout_unknown(given, sources)


def readout_unknown(given: Stated, sources: Sources) -> bool:
    """Whether nobody states the readout: a frame's period is only its upper bound."""
    readout, _ = timing.readout_of(given, sources)
    return readout is None or readout.within == (0.0, readout.value)


def of_take(take: Take, given: Stated, first: int, last: int, on_damage: OnDamage = "fail") -> Measured | None:
    """What the frames [first, last) of a clip show of its shutter; None where all is stated and nothing is to be checked."""
    assert isinstance(take.source, Stream)
    if not needed(given, take.shutter):
        return None
    begin = max(first, (first + last - FRAMES) // 2)
    shown = clip_frames.decoded(take.source, begin, min(last, begin + FRAMES), on_damage=on_damage)
    lens = take.profile.intrinsics if take.profile else None
    focal = given.focal_px or (
        lens.fx if lens else take.focal.value if take.focal else USUAL_FOCAL * max(take.source.rows, take.source.cols)
    )
    return measured(shown, given, take.shutter, focal)


def with_measured(take: Take, given: Stated) -> Take:
    """The take with what its frames show, and in its notes what they do not show."""
    assert isinstance(take.source, Stream)
    found = of_take(take, given, 0, take.source.frames)
    unclear = tuple(f"not measured: {reason}" for reason in found.unclear) if found else ()
    return replace(take, shutter=replace(take.shutter, measured=found), notes=(*take.notes, *unclear))


def measured(frames: Iterable[Frame], given: Stated, sources: Sources, focal: float) -> Measured:
    """The exposure, and where it is unknown the readout, of successive frames of a clip."""
    assert sources.fps is not None
    period, rows, cols = 1 / sources.fps, sources.rows, sources.cols
    direction = timing.direction_of(given, sources).value
    intrinsics = Intrinsics.centred(focal=focal, rows=rows, cols=cols)

    usual = timing.USUAL * period  # with which points are followed until both are measured

    def camera(readout: float) -> Camera:
        scanlines = rows if direction.by_row else cols
        shutter = ShutterTiming.from_readout(exposure=usual, readout=readout, rows=scanlines, direction=direction)
        return Camera(timing=shutter, intrinsics=intrinsics)

    run = clip_motion.gather(frames, camera(usual), Settings())
    if not run.followed.any():
        return Measured(unclear=("no points could be followed from frame to frame",))
    unclear: list[str] = []
    readout, vague = None, 0.0
    if readout_unknown(given, sources):
        try:
            readout = round(_readout(run, period, direction), DECIMALS)
        except CannotTellError as error:
            unclear.append(f"readout: {error}")
            readout, vague = with_usual(error.likeliest, period)
    else:
        stated, _ = timing.readout_of(given, sources)
        readout = stated.value if stated else None
    settled = camera(usual if readout is None else readout)
    found = exposure.measured(replace(run, camera=settled.along_scanlines(), source_camera=settled), period)
    if isinstance(found, exposure.Unclear):
        most = found.most and round(found.most, DECIMALS)
        return Measured(most=most, readout=readout, readout_deviation=vague, unclear=(*unclear, f"exposure: {found.reason}"))
    value, deviation, blur = (round(each, DECIMALS) for each in (found.value, found.deviation, found.blur))
    return Measured(exposure=value, deviation=deviation, blur=blur, readout=readout, readout_deviation=vague, unclear=tuple(unclear))


def with_usual(shown: Likeliest | None, period: float) -> tuple[float | None, float]:
    """The readout that vague motion and what is usual of cameras make likeliest, and its deviation, s; None where neither says one."""
    if shown is None or shown.readout <= 0:
        return None, 0.0
    usual, spread = timing.USUAL * period, timing.SPREAD * period
    share = spread**2 / (spread**2 + shown.std**2)  # of two Gaussians' product
    readout = share * shown.readout + (1 - share) * usual
    return round(readout, DECIMALS), round(float(np.sqrt(share)) * shown.std, DECIMALS)


def _readout(run: Run, period: float, direction: Direction) -> float:
    lens = run.camera.intrinsics
    begins = run.begins.tolist()
    pairs = [Pair(before=t.before, after=t.after, begins=(a, b)) for t, a, b in zip(run.links, begins, begins[1:], strict=False)]
    return explain(pairs, rows=lens.rows, cols=lens.cols, period=period, downwards=directions(direction)).readout
