"""A sensor's noise grows with light."""

import numpy as np
import pytest

from rsvideo.physics.noise import Noise


def test_the_variance_is_affine_in_the_light() -> None:
    noise = Noise(read=0.003, shot=4e-4)
    np.testing.assert_allclose(noise.at(np.array([-0.1, 0.0, 0.25])) ** 2, [9e-6, 9e-6, 1.09e-4])


def test_half_of_its_variance_at_half_of_white_is_shot_noise() -> None:
    noise = Noise.at_half(0.01)
    assert noise.at(np.array([0.5]))[0] == pytest.approx(0.01)
    assert noise.read**2 == pytest.approx(0.5e-4)


def test_a_picture_has_the_noise_of_its_mean_light() -> None:
    pixels = np.zeros((10, 10, 3), np.float32)
    pixels[:5] = 0.8
    noise = Noise(read=0.001, shot=1e-3)
    rng = np.random.default_rng(0)
    drawn = noise.at(pixels)[..., None] * rng.standard_normal((10, 10, 3, 500))
    assert noise.over(pixels) == pytest.approx(np.sqrt(np.mean(drawn**2)), rel=0.01)


@pytest.mark.parametrize(("read", "shot"), [(-0.1, 0.0), (0.0, -1e-3), (2.0, 0.0), (0.0, 3.0), (float("nan"), 0.0)])
def test_impossible_noise_is_refused(read: float, shot: float) -> None:
    with pytest.raises(ValueError, match="8-bit codes"):
        Noise(read=read, shot=shot)
