"""Which shutter timing a clip's frames have, and who said so.

The first that answers wins, for the exposure and for the readout each: what was asked for, what the clip itself says, the camera's profile,
the public table, an estimate from the clip, and for the readout at last the frame rate. Total scanlines, given, are the paper's way, after
Forssen & Ringaby (CVPR 2010): a frame's period 1/f is its readout and an inter-frame delay t_d, during which the sensor goes through the
motions of reading rows that are not stored, so that t_r = 1 / (f * scanlines_total), with rows = scanlines_total - t_d / t_r stored.
Without that number t_d is taken as 0, which makes t_r an upper bound: cameras read in about half of that, typically.
"""

import math
from dataclasses import dataclass, replace

from rsvideo.config.quantity import hand_held
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.shooting.fact import Fact
from rsvideo.shooting.readout_table import PERIOD_SLACK, Readout

_APART = 0.05  # of a readout; sources that differ by more are told
_UPRIGHT = (Direction.TOP_TO_BOTTOM, Direction.BOTTOM_TO_TOP)


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What the user said; None leaves the answer to other sources."""

    exposure: float | None = None  # seconds; this or shutter_angle
    shutter_angle: float | None = None  # degrees of a frame's period
    readout: float | None = None  # seconds; this, row_time or scanlines_total
    row_time: float | None = None  # seconds
    scanlines_total: int | None = None  # visible and blanking
    direction: Direction | None = None
    force: bool = False  # take times longer than a frame's period too


@dataclass(frozen=True, kw_only=True)
class Known:
    """What other sources say; None where they do not."""

    rows: int  # as stored
    cols: int
    fps: float | None = None  # None: a photograph
    exposure: Fact[float] | None = None  # seconds; by the clip's metadata
    readout: Fact[float] | None = None
    direction: Fact[Direction] | None = None
    profile_readout: Fact[float] | None = None  # by the camera's profile
    profile_direction: Fact[Direction] | None = None
    table: Readout | None = None  # of published times
    estimated_readout: Fact[float] | None = None  # from the clip's own pictures
    estimated_direction: Fact[Direction] | None = None


@dataclass(frozen=True, kw_only=True)
class Resolved:
    """The timing of a clip's frames, with the source of each part."""

    timing: ShutterTiming
    exposure: Fact[float]  # seconds
    readout: Fact[float]  # seconds
    direction: Fact[Direction]
    notes: tuple[str, ...]  # what the user should know before the work

    @property
    def source(self) -> str:
        """Who said so, in one line."""
        if self.exposure.source == self.readout.source:
            return self.exposure.source
        return f"exposure: {self.exposure.source}; readout: {self.readout.source}"


def resolve(asked: Asked, known: Known) -> Resolved:
    """The timing that the first sources give; ValueError where none does or where what they say cannot be."""
    exposure, notes = exposure_of(asked, known)
    direction = direction_of(asked, known)
    readout, more = readout_of(asked, known)
    if exposure is None:
        raise ValueError(
            "exposure must be given, the clip does not say it; --exposure 1/50 is a time, --shutter-angle 180 half of a frame's period"
        )
    if readout is None:
        raise ValueError(
            "readout must be given, a photograph has no frame rate to bound it by; --readout 20ms is a time, 0 a global shutter"
        )
    timing = ShutterTiming.from_readout(
        exposure=exposure.value, readout=readout.value, rows=_scanlines(known, direction.value), direction=direction.value
    )
    return Resolved(timing=timing, exposure=exposure, readout=readout, direction=direction, notes=notes + more)


def exposure_of(asked: Asked, known: Known) -> tuple[Fact[float] | None, tuple[str, ...]]:
    """How long each row collects light, and what to know of it; None where nobody says it."""
    if asked.exposure is not None and asked.shutter_angle is not None:
        raise ValueError(
            f"only one of --exposure and --shutter-angle may be given, got {asked.exposure:g} s and {asked.shutter_angle:g} degrees"
        )
    if asked.exposure is not None:
        return Fact(
            value=_within_period("exposure", hand_held("exposure", asked.exposure, zero=False), asked, known), source="explicit"
        ), ()
    if asked.shutter_angle is not None:
        return Fact(value=_from_angle(asked.shutter_angle, known.fps), source=f"shutter angle of {asked.shutter_angle:g} degrees"), ()
    return _usable("exposure", known.exposure, asked, known)


def readout_of(asked: Asked, known: Known) -> tuple[Fact[float] | None, tuple[str, ...]]:
    """How long the frame takes to be read, and what to know of it; None where nobody says it."""
    if (said := _asked_readout(asked, known)) is not None:
        _ = _within_period("readout", said.value, asked, known)
        return said, ()
    notes: tuple[str, ...] = ()
    found: list[Fact[float]] = []
    for source in (known.readout, known.profile_readout, _from_table(known.table), known.estimated_readout):
        usable, more = _usable("readout", source, asked, known)
        notes += more
        found += [usable] if usable else []
    if found:
        first, *others = found
        apart = [other for other in others if not _agree(first, other)]
        told = [f"readout {_ms(first.value)} by {first.source}, but {_ms(other.value)} by {other.source}" for other in apart]
        return first, notes + tuple(told)
    if known.fps is None:
        return None, notes
    return Fact(value=1 / known.fps, source="frame rate", within=(0.0, 1 / known.fps)), (
        *notes,
        f"readout {_ms(1 / known.fps)} is only its upper bound, the whole period of a frame: no other source says it;"
        " most cameras read in about half of that; --readout, --camera or --scanlines-total say more",
    )


def direction_of(asked: Asked, known: Known) -> Fact[Direction]:
    """The way the readout runs over the stored picture: downwards, if nobody says otherwise."""
    if asked.direction is not None:
        return Fact(value=asked.direction, source="explicit")
    for said in (known.direction, known.profile_direction):
        if said is not None:
            return said
    if known.table is not None and known.table.direction is not Direction.TOP_TO_BOTTOM:
        return Fact(value=known.table.direction, source="public table")
    return known.estimated_direction or Fact(value=Direction.TOP_TO_BOTTOM, source="assumed")


def _scanlines(known: Known, direction: Direction) -> int:
    return known.rows if direction in _UPRIGHT else known.cols


def _asked_readout(asked: Asked, known: Known) -> Fact[float] | None:
    given = {"--readout": asked.readout, "--row-time": asked.row_time, "--scanlines-total": asked.scanlines_total}
    chosen = [name for name, value in given.items() if value is not None]
    if len(chosen) > 1:
        raise ValueError(f"only one of {', '.join(given)} may be given, got {' and '.join(chosen)}")
    scanlines = _scanlines(known, direction_of(asked, known).value)
    if asked.readout is not None:
        return Fact(value=hand_held("readout", asked.readout, zero=True), source="explicit")
    if asked.row_time is not None:
        slip = f"row-time must let {scanlines} rows be read in 1 s, got {asked.row_time:g} s a row; is it in milliseconds or microseconds?"
        if not 0 <= scanlines * asked.row_time <= 1:
            raise ValueError(slip)
        return Fact(value=scanlines * asked.row_time, source="explicit")
    if asked.scanlines_total is not None:
        if known.fps is None:
            raise ValueError("scanlines-total needs a frame rate, a photograph has none; give --readout")
        if asked.scanlines_total < scanlines:
            raise ValueError(
                f"scanlines-total must be at least the {scanlines} that are stored, got {asked.scanlines_total};"
                " it counts blanking lines too; was the clip scaled?"
            )
        row_time = 1 / (known.fps * asked.scanlines_total)  # Forssen & Ringaby: 1/f = rows t_r + t_d
        return Fact(value=scanlines * row_time, source=f"frame rate and {asked.scanlines_total} total scanlines")
    return None


def _from_angle(angle: float, fps: float | None) -> float:
    if not 0 < angle <= 360:
        slip = "is it a time? then it is --exposure" if 0 < angle < 1 or angle > 360 else "no light is collected in no time"
        raise ValueError(f"shutter-angle must lie in (0, 360] degrees, got {angle:g}; {slip}")
    if fps is None:
        raise ValueError("shutter-angle needs a frame rate, a photograph has none; give --exposure")
    return angle / 360 / fps


def _from_table(table: Readout | None) -> Fact[float] | None:
    if table is None:
        return None
    source = f"public table, the median of {table.n} owner{'s' if table.n > 1 else ''} for {table.mode}"
    return Fact(value=table.median, source=source, within=(table.low, table.high) if table.n > 1 else None)


def _usable(name: str, said: Fact[float] | None, asked: Asked, known: Known) -> tuple[Fact[float] | None, tuple[str, ...]]:
    """A source's answer if it can be, else a note that it was passed over."""
    if said is None:
        return None, ()
    try:
        return replace(said, value=_within_period(name, hand_held(name, said.value, zero=name == "readout"), asked, known)), ()
    except ValueError as error:
        return None, (f"passed over what {said.source} says: {error}",)


def _within_period(name: str, value: float, asked: Asked, known: Known) -> float:
    if known.fps is None or asked.force or value * known.fps <= 1 + PERIOD_SLACK:
        return value
    slip = (
        "is it in milliseconds?" if value * 1e-3 * known.fps <= 1 else "is the clip slowed down or sped up? --force takes it all the same"
    )
    raise ValueError(f"{name} must be at most one frame's period, {_ms(1 / known.fps)} at {known.fps:.5g} fps, got {_ms(value)}; {slip}")


def _agree(one: Fact[float], other: Fact[float]) -> bool:
    low, high = other.within or (other.value, other.value)
    return low - _APART * one.value <= one.value <= high + _APART * one.value


def _ms(seconds: float) -> str:
    return f"{seconds * 1e3:.4g} ms" if math.isfinite(seconds) else f"{seconds} s"
