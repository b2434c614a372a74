from collections.abc import Callable

import cv2
import numpy as np
import pytest
from skimage import data
from skimage.metrics import structural_similarity

from rsvideo.report import metrics


@pytest.fixture(scope="module")
def photograph() -> np.ndarray:
    """256 x 256 of the camera man: edges, a lawn, a sky."""
    return cv2.resize((data.camera() / 255).astype(np.float32), (256, 256), interpolation=cv2.INTER_AREA)


def blurred(image: np.ndarray, sigma: float) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), sigma)


def noisy(image: np.ndarray, sigma: float) -> np.ndarray:
    return image + np.random.default_rng(0).normal(0, sigma, image.shape).astype(np.float32)


def moved(image: np.ndarray, x: Callable | float = 0.0, y: float = 0.0) -> np.ndarray:
    """Sampled `x` to the right, which may depend on the row, and `y` below."""
    rows, cols = np.indices(image.shape, dtype=np.float32)
    right = cols + (x(rows) if callable(x) else np.float32(x))
    return cv2.remap(image, np.asarray(right), np.asarray(rows + np.float32(y)), cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)


def test_psnr_of_white_noise_is_its_level(photograph: np.ndarray) -> None:
    assert metrics.psnr(noisy(photograph, 0.02)[..., None], photograph[..., None]) == pytest.approx(-20 * np.log10(0.02), abs=0.1)


def test_a_shift_and_a_scale_cost_nothing(photograph: np.ndarray) -> None:
    soft = blurred(photograph, 2)
    shown = noisy(soft, 0.01)
    away = 0.8 * moved(shown, 3.0, -2.0)
    assert metrics.psnr(away[..., None], soft[..., None]) == pytest.approx(metrics.psnr(shown[..., None], soft[..., None]), abs=0.02)
    assert metrics.psnr((0.8 * moved(soft, 1.37, 2.21))[..., None], soft[..., None]) > 50  # as far as interpolation can tell


def test_ssim_is_that_of_scikit_image(photograph: np.ndarray) -> None:
    a = blurred(noisy(photograph, 0.05), 1)
    ours = metrics.ssim_of(metrics.Aligned(image=a[..., None], truth=photograph[..., None]))
    theirs = structural_similarity(a, photograph, data_range=1, gaussian_weights=True, sigma=1.5, use_sample_covariance=False)
    assert ours == pytest.approx(theirs, abs=1e-5)


def test_an_edge_is_as_wide_as_the_gaussian_that_blurred_it() -> None:
    y, x = np.indices((200, 200), dtype=np.float32)
    step = (np.hypot(x - 100, y - 100) < 60).astype(np.float32)
    for sigma in (1.5, 2.5):
        assert metrics.edge_width(0.2 + 0.5 * blurred(step, sigma)) == pytest.approx(2 * 1.2816 * sigma, rel=0.05)


def test_noise_hardly_changes_how_sharp_a_picture_counts(photograph: np.ndarray) -> None:
    soft = blurred(photograph, 2)
    assert metrics.edge_width(photograph) < 0.6 * metrics.edge_width(soft)
    assert metrics.edge_width(noisy(soft, 0.01)) == pytest.approx(metrics.edge_width(soft), rel=0.15)


def test_a_picture_without_edges_has_no_width() -> None:
    assert np.isnan(metrics.edge_width(np.full((80, 80), 0.5, np.float32)))
    assert np.isnan(metrics.edge_width(np.zeros((30, 20), np.float32)))


def test_ripples_on_a_sky_are_ringing_and_their_height_is_told(photograph: np.ndarray) -> None:
    recorded = blurred(photograph, 2)
    ripple = 0.02 * np.sin(2 * np.pi * np.arange(256) / 12).astype(np.float32)
    before, after = metrics.ringing(recorded, recorded), metrics.ringing(recorded + ripple, recorded)
    assert before < 0.6
    assert np.sqrt(after**2 - before**2) == pytest.approx(100 * 0.02 / np.sqrt(2), rel=0.25)


def test_white_noise_is_white_and_a_picture_is_not(photograph: np.ndarray) -> None:
    noise, everywhere = noisy(0 * photograph, 1), np.ones(photograph.shape, bool)
    assert metrics.whiteness(noise, everywhere) < 0.02
    assert metrics.whiteness(photograph - photograph.mean(), everywhere) > 0.5
    half = everywhere.copy()
    half[:, :128] = False
    assert metrics.whiteness(noise + 50 * ~half, half) < 0.02  # what is not valid does not count


def test_autocorrelation_of_a_moving_average_is_known() -> None:
    noise = np.random.default_rng(1).normal(size=(400, 401)).astype(np.float32)
    residual = noise[:, 1:] + noise[:, :-1]  # 1/2 at one pixel along the row, and 0 elsewhere
    lags = (metrics._LAGS + 1) * (2 * metrics._LAGS + 1) - metrics._LAGS - 1
    assert metrics.whiteness(residual, np.ones(residual.shape, bool)) == pytest.approx(0.5 / np.sqrt(lags), rel=0.03)


def test_a_line_that_sways_is_as_far_from_straight_as_it_sways() -> None:
    rows, cols = np.indices((240, 240), dtype=np.float32)
    stripes = blurred(((cols + 0.2 * rows) % 60 < 30).astype(np.float32), 1.0)
    straight, lines = metrics.straightness(stripes)
    assert straight < 0.15  # stairs of the pixels
    assert lines >= 4
    bent, _ = metrics.straightness(moved(stripes, lambda r: 1.5 * np.sin(r / 12)))
    assert bent == pytest.approx(1.5 / np.sqrt(2) * np.cos(np.arctan(0.2)), rel=0.15)


def test_where_there_is_no_line_nothing_is_said() -> None:
    value, lines = metrics.straightness(blurred(noisy(np.full((100, 100), 0.5, np.float32), 0.1), 3))
    assert (np.isnan(value), lines) == (True, 0)


def test_motion_is_no_flicker_but_noise_is(photograph: np.ndarray) -> None:
    soft = blurred(photograph, 1)
    panned = metrics.flicker(soft, moved(soft, 2.5, 1.0))
    shaken = metrics.flicker(soft, noisy(moved(soft, 2.5, 1.0), 0.05))
    assert panned < 0.1
    assert shaken > 3 * panned
