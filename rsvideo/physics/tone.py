"""Transfer functions under their standards' names: code values to linear light and back."""

import enum

import numpy as np
from jaxtyping import Float32


class Transfer(enum.StrEnum):
    """How code values in [0, 1] stand for linear light in [0, 1]."""

    SRGB = "srgb"  # IEC 61966-2-1
    BT709 = "bt709"  # ITU-R BT.709, camera side; constants to the digits of BT.2020, so that both pieces meet
    LINEAR = "linear"


_SRGB_KNEE = 0.0031308  # linear light
_BT709_ALPHA, _BT709_BETA = 1.09929682680944, 0.018053968510807


def encode(transfer: Transfer, linear: Float32[np.ndarray, "*shape"]) -> Float32[np.ndarray, "*shape"]:
    """Code values of linear light; light outside [0, 1] is clipped."""
    light = np.clip(linear, 0, 1)
    match transfer:
        case Transfer.SRGB:
            return np.where(light <= _SRGB_KNEE, 12.92 * light, 1.055 * light ** np.float32(1 / 2.4) - 0.055)
        case Transfer.BT709:
            curve = _BT709_ALPHA * light ** np.float32(0.45) - (_BT709_ALPHA - 1)
            return np.where(light < _BT709_BETA, 4.5 * light, curve)
        case Transfer.LINEAR:
            return light


def decode(transfer: Transfer, codes: Float32[np.ndarray, "*shape"]) -> Float32[np.ndarray, "*shape"]:
    """Linear light of code values in [0, 1]; the inverse of `encode`."""
    match transfer:
        case Transfer.SRGB:
            return np.where(codes <= 12.92 * _SRGB_KNEE, codes / 12.92, ((codes + 0.055) / 1.055) ** np.float32(2.4))
        case Transfer.BT709:
            curve = ((codes + (_BT709_ALPHA - 1)) / _BT709_ALPHA) ** np.float32(1 / 0.45)
            return np.where(codes < 4.5 * _BT709_BETA, codes / 4.5, curve)
        case Transfer.LINEAR:
            return codes
