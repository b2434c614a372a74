"""The request for one photograph or clip: every option with its type, unit, bounds, default and words, once.

The command line, the sections of a job's file and its JSON Schema are made from these models. A new option is a field here,
and the place that uses it.
"""

from collections.abc import Iterable, Mapping
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticUndefined

from rsvideo.config import media, option
from rsvideo.config.address import Origin
from rsvideo.config.media import Codec
from rsvideo.config.method import Method
from rsvideo.config.option import Option, OptionField
from rsvideo.config.quantity import frame_rate
from rsvideo.config.units import Angle, CurveName, Pixels, Range, Rate, Size, Time, TimeOrZero
from rsvideo.physics.shutter import Direction

_RIVALS = ({"readout", "row_time", "scanlines_total"}, {"exposure", "shutter_angle"})  # one of them answers for the others


class Section(BaseModel):
    """A group of options; a word that is none of them is refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _null_is_the_default(cls, data: Any) -> Any:
        """In YAML a key without a value takes back what an earlier layer says."""
        if not isinstance(data, dict):
            return data
        defaults = {name: field.default for name, field in cls.model_fields.items() if field.default is not PydanticUndefined}
        return {name: defaults.get(name) if value is None else value for name, value in data.items()}


class Input(Section):
    """What is read."""

    range: Annotated[
        Range | None, Option(help="The part that is restored, such as 00:10-00:12.", metavar="FROM-TO", unless="all of it", clips_only=True)
    ] = None
    rate: Annotated[
        Rate | None,
        Option(
            help="Of a folder of pictures, or of a pipe that does not state it: frames a second, 25 or 24000/1001.",
            metavar="FPS",
            unless="as CinemaDNG states it",
            clips_only=True,
        ),
    ] = None
    on_damage: Annotated[
        Literal["fail", "passthrough", "skip"],
        Option(help="What becomes of damaged frames, which cannot be decoded whole.", clips_only=True),
    ] = "fail"

    @property
    def frame_rate(self) -> Fraction | None:
        """Of a sequence of pictures, as far as it is stated."""
        return None if self.rate is None else frame_rate(self.rate)


class Camera(Section):
    """When each row collects light, and through which lens. What is left out is taken from the file, as far as it says it."""

    profile: Annotated[
        str | None,
        Option(
            help="A measured camera mode, by name or as a file; of a clip, also a camera of the public table.",
            metavar="NAME|FILE",
            named="--camera",
            is_file=True,
        ),
    ] = None
    exposure: Annotated[
        Time | None,
        Option(help="How long each row collects light: 1/50, 20ms, 0.02.", metavar="TIME", unless="from the file's metadata, as EXIF"),
    ] = None
    shutter_angle: Annotated[
        Angle | None, Option(help="Degrees of a frame's period, instead of the exposure.", metavar="DEGREES", clips_only=True)
    ] = None
    readout: Annotated[
        TimeOrZero | None, Option(help="From the first row's opening to the last one's; 0 is a global shutter.", metavar="TIME")
    ] = None
    row_time: Annotated[
        TimeOrZero | None, Option(help="From one stored row's opening to the next one's, instead of the readout.", metavar="TIME")
    ] = None
    scanlines_total: Annotated[
        int | None,
        Field(ge=1, le=1_000_000),
        Option(help="Visible and blanking lines, instead of the readout: row time is 1 / (frame rate * N).", metavar="N", clips_only=True),
    ] = None
    direction: Annotated[
        Direction | None, Option(help="In which direction the readout runs over the picture as stored.", unless="top-to-bottom")
    ] = None
    focal_px: Annotated[
        Pixels | None, Option(help="Focal length in pixels.", metavar="PX", unless="from the file's metadata, as EXIF's 35 mm equivalent")
    ] = None
    transfer: Annotated[
        CurveName | None,
        Option(
            help="How codes stand for light, by the standard's name: srgb, bt709, s-log3, ...",
            metavar="CURVE",
            unless="the clip's tag, or srgb",
            many=True,
        ),
    ] = None
    force: Annotated[bool, Option(help="Take times longer than a frame's period, too.", clips_only=True)] = False


class Motion(Section):
    """How the camera's path is found, and which path the result follows."""

    model: Annotated[Literal["rotation", "shift"], Option(help="All three angles, or the paper's shift.", named="--motion")] = "rotation"
    degree: Annotated[int, Field(ge=1, le=12), Option(help="Of the trajectory's polynomial.")] = 4
    start: Annotated[Literal["spectra", "kernels", "tracing"], Option(help="What the first trajectory is found from.")] = "spectra"
    refinement: Annotated[
        Literal["sparsity", "alternation"],
        Option(help="Of it, where a frame stands alone: latent image eliminated, or the paper's Algorithm 1."),
    ] = "sparsity"
    trajectory: Annotated[
        Path | None,
        Option(
            help="A file with the motion, which is then not estimated: of rsvideo track, a sidecar, CSV of t_s,pitch_rad,yaw_rad,roll_rad.",
            metavar="FILE",
            is_file=True,
        ),
    ] = None
    gyro: Annotated[
        Path | None,
        Option(
            help="A gyroscope's log (.gcsv, CSV, t_ns wx wy wz), for the methods gyro and gyro+refine.",
            metavar="FILE",
            unless="what the clip embeds",
            is_file=True,
        ),
    ] = None
    gyro_offset: Annotated[
        float | None,
        Field(ge=-1e6, le=1e6),
        Option(help="Seconds, what the clip's time becomes the log's by adding.", metavar="SECONDS", unless="found"),
    ] = None
    gyro_axes: Annotated[
        str | None,
        Field(pattern="^[XYZxyz]{3}$"),
        Option(help="The gyroscope's axes along the camera's right, down and forward.", metavar="XYZ", unless="found"),
    ] = None
    path: Annotated[Literal["keep", "smooth"], Option(help="The camera's own path, or a smooth one, with a crop.", clips_only=True)] = (
        "keep"
    )

    @property
    def states_gyro(self) -> bool:
        """Whether anything is stated of a gyroscope's log."""
        return (self.gyro, self.gyro_offset, self.gyro_axes) != (None, None, None)


class Deblur(Section):
    """How the sharp picture is found."""

    method: Annotated[Method, Option(help="This project's, or one that it is compared with; none decodes and encodes only.")] = (
        Method.RSVIDEO
    )
    block_rows: Annotated[
        int | None, Field(ge=16, le=100_000), Option(help="Rows of a block of the method stitch.", unless="a third of the frame")
    ] = None
    frames: Annotated[
        Literal["together", "alone", "cold"],
        Option(help="Restored with their neighbours, along the clip's path only, or each as a still.", clips_only=True),
    ] = "together"
    prior: Annotated[Literal["denoiser", "tv"], Option(help="What a sharp picture is taken to look like.")] = "denoiser"
    quality: Annotated[Literal["draft", "normal", "best"], Option(help="How much work a frame gets: seconds against decibels.")] = "normal"
    device: Annotated[
        Literal["auto", "cpu", "cuda"], Option(help="What restores; auto takes an NVIDIA GPU if the extra gpu finds one.")
    ] = "auto"


class Encoding(Section):
    """How the result is written; what is left out is as in the source."""

    codec: Annotated[Codec, Option(help="png, tiff and exr write folders of pictures.", clips_only=True)] = "same"
    crf: Annotated[
        float | None, Field(ge=0, le=63), Option(help="Constant rate factor of h264 and hevc.", unless="visually lossless", clips_only=True)
    ] = None
    pixel_format: Annotated[
        str,
        Field(pattern=r"^\w+$"),
        Option(
            help="By FFmpeg's name, such as yuv422p10le; of --format rawvideo, as INPUT and as OUTPUT.", metavar="NAME", clips_only=True
        ),
    ] = "same"
    side_by_side: Annotated[bool, Option(help="The source on the left, the result on the right.", clips_only=True)] = False


class Pipe(Section):
    """What standard input or output carries, where INPUT or OUTPUT is `-`."""

    format: Annotated[media.Pipe, Option(help="Of a pipe: y4m, or bare pixels.", clips_only=True)] = "y4m"
    size: Annotated[
        Size | None, Option(help="Of bare pixels as INPUT: columns and rows, 1920x1080.", metavar="COLSxROWS", clips_only=True)
    ] = None
    matrix: Annotated[
        Literal["bt601", "bt709", "bt2020nc"] | None,
        Option(help="Of a pipe as INPUT: how Y, U and V are mixed.", unless="by the size, as players do", clips_only=True),
    ] = None


class Sections(Section):
    """All options, in their sections."""

    input: Input = Input()
    camera: Camera = Camera()
    motion: Motion = Motion()
    deblur: Deblur = Deblur()
    encoding: Encoding = Encoding()
    pipe: Pipe = Pipe()

    @classmethod
    def layered(cls, layers: Iterable["Sections"]) -> "Sections":
        """The later layers over the earlier ones; one of several options for the same quantity takes the place of the others."""
        merged: dict[str, dict[str, Any]] = {}
        for layer in layers:
            for section, given in layer.stated().items():
                out = set().union(*(rivals for rivals in _RIVALS if any(given.get(name) is not None for name in rivals)))
                merged[section] = {name: value for name, value in merged.get(section, {}).items() if name not in out} | given
        return Sections.model_validate(merged)

    def stated(self) -> dict[str, dict[str, Any]]:
        """What was given a value, section by section."""
        sections = (name for name in Sections.model_fields if name in self.model_fields_set)
        return {name: getattr(self, name).model_dump(exclude_unset=True) for name in sections}

    def of_clips(self) -> list[OptionField]:
        """The options that concern clips only and do not have their default."""
        return [each for each in option_fields() if each.option.clips_only and self.value(each) != each.field.default]

    def without_clips_options(self) -> "Sections":
        """The options that concern photographs too."""
        clips_only = {(each.section, each.name) for each in option_fields() if each.option.clips_only}
        stated = self.stated().items()
        return Sections.model_validate(
            {section: {name: value for name, value in given.items() if (section, name) not in clips_only} for section, given in stated}
        )

    def files_beside(self, folder: Path) -> "Sections":
        """The same with files' paths, which are relative to a folder; a camera may be named as well as its file."""
        stated = self.stated()
        for each in option_fields():
            value = stated.get(each.section, {}).get(each.name)
            if each.option.is_file and value is not None and (each.types[0] is Path or (folder / value).is_file()):
                stated[each.section][each.name] = str(folder / value)
        return Sections.model_validate(stated)

    def value(self, field: OptionField) -> Any:
        """Of one option."""
        return getattr(getattr(self, field.section), field.name)


class Measured(BaseModel):
    """What was measured from a clip's own frames."""

    model_config = ConfigDict(frozen=True)

    exposure: float | None = None  # s, as blur shows it, with softness where that cannot be separated; None where it does not
    deviation: float = 0.0  # s
    sharp: float | None = None  # s, of this exposure, without softness; None: all of it
    most: float | None = None  # s, of an exposure that blur does not show; None where it does not even show that
    blur: float | None = None  # px, that this exposure leaves in the middle one of the frames it was measured from
    least: float = 0.0  # s, of an exposure, whatever of the blur may be softness
    readout: float | None = None  # s; 0 where motion shows none, None where too few points show any, or nobody had to measure it
    readout_deviation: float = 0.0  # s, of a readout that is likeliest and too uncertain for an answer, or of none; 0 of any other
    direction: Direction | None = None  # of the readout, where motion plainly shows another one than is stated or usual
    contrary: float | None = None  # s, a readout that the clip shows against the one that is stated; 0: none
    stabilised: bool = False  # whether motion shows that the frames were shifted after they were read
    focal: float | None = None  # px; None where nobody had to measure it, or no points could be followed
    focal_deviation: float = 0.0  # of its logarithm
    unclear: tuple[str, ...] = ()  # why what is None, or uncertain, could not be measured

    @property
    def readout_guessed(self) -> bool:
        """Whether nobody states the readout, and the clip shows not even a likely one: it may be anything, and 0 or unknown here."""
        return self.readout is None or (self.readout == 0 and self.readout_deviation > 0)


class Request(Sections):
    """One photograph or clip, what it becomes, and how."""

    source: Path
    output: Path
    overwrite: bool = False
    motion_only: bool = False  # OUTPUT is the motion's sidecar, and no picture is written
    preview: bool = False  # OUTPUT is a picture of one frame, and no sidecar is written
    measured: Measured | None = None  # once the request is prepared
    origin: Origin | None = None  # the object that the source is a copy of

    @classmethod
    def of(cls, source: Path, output: Path, sections: Sections, *, overwrite: bool = False, origin: Origin | None = None) -> "Request":
        """The request for one source."""
        return cls.model_validate({"source": source, "output": output, "overwrite": overwrite, "origin": origin, **sections.stated()})

    @property
    def named(self) -> str:
        """What people call the source: its address, or its path."""
        return self.origin.address if self.origin else str(self.source)

    @property
    def is_clip(self) -> bool:
        """Whether the source is taken for a clip, not for a photograph."""
        return media.is_clip(self.source)

    @property
    def record(self) -> Path:
        """Where the sidecar goes."""
        return self.output.with_suffix(".rsvideo.json")

    @property
    def log(self) -> Path:
        """Where the motion of a clip goes as a gyroscope's log."""
        return self.output.with_suffix(".gcsv")

    @property
    def files(self) -> tuple[Path, ...]:
        """All that is written."""
        if media.is_pipe(self.output):
            return ()
        if self.motion_only or self.preview:
            return (self.output,)
        return (self.output, self.record, self.log) if self.is_clip else (self.output, self.record)

    @property
    def inputs(self) -> tuple[Path, ...]:
        """All that is read: the source, pictures that it may stand for, and the files that options name."""
        named = [Path(value) for each in option_fields() if each.option.is_file and (value := self.value(each)) is not None]
        pictures = []
        if media.is_pattern(self.source) and not self.source.exists() and self.source.parent.is_dir():
            pictures = [each for each in self.source.parent.iterdir() if each.suffix.lower() == self.source.suffix.lower()]
        source = () if media.is_pipe(self.source) else (self.source,)
        return (*source, *pictures, *(each for each in named if each.is_file()))

    def replaced(self, **changes: Any) -> "Request":
        """The same with changes: `replaced(output=path, deblur={"method": Method.NONE})`."""
        whole = {
            name: getattr(self, name).model_copy(update=dict(value)) if isinstance(value, Mapping) else value
            for name, value in changes.items()
        }
        return self.model_copy(update=whole)


@cache
def option_fields() -> tuple[OptionField, ...]:
    """All options of a request."""
    return tuple(option.fields(Sections))
