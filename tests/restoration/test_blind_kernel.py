"""One kernel of a whole image: what it was blurred with is found back, and what a kernel is, stays."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rsvideo.restoration.blind_kernel import KernelSettings, centre, clean, estimate, kernel_from_gradients, l0_latent, wrapped

KERNELS = arrays(np.float32, st.sampled_from([(7, 7), (9, 9)]), elements=st.floats(0, 1, width=32)).filter(lambda k: k.sum() > 0.1)


def edges(rows=150, cols=170, seed=3):
    """Rectangles of all sizes upon each other: sharp edges every few pixels."""
    rng = np.random.default_rng(seed)
    image = np.full((rows, cols), 0.4, np.float32)
    for _ in range(120):
        y, x, h, w = rng.integers(-20, rows), rng.integers(-20, cols), rng.integers(6, 50), rng.integers(6, 50)
        image[max(y, 0) : y + h, max(x, 0) : x + w] = rng.random()
    return image


def hook(size=13):
    """A path that goes right and then turns down."""
    kernel = np.zeros((size, size), np.float32)
    cv2.polylines(kernel, [np.array([[2, 4], [7, 4], [9, 6], [9, 10]])], False, 1.0)
    return centre(kernel / kernel.sum())


def blurred(image, kernel):
    return cv2.filter2D(image, -1, kernel[::-1, ::-1].copy(), borderType=cv2.BORDER_WRAP)


def likeness(one, other):
    """The normalised correlation of two kernels, shifted to where they agree best."""
    pad = np.pad(one, 3)
    n = len(other)
    shifts = [pad[y : y + n, x : x + n] for y in range(7) for x in range(7)]
    return max(float((s * other).sum() / np.linalg.norm(s) / np.linalg.norm(other)) for s in shifts)


def test_the_kernel_that_blurred_an_image_with_edges_is_found_back():
    true = hook()
    image = blurred(edges(), true) + 0.003 * np.random.default_rng(0).standard_normal((150, 170)).astype(np.float32)
    *_, found = estimate(image, 13, KernelSettings())
    assert likeness(found, true) > 0.9
    assert likeness(found[::-1, ::-1], true) < 0.8  # nor turned round
    assert found.sum() == pytest.approx(1, abs=1e-5)


def test_scales_go_from_coarse_to_fine():
    sizes = [len(k) for k in estimate(edges(80, 80), 15, KernelSettings(steps=1))]
    assert sizes == sorted(set(sizes))
    assert sizes[0] == 5
    assert sizes[-1] == 15
    assert all(n % 2 for n in sizes)


def test_from_the_true_gradients_the_kernel_is_exact():
    sharp, true = edges(), hook()

    def gradients(image):
        return [np.roll(image, -1, 1) - image, np.roll(image, -1, 0) - image]

    found = kernel_from_gradients(gradients(blurred(sharp, true)), gradients(sharp), 13, KernelSettings(ridge=1e-4))
    np.testing.assert_allclose(found, true, atol=0.01)


def test_the_latent_image_of_the_true_kernel_is_sharper_and_nearer():
    sharp, true = edges(), hook()
    image = blurred(sharp, true)
    latent = l0_latent(image, true, 2e-3, KernelSettings())
    assert np.mean((latent - sharp) ** 2) < 0.2 * np.mean((image - sharp) ** 2)


@given(KERNELS)
def test_a_centred_kernel_is_the_same_of_sum_one_with_its_centroid_in_the_middle(kernel):
    once = centre(np.pad(kernel, len(kernel)))
    assert once.sum() == pytest.approx(1, abs=1e-5)
    offset = np.indices(once.shape) - (len(once) - 1) / 2
    assert np.abs((once * offset).sum(axis=(1, 2))).max() <= 0.5 + 1e-4
    moved, given = (np.sort(k.ravel())[-kernel.size :] for k in (once, np.pad(kernel, len(kernel))))
    np.testing.assert_allclose(moved, given / given.sum(), atol=1e-5)


@given(st.integers(-2, 2), st.integers(-2, 2))
def test_a_moved_kernel_is_moved_back(dy, dx):
    np.testing.assert_allclose(centre(np.roll(np.pad(hook(), 3), (dy, dx), (0, 1))), np.pad(hook(), 3), atol=1e-6)


def test_noise_and_pieces_apart_are_cleaned_away():
    true = np.pad(hook(), 4)
    dirty = true.copy()
    dirty[0, 0] = 0.5 * true.max()  # a piece apart
    dirty[:, -1] = 0.03 * true.max()  # a floor
    np.testing.assert_allclose(clean(dirty, 0.05), true, atol=1e-6)


@given(KERNELS)
def test_a_clean_kernel_is_one_piece_without_noise_of_sum_one(kernel):
    k = clean(np.pad(kernel, len(kernel) // 2 + 1), 0.3)  # with room to be centred in
    assert (k >= 0).all()
    assert k.sum() == pytest.approx(1, abs=1e-5)
    assert cv2.connectedComponents((k > 0).astype(np.uint8), connectivity=8)[0] == 2


def test_a_wrapped_image_keeps_its_pixels_and_joins_its_other_side_smoothly():
    image = edges(40, 50)
    whole = wrapped(image, 12)
    np.testing.assert_array_equal(whole[:40, :50], image)
    for axis, rest in ((0, np.s_[40:]), (1, np.s_[:, 50:])):
        step = np.abs(np.roll(whole, -1, axis) - whole)[rest]
        assert step.max() <= 1 / 24  # the whole range over the margins on both sides
