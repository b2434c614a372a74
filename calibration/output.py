"""Where a file is written: its suffix names the format, and nothing is replaced unless that is wanted."""

from collections.abc import Iterable
from pathlib import Path

from rsvideo.config.placing import check


def file_format(path: Path, formats: tuple[str, ...], *, overwrite: bool, read: Iterable[Path] = ()) -> str:
    """The format that a file's suffix names, if it is one of `formats` (any, where these are none) and the file may be written.

    `read` are inputs, files or folders of them, which are never replaced. Raises ValueError, FileExistsError.
    """
    kind = path.suffix.lower().removeprefix(".")
    if formats and kind not in formats:
        raise ValueError(f"{path} must end in .{', .'.join(formats)}, it ends in {path.suffix!r}; the ending names the format")
    if not path.parent.is_dir():
        raise ValueError(f"the folder {path.parent} must exist; make it first, or is its name mistyped?")
    within = [file for each in read for file in (sorted(each.iterdir()) if each.is_dir() else [each])]
    check([path], within, overwrite=overwrite)
    return kind
