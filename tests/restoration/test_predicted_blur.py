"""Neighbours show how much of the blur that a path predicts is in a frame."""

import cv2
import numpy as np
import pytest

from rsvideo.restoration.predicted_blur import Confirmed, Predicted, confirmed
from rsvideo.restoration.trust import borne_out, confirmation

ROWS, COLS = 80, 120
EVERYWHERE = np.ones((ROWS, COLS), bool)


def scene(*, texture: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    """A picture, and the same blurred."""
    sharp = 0.5 + texture * np.random.default_rng(0).normal(size=(ROWS, COLS)).astype(np.float32)
    return sharp, cv2.blur(sharp, (7, 1))


def measured(observed: np.ndarray, blurred: np.ndarray, displaced: np.ndarray, shown: np.ndarray) -> Confirmed:
    return confirmed(Predicted(observed=observed, target=displaced, blurred=blurred, displaced=displaced, shown=shown))


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0, 1.3])
def test_the_share_of_the_blur_that_is_there_is_found(share: float) -> None:
    sharp, blurred = scene()
    found = measured(sharp + np.float32(share) * (blurred - sharp), blurred, sharp, EVERYWHERE)
    assert found.whole == pytest.approx(share, abs=1e-3)
    np.testing.assert_allclose(found.about, share, atol=0.01)


def test_what_noise_hides_is_not_held_against_the_path() -> None:
    sharp, blurred = scene(texture=0.002)
    noisy = sharp + 0.05 * np.random.default_rng(1).normal(size=sharp.shape).astype(np.float32)
    assert (measured(noisy, blurred, sharp, EVERYWHERE).about > 1).mean() > 0.5


def test_where_no_neighbour_shows_the_place_the_path_is_followed() -> None:
    sharp, blurred = scene()
    shown = EVERYWHERE.copy()
    shown[:, 60:] = False
    found = measured(sharp, blurred, sharp, shown)
    np.testing.assert_array_equal(found.about[:, 60:], 1)
    assert found.about[:, :60].max() < 0.1
    nowhere = measured(sharp, blurred, sharp, ~EVERYWHERE)
    assert nowhere.whole == 1
    np.testing.assert_array_equal(confirmation(nowhere, 6.0), 1)


def test_blur_that_is_not_there_is_not_taken_away_unless_it_is_short() -> None:
    sharp, blurred = scene()
    half = sharp.copy()
    half[:, :60] = blurred[:, :60]
    found = measured(half, blurred, sharp, EVERYWHERE)
    assert found.whole == pytest.approx(0.5, abs=0.05)
    share = confirmation(found, 6.0)
    assert share[40, 20] == pytest.approx(0.5, abs=0.15)  # by the frame as a whole
    assert share[40, 100] == 0
    np.testing.assert_array_equal(confirmation(found, 2.0), 1)


def test_the_less_sure_the_blur_is_the_more_of_it_has_to_show() -> None:
    sharp, blurred = scene()
    found = measured(0.6 * blurred + 0.4 * sharp, blurred, sharp, EVERYWHERE)
    assert found.whole == pytest.approx(0.6, abs=0.02)
    shares = [confirmation(found, 6.0, certainty)[40, 60] for certainty in (1.0, 0.9, 0.7)]
    assert shares == pytest.approx([1, 0.5, 0], abs=0.15)
    there = measured(blurred, blurred, sharp, EVERYWHERE)
    np.testing.assert_array_equal(confirmation(there, 6.0, 0.5), 1)


def test_a_path_is_borne_out_by_blur_that_is_there_or_too_short_to_tell() -> None:
    sharp, blurred = scene()
    there, missing = (measured(frame, blurred, sharp, EVERYWHERE) for frame in (blurred, sharp))
    assert [borne_out(there, 6.0), borne_out(missing, 6.0), borne_out(missing, 2.0)] == [1, 0, 1]
    assert 0 < borne_out(missing, 2.5) < 1
