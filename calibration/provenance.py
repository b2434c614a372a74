"""How, when and on what files a part of a profile was measured."""

import datetime
from collections.abc import Mapping
from pathlib import Path

from rsvideo.config.files import sha256
from rsvideo.shooting.camera_profile import Found

_NAMES = 3  # files that are named in words; the others are counted
_TEXT_LETTERS, _FILE_LETTERS, _CAMERA_LETTERS = 500, 300, 100  # that a profile takes for a text, a file's name, a camera's


def provenance(how: str, files: Mapping[str, Path], when: str | None = None) -> Found:
    """The method, the day (today unless given), and the files, by what they are called, with their SHA-256."""
    names = list(files)
    words = ", ".join(names[:_NAMES]) + (f" and {len(names) - _NAMES} more" if len(names) > _NAMES else "")
    return Found(
        how=how[:_TEXT_LETTERS],
        when=when or today(),
        source=words[:_TEXT_LETTERS],
        files={name[-_FILE_LETTERS:]: sha256(path) for name, path in files.items()},
    )


def today() -> str:
    """The day in UTC, as profiles note it."""
    return datetime.datetime.now(tz=datetime.UTC).date().isoformat()


def camera_name(*names: str | None) -> str:
    """The first name that is given, as long as a profile takes it."""
    return next((name for name in names if name), "unnamed")[:_CAMERA_LETTERS]
