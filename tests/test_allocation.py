"""Memory that is freed serves the next array; garbage is not looked for while libraries are loaded."""

import gc
import subprocess
import sys

import pytest

from rsvideo.allocation import nothing_collected

FAULTS = """
import resource, sys
import numpy as np
from rsvideo.allocation import keep_freed_memory
if sys.argv[1] == "kept":
    keep_freed_memory()
np.ones(8_000_000)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20):
    np.ones(8_000_000)  # 64 MB
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="mallopt is glibc's")
def test_arrays_made_again_and_again_touch_no_new_pages() -> None:
    given_back, kept = (
        int(subprocess.run([sys.executable, "-c", FAULTS, how], capture_output=True, text=True, timeout=60, check=True).stdout)
        for how in ("given back", "kept")
    )
    assert kept < given_back / 10


def test_garbage_is_looked_for_again_once_libraries_are_loaded() -> None:
    with nothing_collected():
        assert not gc.isenabled()
    assert gc.isenabled()
