"""On PYTHONPATH, gives every Python process the core that costs nothing: also those that the command does not start itself.

The environment asks for more mishaps: VERSION, that rsvideo seems to have, HIDDEN, where it is not installed at all,
and BARE, where it is without the libraries of object storage.
"""

import importlib.metadata
import os
import runpy
import sys
from pathlib import Path

stated, pretended = importlib.metadata.version, os.environ.get("VERSION")


def version(name: str) -> str:
    """As the environment has it."""
    if name == "rsvideo" and os.environ.get("HIDDEN"):
        raise importlib.metadata.PackageNotFoundError(name)
    return pretended if name == "rsvideo" and pretended else stated(name)


importlib.metadata.version = version
if os.environ.get("BARE"):
    sys.modules["fsspec"] = None  # pyright: ignore[reportArgumentType]
if os.environ.get("HIDDEN"):
    sys.modules["rsvideo"] = None  # pyright: ignore[reportArgumentType] # as Python has it: no import finds such a module
else:
    runpy.run_path(str(Path(__file__).parents[1] / "stand_in.py"), run_name="stand_in")
