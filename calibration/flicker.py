"""What a rolling shutter records under a light that flickers: the twin of `timing.bands`, for tests, measurements and examples."""

import numpy as np
from jaxtyping import Float, UInt8

from rsvideo.physics import tone
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.tone import Transfer

_GREY, _NOISE = 0.3, 0.002  # linear light, and its standard deviation


def square(duty: float, terms: int = 25) -> Float[np.ndarray, " terms"]:
    """Amplitudes a_h of cos(2 pi h f t) of a light that is on for a part `duty` of its period, about its mean 1."""
    h = np.arange(1, terms + 1)
    return 2 * np.sinc(h * duty)


def sine(depth: float) -> Float[np.ndarray, " one"]:
    """Amplitude of a light that swings by `depth` about its mean 1."""
    return np.array([depth])


def gains(
    timing: ShutterTiming, begins: float, amplitudes: Float[np.ndarray, " terms"], *, hertz: float, cycles: float = 0.0
) -> Float[np.ndarray, " scanlines"]:
    """The light of each scanline, as a multiple of its mean: the mean over the exposure of a wave that is `cycles` ahead.

    Examples:
        An exposure of a whole period of the light leaves no bands:

        >>> from calibration import flicker
        >>> from rsvideo.physics.shutter import ShutterTiming
        >>> timing = ShutterTiming(exposure=0.01, row_time=1e-4, rows=4)
        >>> flicker.gains(timing, 0.0, flicker.sine(0.5), hertz=100).round(6).tolist()
        [1.0, 1.0, 1.0, 1.0]
    """
    h = np.arange(1, len(amplitudes) + 1)
    middle = hertz * (begins + timing.row_start() + timing.exposure / 2) + cycles
    averaged = amplitudes * np.sinc(h * hertz * timing.exposure)  # over a box of the exposure's length
    return 1 + np.cos(2 * np.pi * np.outer(middle, h)) @ averaged


def lit(
    scene: Float[np.ndarray, "rows cols channels"], timing: ShutterTiming, multiples: Float[np.ndarray, " scanlines"]
) -> Float[np.ndarray, "rows cols channels"]:
    """A scene in linear light under a light that scanlines find so many times as bright; stored rows in the image's order.

    Examples:
        >>> import numpy as np
        >>> from calibration import flicker
        >>> from rsvideo.physics.shutter import ShutterTiming
        >>> timing = ShutterTiming(exposure=1e-3, row_time=1e-4, rows=2)
        >>> flicker.lit(np.ones((2, 1, 1)), timing, np.array([0.5, 2.0])).ravel().tolist()
        [0.5, 2.0]
    """
    return timing.direction.image(timing.direction.scanlines(scene) * multiples[:, None, None])


def wall(
    timing: ShutterTiming, *, hertz: float, begins: float = 0.0, depth: float = 0.2, cols: int = 32, seed: int = 0
) -> UInt8[np.ndarray, "rows cols"]:
    """A photograph of a grey wall whose light swings by `depth` about its mean: 8-bit sRGB codes, with a little noise.

    Scanlines are rows. `begins` is when the first row opens, in seconds.

    Examples:
        >>> from calibration import flicker
        >>> from rsvideo.physics.shutter import ShutterTiming
        >>> flicker.wall(ShutterTiming(exposure=1e-4, row_time=1e-4, rows=48), hertz=500.0, cols=8).shape
        (48, 8)
    """
    light = lit(np.full((timing.rows, cols, 1), _GREY), timing, gains(timing, begins, sine(depth), hertz=hertz))[..., 0]
    light = np.clip(light + _NOISE * np.random.default_rng(seed).standard_normal(light.shape), 0, 1)
    return np.round(255 * tone.encode(Transfer.SRGB, light.astype(np.float32))).astype(np.uint8)
