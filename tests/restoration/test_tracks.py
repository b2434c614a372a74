"""Points are found again where they have moved to, and not found where there is nothing to follow."""

import cv2
import numpy as np
import pytest
import skimage.data

from rsvideo.restoration.tracks import Tracks, codes, displaced, track

ROWS, COLS = 144, 200


def view(x: float, y: float, scene: str = "camera") -> np.ndarray:
    """What a camera sees whose top-left pixel lies at (x, y) of the scene."""
    photograph = np.asarray(getattr(skimage.data, scene)()).astype(np.float32)
    to_scene = np.array([[1, 0, x], [0, 1, y]], np.float64)
    sharp = cv2.warpAffine(photograph, to_scene, (COLS, ROWS), flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP)
    return np.clip(sharp, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (2.3, -1.7), (-21.4, 12.6)])
def test_a_shift_is_measured_to_a_tenth_of_a_pixel(shift: tuple[float, float]) -> None:
    seen = track(view(130, 100), view(130 + shift[0], 100 + shift[1]))
    assert len(seen.before) >= 60
    apart = seen.before - seen.after - np.array(shift)  # a camera that moves right moves the image left
    assert np.abs(np.median(apart, axis=0)).max() < 0.05
    assert np.median(np.linalg.norm(apart, axis=1)) < 0.1


def smeared(x: float, blur: float, scene: str = "camera") -> np.ndarray:
    """What a camera sees that turns to the right by `blur` px about (x, 100) of the scene."""
    photograph = np.asarray(getattr(skimage.data, scene)()).astype(np.float32)
    rows, cols = 288, 300
    seen = np.zeros((rows, cols), np.float32)
    for moved in np.arange(-blur / 2, blur / 2):
        to_scene = np.array([[1, 0, x + moved], [0, 1, 100]])
        seen += cv2.warpAffine(photograph, to_scene, (cols, rows), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    return np.round(seen / blur).astype(np.uint8)


def test_blur_that_a_window_does_not_show_is_followed_better_in_smaller_frames() -> None:
    before, after = smeared(50, 48), smeared(110, 62)  # the camera turns faster and faster
    full, small = (track(before, after, exposed) for exposed in (0.0, 0.8))
    missed = [np.median(np.linalg.norm(seen.before - seen.after - [60, 0], axis=1)) for seen in (full, small)]
    assert len(small.before) >= 40
    assert missed[1] < 0.7 * missed[0]
    assert small.error > full.error


def test_shorter_blur_is_followed_as_if_there_were_none() -> None:
    before, after = smeared(100, 8), smeared(110, 8)
    np.testing.assert_array_equal(track(before, after, 0.8).after, track(before, after).after)


def test_nothing_is_followed_across_a_cut() -> None:
    assert len(track(view(130, 100), view(100, 100, "coins")).before) == 0
    assert len(track(view(130, 100, "brick"), view(130, 100, "gravel")).before) == 0
    assert len(track(smeared(50, 64), smeared(50, 64, "coins"), 0.8).before) == 0


def test_nothing_is_followed_where_there_is_nothing_to_see() -> None:
    flat = np.full((ROWS, COLS), 90, np.uint8)
    assert len(track(flat, flat).before) == 0
    assert len(track(view(130, 100), flat).before) == 0


def test_what_moves_by_itself_is_left_out() -> None:
    before, after = view(130, 100), view(134, 100)
    before[40:110, 60:140], after[40:110, 68:148] = (view(200, 200, "gravel")[:70, :80],) * 2
    seen = track(before, after)
    apart = np.linalg.norm(seen.before - seen.after - [4, 0], axis=1)
    assert len(apart) >= 40
    assert apart.max() < 7


def test_shadows_have_contrast_for_tracking() -> None:
    light = np.array([[0.0, 0.0025, 0.01, 1.0, 1.5, -0.1]])
    np.testing.assert_array_equal(codes(light), [[0, 13, 26, 255, 255, 0]])


def test_a_place_moves_as_the_points_near_it() -> None:
    """Two things that move by themselves, through two links; one of five points about a place is wrong."""
    rng = np.random.default_rng(3)
    near, far = rng.uniform(0, 20, (40, 2)), rng.uniform(100, 120, (40, 2))
    moved = np.concatenate([np.full((40, 2), (4.0, -1.0)), np.full((40, 2), (-2.0, 3.0))])
    before = np.concatenate([near, far])
    after = before + moved
    after[::7] += 30.0
    links = [Tracks(before=before, after=after), Tracks(before=before + moved, after=after + moved)]
    places = np.array([[10.0, 10.0], [110.0, 110.0]])
    np.testing.assert_allclose(displaced(links, places), 2 * moved[[0, 40]], atol=1e-9)
    np.testing.assert_array_equal(displaced([], places), np.zeros((2, 2)))
