"""A job as a person writes it: which clips, how each is treated, and where the results go."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema

from rsvideo.config.method import Method
from rsvideo.config.quantity import hand_held, pixels, seconds, span
from rsvideo.config.yaml import ConfigError, Positions, meant, shown, validated
from rsvideo.physics.shutter import Direction
from rsvideo.physics.tone import Transfer
from rsvideo.video.output_format import Codec

SECTIONS = ("input", "camera", "motion", "deblur", "encoding")
MOST_ENTRIES = 10_000
_RIVALS = ({"readout", "row_time", "scanlines_total"}, {"exposure", "shutter_angle"})  # one of them answers for the others


def _text(value: object, rule: str) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise ValueError(f"{rule}, got {shown(value)}")
    return str(value)


def _time(name: str, *, zero: bool) -> BeforeValidator:
    rule = f"{name} must be a time such as 1/50, 20ms or 0.02 (seconds)"
    return BeforeValidator(lambda value: hand_held(name, seconds(name, _text(value, rule)), zero=zero))


def _pixels(value: object) -> float:
    return pixels("focal_px", _text(value, "focal_px must be a positive number of pixels such as 1400"))


def _span(value: object) -> tuple[float, float]:
    return value if isinstance(value, tuple) else span(_text(value, "range must read like 00:10-00:12 or 10-12.5"))


def _name(value: object) -> str:
    rule = "a name must be a pattern for a file's name such as {stem}_rsvideo{ext}, made with {stem}, {ext} and {folder}"
    text = _text(value, rule)
    rest = re.sub(r"\{(stem|ext|folder)\}", "", text)
    if not text or set(rest) & set("{}/\\") or rest in (".", "..") or text.startswith("."):
        raise ValueError(f"{rule}, got {shown(value)}; where the results go is output.folder")
    return text


def _truth(value: object) -> str:
    text = _text(value, "truth must be a file's name such as truth{ext}, made with {stem}, {ext} and {folder}")
    if set(re.sub(r"\{(stem|ext|folder)\}", "", text)) & set("{}"):
        raise ValueError(f"truth may hold {{stem}}, {{ext}} and {{folder}}, got {shown(text)}")
    return text


def _written(pattern: str, example: str) -> WithJsonSchema:
    return WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string", "pattern": pattern}], "examples": [example]})


_TIME = _written(r"^\s*[\d.]+(/[\d.]+)?\s*(s|ms|us)?\s*$", "1/50")
Opening = Annotated[float, _time("exposure", zero=False), _TIME]
Readout = Annotated[float, _time("readout", zero=True), _TIME]
RowTime = Annotated[float, _time("row_time", zero=True), _TIME]
Pixels = Annotated[float, BeforeValidator(_pixels), _written(r"^\s*[\d.]+\s*(px)?\s*$", "1400")]
Span = Annotated[tuple[float, float], BeforeValidator(_span), WithJsonSchema({"type": "string", "examples": ["00:10-00:12"]})]
Rate = Annotated[str, BeforeValidator(lambda value: _text(value, "rate must be in frames per second, such as 24 or 24000/1001"))]
Name = Annotated[str, BeforeValidator(_name)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Input(_Section):
    """What is read."""

    range: Span | None = Field(default=None, description="The part of the clip that is treated.")
    rate: Rate | None = Field(default=None, description="Frames per second of a folder of pictures.")
    on_damage: Literal["fail", "passthrough", "skip"] = Field(
        default="fail", description="What becomes of frames that cannot be decoded whole."
    )


class Camera(_Section):
    """When each row collects light, and through which lens. What is left out is taken from the file, as far as it says it."""

    profile: str | None = Field(default=None, description="A measured camera mode, by name or as a file.")
    exposure: Opening | None = Field(default=None, description="How long each row collects light.")
    shutter_angle: Annotated[float, Field(gt=0, le=360)] | None = Field(default=None, description="Degrees, instead of exposure.")
    readout: Readout | None = Field(default=None, description="From the first row's opening to the last one's; 0 is a global shutter.")
    row_time: RowTime | None = Field(default=None, description="From one stored row's opening to the next one's, instead of readout.")
    scanlines_total: Annotated[int, Field(gt=0, le=1_000_000)] | None = Field(
        default=None, description="Visible and blanking lines of a frame period, instead of readout."
    )
    direction: Direction | None = Field(default=None, description="The way the readout runs over the picture as stored.")
    focal_px: Pixels | None = Field(default=None, description="Focal length in pixels.")
    transfer: Transfer | None = Field(default=None, description="How codes stand for light, by the standard's name.")
    force: bool = Field(default=False, description="Accept a readout longer than a frame's period.")


class Motion(_Section):
    """How the camera's path is found, and which path the result follows."""

    model: Literal["rotation", "shift"] | None = Field(default=None, description="All three angles, or the paper's shift.")
    degree: Annotated[int, Field(ge=1, le=12)] | None = Field(default=None, description="Of the trajectory's polynomial.")
    start: Literal["kernels", "tracing"] | None = Field(default=None, description="How the first trajectory is found.")
    refinement: Literal["sparsity", "alternation"] | None = Field(
        default=None, description="Of it, where a frame stands alone: latent image eliminated, or the paper's Algorithm 1."
    )
    trajectory: str | None = Field(default=None, description="A file with the motion, which is then not estimated.")
    gyro: str | None = Field(
        default=None, description="A gyroscope's log, for the methods that follow one; what the clip embeds if left out."
    )
    gyro_offset: Annotated[float, Field(ge=-1e6, le=1e6)] | None = Field(
        default=None, description="Seconds, what the clip's time becomes the log's by adding; found if left out."
    )
    gyro_axes: Annotated[str, Field(pattern="^[XYZxyz]{3}$")] | None = Field(
        default=None, description="The gyroscope's axes along the camera's right, down and forward; found if left out."
    )
    path: Literal["keep", "smooth"] = Field(default="keep", description="The camera's own path, or a smooth one (with a crop).")


class Deblur(_Section):
    """How the sharp picture is found."""

    method: Method = Field(
        default=Method.RSVIDEO,
        description="This project's, or one that it is compared with; none decodes and encodes, and changes nothing.",
    )
    block_rows: Annotated[int, Field(ge=16, le=100_000)] | None = Field(
        default=None, description="Of the method stitch; a third of the frame if left out."
    )
    frames: Literal["together", "alone", "cold"] | None = Field(
        default=None, description="Restored with their neighbours (as if left out), along the clip's path only, or each as a still."
    )
    prior: Literal["denoiser", "tv"] | None = Field(default=None, description="What a sharp picture is taken to look like.")


class Encoding(_Section):
    """How the result is written; what is left out is as in the source."""

    codec: Codec | None = Field(default=None, description="png, tiff and exr write folders of pictures.")
    quality: Annotated[float, Field(ge=0, le=63)] | None = Field(default=None, description="Constant rate factor of h264 and hevc.")
    pixel_format: Annotated[str, Field(pattern=r"^\w+$")] | None = Field(default=None, description="By FFmpeg's name, such as yuv422p10le.")
    side_by_side: bool = Field(default=False, description="The source on the left, the result on the right.")


class Treatment(_Section):
    """How a clip is treated."""

    input: Input = Input()
    camera: Camera = Camera()
    motion: Motion = Motion()
    deblur: Deblur = Deblur()
    encoding: Encoding = Encoding()

    @staticmethod
    def layered(layers: Iterable["Treatment"]) -> "Treatment":
        """The later layers over the earlier ones; one of several ways to say a thing takes the place of the others."""
        merged: dict[str, dict[str, Any]] = {}
        for layer in layers:
            for section in layer.model_fields_set & set(SECTIONS):
                given = getattr(layer, section).model_dump(exclude_unset=True)
                out = set().union(*(rivals for rivals in _RIVALS if any(given.get(name) is not None for name in rivals)))
                merged[section] = {name: value for name, value in merged.get(section, {}).items() if name not in out} | given
        return Treatment.model_validate(merged)


class Clip(Treatment):
    """Some clips, and what is special about them."""

    source: Annotated[list[str], BeforeValidator(lambda value: [value] if isinstance(value, str) else value), Field(min_length=1)] = Field(
        description="A file, a folder of pictures, or a pattern such as clips/*.mp4; or a list of these."
    )
    preset: str | None = Field(default=None, description="One of presets, under what is said here.")
    name: Name | None = Field(default=None, description="The result's name, instead of output.name.")


class Output(_Section):
    """Where the results go."""

    folder: str = Field(default="restored", min_length=1, description="Relative to the job's file.")
    name: Name = Field(default="{stem}_rsvideo{ext}", description="With the source's {stem}, {ext} and {folder}.")


class Report(_Section):
    """What counts as success, and what rsvideo compare is to show."""

    most_failed_frames: Annotated[int, Field(ge=0)] = Field(default=0, description="In a clip; with more, the command ends with 5.")
    methods: Annotated[list[Method], Field(max_length=20)] = Field(
        default=[], description="Of rsvideo compare: what is tried on each clip; all that apply if left out."
    )
    truth: Annotated[str, BeforeValidator(_truth)] | None = Field(
        default=None,
        description="Of rsvideo compare: the clip that each would be if nothing blurred, relative to its source: truth/{stem}{ext}.",
    )
    crops: Annotated[list[tuple[int, int, int, int]], Field(max_length=20)] = Field(
        default=[], description="Of rsvideo compare: parts to look at first, as [x, y, width, height] in pixels."
    )

    def truth_of(self, source: Path) -> Path | None:
        """The truth of one clip."""
        if self.truth is None:
            return None
        parts = {"stem": source.stem, "ext": source.suffix, "folder": source.absolute().parent.name}
        return source.parent / re.sub(r"\{(\w+)\}", lambda match: parts[match[1]], self.truth)


class JobFile(_Section):
    """The whole file."""

    output: Output = Output()
    report: Report = Report()
    defaults: Treatment = Treatment()
    presets: dict[str, Treatment] = {}
    clips: Annotated[
        list[Annotated[Clip, BeforeValidator(lambda value: {"source": value} if isinstance(value, str) else value)]],
        Field(min_length=1, max_length=MOST_ENTRIES),
    ]

    def treatment(self, clip: Clip, said: Treatment) -> Treatment:
        """How one entry's clips are treated: defaults, then its preset, then its own words, then those of the command line."""
        preset = [self.presets[clip.preset]] if clip.preset is not None else []
        return Treatment.layered([self.defaults, *preset, clip, said])


class Said(Treatment):
    """What --set may say."""

    output: Output = Output()
    report: Report = Report()


def said(words: Iterable[str]) -> Said:
    """What `--set section.key=value` say."""
    data: dict[str, dict[str, str]] = {}
    for word in words:
        key, equals, value = word.partition("=")
        section, dot, name = key.strip().partition(".")
        if not (equals and dot and section and name):
            raise ConfigError(f"--set must read like camera.exposure=1/100, got {shown(word)}")
        data.setdefault(section, {})[name] = value.strip()
    try:
        return validated(Said, data, Positions(path=Path("--set"), lines={}))
    except ConfigError as error:
        raise ConfigError(*(fault.replace("--set:1: ", "--set ", 1) for fault in error.faults)) from error


def understood(data: object, positions: Positions) -> JobFile:
    """The job that a file's data describe; every fault is told with its line."""
    if not isinstance(data, dict):
        raise ConfigError(positions.fault((), f"must map words such as clips and output to settings, it holds {shown(data)}"))
    job = validated(JobFile, data, positions)
    faults = [
        positions.fault(("clips", number, "preset"), f"there is no preset {shown(clip.preset)}{meant(clip.preset, job.presets)}")
        for number, clip in enumerate(job.clips)
        if clip.preset is not None and clip.preset not in job.presets
    ]
    if faults:
        raise ConfigError(*faults)
    return job
