"""Where a file is written: its suffix names the format, and nothing is replaced unless that is wanted."""

from pathlib import Path


def file_format(path: Path, formats: tuple[str, ...], *, overwrite: bool) -> str:
    """The format that a file's suffix names, if it is one of `formats` (any, where these are none) and the file may be written."""
    kind = path.suffix.lower().removeprefix(".")
    if formats and kind not in formats:
        raise ValueError(f"{path} must end in .{', .'.join(formats)}, it ends in {path.suffix!r}; the ending names the format")
    if not path.parent.is_dir():
        raise ValueError(f"the folder {path.parent} must exist; make it first, or is its name mistyped?")
    if path.exists() and not overwrite:
        raise FileExistsError(f"{path} exists already; give --overwrite to replace it")
    return kind
