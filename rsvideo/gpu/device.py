"""Whether there is a device to work on. Nothing here loads CuPy, or starts CUDA in this process, which its children would not survive."""

import ctypes
import os
import subprocess
import sys
from importlib.util import find_spec

SIMULATOR = "NUMBA_ENABLE_CUDASIM"  # of the environment: 1 lets numba-cuda run kernels in Python
_found: list[str | None] = []  # in this process, or in the one that began it: what `unavailable` answers, once there is an answer
_DRIVERS = ("libcuda.so.1", "nvcuda.dll")
_LONGEST = 120  # seconds that the probe may take; it compiles a kernel
_PROBE = """
import cupy, numba.cuda
numba.config.CUDA_ARRAY_INTERFACE_SYNC = 0

@numba.cuda.jit
def double(x):
    x[numba.cuda.grid(1)] *= 2

x = cupy.fft.irfft(cupy.fft.rfft(cupy.arange(32, dtype="f4")))
double[1, 32](x)
assert abs(float(x.sum()) - 31 * 32) < 1e-2
"""


class DeviceMemoryError(MemoryError):
    """The device's memory does not hold what has to be in it at a time."""


def simulated() -> bool:
    """Whether kernels run in Python."""
    return os.environ.get(SIMULATOR) == "1"


def unavailable() -> str | None:
    """Why nothing can be computed on a device; None: a trial in a process of its own gave the right numbers."""
    if not _found:
        _found.append(_tried())
    return _found[0]


def found() -> list[str | None]:
    """The answer that a process begun here need not find again; none is looked for."""
    return _found.copy()


def take(answer: list[str | None]) -> None:
    """Believe what was found by the process that began this one; without an answer, find it when it is needed."""
    _found[:] = answer


def _tried() -> str | None:
    missing = [package for module, package in (("cupy", "CuPy"), ("numba_cuda", "numba-cuda")) if find_spec(module) is None]
    if simulated():
        missing = [package for package in missing if package != "CuPy"]
    if missing:
        return f"the extra gpu is not installed, there is no {' and no '.join(missing)}; pip install 'rsvideo[gpu]' brings it"
    if simulated():
        return None
    if not any(_loads(name) for name in _DRIVERS):
        return "there is no NVIDIA driver"
    try:
        done = subprocess.run([sys.executable, "-P", "-c", _PROBE], capture_output=True, text=True, timeout=_LONGEST, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"a trial on the GPU failed: {error}"
    why = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
    return None if done.returncode == 0 else f"a trial on the GPU failed: {why[0]}"


def _loads(name: str) -> bool:
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True
