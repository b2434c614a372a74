"""One photograph from array to array: what the command writes, in the kind that was given."""

from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

import rsvideo
from rsvideo.config.request import Request
from rsvideo.frame import Verdict
from rsvideo.physics.blur import BlurOperator
from rsvideo.physics.camera import Camera
from rsvideo.pipeline.deblur import carry_out
from rsvideo.pipeline.prepare import prepare
from rsvideo.progress import ignore

SHUTTER = rsvideo.Shutter(exposure="1/50", readout="20ms")
CAMERA = rsvideo.Camera(focal_px=200)
QUICK = rsvideo.Settings(prior="tv")
DIRECTIONS = ["top-to-bottom", "bottom-to-top", "left-to-right", "right-to-left"]


@pytest.fixture(scope="module")
def shot() -> rsvideo.Simulated:
    """A grey picture blurred by 6 px, as light."""
    sharp = np.kron(np.random.default_rng(0).random((10, 14)), np.ones((8, 8)))
    return rsvideo.simulate(sharp, shutter=SHUTTER, camera=CAMERA, blur_px=6, seed=1)


def codes(light: np.ndarray, dtype: type) -> np.ndarray:
    return np.rint(light * np.iinfo(dtype).max).astype(dtype)


@pytest.mark.parametrize("shape", ["grey", "one channel", "colour"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float64])
def test_a_picture_comes_back_in_the_kind_and_shape_that_was_given(shot: rsvideo.Simulated, dtype: type, shape: str) -> None:
    image = shot.blurred if np.dtype(dtype).kind == "f" else codes(shot.blurred, dtype)
    image = {"grey": image, "one channel": image[..., None], "colour": np.repeat(image[..., None], 3, axis=2)}[shape].astype(dtype)
    before = image.copy()
    transfer = None if np.dtype(dtype).kind == "f" else "linear"
    result = rsvideo.deblur(image, shutter=SHUTTER, camera=CAMERA, settings=QUICK, trajectory=shot.trajectory, transfer=transfer)
    assert result.restored
    assert result.latent.shape == image.shape == result.light.shape
    assert result.latent.dtype == (np.float32 if np.dtype(dtype).kind == "f" else dtype)
    assert result.light.dtype == np.float32
    assert result.light.min() >= 0
    assert result.light.max() <= 1
    np.testing.assert_array_equal(image, before)
    sharp = shot.truth.reshape(*shot.truth.shape, *[1] * (image.ndim - 2))
    assert np.abs(result.light - sharp).mean() < 0.6 * np.abs(shot.blurred - shot.truth).mean()


def test_the_pixels_are_those_that_the_command_writes(samples: Path, tmp_path: Path) -> None:
    photograph = imageio.imread(samples / "coffee" / "blurred.png")[100:228, 200:360]
    imageio.imwrite(tmp_path / "in.png", photograph)
    motion = samples / "coffee" / "motion.csv"
    sections = {"camera": {"exposure": 0.02, "readout": 0.02, "focal_px": 1400}, "motion": {"trajectory": motion}}
    request = Request.model_validate({"source": tmp_path / "in.png", "output": tmp_path / "out.png", **sections})
    carry_out(prepare(request), ignore)
    camera = rsvideo.Camera(focal_px=1400)
    result = rsvideo.deblur(photograph, shutter=SHUTTER, camera=camera, trajectory=motion)
    assert result.restored
    np.testing.assert_array_equal(result.latent, imageio.imread(tmp_path / "out.png"))
    of_file = rsvideo.deblur(rsvideo.read(tmp_path / "in.png"), shutter=SHUTTER, camera=camera, trajectory=motion)
    np.testing.assert_array_equal(of_file.latent, result.light)


def test_what_is_left_as_it_was_comes_back_exactly() -> None:
    blank = np.full((40, 48, 3), 77, np.uint8)
    result = rsvideo.deblur(blank, shutter=SHUTTER, camera=CAMERA)
    assert result.verdict is Verdict.NO_TEXTURE
    assert not result.restored
    np.testing.assert_array_equal(result.latent, blank)
    assert result.latent is not blank


def test_the_stages_are_observed(shot: rsvideo.Simulated) -> None:
    observed: list[rsvideo.Progress] = []
    rsvideo.deblur(shot.blurred, shutter=SHUTTER, camera=CAMERA, trajectory=shot.trajectory, observe=observed.append)
    assert {at.stage for at in observed} == {"latent image"}  # the motion is given
    assert [at.fraction for at in observed] == sorted(at.fraction for at in observed)
    assert observed[-1].fraction == 1


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_psfs_are_those_of_the_blur_operator(direction: str) -> None:
    sharp = np.random.default_rng(0).random((90, 110))
    shutter = rsvideo.Shutter(exposure="1/50", readout="20ms", direction=direction)
    taken = rsvideo.simulate(sharp, shutter=shutter, camera=rsvideo.Camera(focal_px=100), blur_px=7, seed=3, size=(65, 75), noise=0)
    result = rsvideo.deblur(
        taken.blurred, shutter=shutter, camera=rsvideo.Camera(focal_px=100), settings=QUICK, trajectory=taken.trajectory
    )
    kernels = result.psfs((5, 3))
    camera = Camera(timing=result.timing, intrinsics=result.camera)
    operator = BlurOperator.covering(result.trajectory.curve, camera=camera, samples=400)
    for i, row in enumerate(range(6, 65, 13)):
        for j, col in enumerate(range(12, 75, 25)):
            twin = operator.psf(row, col)
            half = (kernels.shape[2] - twin.shape[0]) // 2
            np.testing.assert_allclose(kernels[i, j], np.pad(twin, half) if half >= 0 else twin[-half:half, -half:half], atol=2e-3)
            assert kernels[i, j].sum() == pytest.approx(1)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ({"shutter": rsvideo.Shutter(readout=0.02)}, r"exposure must be given, an array does not say it; Shutter\(exposure='1/50'\)"),
        ({"shutter": rsvideo.Shutter(exposure=0.02)}, "readout must be given, an array does not say it"),
        ({"camera": rsvideo.Camera()}, "focal-px must be given, an array does not say it"),
        ({"camera": rsvideo.Camera(focal_px=4.2)}, "is it in millimetres"),
        ({"transfer": "srgb"}, "transfer says what codes mean, a floating-point array is linear light already"),
        ({"camera": rsvideo.Camera(profile="no-such-camera")}, "there is no camera profile named no-such-camera"),
    ],
)
def test_what_is_missing_or_contradicts_itself_is_refused(shot: rsvideo.Simulated, words: dict, line: str) -> None:
    with pytest.raises(ValueError, match=line):
        rsvideo.deblur(shot.blurred, **{"shutter": SHUTTER, "camera": CAMERA, **words})


def test_an_unknown_transfer_is_refused_with_the_nearest(shot: rsvideo.Simulated) -> None:
    with pytest.raises(ValueError, match=r"transfer must be one of srgb.*did you mean s-log3"):
        rsvideo.deblur(codes(shot.blurred, np.uint8), shutter=SHUTTER, camera=CAMERA, transfer="slog3")


def test_a_motion_that_ends_too_early_is_refused(shot: rsvideo.Simulated) -> None:
    short = rsvideo.Trajectory.through(np.array([0.0, 0.01]), np.zeros((2, 3)))
    with pytest.raises(ValueError, match=r"trajectory must cover the picture's whole interval, 0 to 0\.04 s, it covers 0 to 0\.01 s"):
        rsvideo.deblur(shot.blurred, shutter=SHUTTER, camera=CAMERA, trajectory=short)


def test_a_profile_answers_for_lens_readout_and_tone(shot: rsvideo.Simulated, tmp_path: Path) -> None:
    rows, cols = shot.blurred.shape
    profile = tmp_path / "mine.yaml"
    profile.write_text(
        f"name: Mine\nmode: {{rows: {rows}, cols: {cols}}}\nintrinsics: {{fx: 201, fy: 202, cx: 60, cy: 50}}\n"
        "timing: {readout_s: 0.02, direction: bottom-to-top}\ntone: {transfer: linear}\n"
    )
    image = codes(shot.blurred, np.uint8)
    camera = rsvideo.Camera(profile=profile)
    result = rsvideo.deblur(image, shutter=rsvideo.Shutter(exposure=0.02), camera=camera, trajectory=shot.trajectory)
    assert (result.camera.fx, result.camera.fy, result.timing.direction) == (201, 202, "bottom-to-top")
    assert result.timing.readout == pytest.approx(0.02)
    assert "profile" in result.timing_source
    stated = rsvideo.Shutter(exposure=0.02, readout=0.02, direction="bottom-to-top")
    same = rsvideo.deblur(image, shutter=stated, camera=camera, trajectory=shot.trajectory, transfer="linear")
    np.testing.assert_array_equal(result.latent, same.latent)
