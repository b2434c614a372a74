"""Filters and samples of pictures are OpenCV's, at places that it does not round."""

import cv2
import numpy as np
import pytest

from rsvideo.gpu import arrays, resampling
from rsvideo.gpu.arrays import to_host, xp
from rsvideo.restoration.nodes import NODES, between, nodes

LARGE = not arrays.SIMULATED
ROWS, COLS = (270, 333) if LARGE else (19, 23)
ROUNDED = 32  # parts of a px, to which OpenCV rounds places
RNG = np.random.default_rng(0)


def picture(channels: int) -> np.ndarray:
    """Of middle tones: few samples are clipped."""
    return RNG.uniform(0.2, 0.8, (ROWS, COLS, channels)).astype(np.float32)


def scattered(parts: float) -> np.ndarray:
    """Places (2, rows, cols), x and y, in so many parts of a px, some beyond every border."""
    x, y = np.meshgrid(np.arange(COLS), np.arange(ROWS))
    drift = RNG.uniform(-6, 6, (2, ROWS, COLS))
    return (np.round((np.stack([x, y]) + drift) * parts) / parts).astype(np.float32)


def test_filters_are_opencvs() -> None:
    image = picture(1)[..., 0]
    there = xp.asarray(image)
    np.testing.assert_allclose(to_host(resampling.blurred(there, 1.2)), cv2.GaussianBlur(image, (0, 0), 1.2), atol=1e-6)
    narrow = resampling.blurred(there[:3], 1.2)  # fewer rows than the filter reaches
    np.testing.assert_allclose(to_host(narrow), cv2.GaussianBlur(np.ascontiguousarray(image[:3]), (0, 0), 1.2), atol=1e-6)
    np.testing.assert_allclose(to_host(resampling.mean(there, 15)), cv2.boxFilter(image, -1, (15, 15)), atol=2e-6)
    gx, gy = resampling.gradients(there)
    np.testing.assert_allclose(to_host(gx), cv2.Sobel(image, -1, 1, 0, scale=1 / 8), atol=1e-6)
    np.testing.assert_allclose(to_host(gy), cv2.Sobel(image, -1, 0, 1, scale=1 / 8), atol=1e-6)


@pytest.mark.parametrize("name", ["lanczos", "linear"])
def test_samples_are_opencvs_where_it_does_not_round_places(name: str) -> None:
    image, at = picture(2), scattered(ROUNDED)
    how = cv2.INTER_LANCZOS4 if name == "lanczos" else cv2.INTER_LINEAR
    expected = np.clip(cv2.remap(image, at[0], at[1], how, borderMode=cv2.BORDER_REPLICATE), 0, 1)
    found = getattr(resampling, name)(arrays.planes_to_device(image), xp.asarray(at))
    np.testing.assert_allclose(arrays.planes_to_host(found), expected, atol=2e-5)


def test_lanczos_samples_at_any_place_are_the_sums_that_define_them() -> None:
    image, at = picture(1)[..., 0], scattered(1e6)
    expected = np.zeros(image.shape)
    whole = np.floor(at).astype(int)
    along = []
    for axis in range(2):
        d = at[axis].astype(float) - whole[axis] - np.arange(-3, 5)[:, None, None]
        weights = np.sinc(d) * np.sinc(d / 4)
        along.append(weights / weights.sum(axis=0))
    for i in range(8):
        for k in range(8):
            row, col = np.clip(whole[1] + i - 3, 0, ROWS - 1), np.clip(whole[0] + k - 3, 0, COLS - 1)
            expected += along[1][i] * along[0][k] * image[row, col]
    found = to_host(resampling.lanczos(xp.asarray(image)[None], xp.asarray(at)))[0]
    np.testing.assert_allclose(found, np.clip(expected, 0, 1), atol=1e-4)  # places of a few hundred px have 24 bits


@pytest.mark.parametrize("by_row", [True, False], ids=["every row", "every few rows"])
def test_places_between_nodes_are_the_processors(by_row: bool) -> None:
    columns = nodes(COLS)
    rows = np.arange(ROWS) if by_row else nodes(ROWS)
    x, y = np.meshgrid(columns.astype(float), np.arange(ROWS, dtype=float))
    bent = np.stack([0.02 * x - 0.01 * y + 1.5, 0.03 * y - 0.7], axis=-1)
    bent += np.sin(np.arange(ROWS))[:, None, None] if by_row else 0.0
    shift = RNG.uniform(-1, 1, (2, 2, ROWS))
    side = np.linspace(-0.5, 0.5, COLS)[columns]
    moved = (shift[0][:, :, None] + shift[1][:, :, None] * side).transpose(1, 2, 0)
    expected = between((np.stack([x, y], axis=-1) + bent + moved).astype(np.float32), columns)
    how = bent[rows], (1 if by_row else NODES, NODES), (ROWS, COLS), shift
    np.testing.assert_allclose(to_host(resampling.places(*how)), expected, atol=1e-4)
    np.testing.assert_allclose(to_host(resampling.places(*how, (3, 2))), expected[:, 3:-3:2, 3:-3:2], atol=1e-4)
