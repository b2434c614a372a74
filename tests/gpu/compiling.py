"""Compiles every kernel for real architectures, without a device: python tests/gpu/compiling.py

The types are those with which the project starts them. Prints a line a kernel and architecture: how many operations in double precision
it has. Exit code 77 where the compiler is not installed; the extra gpu brings it.
"""

import re
import sys
from types import ModuleType, SimpleNamespace

from cuda.pathfinder import DynamicLibNotFoundError, load_nvidia_dynamic_lib

NONE_HERE = 77
ARCHITECTURES = (7, 5), (9, 0)  # the oldest that CUDA 12 and 13 both know, and Hopper


def without_a_device() -> None:
    """Nothing is run: CuPy is not needed, and the architecture is stated instead of a device's."""
    sys.modules["cupy"] = ModuleType("cupy")
    sys.modules["cupy"].cuda = SimpleNamespace(memory=SimpleNamespace(OutOfMemoryError=MemoryError))  # pyright: ignore[reportAttributeAccessIssue]


def main() -> int:
    """Compile all."""
    for library in ("nvvm", "nvrtc"):
        try:
            load_nvidia_dynamic_lib(library)
        except DynamicLibNotFoundError:
            print(f"there is no {library}; pip install 'rsvideo[gpu]' brings it")
            return NONE_HERE
    without_a_device()
    from numba import boolean, complex64, cuda, float32, float64, int8, int32, int64, types
    from numba.cuda import dispatcher

    from rsvideo.gpu import banded, collaborative_filter, fusion, resampling, row_fourier, sparsity, total_variation

    def array(kind: types.Type, sides: int) -> types.Array:
        return types.Array(kind, sides, "C")

    bands, flat, line = array(complex64, 2), array(complex64, 1), array(float32, 1)
    base, readers, offsets, places = array(int32, 2), array(int32, 3), array(int8, 4), array(int32, 1)
    picture, picture4, sums = array(float32, 3), array(float32, 4), array(int64, 3)
    kernels = {
        banded._factor_in_window: (bands, int64, int64, array(float32, 1), float32, bands),
        banded._factor_in_place: (bands, int64, int64, array(float32, 1), float32, bands),
        banded._solve: (bands, int64, int64, int64, int64, flat, flat),
        row_fourier._symbol: (line, base, int64, float64, int64, int64, int64, flat),
        row_fourier._forward: (flat, base, int64, int64, int64, int64, flat, flat),
        row_fourier._adjoint: (flat, base, readers, int64, int64, int64, flat, flat),
        row_fourier._gram: (flat, base, readers, int64, int64, flat),
        collaborative_filter._search: (array(float32, 2), places, places, array(int8, 1), offsets),
        sparsity._means: (line, int64, int64, int64, float32, line),
        total_variation._split: (line, int64, int64, float32, line, line),
        total_variation._join: (line, int64, int64, float32, line),
        total_variation._complete: (array(boolean, 1), line, line, line, line, float32, line),
        sparsity._sensitivity: (*[picture4] * 6, picture4, places, int64, int64, picture4),
        resampling._along: (line, int64, int64, line, line),
        resampling._places: (line, *[int64] * 4, line, *[int64] * 5, line),
        resampling._lanczos: (line, int64, int64, int64, line, line),
        resampling._linear: (line, int64, int64, int64, line, line),
        fusion._moments: (*[line] * 4, int64, int64, int64, line),
        collaborative_filter._filter: (picture, picture, offsets, places, places, float32, boolean, sums, sums),
    }
    for architecture in ARCHITECTURES:
        stated = SimpleNamespace(compute_capability=architecture)
        dispatcher.get_current_device = lambda stated=stated: stated  # pyright: ignore[reportPrivateImportUsage]
        for kernel, signature in kernels.items():
            how = {"device": False, "cc": architecture, "output": "ptx", "abi": "numba"}
            ptx, _ = cuda.compile(kernel.py_func, signature, **how)  # pyright: ignore[reportPrivateImportUsage]
            double = len(re.findall(r"\b(?:add|sub|mul|fma|div)\.(?:\w+\.)*f64\b", ptx))
            print(f"{kernel.py_func.__name__} sm_{architecture[0]}{architecture[1]} {double}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
