"""What tells one file's content from another's, and one request from another."""

import hashlib
import json
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rsvideo.config.files import sha256
from rsvideo.config.request import Request, option_fields
from rsvideo.pipeline import devices

WHOLE = 64_000_000  # bytes; of larger files, and in folders, the size, the time of the last change and both ends are taken
_END = 4_000_000
_END_IN_FOLDER = 64_000


def of_source(path: Path) -> str:
    """Changes when a clip, or any picture in a folder, does; of a pattern, any in its folder."""
    if not path.exists():
        path = path.parent
    if path.is_dir():
        ends = [[each.name, _ends(each, _END_IN_FOLDER)] for each in sorted(path.iterdir()) if each.is_file()]
        return of_values({"folder": ends})
    return sha256(path) if path.stat().st_size <= WHOLE else _ends(path, _END)


def of_request(request: Request) -> str:
    """Of all that steers the work, and of the program; files by what they hold, not by where they are; a GPU, however it was chosen."""
    stated = request.model_dump(mode="json", exclude={"source", "output", "overwrite", "origin"})
    for each in option_fields():
        value = request.value(each)
        if each.option.is_file and value is not None and Path(value).is_file():
            stated[each.section][each.name] = sha256(Path(value))
    del stated["deblur"]["device"]
    if (device := devices.chosen(request.deblur.device, request.deblur.method)) != "cpu":
        stated["deblur"]["device"] = device
    return of_values({**stated, "rsvideo": version("rsvideo")})


def of_values(values: Mapping[str, Any]) -> str:
    """SHA-256 of plain values under their names."""
    return hashlib.sha256(json.dumps(values, sort_keys=True, default=str).encode()).hexdigest()


def _ends(path: Path, length: int) -> str:
    stat = path.stat()
    with path.open("rb") as file:
        head = file.read(length)
        file.seek(max(0, stat.st_size - length))
        tail = file.read(length)
    return hashlib.sha256(head + tail + f"{stat.st_size} {stat.st_mtime_ns}".encode()).hexdigest()
