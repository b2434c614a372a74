import numpy as np

from rsvideo.pipeline import compare
from rsvideo.report.comparison import Crop
from tests.report.test_plots import sidecar


def test_crops_are_where_entries_differ_and_lie_apart() -> None:
    area = np.zeros((300, 400))
    area[40:60, 300:340] = 1.0
    area[200:230, 100:140] = 0.5
    first, second, *_ = compare._crops(area, 300, 400)
    assert first.x <= 300
    assert first.x + first.w >= 340
    assert first.y <= 40
    assert first.y + first.h >= 60
    assert second.x <= 100
    assert second.y + second.h >= 230
    assert abs(first.x - second.x) >= first.w or abs(first.y - second.y) >= first.h


def test_where_nothing_differs_the_middle_is_shown() -> None:
    assert list(compare._crops(np.zeros((300, 400)), 300, 400)) == [Crop(x=152, y=114, w=96, h=72, chosen=False)]
    small = list(compare._crops(np.ones((64, 80)), 64, 80))
    assert all(c.x >= 0 and c.y >= 0 and c.x + c.w <= 80 and c.y + c.h <= 64 for c in small)
    assert small


def test_a_grid_of_kernels_blends_from_one_to_the_next() -> None:
    latent = np.zeros((60, 90), np.float32)
    latent[30, ::10] = 1
    psfs = np.zeros((1, 2, 5, 5), np.float32)
    psfs[0, 0, 2, 3] = 1  # one pixel to the right
    psfs[0, 1, 2, 1] = 1  # one to the left
    seen, border = compare._convolved(latent, psfs)
    assert border == 3
    assert (seen[30, 11], seen[30, 9]) == (1, 0)
    assert (seen[30, 81], seen[30, 79]) == (0, 1)
    assert 0 < seen[30, 41] < 1
    np.testing.assert_allclose(compare._convolved(np.full((60, 90), 0.3, np.float32), psfs)[0], 0.3, rtol=1e-5)


def test_the_motion_found_explains_what_it_has_blurred() -> None:
    said = sidecar(x=8)
    rng = np.random.default_rng(0)
    latent = rng.random((300, 400)).astype(np.float32)
    seen, border = compare._moved(latent, said.frames[0], said)
    row = 150  # open over the middle half of a steady pan of 8 px: 4 px
    expected = np.convolve(latent[row], np.ones(4) / 4, mode="same")
    inside = seen[row, border:-border]
    assert np.corrcoef(inside, expected[border:-border])[0, 1] > 0.9
    assert border < 12


def test_as_many_frames_are_shown_as_a_page_can_carry() -> None:
    assert compare._looks(24, 8, 640 * 360) == frozenset(range(24))
    many = compare._looks(1000, 8, 3840 * 2160 / 4)
    assert 1 <= len(many) <= 12
    assert compare._looks(1, 8, 1e9) == frozenset({0})
