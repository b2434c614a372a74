"""From the words that restoring and comparing share on the command line to a job."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsvideo.pipeline.clip_job import ClipJob
    from rsvideo.pipeline.job import Job

_CLIPS = (".mp4", ".m4v", ".mov", ".qt", ".mkv", ".webm", ".avi", ".mts")

_CLIPS_ONLY = (
    *("shutter_angle", "scanlines_total", "part", "rate", "frames", "side_by_side", "path", "on_damage"),
    *("codec", "quality", "pixel_format", "force"),
)
_GYRO = {"gyro": "path", "gyro_offset": "offset", "gyro_axes": "axes"}
_STEERING = ("motion", "degree", "start", "refinement", "prior", "frames")  # the core's settings
_ENCODING = ("codec", "quality", "pixel_format")
_PLAIN = (
    *("exposure", "shutter_angle", "readout", "row_time", "scanlines_total", "direction", "focal_px", "camera", "transfer", "trajectory"),
    *("method", "block_rows", "path", "part", "side_by_side", "on_damage", "rate", "force"),
)
_SILENT = ("keep", "fail")  # what an option holds that says nothing


def words(options: Mapping[str, Any]) -> dict[str, Any]:
    """What a command's options say of a job, under their own names; those that say nothing are left out."""
    said = {name: options.get(name) for name in (*_PLAIN, *_GYRO, *_STEERING, *_ENCODING)}
    return {name: value for name, value in said.items() if value is not None and value is not False and value not in _SILENT}


def option(name: str) -> str:
    """As it is written on the command line."""
    return "--range" if name == "part" else "--" + name.replace("_", "-")


def is_clip(source: Path) -> bool:
    """By its name: what is wrong with a file that is not what its name says is told when it is read."""
    return source.suffix.lower() in _CLIPS or source.is_dir() or any(mark in source.name for mark in "#%*")


def job(source: Path, output: Path, words: Mapping[str, Any]) -> "Job | ClipJob":
    """The Job of a photograph or the ClipJob of a clip; what `words` do not say is left to the file or to the method."""
    from rsvideo.config.method import GyroFile
    from rsvideo.config.quantity import pixels, seconds, span
    from rsvideo.config.yaml import meant
    from rsvideo.physics.shutter import Direction
    from rsvideo.physics.tone import Transfer

    parts = {"steering": _STEERING, "encoding": _ENCODING}
    said = {name: value for name, value in words.items() if name not in (*_STEERING, *_ENCODING, *_GYRO, "part")}
    said |= {part: {name: words[name] for name in names if name in words} for part, names in parts.items()}
    said["gyro"] = GyroFile(**{field: words.get(name) for name, field in _GYRO.items()})
    for name in ("exposure", "readout", "row_time"):
        if name in said:
            said[name] = seconds(name.replace("_", "-"), said[name])
    if "focal_px" in said:
        said["focal_px"] = pixels("focal-px", said["focal_px"])
    if "direction" in said:
        said["direction"] = Direction(said["direction"])
    if "part" in words:
        said["span"] = span(words["part"])
    if "transfer" in said:
        if said["transfer"] not in set(Transfer):
            raise ValueError(
                f"transfer must be one of {', '.join(Transfer)}, got {said['transfer']!r}{meant(said['transfer'], list(Transfer))}"
            )
        said["transfer"] = Transfer(said["transfer"])
    if is_clip(source):
        from rsvideo.pipeline.clip_job import ClipJob

        return ClipJob(source=source, output=output, **said)
    from rsvideo.pipeline.job import Job

    if wrong := next((name for name in _CLIPS_ONLY if name in words), None):
        raise ValueError(f"{option(wrong)} concerns clips, {source} is taken for a photograph; clips are .mp4, .mov, .mkv or folders")
    del said["encoding"]
    return Job(source=source, output=output, **said)
