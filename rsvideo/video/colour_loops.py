"""Loops over a picture's pixels between codes and light; `rsvideo.video.colour` says what they stand for.

They are exact in single precision, whatever is computed at once: where light does not change, the codes come back as they were.
"""

from typing import no_type_check

import numpy as np
from numba import njit

from rsvideo.threads import loop


@no_type_check
@njit(cache=True)
def _entry(table, at):
    """Of a table, interpolated between two; the first and the last hold beyond it, the first for NaN too."""
    last = len(table) - 1
    if not at > 0:
        return table[0]
    k = int(min(at, np.float32(last)))
    return table[last] if k >= last else table[k] + (at - np.float32(k)) * (table[k + 1] - table[k])


@no_type_check
@njit(cache=True)
def _primed(light, table):
    """R' of light, by a table over the fourth root of it."""
    return _entry(table, np.sqrt(np.sqrt(light)) * np.float32(len(table) - 1)) if light > 0 else table[0]


@no_type_check
@loop(fastmath=False)
def light_by(first, last, primed, table, scale, full, low, high, light, clipped):
    """Light by a table, and whether the camera was full, of a channel."""
    for i in range(first, last):
        for j in range(primed.shape[1]):
            value = primed[i, j]
            light[i, j] = _entry(table, value * scale)
            clipped[i, j] = value >= full or low <= value <= high


@no_type_check
@loop(fastmath=False)
def primed_by(first, last, light, table, primed):
    """The inverse of a channel's light."""
    for i in range(first, last):
        for j in range(light.shape[1]):
            primed[i, j] = _primed(light[i, j], table)


@no_type_check
@njit(cache=True)
def _finer_row(coarse, i, down, zero, per_span, out):
    """Chroma beside row i of luma, which lies midway between two rows of it where it has half as many."""
    n = min(i >> 1 if down else i, coarse.shape[0] - 1)
    other = n if not down else min(n + 1, coarse.shape[0] - 1) if i & 1 else max(n - 1, 0)
    for j in range(coarse.shape[1]):
        own = (np.float32(coarse[n, j]) - zero) * per_span
        if down:
            own = np.float32(0.75) * own + np.float32(0.25) * ((np.float32(coarse[other, j]) - zero) * per_span)
        out[j] = own


@no_type_check
@njit(cache=True)
def _finer(row, j, across):
    """Chroma beside column j of luma; every second one is sited with a column of it where it has half as many."""
    n = min(j >> 1 if across else j, len(row) - 1)
    if not across:
        return row[n]
    return np.float32(0.5) * (row[n] + row[min(n + 1, len(row) - 1)]) if j & 1 else row[n]


@no_type_check
@loop(fastmath=False)
def light_of_ycbcr(first, last, luma, cb, cr, zeros, per_span, weights, down, across, table, scale, full, low, high, light, clipped):
    """Light of luma and chroma. `weights` are K_R, K_B, 2 (1 - K_R), 2 (1 - K_B) and 1 / K_G; `down` and `across`: chroma is halved."""
    kr, kb, to_red, to_blue, per_green = weights[0], weights[1], weights[2], weights[3], weights[4]
    u, v = np.empty(cb.shape[1], np.float32), np.empty(cr.shape[1], np.float32)
    for i in range(first, last):
        _finer_row(cb, i, down, zeros[1], per_span[1], u)
        _finer_row(cr, i, down, zeros[1], per_span[1], v)
        for j in range(luma.shape[1]):
            y = (np.float32(luma[i, j]) - zeros[0]) * per_span[0]
            red, blue = y + to_red * _finer(v, j, across), y + to_blue * _finer(u, j, across)
            green = (y - kr * red - kb * blue) * per_green
            for k, value in enumerate((red, green, blue)):
                light[i, j, k] = _entry(table, value * scale)
                clipped[i, j, k] = value >= full or low <= value <= high


@no_type_check
@loop(fastmath=False)
def change_in_ycbcr(first, last, now, before, table, weights, luma, cb, cr):
    """What a change of light adds to luma and to chroma; `weights` are K_R, K_G, K_B, 1 / (2 (1 - K_B)) and 1 / (2 (1 - K_R))."""
    change = np.zeros(3, np.float32)
    for i in range(first, last):
        for j in range(now.shape[1]):
            for k in range(3):
                a, b = now[i, j, k], before[i, j, k]
                change[k] = np.float32(0) if a == b else _primed(a, table) - _primed(b, table)
            y = weights[0] * change[0] + weights[1] * change[1] + weights[2] * change[2]
            luma[i, j] = y
            cb[i, j], cr[i, j] = (change[2] - y) * weights[3], (change[0] - y) * weights[4]


@no_type_check
@loop(fastmath=False)
def coarser(first, last, fine, down, across, out):
    """Chroma at half as many rows, half as many columns, or both: the counterpart of what makes it finer, its weights transposed."""
    rows, cols = fine.shape
    row = np.empty(cols, np.float32)
    for i in range(first, last):
        for j in range(cols):
            if down:
                above, below = fine[max(2 * i - 1, 0), j], fine[min(2 * i + 2, rows - 1), j]
                row[j] = np.float32(0.125) * (above + below) + np.float32(0.375) * (fine[2 * i, j] + fine[min(2 * i + 1, rows - 1), j])
            else:
                row[j] = fine[i, j]
        for j in range(out.shape[1]):
            if across:
                beside = row[max(2 * j - 1, 0)] + row[min(2 * j + 1, cols - 1)]
                out[i, j] = np.float32(0.25) * beside + np.float32(0.5) * row[2 * j]
            else:
                out[i, j] = row[j]
