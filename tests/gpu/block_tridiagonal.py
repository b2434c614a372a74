"""Banded systems as block-tridiagonal ones, in plain batched linear algebra: a slow twin of the kernels, for arrays of any library.

A band of width W is block-tridiagonal with blocks of W - 1 rows: diagonal blocks D_k, and U_k beside them. With N = R^H R,

    R_k^H R_k = D_k - M_{k-1}^H M_{k-1},    M_k = R_k^-H U_k,

so that each step is a Cholesky factor, an inverse and two products of small dense matrices, of all systems at once.
"""

from typing import Any

import numpy as np


def dense(band: Any, xp: Any = np) -> Any:
    """The systems written out, (systems, rows, rows), of their upper bands (systems, rows, width)."""
    systems, rows, width = band.shape
    full = xp.zeros((systems, rows, rows), band.dtype)
    for o in range(min(width, rows)):
        j = xp.arange(rows - o)
        full[:, j + o, j] = band[:, : rows - o, o].conj()
        full[:, j, j + o] = band[:, : rows - o, o]
    return full


def solved(band: Any, right: Any, xp: Any = np) -> Any:
    """N^-1 right, of (systems, rows, sides)."""
    systems, rows, width = band.shape
    size = width - 1
    count = -(-rows // size)
    padded = xp.zeros((systems, count * size, width), band.dtype)
    padded[:, :rows] = band
    padded[:, rows:, 0] = 1
    b = xp.zeros((systems, count * size, right.shape[2]), right.dtype)
    b[:, :rows] = right
    D, U = _blocks(padded, size, count, xp)
    inverses, M, y = [], [], []
    for k in range(count):
        block, known = D[k], b[:, k * size : (k + 1) * size]
        if k:
            block = block - _adjoint(M[-1]) @ M[-1]
            known = known - _adjoint(M[-1]) @ y[-1]
        inverses.append(xp.linalg.inv(xp.linalg.cholesky(block)))  # R_k^-H
        y.append(inverses[-1] @ known)
        if k + 1 < count:
            M.append(inverses[-1] @ U[k])
    x = [_adjoint(inverses[-1]) @ y[-1]]
    for k in range(count - 2, -1, -1):
        x.insert(0, _adjoint(inverses[k]) @ (y[k] - M[k] @ x[0]))
    return xp.concatenate(x, axis=1)[:, :rows]


def _blocks(band: Any, size: int, count: int, xp: Any) -> tuple[list[Any], list[Any]]:
    """D_k and U_k."""
    D, U = [], []
    for k in range(count):
        rows = dense(band[:, k * size : (k + 1) * size], xp)
        beside = xp.zeros_like(rows)
        for j in range(size):
            beside[:, j, : j + 1] = band[:, k * size + j, size - j :]
        D.append(rows)
        U.append(beside)
    return D, U


def _adjoint(matrix: Any) -> Any:
    return matrix.swapaxes(-1, -2).conj()
