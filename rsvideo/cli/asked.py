"""From the words that restoring and comparing share on the command line to a job."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rsvideo.pipeline.clip_job import ClipJob
    from rsvideo.pipeline.job import Job

_CLIPS = (".mp4", ".m4v", ".mov", ".qt", ".mkv", ".webm", ".avi", ".mts")

_CLIPS_ONLY = {
    "shutter_angle": "--shutter-angle",
    "scanlines_total": "--scanlines-total",
    "span": "--range",
    "rate": "--rate",
    "frames": "--frames",
    "side_by_side": "--side-by-side",
    "path": "--path",
    "on_damage": "--on-damage",
    "codec": "--codec",
    "quality": "--quality",
    "pixel_format": "--pixel-format",
    "force": "--force",
}


def is_clip(source: Path) -> bool:
    """By its name: what is wrong with a file that is not what its name says is told when it is read."""
    return source.suffix.lower() in _CLIPS or source.is_dir() or any(mark in source.name for mark in "#%*")


def job(source: Path, output: Path, words: Mapping[str, Any]) -> "Job | ClipJob":
    """The Job of a photograph or the ClipJob of a clip; what `words` do not say is left to the file or to the method."""
    from rsvideo.config.quantity import pixels, seconds, span
    from rsvideo.config.yaml import meant
    from rsvideo.physics.shutter import Direction
    from rsvideo.physics.tone import Transfer

    said = {name: value for name, value in words.items() if value is not None}
    for name in ("exposure", "readout", "row_time"):
        if name in said:
            said[name] = seconds(name.replace("_", "-"), said[name])
    if "focal_px" in said:
        said["focal_px"] = pixels("focal-px", said["focal_px"])
    if "direction" in said:
        said["direction"] = Direction(said["direction"])
    if "span" in said:
        said["span"] = span(said["span"])
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

    encoding = said.pop("encoding", {})
    said_in = {name: value for part in (said, said.get("steering", {}), encoding) for name, value in part.items()}
    if wrong := next((option for name, option in _CLIPS_ONLY.items() if said_in.get(name)), None):
        raise ValueError(f"{wrong} concerns clips, {source} is taken for a photograph; clips are .mp4, .mov, .mkv or folders")
    return Job(source=source, output=output, **said)
