import numpy as np

from rsvideo.comparison import residual
from tests.report.test_plots import sidecar


def test_a_grid_of_kernels_blends_from_one_to_the_next() -> None:
    latent = np.zeros((60, 90), np.float32)
    latent[30, ::10] = 1
    psfs = np.zeros((1, 2, 5, 5), np.float32)
    psfs[0, 0, 2, 3] = 1  # one pixel to the right
    psfs[0, 1, 2, 1] = 1  # one to the left
    seen, border = residual._convolved(latent, psfs)
    assert border == 3
    assert (seen[30, 11], seen[30, 9]) == (1, 0)
    assert (seen[30, 81], seen[30, 79]) == (0, 1)
    assert 0 < seen[30, 41] < 1
    np.testing.assert_allclose(residual._convolved(np.full((60, 90), 0.3, np.float32), psfs)[0], 0.3, rtol=1e-5)


def test_the_motion_found_explains_what_it_has_blurred() -> None:
    said = sidecar(x=8)
    rng = np.random.default_rng(0)
    latent = rng.random((300, 400)).astype(np.float32)
    seen, border = residual._moved(latent, said.frames[0], said)
    row = 150  # open over the middle half of a steady pan of 8 px: 4 px
    expected = np.convolve(latent[row], np.ones(4) / 4, mode="same")
    inside = seen[row, border:-border]
    assert np.corrcoef(inside, expected[border:-border])[0, 1] > 0.9
    assert border < 12
