"""A job as a person writes it: which clips and photographs, how each is treated, and where the results go."""

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

from pydantic import BeforeValidator, Field

from rsvideo.config.method import Method
from rsvideo.config.request import Section, Sections
from rsvideo.config.units import text
from rsvideo.config.yaml import ConfigError, Positions, meant, shown, validated

MOST_ENTRIES = 10_000


def _name(value: object) -> str:
    rule = "a name must be a pattern for a file's name such as {stem}_rsvideo{ext}, made with {stem}, {ext} and {folder}"
    name = text(value, rule)
    rest = re.sub(r"\{(stem|ext|folder)\}", "", name)
    if not name or set(rest) & set("{}/\\") or rest in (".", "..") or name.startswith("."):
        raise ValueError(f"{rule}, got {shown(value)}; where the results go is output.folder")
    return name


def _truth(value: object) -> str:
    name = text(value, "truth must be a file's name such as truth{ext}, made with {stem}, {ext} and {folder}")
    if set(re.sub(r"\{(stem|ext|folder)\}", "", name)) & set("{}"):
        raise ValueError(f"truth may hold {{stem}}, {{ext}} and {{folder}}, got {shown(name)}")
    return name


Name = Annotated[str, BeforeValidator(_name)]


class Clip(Sections):
    """Some clips or photographs, and what is special about them."""

    source: Annotated[list[str], BeforeValidator(lambda value: [value] if isinstance(value, str) else value), Field(min_length=1)] = Field(
        description="A clip, a photograph, a folder of pictures, a pattern such as clips/*.mp4, or s3://bucket/*.mp4; or a list."
    )
    preset: str | None = Field(default=None, description="One of presets, under what is said here.")
    name: Name | None = Field(default=None, description="The result's name, instead of output.name.")


class Output(Section):
    """Where the results go."""

    folder: str = Field(
        default="restored", min_length=1, description="Relative to the job's file, or an address such as s3://bucket/folder."
    )
    name: Name = Field(default="{stem}_rsvideo{ext}", description="With the source's {stem}, {ext} and {folder}.")


class Report(Section):
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


class JobFile(Section):
    """The whole file."""

    output: Output = Output()
    report: Report = Report()
    defaults: Sections = Sections()
    presets: dict[str, Sections] = Field(default={}, description="For some of the clips, by name.")
    clips: Annotated[
        list[Annotated[Clip, BeforeValidator(lambda value: {"source": value} if isinstance(value, str) else value)]],
        Field(min_length=1, max_length=MOST_ENTRIES),
    ]

    def sections(self, clip: Clip, overrides: Sections) -> list[Sections]:
        """What is stated of an entry's sources, the later over the earlier: defaults, its preset, itself, and the command line."""
        preset = [self.presets[clip.preset]] if clip.preset is not None else []
        return [self.defaults, *preset, clip, overrides]


class Overrides(Sections):
    """What --set may state."""

    output: Output = Output()
    report: Report = Report()


def overrides(words: Iterable[str]) -> Overrides:
    """What `--set section.key=value` state."""
    data: dict[str, dict[str, str]] = {}
    for word in words:
        key, equals, value = word.partition("=")
        section, dot, name = key.strip().partition(".")
        if not (equals and dot and section and name):
            raise ConfigError(f"--set must read like camera.exposure=1/100, got {shown(word)}")
        data.setdefault(section, {})[name] = value.strip()
    try:
        return validated(Overrides, data, Positions(path=Path("--set"), lines={}))
    except ConfigError as error:
        raise ConfigError(*(fault.replace("--set:1: ", "--set ", 1) for fault in error.faults)) from error


def parsed(data: object, positions: Positions) -> JobFile:
    """The job that a file's data describe; every fault is reported with its line."""
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
