"""Names that no file can have are refused before the work."""

import os
from pathlib import Path


def check(*paths: Path) -> None:
    """ValueError where the system refuses a name or links in it lead in a circle; nothing need exist under it."""
    for path in paths:
        try:
            os.lstat(path)
        except (FileNotFoundError, NotADirectoryError, PermissionError):
            continue
        except OSError as error:
            raise ValueError(f"{path} cannot be a file's name: {str(error.strerror).lower()}; give it another one") from error
