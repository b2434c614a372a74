"""Which shutter timing a photograph or a clip's frames have, and who stated it.

The first that answers wins, for the exposure and for the readout each: the request, the file's own metadata, the camera's profile, the
public table, what the clip's own frames show, and for the readout of a clip at last the frame rate. Total scanlines, where they are
given, are used as in the paper, after Forssen & Ringaby (CVPR 2010): a frame's period 1/f is its readout and an inter-frame delay t_d,
during which the sensor goes through the motions of reading rows that are not stored, so that t_r = 1 / (f * scanlines_total), with
rows = scanlines_total - t_d / t_r stored. Without that number t_d is taken as 0, which makes t_r an upper bound: cameras read in about
half of that, typically.
"""

import math
from dataclasses import dataclass, replace

from rsvideo.config.quantity import HAND_HELD_LIMIT, hand_held
from rsvideo.config.request import Camera, Measured
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.shooting import usual
from rsvideo.shooting.fact import Fact
from rsvideo.shooting.readout_table import PERIOD_SLACK, Readout

_APART = 0.05  # of a readout; a note names sources that differ by more
_CONTRADICTED = 1.2  # ratio of a stated exposure and the measured one from which on one of them is wrong; measured ones rarely are by 1.1
_CERTAIN = 5.0  # deviations of the measured one, by which they must differ too: these do not hold what the path itself is off by
UNCLEAR_EXPOSURE = "exposure: "  # before the reason why blur does not show it
_BY_BLUR, _BY_MOTION = "measured from the clip's blur", "measured from the clip's motion"


@dataclass(frozen=True, kw_only=True)
class Sources:
    """What the request leaves open, as other sources state it; None where they do not."""

    rows: int  # as stored
    cols: int
    fps: float | None = None  # None: a photograph
    bits: float = math.inf  # of a clip: `Stream.bits`
    exposure: Fact[float] | None = None  # seconds; by the file's metadata
    readout: Fact[float] | None = None
    direction: Fact[Direction] | None = None
    profile_readout: Fact[float] | None = None  # by the camera's profile
    profile_direction: Fact[Direction] | None = None
    table: Readout | None = None  # of published times
    measured: Measured | None = None  # from the clip's own frames


@dataclass(frozen=True, kw_only=True)
class Resolved:
    """The timing of a photograph or of a clip's frames, with the source of each part."""

    timing: ShutterTiming
    exposure: Fact[float]  # seconds
    readout: Fact[float]  # seconds
    direction: Fact[Direction]
    notes: tuple[str, ...]  # what the user should know before the work

    @property
    def by_blur(self) -> bool:
        """Whether the clip's blur states the exposure."""
        return self.exposure.source == _BY_BLUR

    @property
    def exposure_open(self) -> bool:
        """Whether nobody states the exposure, so that automatic exposure may change it from frame to frame."""
        return self.exposure.assumed or self.by_blur

    @property
    def source(self) -> str:
        """Who stated it, in one line."""
        if self.exposure.source == self.readout.source:
            return self.exposure.source
        return f"exposure: {self.exposure.source}; readout: {self.readout.source}"


def resolve(given: Camera, sources: Sources) -> Resolved:
    """The timing that the first sources give; ValueError where none does or where what they say cannot be."""
    exposure, notes = exposure_of(given, sources)
    direction = direction_of(given, sources)
    readout, more = readout_of(given, sources)
    if exposure is None:
        raise ValueError(_exposure_missing(sources) + "".join(f"; {note}" for note in notes))
    if readout is None:
        raise ValueError(
            "readout must be given, exactly one of --readout and --row-time; neither was, and a photograph has no frame rate"
            " to bound it by; 0 is a global shutter, a phone's or DSLR's video often reads in 10ms to 30ms"
            + "".join(f"; {note}" for note in more)
        )
    timing = ShutterTiming.from_readout(
        exposure=exposure.value, readout=readout.value, rows=_scanlines(sources, direction.value), direction=direction.value
    )
    return Resolved(timing=timing, exposure=exposure, readout=readout, direction=direction, notes=notes + more)


def _exposure_missing(sources: Sources) -> str:
    if sources.fps is None:
        return "exposure must be given, the photograph does not state it in EXIF; --exposure 1/50, 20ms and 0.02 are times"
    return "exposure must be given, the clip does not say it; --exposure 1/50 is a time, --shutter-angle 180 half of a frame's period"


def exposure_of(given: Camera, sources: Sources) -> tuple[Fact[float] | None, tuple[str, ...]]:
    """How long each row collects light, and what to know of it; None where nobody says it."""
    if given.exposure is not None and given.shutter_angle is not None:
        raise ValueError(
            f"only one of --exposure and --shutter-angle may be given, got {given.exposure:g} s and {given.shutter_angle:g} degrees"
        )
    if given.exposure is not None:
        return _checked(Fact(value=_within_period("exposure", given.exposure, given, sources), source="explicit"), given, sources)
    if given.shutter_angle is not None:
        if sources.fps is None:
            raise ValueError("shutter-angle needs a frame rate, a photograph has none; give --exposure")
        angle = given.shutter_angle
        return _checked(Fact(value=angle / 360 / sources.fps, source=f"shutter angle of {angle:g} degrees"), given, sources)
    stated, notes = _usable("exposure", sources.exposure, given, sources)
    if stated is None and sources.measured is not None and sources.fps is not None:
        return _from_blur(sources.measured, sources.fps), notes
    return stated, notes


def _from_blur(measured: Measured, fps: float) -> Fact[float]:
    """The measured exposure, or the mild one where blur does not show it."""
    if measured.exposure is None:
        if measured.most is not None and measured.most < usual.MILD / fps:
            return Fact(
                value=measured.most, source="assumed, the longest that the clip's blur allows", within=(0.0, measured.most), assumed=True
            )
        return _mild(fps)
    sharp, spread = measured.sharp or measured.exposure, 2 * measured.deviation
    return Fact(value=sharp, source=_BY_BLUR, within=(max(0.0, sharp - spread), measured.exposure + spread))


def _mild(fps: float) -> Fact[float]:
    """Of an exposure that nothing shows, or a readout that was not looked for."""
    return Fact(value=usual.MILD / fps, source="assumed, a quarter of a frame's period", within=(0.0, 1 / fps), assumed=True)


def _checked(stated: Fact[float], given: Camera, sources: Sources) -> tuple[Fact[float], tuple[str, ...]]:
    """What is typed in, or what the blur shows if that contradicts it."""
    measured = sources.measured
    if measured is None or given.force or sources.fps is None:
        return stated, ()
    if measured.exposure is None:
        if measured.most is None or stated.value < _CONTRADICTED * measured.most:
            return stated, _unchecked(stated, measured)
        taken = _from_blur(measured, sources.fps)
        return taken, (
            f"the clip's blur is at least {stated.value / measured.most:.2g} times shorter than an exposure of"
            f" {_fraction(stated.value)} leaves along its motion; {ms(taken.value)} is taken, --force takes what is given",
        )
    ratio = stated.value / measured.exposure
    if not apart(stated.value, measured.exposure):
        return stated, ()
    if abs(stated.value - measured.exposure) < _CERTAIN * measured.deviation:
        shown = f"its blur shows {ms(measured.exposure)}, give or take {ms(measured.deviation)}"
        return stated, (f"the exposure of {_fraction(stated.value)} is taken as given, though the clip may contradict it: {shown}",)
    times, than = (ratio, "shorter") if ratio > 1 else (1 / ratio, "longer")
    words = f"the clip's blur is {times:.2g} times {than} than an exposure of {_fraction(stated.value)} leaves along its motion"
    if measured.least <= stated.value < measured.exposure:
        return stated, (f"{words}, which softness of lens or codec, or blur from before, explains as well; {ms(stated.value)} is taken",)
    taken = _from_blur(measured, sources.fps)
    return taken, (f"{words}; is it {_fraction(taken.value)}? {ms(taken.value)} is taken, --force takes what is given",)


def _unchecked(stated: Fact[float], measured: Measured) -> tuple[str, ...]:
    """What to know of an exposure that is typed in, of a clip that does not show its own."""
    if stated.value * _CONTRADICTED < measured.least:
        words = f"the clip's blur is at least {measured.least / stated.value:.2g} times longer than softness and an exposure of"
        return (f"{words} {_fraction(stated.value)} leave; is it {_fraction(measured.least)} or longer?",)
    reasons = (each.removeprefix(UNCLEAR_EXPOSURE) for each in measured.unclear if each.startswith(UNCLEAR_EXPOSURE))
    words = f"the exposure of {_fraction(stated.value)} is taken as given, since the clip does not show its own"
    return tuple(f"{words}: {reason}" for reason in reasons)


def apart(one: float, other: float) -> bool:
    """Whether two exposures cannot both be right."""
    return max(one / other, other / one) >= _CONTRADICTED


def _fraction(seconds: float) -> str:
    return f"1/{round(1 / seconds)} s"


def readout_of(given: Camera, sources: Sources) -> tuple[Fact[float] | None, tuple[str, ...]]:
    """How long the frame takes to be read, and what to know of it; None where nobody says it."""
    if (stated := _given_readout(given, sources)) is not None:
        _ = _within_period("readout", stated.value, given, sources)
        return stated, _contrary(stated, given, sources)
    notes: tuple[str, ...] = ()
    found: list[Fact[float]] = []
    for source in (sources.readout, sources.profile_readout, _from_table(sources.table)):
        usable, more = _usable("readout", source, given, sources)
        notes += more
        found += [usable] if usable else []
    if found:
        first, *others = found
        if overruled := _overruled(first, given, sources):
            return overruled[0], (*notes, overruled[1])
        apart = [other for other in others if not _agree(first, other)]
        return first, (
            *notes,
            *_contrary(first, given, sources),
            *(f"readout {ms(first.value)} by {first.source}, but {ms(other.value)} by {other.source}" for other in apart),
        )
    if sources.fps is None:
        return None, notes
    if sources.measured is not None:
        return _from_motion(sources.measured, sources.fps), notes
    return Fact(value=1 / sources.fps, source="frame rate", within=(0.0, 1 / sources.fps)), (
        *notes,
        f"readout {ms(1 / sources.fps)} is only its upper bound, the whole period of a frame: no other source says it;"
        " most cameras read in about half of that; --readout, --camera or --scanlines-total say more",
    )


def _overruled(stated: Fact[float], given: Camera, sources: Sources) -> tuple[Fact[float], str] | None:
    """The readout that the clip shows, where that contradicts what is stated and nobody typed that in; and what to know of it."""
    shown = sources.measured
    if shown is None or shown.contrary is None or given.force or sources.fps is None:
        return None
    taken = _from_motion(shown, sources.fps)
    words = f"one of {ms(taken.value)}: that is taken" if shown.contrary else "none, as if it was stabilised: none is taken"
    return taken, f"a readout of {ms(stated.value)} by {stated.source}, but the clip's motion shows {words}; --readout takes another"


def _contrary(stated: Fact[float], given: Camera, sources: Sources) -> tuple[str, ...]:
    """What to know where the clip shows another readout than what is typed in: that is taken, for a clip may be sheared before."""
    shown, direction = sources.measured or Measured(), direction_of(given, sources).value
    if given.force:
        return ()
    words: tuple[str, ...] = ()
    if shown.contrary:
        words = (f"the clip's motion shows a readout of {ms(shown.contrary)}; is it that? {ms(stated.value)} is taken as given",)
    elif shown.contrary is not None and not shown.stabilised:
        words = (f"the clip's motion shows no readout; was it stabilised? {ms(stated.value)} is taken as given",)
    if shown.stabilised:
        words += (f"the clip's motion does not go on within its frames; was it stabilised? {ms(stated.value)} is taken as given",)
    if shown.direction not in (None, direction):
        words += (f"the clip's motion shows that its readout runs {shown.direction}; is it that? {direction} is taken as given",)
    return words


def _from_motion(measured: Measured, fps: float) -> Fact[float]:
    if measured.readout is None:
        return _mild(fps)
    if spread := 2 * measured.readout_deviation:
        within = max(0.0, measured.readout - spread), measured.readout + spread
        source = "assumed, since the clip's motion shows none" if measured.readout_guessed else "the likeliest by the clip's motion"
        return Fact(value=measured.readout, source=source, within=within, assumed=True)
    return Fact(value=measured.readout, source=_BY_MOTION)


def direction_of(given: Camera, sources: Sources) -> Fact[Direction]:
    """In which direction the readout runs over the stored picture: downwards, if nobody states another."""
    if given.direction is not None:
        return Fact(value=given.direction, source="explicit")
    for stated in (sources.direction, sources.profile_direction):
        if stated is not None:
            return stated
    if sources.table is not None and sources.table.direction is not Direction.TOP_TO_BOTTOM:
        return Fact(value=sources.table.direction, source="public table")
    if sources.measured is not None and sources.measured.direction is not None:
        return Fact(value=sources.measured.direction, source=_BY_MOTION)
    return Fact(value=Direction.TOP_TO_BOTTOM, source="assumed", assumed=True)


def _scanlines(sources: Sources, direction: Direction) -> int:
    return sources.rows if direction.by_row else sources.cols


def readout_typed(given: Camera) -> bool:
    """Whether the request itself states the readout."""
    return any(value is not None for value in _readout_options(given).values())


def _readout_options(given: Camera) -> dict[str, float | None]:
    return {"--readout": given.readout, "--row-time": given.row_time, "--scanlines-total": given.scanlines_total}


def _given_readout(given: Camera, sources: Sources) -> Fact[float] | None:
    options = _readout_options(given)
    chosen = [name for name, value in options.items() if value is not None]
    if len(chosen) > 1:
        if sources.fps is None:
            raise ValueError(f"exactly one of --readout and --row-time must be given, both were given: {' and '.join(chosen)}")
        raise ValueError(f"only one of {', '.join(options)} may be given, got {' and '.join(chosen)}")
    scanlines = _scanlines(sources, direction_of(given, sources).value)
    if given.readout is not None:
        return Fact(value=given.readout, source="explicit")
    if given.row_time is not None:
        readout = scanlines * given.row_time
        if readout > HAND_HELD_LIMIT:
            raise ValueError(
                f"row-time must let {scanlines} rows be read in {HAND_HELD_LIMIT:g} s, got {given.row_time:g} s a row;"
                f" is it in milliseconds or microseconds? that makes {readout:g} s"
            )
        return Fact(value=readout, source="explicit")
    if given.scanlines_total is not None:
        if sources.fps is None:
            raise ValueError("scanlines-total needs a frame rate, a photograph has none; give --readout")
        if given.scanlines_total < scanlines:
            raise ValueError(
                f"scanlines-total must be at least the {scanlines} that are stored, got {given.scanlines_total};"
                " it counts blanking lines too; was the clip scaled?"
            )
        row_time = 1 / (sources.fps * given.scanlines_total)  # Forssen & Ringaby: 1/f = rows t_r + t_d
        return Fact(value=scanlines * row_time, source=f"frame rate and {given.scanlines_total} total scanlines")
    return None


def _from_table(table: Readout | None) -> Fact[float] | None:
    if table is None:
        return None
    source = f"public table, the median of {table.n} owner{'s' if table.n > 1 else ''} for {table.mode}"
    return Fact(value=table.median, source=source, within=(table.low, table.high) if table.n > 1 else None)


def _usable(name: str, stated: Fact[float] | None, given: Camera, sources: Sources) -> tuple[Fact[float] | None, tuple[str, ...]]:
    """A source's answer if it can be, else a note that it was passed over."""
    if stated is None:
        return None, ()
    try:
        return replace(stated, value=_within_period(name, hand_held(name, stated.value, zero=name == "readout"), given, sources)), ()
    except ValueError as error:
        return None, (f"passed over what {stated.source} says: {error}",)


def _within_period(name: str, value: float, given: Camera, sources: Sources) -> float:
    if sources.fps is None or given.force or value * sources.fps <= 1 + PERIOD_SLACK:
        return value
    slip = (
        "is it in milliseconds?" if value * 1e-3 * sources.fps <= 1 else "is the clip slowed down or sped up? --force takes it all the same"
    )
    raise ValueError(f"{name} must be at most one frame's period, {ms(1 / sources.fps)} at {sources.fps:.5g} fps, got {ms(value)}; {slip}")


def _agree(one: Fact[float], other: Fact[float]) -> bool:
    low, high = other.within or (other.value, other.value)
    return low - _APART * one.value <= one.value <= high + _APART * one.value


def ms(seconds: float) -> str:
    """A time in words."""
    return f"{seconds * 1e3:.4g} ms" if math.isfinite(seconds) else f"{seconds} s"
