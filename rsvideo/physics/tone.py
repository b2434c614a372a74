"""Transfer functions under their standards' names: code values to linear light and back.

Code 1.0 is light 1.0 in all of them: curves whose top code stands for more than white (log curves, PQ) are divided by that light.
Log curves have codes below the one of black; there light is negative, as the curve's formula has it. Their makers write them for
whole codes, code / (2^bits - 1), also where the stream's range is limited.
"""

import enum
import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from jaxtyping import Float32


class Transfer(enum.StrEnum):
    """How code values in [0, 1] stand for linear light, which is 1 at code 1."""

    SRGB = "srgb"  # IEC 61966-2-1
    BT709 = "bt709"  # ITU-R BT.709, camera side; constants to the digits of BT.2020, so that both pieces meet; BT.601 and BT.2020 too
    LINEAR = "linear"
    GAMMA22 = "gamma22"  # ITU-R BT.470 M
    GAMMA28 = "gamma28"  # ITU-R BT.470 B, G
    PQ = "pq"  # SMPTE ST 2084; light 1 is 10 000 cd/m2
    HLG = "hlg"  # ARIB STD-B67, ITU-R BT.2100; scene light
    SLOG3 = "s-log3"  # Sony, technical summary for S-Gamut3/S-Log3
    CLOG = "c-log"  # Canon Log, revision 1.2
    CLOG3 = "c-log3"  # Canon Log 3
    VLOG = "v-log"  # Panasonic V-Log/V-Gamut reference manual
    LOGC3 = "logc3"  # ARRI LogC3 at EI 800, scene exposure

    @property
    def logarithmic(self) -> bool:
        """Whether this is a camera's log curve, defined on whole codes."""
        return self in _LOGS or self in _CANON_LOGS


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A tone curve that was measured: light at codes evenly spaced from 0 to 1, rising to 1; straight on beyond its ends."""

    light: tuple[float, ...]
    value: ClassVar[Literal["measured"]] = "measured"
    logarithmic: ClassVar[bool] = False

    def at(self, code: np.ndarray) -> np.ndarray:
        """Light of codes."""
        step = 1 / (len(self.light) - 1)
        beyond = np.maximum(code - 1, 0) * (self.light[-1] - self.light[-2]) / step  # limited range has codes above nominal white
        return np.interp(code, np.linspace(0, 1, len(self.light)), self.light) + beyond

    def code(self, light: np.ndarray) -> np.ndarray:
        """Codes of light; of several codes of one light, the highest: that of black."""
        curve = np.array(self.light)
        rising = np.append(np.diff(curve) > 0, True)
        return np.interp(light, curve[rising], np.linspace(0, 1, len(curve))[rising])


Tone = Transfer | Curve

_SRGB_KNEE = 0.0031308  # linear light
_BT709_ALPHA, _BT709_BETA = 1.09929682680944, 0.018053968510807
_PQ_M1, _PQ_M2, _PQ_C1, _PQ_C2, _PQ_C3 = 2610 / 16384, 2523 / 4096 * 128, 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
_HLG_A = 0.17883277
_HLG_B, _HLG_C = 1 - 4 * _HLG_A, 0.5 - _HLG_A * math.log(4 * _HLG_A)
_LEAST_ARGUMENT = 1e-9  # of a logarithm whose branch is not taken there
_CANON_WHITE = 0.9  # of light, to which Canon's curves refer: the reflectance of a white card


@dataclass(frozen=True, kw_only=True)
class _Log:
    """code = c log10(a light + b) + d from `knee` on, and `slope` light + `offset` below it."""

    a: float
    b: float
    c: float
    d: float
    knee: float  # linear light
    slope: float
    offset: float

    def code(self, light: np.ndarray) -> np.ndarray:
        curve = self.c * np.log10(np.maximum(self.a * light + self.b, _LEAST_ARGUMENT)) + self.d
        return np.where(light >= self.knee, curve, self.slope * light + self.offset)

    def light(self, code: np.ndarray) -> np.ndarray:
        curve = (10 ** ((code - self.d) / self.c) - self.b) / self.a
        return np.where(code >= self.slope * self.knee + self.offset, curve, (code - self.offset) / self.slope)


_LOGS = {
    Transfer.SLOG3: _Log(
        a=1 / 0.19,
        b=0.01 / 0.19,
        c=261.5 / 1023,
        d=420 / 1023,
        knee=0.01125,
        slope=(171.2102946929 - 95) / 0.01125 / 1023,
        offset=95 / 1023,
    ),
    Transfer.VLOG: _Log(a=1, b=0.00873, c=0.241514, d=0.598206, knee=0.01, slope=5.6, offset=0.125),
    Transfer.LOGC3: _Log(a=5.555556, b=0.052272, c=0.247190, d=0.385537, knee=0.010591, slope=5.367655, offset=0.092809),
}


@dataclass(frozen=True, kw_only=True)
class _CanonLog:
    """code = d + sign(x) c log10(a |x| + 1) of x = light / _CANON_WHITE; within +-`straight` of black it is slope x + offset."""

    a: float
    c: float
    low: float  # d of the branch below black
    high: float  # d of the branch above
    straight: float  # x
    slope: float
    offset: float

    def code(self, light: np.ndarray) -> np.ndarray:
        x = light / _CANON_WHITE
        bent = self.c * np.log10(self.a * np.abs(x) + 1)
        return np.where(np.abs(x) <= self.straight, self.slope * x + self.offset, np.where(x < 0, self.low - bent, self.high + bent))

    def light(self, code: np.ndarray) -> np.ndarray:
        below = code < self.offset
        bent = (10 ** (np.where(below, self.low - code, code - self.high) / self.c) - 1) / self.a
        straight = np.abs(code - self.offset) <= self.slope * self.straight
        return _CANON_WHITE * np.where(straight, (code - self.offset) / self.slope, np.where(below, -bent, bent))


_CANON_LOGS = {
    Transfer.CLOG: _CanonLog(a=10.1596, c=0.45310179, low=0.12512248, high=0.12512248, straight=0.0, slope=1.0, offset=0.12512248),
    Transfer.CLOG3: _CanonLog(
        a=14.98325, c=0.36726845, low=0.12783901, high=0.12240537, straight=0.014, slope=1.9754798, offset=0.12512219
    ),
}


def encode(transfer: Tone, linear: Float32[np.ndarray, "*shape"]) -> Float32[np.ndarray, "*shape"]:
    """Code values of linear light; what lies outside codes [0, 1] is clipped."""
    match transfer:
        case Curve():
            return transfer.code(np.clip(linear, 0, 1)).astype(np.float32)
        case Transfer.SRGB:
            light = np.clip(linear, 0, 1)
            return np.where(light <= _SRGB_KNEE, 12.92 * light, 1.055 * light ** np.float32(1 / 2.4) - 0.055)
        case Transfer.BT709:
            light = np.clip(linear, 0, 1)
            curve = _BT709_ALPHA * light ** np.float32(0.45) - (_BT709_ALPHA - 1)
            return np.where(light < _BT709_BETA, 4.5 * light, curve)
        case Transfer.LINEAR:
            return np.clip(linear, 0, 1)
        case Transfer.GAMMA22:
            return np.clip(linear, 0, 1) ** np.float32(1 / 2.2)
        case Transfer.GAMMA28:
            return np.clip(linear, 0, 1) ** np.float32(1 / 2.8)
        case _:
            code = _code(transfer, np.clip(linear.astype(np.float64), -1, 1) * _top(transfer))
            return np.clip(code, 0, 1).astype(np.float32)


def decode(transfer: Tone, codes: Float32[np.ndarray, "*shape"]) -> Float32[np.ndarray, "*shape"]:
    """Linear light of code values in [0, 1]; the inverse of `encode`."""
    match transfer:
        case Curve():
            return transfer.at(codes).astype(np.float32)
        case Transfer.SRGB:
            return np.where(codes <= 12.92 * _SRGB_KNEE, codes / 12.92, ((codes + 0.055) / 1.055) ** np.float32(2.4))
        case Transfer.BT709:
            curve = ((codes + (_BT709_ALPHA - 1)) / _BT709_ALPHA) ** np.float32(1 / 0.45)
            return np.where(codes < 4.5 * _BT709_BETA, codes / 4.5, curve)
        case Transfer.LINEAR:
            return codes
        case Transfer.GAMMA22:
            return np.clip(codes, 0, None) ** np.float32(2.2)
        case Transfer.GAMMA28:
            return np.clip(codes, 0, None) ** np.float32(2.8)
        case _:
            return (_light(transfer, codes.astype(np.float64)) / _top(transfer)).astype(np.float32)


def _code(transfer: Transfer, light: np.ndarray) -> np.ndarray:
    match transfer:
        case Transfer.PQ:
            y = np.maximum(light, 0) ** _PQ_M1
            return ((_PQ_C1 + _PQ_C2 * y) / (1 + _PQ_C3 * y)) ** _PQ_M2
        case Transfer.HLG:
            bent = _HLG_A * np.log(np.maximum(12 * light - _HLG_B, _LEAST_ARGUMENT)) + _HLG_C
            return np.where(light <= 1 / 12, np.sqrt(3 * np.maximum(light, 0)), bent)
        case _:
            return (_LOGS | _CANON_LOGS)[transfer].code(light)


def _light(transfer: Transfer, code: np.ndarray) -> np.ndarray:
    match transfer:
        case Transfer.PQ:
            v = np.maximum(code, 0) ** (1 / _PQ_M2)
            return (np.maximum(v - _PQ_C1, 0) / (_PQ_C2 - _PQ_C3 * v)) ** (1 / _PQ_M1)
        case Transfer.HLG:
            return np.where(code <= 0.5, np.maximum(code, 0) ** 2 / 3, (np.exp((code - _HLG_C) / _HLG_A) + _HLG_B) / 12)
        case _:
            return (_LOGS | _CANON_LOGS)[transfer].light(code)


def _top(transfer: Transfer) -> float:
    """The light of code 1 before it is called 1."""
    return float(_light(transfer, np.ones(1))[0])
