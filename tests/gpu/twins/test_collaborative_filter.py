"""The denoiser on the device finds the processor's groups and filters them alike."""

import numpy as np
import pytest

from rsvideo.gpu import arrays, collaborative_filter
from rsvideo.gpu.arrays import to_host, xp
from rsvideo.gpu.collaborative_filter import Matches
from rsvideo.solvers import collaborative_filter as twin

LARGE = not arrays.SIMULATED
SIGMA = 0.2


def image(rows: int, cols: int, channels: int, levels: int = 16) -> np.ndarray:
    """Noise of few levels: distances between patches are sums of whole numbers, exact in every order; of two levels, many are equal."""
    return (np.random.default_rng(0).integers(0, levels, (rows, cols, channels)) / 16).astype(np.float32)


def on_device(picture: np.ndarray) -> arrays.Array:
    return xp.asarray(np.ascontiguousarray(np.moveaxis(picture, 2, 0)))


@pytest.mark.parametrize(("rows", "cols"), [(60, 83), (9, 200), (200, 9)] if LARGE else [(12, 13), (9, 21)])
def test_the_groups_are_the_processors_to_the_last_tie(rows: int, cols: int) -> None:
    picture = image(rows, cols, 1, levels=2)
    np.testing.assert_array_equal(to_host(collaborative_filter.match(on_device(picture)).offsets), twin.match(picture).offsets)


@pytest.mark.parametrize("shrinkage", ["threshold", "wiener"])
@pytest.mark.parametrize("channels", [1, 3])
def test_the_picture_is_the_processors(shrinkage: str, channels: int) -> None:
    picture = image(*((60, 83) if LARGE else (8, 13)), channels)
    pilot = None if shrinkage == "threshold" else np.ascontiguousarray(picture[::-1])
    matches = twin.match(picture)
    ours = collaborative_filter.denoise(
        on_device(picture),
        SIGMA,
        pilot=None if pilot is None else on_device(pilot),
        matches=Matches(offsets=xp.asarray(matches.offsets)),
    )
    theirs = twin.denoise(picture, SIGMA, pilot=pilot, matches=matches)
    np.testing.assert_allclose(np.moveaxis(to_host(ours), 0, 2), theirs, atol=2e-6)


def test_sums_in_whole_numbers_are_the_same_bytes_every_time() -> None:
    picture = on_device(image(60, 83, 3) if LARGE else image(9, 9, 1))
    first, second = (to_host(collaborative_filter.denoise(picture, SIGMA)) for _ in range(2))
    np.testing.assert_array_equal(first, second)
