"""What a clip states of how it was shot: in its container's tags, in what its maker embedded, in the EXIF of a sequence's first file."""

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from rsvideo.config.files import UnreadableError, read_whole
from rsvideo.config.quantity import seconds
from rsvideo.shooting.fact import Fact
from rsvideo.stills import exif
from rsvideo.stills.codes import MOST_BYTES
from rsvideo.video import telemetry
from rsvideo.video.stream import Stream
from rsvideo.video.telemetry import MOST_CHARACTERS

_STEADY = 0.1  # by which an exposure may vary over a clip without a word
_CLOCK = re.compile(r"time ?code|tmcd|tcd", re.IGNORECASE)  # names of tracks that hold time codes alone
_TAGS = {  # the last parts of tags' names, without case, blanks and underscores, best first
    "make": ("make", "manufacturer"),
    "model": ("model", "cameramodel", "cameramodelname", "cameratype"),
    "exposure": ("exposuretime", "shutterspeed"),
    "angle": ("shutterangle",),
    "iso": ("iso", "isospeed", "exposureindexasa"),
    "focal": ("35mmequivalent", "focallengthin35mmfilm"),
    "rate": ("capturefps", "sensorfps"),
    "captured": ("creationdate", "creationtime", "datetimeoriginal", "date"),
}


@dataclass(frozen=True, kw_only=True)
class ClipFacts:
    """How a clip was shot; None where it does not say."""

    make: Fact[str] | None = None
    model: Fact[str] | None = None
    exposure: Fact[float] | None = None  # seconds; `within` spans the clip's frames
    readout: Fact[float] | None = None  # seconds
    frame_rate: Fact[float] | None = None  # of the recording, which a clip in slow motion is not played at
    iso: Fact[float] | None = None
    focal_35mm: Fact[float] | None = None  # the equivalent on 36 x 24 mm
    captured: Fact[str] | None = None
    notes: tuple[str, ...] = ()

    @property
    def camera(self) -> str | None:
        """Maker and model, as tables are searched."""
        words = [fact.value for fact in (self.make, self.model) if fact is not None]
        return " ".join(words) if self.model is not None else None

    def focal_px(self, rows: int, cols: int) -> float | None:
        """The focal length in pixels of an uncropped picture."""
        return exif.Capture(focal_35mm=self.focal_35mm.value).focal_px(rows, cols) if self.focal_35mm else None


def read(stream: Stream) -> ClipFacts:
    """What a clip that was probed states; by a maker's data first, then by tags. Nothing raises: what is damaged states nothing."""
    if stream.files:
        return _of_sequence(stream.files[0])
    tags = _of_tags({**stream.metadata, **stream.tags}, float(stream.rate))
    made, notes = _embedded(stream)
    rate = tags.frame_rate
    if rate is not None and abs(rate.value * float(stream.interval_s) - 1) > _STEADY:
        played = f"played at {float(stream.rate):.5g}: its times are those of the recording, give them explicitly"
        notes += (f"recorded at {rate.value:.5g} fps and {played}",)
    return ClipFacts(
        make=made.make or tags.make or _handled(stream),
        model=made.model or tags.model,
        exposure=made.exposure or tags.exposure,
        readout=made.readout,
        frame_rate=rate,
        iso=made.iso or tags.iso,
        focal_35mm=tags.focal_35mm,
        captured=tags.captured,
        notes=notes,
    )


def _of_sequence(path: Path) -> ClipFacts:
    try:
        found = exif.capture(read_whole(path, most=MOST_BYTES))
    except UnreadableError as error:
        return ClipFacts(notes=(str(error),))
    source = f"EXIF of {path.name}"
    return ClipFacts(
        model=Fact(value=found.camera, source=source) if found.camera else None,
        exposure=Fact(value=found.exposure, source=source) if found.exposure else None,
        focal_35mm=Fact(value=found.focal_35mm, source=source) if found.focal_35mm else None,
    )


def _of_tags(tags: Mapping[str, str], rate: float) -> ClipFacts:
    exposure = next(_numbers(tags, "exposure", _time), None)
    if exposure is None and (angle := next(_numbers(tags, "angle", _number), None)) and angle.value <= 360:
        exposure = Fact(value=angle.value / 360 / rate, source=angle.source)
    return ClipFacts(
        make=next(_words(tags, "make"), None),
        model=next(_words(tags, "model"), None),
        exposure=exposure,
        frame_rate=next(_numbers(tags, "rate", _number), None),
        iso=next(_numbers(tags, "iso", _number), None),
        focal_35mm=next(_numbers(tags, "focal", _number), None),
        captured=next(_words(tags, "captured"), None),
    )


def _words(tags: Mapping[str, str], fact: str) -> Iterator[Fact[str]]:
    """What tags say of a fact, the best first."""
    for name in _TAGS[fact]:
        for key, value in tags.items():
            parts = re.sub(r"-[a-z]{3}$|[ _]", "", key.lower()).split(".")
            text = value.strip()[:MOST_CHARACTERS]
            if any("".join(parts[start:]) == name for start in range(len(parts))) and text and text.isprintable():
                yield Fact(value=text, source=f"the clip's tag {key[:MOST_CHARACTERS]}")


def _numbers(tags: Mapping[str, str], fact: str, number: Callable[[str], float]) -> Iterator[Fact[float]]:
    for text in _words(tags, fact):
        if 0 < (value := number(text.value)) < math.inf:
            yield Fact(value=value, source=text.source)


def _time(text: str) -> float:
    try:
        return seconds("exposure", text)
    except ValueError:
        return math.nan


def _number(text: str) -> float:
    try:
        return float(text.rstrip("°").removesuffix("mm").strip())
    except ValueError:
        return math.nan


def _embedded(stream: Stream) -> tuple[ClipFacts, tuple[str, ...]]:
    """What the maker embedded, and what to know of it."""
    if not any(track.kind == "data" and not _CLOCK.search(track.name) for track in stream.tracks):
        return ClipFacts(), ()
    try:
        found = telemetry.read(stream.path)
    except telemetry.UnavailableError as error:
        return ClipFacts(), (f"its data tracks are not read: {error}",)
    source = f"{found.make}'s telemetry" if found.make else "embedded telemetry"
    notes: tuple[str, ...] = ()
    exposure = None
    if found.exposure is not None:
        least, median, most = found.exposure
        exposure = Fact(value=median, source=source, within=(least, most))
        if most > least * (1 + _STEADY):
            notes += (f"exposure varies from {least * 1e3:.3g} to {most * 1e3:.3g} ms over the clip; its median is taken",)
    if found.stabilised:
        notes += ("the camera stabilised the clip itself: its rows no longer stand where and when they were exposed",)
    return ClipFacts(
        make=Fact(value=found.make, source=source) if found.make else None,
        model=Fact(value=found.model, source=source) if found.model else None,
        exposure=exposure,
        readout=Fact(value=found.readout, source=source) if found.readout else None,
        iso=Fact(value=found.iso, source=source) if found.iso else None,
    ), notes


def _handled(stream: Stream) -> Fact[str] | None:
    """The maker, where only the name of a track gives it away."""
    for track in (stream.tags.get("handler_name", ""), *(track.name for track in stream.tracks)):
        if "gopro" in track.lower():
            return Fact(value="GoPro", source="the name of a track")
    return None
