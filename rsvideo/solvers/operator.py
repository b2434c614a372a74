"""What a solver asks of a linear map."""

from typing import Protocol, runtime_checkable

import numpy as np


@runtime_checkable
class LinearOperator(Protocol):
    """A matrix given by its products and those of its transpose."""

    def forward(self, x: np.ndarray, /) -> np.ndarray:
        """A x."""
        ...

    def adjoint(self, y: np.ndarray, /) -> np.ndarray:
        """A^T y."""
        ...
