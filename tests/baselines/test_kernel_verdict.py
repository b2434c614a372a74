"""A kernel is believed where the frame bears it out, and a frame is left as it was where it does not."""

import numpy as np
import pytest

from rsvideo.baselines import uniform
from rsvideo.baselines.kernel_verdict import believed, compared, stretched
from rsvideo.frame import Verdict
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.restoration.blind_kernel import ridge_latent
from rsvideo.restoration.scene import Scene, scene_of
from tests.baselines.scenes import cards, frame, view
from tests.baselines.test_uniform import HOOK, SETTINGS, drawn, shutter, taken

pytestmark = pytest.mark.usefixtures("small_kernels")
KERNEL = drawn(HOOK, 15).astype(np.float32)


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Of a frame that is blurred by KERNEL."""
    return scene_of(view(frame(taken(scene=cards(320, 320, count=400)).blurred), shutter()), SETTINGS)


def test_the_true_kernel_is_believed_and_others_are_not(scene: Scene) -> None:
    assert believed(scene, KERNEL)
    assert not believed(scene, np.ascontiguousarray(KERNEL[::-1, ::-1]))
    assert not believed(scene, np.ascontiguousarray(np.rot90(KERNEL)))
    assert not believed(scene, stretched(KERNEL, 1.5))
    assert not believed(scene, stretched(KERNEL, 0.6))


def test_what_speaks_for_a_kernel_speaks_against_its_mirror_image(scene: Scene) -> None:
    along, back = (compared(scene, kernel)[0] for kernel in (KERNEL, np.ascontiguousarray(KERNEL[::-1, ::-1])))
    assert along > 2
    assert back == pytest.approx(-along, rel=0.2)


@pytest.mark.parametrize("times", [0.5, 1.0, 1.7])
def test_a_stretched_kernel_has_its_moments_stretched(times: float) -> None:
    def moments(kernel: np.ndarray) -> np.ndarray:
        middle = (len(kernel) - 1) / 2
        return np.array([(kernel * (along - middle)).sum() for along in np.indices(kernel.shape)])

    assert stretched(KERNEL, times).sum() == pytest.approx(1, abs=1e-5)
    np.testing.assert_allclose(moments(stretched(KERNEL, times)), times * moments(KERNEL), atol=0.01)


def test_a_latent_image_of_a_weak_ridge_is_the_picture_that_was_blurred() -> None:
    sharp = cards(96, 96)[..., 0].astype(np.float32)
    kernel = np.zeros((5, 5), np.float32)
    kernel[2, 1:4] = 0.25, 0.5, 0.25  # nothing is lost but at the highest frequency
    blurred = sum(kernel[2, j] * np.roll(sharp, j - 2, 1) for j in range(5))
    found = ridge_latent(np.asarray(blurred, np.float32), kernel, 1e-5)[8:-8, 8:-8]
    assert np.corrcoef(found.ravel(), sharp[8:-8, 8:-8].ravel())[0, 1] > 0.98


def test_a_frame_whose_kernel_is_not_borne_out_is_left_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    pixels = taken(scene=cards(200, 200)).blurred
    monkeypatch.setattr(uniform, "fitted", lambda *_: np.ascontiguousarray(KERNEL[::-1, ::-1]))
    result = uniform.restored(view(frame(pixels), shutter()), SETTINGS)
    assert result.verdict is Verdict.UNEXPLAINED
    np.testing.assert_array_equal(result.latent, pixels)


def test_the_smallest_frame_can_be_judged() -> None:
    pixels = cards(32, 32)
    timing = ShutterTiming.from_readout(exposure=0.04, readout=0.0, rows=32)
    assert np.isfinite(compared(scene_of(view(frame(pixels), timing), SETTINGS), KERNEL[4:-4, 4:-4])).all()
