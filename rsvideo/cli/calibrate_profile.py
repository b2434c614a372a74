"""The profile that every measurement writes: where it goes, what it is added to, and what is said of it."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

if TYPE_CHECKING:
    from rsvideo.shooting.camera_profile import CameraProfile

Output = Annotated[Path | None, Option("-o", "--output", metavar="PROFILE", help="Write the profile here (.yaml); else it is printed.")]
Add = Annotated[bool, Option("--add", help="Keep what PROFILE already says of other things.")]
Overwrite = Annotated[bool, Option("--overwrite", help="Replace what exists.")]
Name = Annotated[str | None, Option(metavar="NAME", help="The camera's model; from the pictures unless given.")]
Maker = Annotated[str | None, Option(metavar="MAKER", help="Who made the camera.")]


def named(*names: "str | Path | None") -> str:
    """The first name there is."""
    found = next((name for name in names if name), "unnamed")
    return (found.stem if isinstance(found, Path) else found)[:100]


def may_write(path: Path, kinds: tuple[str, ...], *, overwrite: bool) -> str:
    """The kind that a file's ending names, if it may be written."""
    from rsvideo.cli.exit_codes import RefusedError

    kind = path.suffix.lower().removeprefix(".")
    if kinds and kind not in kinds:
        raise RefusedError(f"{path} must end in .{', .'.join(kinds)}, it ends in {path.suffix!r}; the ending names the format")
    if not path.parent.is_dir():
        raise RefusedError(f"the folder {path.parent} must exist; make it first, or is its name mistyped?")
    if path.exists() and not overwrite:
        raise FileExistsError(f"{path} exists already; give --overwrite to replace it")
    return kind


def earlier(output: Path | None, *, add: bool, overwrite: bool) -> "CameraProfile | None":
    """The profile that is added to, if there is one."""
    from rsvideo.cli.exit_codes import RefusedError
    from rsvideo.shooting import profiles

    if output is None:
        if add:
            raise RefusedError("--add needs -o PROFILE, the profile that is added to")
        return None
    exists = output.exists() and add
    may_write(output, ("yaml", "yml"), overwrite=overwrite or exists)
    return profiles.read(output) if exists else None


def finish(profile: "CameraProfile", output: Path | None, *, printed: bool = True) -> None:
    """Write or print a profile, and say what to do with it."""
    from rsvideo.config.files import write_whole
    from rsvideo.shooting.profiles import encode

    data, _ = encode(profile)
    if output is not None:
        write_whole({output: data})
        say(f"written: {output}; use it with --camera {output}, see it with rsvideo calibrate show {output} -o FIG.png")
    elif printed:
        sys.stdout.write(data.decode())


def today() -> str:
    """The day, as profiles note it."""
    import datetime

    return datetime.datetime.now(tz=datetime.UTC).date().isoformat()


def print_json(told: dict[str, Any]) -> None:
    """All that was found, for machines."""
    import json

    print(json.dumps(told, indent=1, allow_nan=False))


def say(words: str) -> None:
    """A line for a person."""
    print(f"rsvideo: {words}", file=sys.stderr)
