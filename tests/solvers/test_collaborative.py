import numpy as np
import pytest
import skimage.data
from jaxtyping import TypeCheckError
from skimage.restoration import denoise_tv_chambolle

from rsvideo import threads
from rsvideo.solvers.collaborative_filter import CLOSE, COLOUR_STRIDE, GROUP, PATCH, REACH, STRIDE, THRESHOLD, denoise, match


def noisy(clean: np.ndarray, sigma: float) -> np.ndarray:
    return (clean + sigma * np.random.default_rng(5).standard_normal(clean.shape)).astype(np.float32)


def psnr(image: np.ndarray, truth: np.ndarray) -> float:
    return float(-10 * np.log10(np.mean((image - truth) ** 2)))


@pytest.fixture(scope="module")
def photograph() -> np.ndarray:
    return (skimage.data.astronaut()[60:220, 130:330] / 255).astype(np.float32)


def written_out(image: np.ndarray, sigma: float, pilot: np.ndarray | None) -> np.ndarray:
    """The same method in float64, patch by patch."""
    mix = np.array([[1, 1, 1], [1, 0, -1], [1, -2, 1]]) / np.sqrt([[3], [2], [6]])
    planes = np.moveaxis(image.astype(float) @ mix.T, 2, 0)
    guides = planes if pilot is None else np.moveaxis(pilot.astype(float) @ mix.T, 2, 0)
    rows, cols = image.shape[:2]
    k = np.arange(PATCH)
    cosine = np.sqrt(np.where(k > 0, 2, 1) / PATCH)[:, None] * np.cos(np.pi * np.outer(k, 2 * k + 1) / (2 * PATCH))
    haar = np.eye(1)
    while len(haar) < GROUP:
        haar = np.sqrt(0.5) * np.block([[haar, haar], [np.eye(len(haar)), -np.eye(len(haar))]])
    total, share = np.zeros(planes.shape), np.zeros(planes.shape)
    ys, xs = (sorted({*range(0, length - PATCH + 1, STRIDE), length - PATCH}) for length in (rows, cols))
    coarse = [{*places[::COLOUR_STRIDE], places[-1]} for places in (ys, xs)]
    for y in ys:
        for x in xs:
            own = guides[0, y : y + PATCH, x : x + PATCH]
            likes = []
            for v in range(max(0, y - REACH), min(rows - PATCH, y + REACH) + 1):
                for u in range(max(0, x - REACH), min(cols - PATCH, x + REACH) + 1):
                    if max(abs(v - y), abs(u - x)) > CLOSE and ((v - y) % 2 or (u - x) % 2):
                        continue
                    distance = np.sum((guides[0, v : v + PATCH, u : u + PATCH] - own) ** 2)
                    likes.append((distance if (v, u) != (y, x) else -1.0, v, u))
            likes = sorted(likes)[:GROUP]
            for c in range(3) if y in coarse[0] and x in coarse[1] else range(1):

                def spectrum(plane: np.ndarray, likes: list = likes) -> np.ndarray:
                    stack = np.array([plane[v : v + PATCH, u : u + PATCH] for _, v, u in likes])
                    return np.tensordot(haar, cosine @ stack @ cosine.T, 1)

                coefficients = spectrum(planes[c])
                if pilot is None:
                    kept = (abs(coefficients) > THRESHOLD * sigma).astype(float)
                    weight = 1 / max(1, np.sum(kept))
                    kept[0, 0, 0] = 1
                else:
                    power = spectrum(guides[c]) ** 2
                    kept = power / (power + sigma**2)
                    weight = 1 / max(1, np.sum(kept**2))
                stack = cosine.T @ np.tensordot(haar.T, kept * coefficients, 1) @ cosine
                for patch, (_, v, u) in zip(stack, likes, strict=True):
                    total[c, v : v + PATCH, u : u + PATCH] += weight * patch
                    share[c, v : v + PATCH, u : u + PATCH] += weight
    return np.moveaxis(total / share, 0, 2) @ mix


@pytest.mark.parametrize("shrinkage", ["threshold", "wiener"])
def test_agrees_with_the_method_written_out(photograph: np.ndarray, shrinkage: str) -> None:
    clean = photograph[40:106, 20:43]  # two strips, narrower than the search
    image = noisy(clean, 0.04)
    pilot = None if shrinkage == "threshold" else noisy(clean[::-1], 0.01)[::-1]
    np.testing.assert_allclose(denoise(image, 0.04, pilot=pilot), written_out(image, 0.04, pilot), atol=1e-5)


@pytest.mark.parametrize("channels", [1, 3])
def test_a_constant_image_comes_back(channels: int) -> None:
    image = np.full((45, 70, channels), 0.3, np.float32)
    once = denoise(image, 0.05)
    np.testing.assert_allclose(once, image, atol=1e-6)
    assert once.dtype == np.float32


def test_noise_without_a_picture_falls_tenfold_in_variance() -> None:
    flat = np.full((96, 96, 3), 0.5, np.float32)
    image = noisy(flat, 0.05)
    once = denoise(image, 0.05)
    assert np.var(image) > 10 * np.var(once)
    assert np.var(image) > 20 * np.var(denoise(image, 0.05, pilot=once))


@pytest.mark.parametrize(("sigma", "gain"), [(0.02, 5.0), (0.05, 7.5)])
def test_a_photograph_gains_and_total_variation_is_beaten(photograph: np.ndarray, sigma: float, gain: float) -> None:
    image = noisy(photograph, sigma)
    once = denoise(image, sigma)
    twice = denoise(image, sigma, pilot=once)
    smooth = max(psnr(denoise_tv_chambolle(image, weight=w * sigma, channel_axis=2), photograph) for w in (0.5, 0.8, 1.2, 1.7))
    assert psnr(twice, photograph) > psnr(image, photograph) + gain
    assert psnr(twice, photograph) > psnr(once, photograph) + 0.1
    assert psnr(twice, photograph) > smooth + 1


def test_grey_is_denoised_too(photograph: np.ndarray) -> None:
    grey = photograph.mean(axis=2, keepdims=True)
    assert psnr(denoise(noisy(grey, 0.05), 0.05), grey) > psnr(noisy(grey, 0.05), grey) + 5


def test_the_number_of_threads_does_not_change_a_bit(photograph: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> None:
    image = noisy(photograph, 0.05)
    monkeypatch.setattr(threads, "most", lambda: 1)
    alone = denoise(image, 0.05, pilot=photograph)
    for count in (2, 3, 5):
        monkeypatch.setattr(threads, "most", lambda count=count: count)
        np.testing.assert_array_equal(denoise(image, 0.05, pilot=photograph), alone)


@pytest.mark.parametrize("shape", [(8, 8, 3), (8, 50, 1), (50, 8, 3), (9, 11, 1), (15, 64, 3), (53, 31, 1), (101, 17, 3)])
def test_every_size_is_denoised_up_to_its_border(shape: tuple[int, int, int]) -> None:
    clean = np.broadcast_to(np.linspace(0.2, 0.8, shape[0])[:, None, None], shape)
    image = noisy(clean, 0.05)
    twice = denoise(image, 0.05, pilot=denoise(image, 0.05))
    assert twice.shape == shape
    for edge in (np.s_[0], np.s_[-1], np.s_[:, 0], np.s_[:, -1]):
        assert psnr(twice[edge], clean[edge]) > psnr(image[edge], clean[edge])


def test_without_noise_the_image_comes_back(photograph: np.ndarray) -> None:
    np.testing.assert_array_equal(denoise(photograph, 0.0), photograph)


def test_matches_found_before_give_the_same_and_those_of_the_step_before_nearly_so(photograph: np.ndarray) -> None:
    image = noisy(photograph, 0.03)
    once = denoise(image, 0.03)
    twice = denoise(image, 0.03, pilot=once)
    np.testing.assert_array_equal(denoise(image, 0.03, pilot=once, matches=match(once)), twice)
    old, fresh = denoise(image, 0.03, pilot=twice, matches=match(once)), denoise(image, 0.03, pilot=twice)
    assert not np.array_equal(old, fresh)
    assert abs(psnr(old, photograph) - psnr(fresh, photograph)) < 0.1


def test_nothing_is_written_into_what_was_given(photograph: np.ndarray) -> None:
    image, pilot = noisy(photograph, 0.05), photograph.copy()
    before = image.copy()
    denoise(image, 0.05, pilot=pilot, matches=match(pilot))
    np.testing.assert_array_equal(image, before)
    np.testing.assert_array_equal(pilot, photograph)


def test_what_cannot_be_denoised_is_told() -> None:
    with pytest.raises(ValueError, match=r"at least 8 x 8 px in 1 or 3 channels, got 7 x 20 px in 1"):
        match(np.zeros((7, 20, 1), np.float32))
    with pytest.raises(ValueError, match=r"got 20 x 20 px in 2"):
        denoise(np.zeros((20, 20, 2), np.float32), 0.1)
    with pytest.raises(ValueError, match=r"as large, 20 x 20 px; they are of one of \(20, 24\) px"):
        denoise(np.zeros((20, 20, 1), np.float32), 0.1, matches=match(np.zeros((20, 24, 1), np.float32)))
    with pytest.raises(TypeCheckError):
        denoise(np.zeros((20, 20), np.float32), 0.1)
