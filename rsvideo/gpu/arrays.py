"""Where arrays live and how kernels start: CuPy on a device; NumPy and Python threads in numba-cuda's simulator.

The simulator is chosen by NUMBA_ENABLE_CUDASIM=1 before numba is imported. It proves what a kernel computes, not how fast.
"""

import math
import threading
from typing import TYPE_CHECKING, Any

import numpy as np
from numba import cuda
from numba.core import config

SIMULATED = bool(config.ENABLE_CUDASIM)  # pyright: ignore[reportAttributeAccessIssue]
if TYPE_CHECKING or SIMULATED:
    xp = np
    from scipy import ndimage as ndimage
else:
    import cupy as xp
    from cupyx.scipy import ndimage as ndimage

    config.CUDA_LOW_OCCUPANCY_WARNINGS = 0  # small pictures are meant
    config.CUDA_ARRAY_INTERFACE_SYNC = 0  # both work on the same stream, in order; else each launch would wait for the one before

Array = Any
"""Of the device: cupy.ndarray, or numpy.ndarray in the simulator."""
OutOfMemory: type[Exception] = MemoryError if SIMULATED else xp.cuda.memory.OutOfMemoryError  # pyright: ignore[reportAttributeAccessIssue]
SHARED_BYTES = 48 << 10  # of memory that the threads of a block share, which every card grants
_LAUNCHING = threading.Lock()  # the compiler does not bear two threads that start a new kernel at once
_FEWEST = 2  # threads of a block a side in the simulator: enough to meet, and each is a thread of Python


def launch(kernel: Any, blocks: tuple[int, ...], threads: tuple[int, ...], *arguments: Any, shared: int = 0) -> None:
    """Start a kernel, whose loops step by the number of threads and so are right with any; `shared` is in bytes."""
    if SIMULATED:
        threads = tuple(min(_FEWEST, count) for count in threads)
    with _LAUNCHING:
        kernel[blocks, threads, 0, shared](*arguments)


def blocks_of(count: int, threads: int) -> int:
    """How many blocks give each of `count` items a thread; one in the simulator, where threads take several."""
    return 1 if SIMULATED else -(-count // threads)


def to_host(array: Array) -> np.ndarray:
    """A copy in the host's memory."""
    return np.array(array) if SIMULATED else xp.asnumpy(array)  # pyright: ignore[reportAttributeAccessIssue]


def planes_to_device(image: np.ndarray) -> Array:
    """A picture (rows, cols, channels) of the host's as (channels, rows, cols)."""
    return xp.ascontiguousarray(xp.moveaxis(xp.asarray(image, xp.float32), 2, 0))


def planes_to_host(planes: Array) -> np.ndarray:
    """The inverse; the device turns the axes, which is slow on the host."""
    return to_host(xp.ascontiguousarray(xp.moveaxis(planes, 0, 2)))


def release() -> None:
    """Give back what freed arrays have left in CuPy's pool, so that larger ones find room."""
    if not SIMULATED:
        xp.get_default_memory_pool().free_all_blocks()  # pyright: ignore[reportAttributeAccessIssue]


def finish() -> None:
    """Wait until the device has done all that was started."""
    if not SIMULATED:
        cuda.synchronize()


def free_bytes() -> float:
    """Of the device's memory; the simulator's has no end."""
    if SIMULATED:
        return math.inf
    pool = xp.get_default_memory_pool()  # pyright: ignore[reportAttributeAccessIssue]
    return xp.cuda.runtime.memGetInfo()[0] + pool.free_bytes()  # pyright: ignore[reportAttributeAccessIssue]


def name() -> str:
    """Of the device."""
    if SIMULATED:
        return "numba-cuda's simulator"
    return xp.cuda.runtime.getDeviceProperties(xp.cuda.Device().id)["name"].decode()  # pyright: ignore[reportAttributeAccessIssue]
