"""The command of the environment that runs a benchmark, wherever the caller's PATH leads."""

import sys
from pathlib import Path

RSVIDEO = str(Path(sys.executable).with_name("rsvideo"))
