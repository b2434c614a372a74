"""The nouns of clips: what a stream is, how its codes stand for colour, and one picture of it."""

import enum
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import numpy as np
from jaxtyping import Int

from rsvideo.physics.tone import Tone


class Matrix(enum.StrEnum):
    """How Y, U and V are mixed from red, green and blue."""

    RGB = "rgb"  # not mixed
    BT601 = "bt601"
    BT709 = "bt709"
    BT2020 = "bt2020nc"  # non-constant luminance


_LAYOUT = re.compile(r"(?P<kind>yuvj?|gbr|gray)(?P<chroma>\d{3})?p?(?P<bits>9|10|12|14|16|f32)?(le)?")


@dataclass(frozen=True, kw_only=True)
class Colour:
    """What the codes of a stream mean. `assumed` names the facts that the stream does not say."""

    matrix: Matrix
    transfer: Tone
    primaries: str  # of H.273, as FFmpeg spells them; carried, never applied
    full_range: bool
    depth: int  # bits a sample; 32 is floating point, where codes are light already
    subsampling: str  # "4:2:0", "4:2:2", "4:4:4", ... or "4:0:0" for grey
    pixel_format: str  # FFmpeg's name of the planes
    chroma_shift: tuple[int, int] = (0, 0)  # log2 of luma rows and columns per chroma sample
    assumed: frozenset[str] = frozenset()  # of "matrix", "transfer", "primaries", "full_range"
    h273: tuple[int, int, int, int] = (2, 2, 2, 0)  # primaries, transfer, matrix, and FFmpeg's range as stored; 2 and 0: not stated
    saturation: float | None = None  # R'G'B' from which on the camera was full, where that is given; 1 is nominal white

    @property
    def note(self) -> str:
        """Every fact, and whether the stream says it."""
        facts = {
            "matrix": self.matrix.value,
            "transfer": self.transfer.value,
            "primaries": self.primaries,
            "full_range": "full range" if self.full_range else "limited range",
        }
        words = [f"{value} ({'assumed' if name in self.assumed else 'tagged'})" for name, value in facts.items()]
        return f"{self.depth} bit {self.subsampling}, " + ", ".join(words)

    @property
    def floating(self) -> bool:
        """Whether the planes hold floating point."""
        return self.pixel_format.removesuffix("le").endswith("f32")

    @property
    def top(self) -> int:
        """The largest code."""
        return (1 << self.depth) - 1


_SHIFT = {"420": (1, 1), "422": (0, 1), "444": (0, 0), "440": (1, 0), "411": (0, 2), "410": (2, 2)}


def planar(pixel_format: str) -> tuple[int, str, tuple[int, int]] | None:
    """Depth, subsampling and chroma shift of a layout that pictures are handed over in; None of any other."""
    if not (found := _LAYOUT.fullmatch(pixel_format)) or (found["chroma"] is None) == found["kind"].startswith("yuv"):
        return None
    depth = {"f32": 32, None: 8}.get(found["bits"]) or int(found["bits"])
    chroma = found["chroma"] or ("444" if found["kind"] == "gbr" else "400")
    return (depth, ":".join(chroma), _SHIFT.get(chroma, (0, 0))) if chroma in {**_SHIFT, "400": 0} else None


@dataclass(frozen=True, kw_only=True)
class Track:
    """Another track of the file: sound, subtitles, data."""

    index: int
    kind: str  # "audio", "subtitle", "data", "video", "attachment"
    codec: str
    copied: bool  # whether a writer can carry it over unchanged
    name: str = ""  # how people call it


@dataclass(frozen=True, kw_only=True, eq=False)
class Stream:
    """The video of a file or a folder, in sensor order: rows and columns are as coded, display rotation is carried only."""

    path: Path
    codec: str
    rows: int
    cols: int
    rate: Fraction  # pictures a second, as stated or on average
    time_base: Fraction  # seconds
    times: Int[np.ndarray, " frames"]  # pts of every picture, in time_base, rising; counted from the packets, and perhaps before 0
    end: int  # pts at which the last picture ends
    colour: Colour
    index: int = 0  # of the track in its file
    keys: Int[np.ndarray, " keys"] = field(default_factory=lambda: np.zeros(0, np.int64))  # pts of the pictures that need no other, rising
    bits: float = math.inf  # for each px of a picture's side, the root of its pixels, of those that are no key pictures; the mean, weighted
    # by themselves, so that pictures of a camera that stands still count little; infinite where all are key pictures
    mended: Mapping[int, int] = field(default_factory=dict)  # pts in place of the stated ones, by the byte at which a packet begins
    rotation: int = 0  # degrees counter-clockwise, as the display matrix says
    display_matrix: tuple[int, ...] | None = None  # nine numbers, as MOV and FFmpeg store them
    sample_aspect_ratio: Fraction = Fraction(1)
    tracks: tuple[Track, ...] = ()
    metadata: Mapping[str, str] = field(default_factory=dict)  # of the file
    tags: Mapping[str, str] = field(default_factory=dict)  # of the video track
    timecode: str | None = None
    created: str | None = None  # ISO 8601
    mastering: tuple[str, ...] = ()  # of HDR10: the display it was graded on and its brightest light, as x265 writes them
    files: tuple[Path, ...] = ()  # of a sequence, one a picture
    bare: bool = False  # whether the file holds planes one after the other, without any header
    notes: tuple[str, ...] = ()  # what the reader should know was not taken over

    @property
    def frames(self) -> int:
        """How many pictures there are."""
        return len(self.times)

    @property
    def duration_s(self) -> float:
        """Seconds from the first picture to the end of the last."""
        return float((self.end - int(self.times[0])) * self.time_base)

    @property
    def interval_s(self) -> float:
        """The usual time from one picture to the next in seconds: the median, which dropped pictures do not move."""
        return float(np.median(np.diff(self.times)) * float(self.time_base)) if self.frames > 1 else float(1 / self.rate)

    @property
    def variable(self) -> bool:
        """Whether the time between pictures varies by more than the time base's rounding."""
        steps = np.diff(self.times)
        return bool(len(steps) and steps.max() - steps.min() > 1)

    def seconds(self, index: int) -> float:
        """When a picture is shown, counted from the first."""
        return float((int(self.times[index]) - int(self.times[0])) * self.time_base)

    def spacing(self, index: int) -> int:
        """How long a picture is shown, in time_base."""
        following = self.times[index + 1] if index + 1 < self.frames else self.end
        return int(following) - int(self.times[index])


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """One picture as coded: planes in native layout, and when it is shown."""

    planes: tuple[np.ndarray, ...]  # Y, U, V or R, G, B or one grey; uint8 or uint16, float32 for floating-point files
    index: int
    pts: int  # in the stream's time_base
    duration: int  # in the stream's time_base
    time: float  # seconds since the first picture's pts
    damaged: bool = False  # it, or one that it may depend on, could not be decoded as it was meant
