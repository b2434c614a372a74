"""Sixteen numbers side by side do what each of them would do alone."""

from collections.abc import Callable

import numpy as np
import pytest
from numba import njit

from rsvideo import lanes
from rsvideo.lanes import LANES

RNG = np.random.default_rng(0)
A, B = (RNG.uniform(0.5, 2, LANES).astype(np.float32) for _ in range(2))
HALF = LANES // 2


def of_two(operation: Callable[..., object]) -> np.ndarray:
    """What a compiled operation makes of A and B."""
    compiled = njit(operation)

    @njit
    def run(numbers, out):
        lanes.store(out, 0, compiled(lanes.load(numbers, 0), lanes.load(numbers, LANES)))

    out = np.zeros(LANES, np.float32)
    run(np.concatenate([A, B]), out)
    return out


@pytest.mark.parametrize(
    ("operation", "expected"),
    [
        (lambda a, b: a + b, A + B),
        (lambda a, b: a - b, A - B),
        (lambda a, b: a * b, A * B),
        (lambda a, b: a / b, A / B),
        (lambda a, b: lanes.root(a) + b, np.sqrt(A) + B),
        (lambda a, b: lanes.swapped(a) + b, np.roll(A, HALF) + B),
        (lambda a, b: lanes.exceeds(b - a, a), (np.abs(B - A) > A).astype(np.float32)),
        (lambda a, b: lanes.alike(lanes.total(a)) + b, A.sum() + B),
        (lambda a, b: a + b * lanes.alike_halves(np.float32(1), np.float32(-1)), A + B * np.repeat([1, -1], HALF)),
    ],
)
def test_an_operation_is_that_of_each_lane(operation: Callable[..., object], expected: np.ndarray) -> None:
    np.testing.assert_allclose(of_two(operation), expected, rtol=1e-6)


def test_halves_come_from_two_places_and_are_added_to_two_that_may_overlap() -> None:
    @njit
    def run(numbers, out):
        halves = lanes.load_halves(numbers, 1, 20)
        lanes.store_half(out, 0, halves)
        lanes.add_halves(out, 5, 7, halves)

    numbers, out = np.arange(40, dtype=np.float32), np.zeros(20, np.float32)
    run(numbers, out)
    expected = np.zeros(20, np.float32)
    expected[:HALF] = numbers[1 : 1 + HALF]
    expected[5 : 5 + HALF] += numbers[1 : 1 + HALF]
    expected[7 : 7 + HALF] += numbers[20 : 20 + HALF]
    np.testing.assert_array_equal(out, expected)


@pytest.mark.parametrize("frequencies", [LANES, LANES + 5, 3])
def test_spectra_become_lanes_and_lanes_spectra(frequencies: int) -> None:
    rows = 3
    spectra = (RNG.normal(size=(rows, frequencies)) + 1j * RNG.normal(size=(rows, frequencies))).astype(np.complex64)
    back = np.zeros_like(spectra)
    for block in range(-(-frequencies // LANES)):
        side_by_side = np.empty(rows * 2 * LANES, np.float32)
        lanes.gathered(spectra.view(np.float32).ravel(), rows, frequencies, block, side_by_side)
        live = spectra[:, block * LANES : (block + 1) * LANES]
        parts = side_by_side.reshape(rows, 2, LANES)[..., : live.shape[1]]
        np.testing.assert_array_equal(parts[:, 0] + 1j * parts[:, 1], live)
        lanes.scattered(side_by_side, rows, frequencies, block, back.view(np.float32).reshape(-1))
    np.testing.assert_array_equal(back, spectra)
