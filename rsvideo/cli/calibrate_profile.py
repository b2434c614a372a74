"""The profile that every measurement writes: where it goes, what it is added to, and what is printed about it."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from rsvideo.cli.terminal import say

if TYPE_CHECKING:
    from rsvideo.shooting.camera_profile import CameraProfile

Output = Annotated[Path | None, Option("-o", "--output", metavar="PROFILE", help="Write the profile here (.yaml); else it is printed.")]
Add = Annotated[bool, Option("--add", help="Keep what PROFILE already says of other things.")]
Overwrite = Annotated[bool, Option("--overwrite", help="Replace what exists.")]
Name = Annotated[str | None, Option(metavar="NAME", help="The camera's model; from the pictures unless given.")]
Maker = Annotated[str | None, Option(metavar="MAKER", help="Who made the camera.")]


def first_name(*names: "str | Path | None") -> str | None:
    """The first name there is; of a file, its stem."""
    found = next((name for name in names if name), None)
    return found.stem if isinstance(found, Path) else found


def earlier(output: Path | None, *, add: bool, overwrite: bool) -> "CameraProfile | None":
    """The profile that is added to, if there is one; refused before anything is measured where it may not be written."""
    from calibration import profile
    from rsvideo.cli.exit_codes import RefusedError

    if output is not None:
        return profile.earlier(output, add=add, overwrite=overwrite)
    if add:
        raise RefusedError("--add needs -o PROFILE, the profile that is added to")
    return None


def merged(before: "CameraProfile | None", measured: "CameraProfile") -> "CameraProfile":
    """What was measured, in the profile that it is added to."""
    from calibration import profile

    return profile.merge(before, measured) if before else measured


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


def print_json(facts: dict[str, Any]) -> None:
    """All that was found, for machines."""
    import json

    print(json.dumps(facts, indent=1, allow_nan=False))
