"""Codes of a picture into linear light and back, in floating point throughout.

Code values first become R'G'B', where 0 is black and 1 nominal white, then light by the transfer function. Limited range leaves
codes above nominal white; light 1 is the highest of them, so that a camera's super-white survives. What light in [0, 1] cannot
hold (codes below black, colours out of gamut, chroma finer than its samples) is not lost either: `codes` adds to the original's
codes what changed in the picture, and so gives back the original exactly where nothing did.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float32

from rsvideo.physics import tone
from rsvideo.physics.luminance import BT709_WEIGHTS
from rsvideo.physics.tone import Tone
from rsvideo.threads import spread
from rsvideo.video import colour_loops
from rsvideo.video.stream import Colour, Matrix, Picture

Light = Float32[np.ndarray, "rows cols channels"]  # 3, or 1 of a grey picture

_KR_KB = {Matrix.BT601: (0.299, 0.114), Matrix.BT709: (0.2126, 0.0722), Matrix.BT2020: (0.2627, 0.0593)}  # H.273, table 4
_ENTRIES = 1 << 16  # of a table, evenly spaced
_SUPERWHITE = 6.5  # steps below the highest code of the limited range: cameras that use codes above white are full a few codes below it
_BELOW, _ABOVE = 1.5, 4.0  # steps of 8 bits about white that count as clipped: what a codec makes of a plateau


def light(picture: Picture, colour: Colour) -> tuple[Light, Bool[np.ndarray, "rows cols channels"]]:
    """Linear light in [0, 1], and where the camera was full."""
    if colour.floating:
        planes = np.stack(picture.planes, axis=-1).astype(np.float32)
        return np.clip(np.nan_to_num(planes, nan=0.0), 0, 1), planes >= 1
    rows, cols = picture.planes[0].shape
    pixels = np.empty((rows, cols, len(picture.planes)), np.float32)
    clipped, table = np.empty(pixels.shape, bool), _of(colour)[0]
    how = table, np.float32(_ENTRIES / _highest(colour)), *_full(colour)
    if _halved_at_most(colour):
        kr, kb = _KR_KB[colour.matrix]
        weights = np.array([kr, kb, 2 * (1 - kr), 2 * (1 - kb), 1 / (1 - kr - kb)], np.float32)
        zeros = np.array([_zero(k, colour) for k in range(2)])
        per_span = np.array([np.float32(1) / _span(k, colour) for k in range(2)])
        halved = map(bool, colour.chroma_shift)
        spread(colour_loops.light_of_ycbcr, rows, *picture.planes, zeros, per_span, weights, *halved, *how, pixels, clipped)
    else:
        for k, part in enumerate(_primed(picture, colour)):
            spread(colour_loops.light_by, rows, part, *how, pixels[..., k], clipped[..., k])
    return pixels, clipped


def load(colour: Colour) -> None:
    """Make tables and compiled code ready for `light`, which takes the first of them a third of a second."""
    if not colour.floating:
        codes = np.zeros((2, 2), np.uint8 if colour.depth <= 8 else np.uint16)
        light(Picture(planes=(codes,) * (1 if colour.subsampling == "4:0:0" else 3), index=0, pts=0, duration=0, time=0.0), colour)


def codes(pixels: Light, picture: Picture, colour: Colour) -> Picture:
    """`picture` with its light replaced by `pixels`; exactly itself where they are its own light."""
    before = light(picture, colour)[0]
    if pixels.shape != before.shape:
        raise ValueError(f"pixels must be as the picture's, {before.shape}, got {pixels.shape}")
    if colour.floating:
        return replace(picture, planes=tuple(p + (pixels - before)[..., k] for k, p in enumerate(picture.planes)))
    if _halved_at_most(colour):
        kr, kb = _KR_KB[colour.matrix]
        weights = np.array([kr, 1 - kr - kb, kb, 0.5 / (1 - kb), 0.5 / (1 - kr)], np.float32)
        parts = [np.empty(pixels.shape[:2], np.float32) for _ in range(3)]
        spread(colour_loops.change_in_ycbcr, len(pixels), pixels, before, _of(colour)[1], weights, *parts)
        change = _in_steps(parts, colour)
    else:
        change = _mixed([now - then for now, then in zip(_coded(pixels, colour), _coded(before, colour), strict=True)], colour)
    return replace(picture, planes=tuple(_rounded(p + d, colour) for p, d in zip(picture.planes, change, strict=True)))


def encoded(pixels: Light, picture: Picture, target: Colour) -> Picture:
    """A picture in the layout `target` that shows `pixels`, whatever layout `picture` has; only its times are taken."""
    channels = 1 if target.subsampling == "4:0:0" else 3
    if pixels.shape[2] != channels:
        pixels = np.repeat(pixels, 3, axis=2) if channels == 3 else pixels @ BT709_WEIGHTS[:, None]
    if target.floating:
        return replace(picture, planes=tuple(np.ascontiguousarray(pixels[..., k]) for k in range(channels)))
    return replace(picture, planes=_stored(_mixed(_coded(pixels, target), target), target))


def relaid(picture: Picture, colour: Colour, target: Colour) -> Picture:
    """The same picture in another depth, range or chroma layout; through light only where the curve or the matrix differs."""
    grey = colour.subsampling == "4:0:0"
    if colour.floating or target.floating or colour.transfer != target.transfer:
        pixels = np.stack(picture.planes, axis=-1) if colour.floating else light(picture, colour)[0] * np.float32(_full_light(colour))
        return encoded(pixels / np.float32(_full_light(target)), picture, target)
    if colour.matrix is not target.matrix and not grey:
        return replace(picture, planes=_stored(_mixed(_primed(picture, colour), target), target))
    mixed = [_nominal(plane, k, colour) for k, plane in enumerate(picture.planes)]
    if grey and target.subsampling != "4:0:0":
        mixed = [
            mixed[0],
            *([mixed[0]] * 2 if target.matrix is Matrix.RGB else [_coarse(np.zeros_like(mixed[0]), target.chroma_shift)] * 2),
        ]
    elif colour.chroma_shift != target.chroma_shift:
        shape = mixed[0].shape
        mixed = [mixed[0], *(_coarse(_fine(c, shape, colour.chroma_shift), target.chroma_shift) for c in mixed[1:])]
    return replace(picture, planes=_stored([plane * _span(k, target) for k, plane in enumerate(mixed)], target))


def _span(k: int, colour: Colour) -> np.float32:
    """Codes from 0 to 1 of luma or of R'G'B', and from -1/2 to 1/2 of chroma."""
    if colour.full_range:
        return np.float32(colour.top)
    return np.float32((219 if k == 0 or colour.matrix is Matrix.RGB else 224) << (colour.depth - 8))


def _zero(k: int, colour: Colour) -> np.float32:
    """The code of black, or of no colour."""
    if k and colour.matrix is not Matrix.RGB:
        return np.float32(1 << (colour.depth - 1))
    return np.float32(0 if colour.full_range else 16 << (colour.depth - 8))


def _nominal(plane: np.ndarray, k: int, colour: Colour) -> np.ndarray:
    return (plane.astype(np.float32) - _zero(k, colour)) * (np.float32(1) / _span(k, colour))


def _primed(picture: Picture, colour: Colour) -> list[np.ndarray]:
    """R', G' and B' (or grey) of the codes: 0 black, 1 nominal white."""
    parts = [_nominal(plane, k, colour) for k, plane in enumerate(picture.planes)]
    if colour.matrix is not Matrix.RGB and len(parts) == 3:
        kr, kb = _KR_KB[colour.matrix]
        y, cb, cr = parts[0], *(_fine(c, parts[0].shape, colour.chroma_shift) for c in parts[1:])
        red, blue = y + np.float32(2 * (1 - kr)) * cr, y + np.float32(2 * (1 - kb)) * cb
        parts = [red, (y - np.float32(kr) * red - np.float32(kb) * blue) * np.float32(1 / (1 - kr - kb)), blue]
    return parts


def _mixed(parts: list[np.ndarray], colour: Colour) -> list[np.ndarray]:
    """Planes in steps of codes, without the code of zero, that R', G' and B' make; linear."""
    if colour.matrix is not Matrix.RGB and len(parts) == 3:
        kr, kb = _KR_KB[colour.matrix]
        y = np.float32(kr) * parts[0] + np.float32(1 - kr - kb) * parts[1] + np.float32(kb) * parts[2]
        parts = [y, (parts[2] - y) * np.float32(0.5 / (1 - kb)), (parts[0] - y) * np.float32(0.5 / (1 - kr))]
    return _in_steps(parts, colour)


def _in_steps(parts: list[np.ndarray], colour: Colour) -> list[np.ndarray]:
    """Luma, and chroma made coarser, or R', G' and B', in steps of codes."""
    if colour.matrix is not Matrix.RGB:
        parts = [parts[0], *(_coarse(c, colour.chroma_shift) for c in parts[1:])]
    return [part * _span(k, colour) for k, part in enumerate(parts)]


def _stored(parts: list[np.ndarray], colour: Colour) -> tuple[np.ndarray, ...]:
    return tuple(_rounded(part + _zero(k, colour), colour) for k, part in enumerate(parts))


def _rounded(plane: np.ndarray, colour: Colour) -> np.ndarray:
    return np.clip(np.rint(plane), 0, colour.top).astype(np.uint8 if colour.depth <= 8 else np.uint16)


def _fine(c: np.ndarray, shape: tuple[int, ...], shift: tuple[int, int]) -> np.ndarray:
    """Chroma at every luma sample: sited with the left column, and midway between two rows (H.264's and HEVC's default)."""
    rows, cols = shape
    for _ in range(shift[0]):
        quarter, c, coarse = 0.25 * c, np.empty((2 * len(c), c.shape[1]), np.float32), 0.75 * c
        c[::2], c[1::2] = coarse, coarse
        c[:1] += quarter[:1]
        c[2::2] += quarter[:-1]
        c[1:-1:2] += quarter[1:]
        c[-1:] += quarter[-1:]
    for _ in range(shift[1]):
        coarse, c = c, np.empty((len(c), 2 * c.shape[1]), np.float32)
        c[:, ::2] = coarse
        c[:, 1:-1:2] = 0.5 * (coarse[:, :-1] + coarse[:, 1:])
        c[:, -1:] = coarse[:, -1:]
    return c[:rows, :cols]


def _coarse(c: np.ndarray, shift: tuple[int, int]) -> np.ndarray:
    """The counterpart of `_fine`: its weights, transposed."""
    for n in range(max(shift)):
        down, across = (n < times for times in shift)
        fine, c = c, np.empty([-(-side // 2) if halved else side for side, halved in zip(c.shape, (down, across), strict=True)], np.float32)
        spread(colour_loops.coarser, len(c), fine, down, across, c)
    return c


def _halved_at_most(colour: Colour) -> bool:
    """Whether there is chroma, with half as many rows and columns as luma or with all: the layouts of nearly every clip."""
    return colour.matrix is not Matrix.RGB and colour.subsampling != "4:0:0" and max(colour.chroma_shift) <= 1


def _scale(colour: Colour) -> tuple[float, float]:
    """Gain and lift from R'G'B' to what the curve is defined on: log curves are, on whole codes."""
    if colour.transfer.logarithmic and not colour.full_range:
        span, top = 219 << (colour.depth - 8), colour.top
        return span / top, (16 << (colour.depth - 8)) / top
    return 1.0, 0.0


def _highest(colour: Colour) -> float:
    """The largest value of R'G'B' that equal codes reach."""
    if colour.full_range:
        return 1.0
    return (colour.top - (16 << (colour.depth - 8))) / (219 << (colour.depth - 8))


def _full_light(colour: Colour) -> float:
    """The light of `_highest`, where that of code 1 is 1."""
    if colour.floating:
        return 1.0
    gain, lift = _scale(colour)
    return float(tone.decode(colour.transfer, np.array([gain * _highest(colour) + lift], np.float32))[0])


@lru_cache(maxsize=8)
def _tables(transfer: Tone, gain: float, lift: float, highest: float) -> tuple[np.ndarray, np.ndarray]:
    """Light by R'G'B' from 0 to `highest`; and R'G'B' by the fourth root of light, which is where curves are steep."""
    primed = np.linspace(0, highest, _ENTRIES + 1)
    to_light = tone.decode(transfer, (gain * primed + lift).astype(np.float32)).astype(np.float64)
    to_light = np.maximum.accumulate(np.maximum(to_light, 0) / to_light[-1])
    rising = np.concatenate([to_light[:-1] < to_light[1:], [True]])  # of equal ones, the last: the code of black
    roots = np.linspace(0, 1, _ENTRIES + 1)
    to_primed = np.interp(roots**4, to_light[rising], primed[rising])
    return to_light.astype(np.float32), to_primed.astype(np.float32)


def _of(colour: Colour) -> tuple[np.ndarray, np.ndarray]:
    return _tables(colour.transfer, *_scale(colour), _highest(colour))


def _coded(pixels: np.ndarray, colour: Colour) -> list[np.ndarray]:
    """R', G' and B' of light, each by itself."""
    table, parts = _of(colour)[1], [np.empty(pixels.shape[:2], np.float32) for _ in range(pixels.shape[2])]
    for k, part in enumerate(parts):
        spread(colour_loops.primed_by, len(part), pixels[..., k], table, part)
    return parts


def _full(colour: Colour) -> tuple[np.float32, np.float32, np.float32]:
    """From which R'G'B' on the camera was full; and between which two, as a codec leaves a plateau at nominal white."""
    step = 1 / 255 if colour.full_range else 1 / 219
    if colour.depth > 8:
        step /= 2
    above_white = not (colour.full_range or colour.transfer.logarithmic)  # codes beyond nominal white
    below = _SUPERWHITE if above_white else _BELOW
    full = _highest(colour) - below * step if colour.saturation is None else colour.saturation
    low, high = (1 - _BELOW * step, 1 + _ABOVE * step) if above_white else (np.inf, np.inf)
    return np.float32(full), np.float32(low), np.float32(high)
