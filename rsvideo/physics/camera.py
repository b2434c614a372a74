"""Which ray each pixel looks along, and where it moves when the camera turns."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """A pinhole camera, the matrix C of Eq. (4). The centre of the top-left pixel is (0, 0)."""

    fx: float  # focal length in columns
    fy: float  # focal length in rows
    cx: float  # principal point, px
    cy: float
    rows: int
    cols: int

    def __post_init__(self) -> None:
        for name, value in (("fx", self.fx), ("fy", self.fy)):
            if not (math.isfinite(value) and 1 <= value < 1e7):
                raise ValueError(f"focal length {name} must lie in [1, 1e7) px, got {value:g} px; is it in millimetres?")
        if min(self.rows, self.cols) < 1:
            raise ValueError(f"an image has at least one row and column, got {self.rows} x {self.cols}")

    @classmethod
    def centred(cls, *, focal: float, rows: int, cols: int) -> "Intrinsics":
        """Square pixels, the principal point at the frame's centre."""
        return cls(fx=focal, fy=focal, cx=(cols - 1) / 2, cy=(rows - 1) / 2, rows=rows, cols=cols)

    @property
    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """C: camera coordinates to homogeneous pixels."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])
