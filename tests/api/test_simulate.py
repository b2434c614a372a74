"""Pictures made by the public simulation are those of the renderer."""

from pathlib import Path

import numpy as np
import pytest

import rsvideo

SHUTTER = rsvideo.Shutter(exposure="1/50", readout="20ms")
CAMERA = rsvideo.Camera(focal_px=150)
SHARP = np.random.default_rng(0).random((80, 120, 3))


def test_a_seed_says_all_of_the_hand_and_of_the_noise() -> None:
    one, same, other = (rsvideo.simulate(SHARP, shutter=SHUTTER, camera=CAMERA, blur_px=5, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.blurred, same.blurred)
    assert one.blur_px == pytest.approx(5)
    assert not np.array_equal(one.trajectory.poses[:5], other.trajectory.poses[:5])


def test_codes_in_are_codes_out() -> None:
    codes = np.rint(SHARP * 255).astype(np.uint8)
    shot = rsvideo.simulate(codes, shutter=SHUTTER, camera=CAMERA, motion={"x": [0, 5]}, noise=0)
    assert shot.blurred.dtype == shot.truth.dtype == np.uint8
    rows, cols = shot.truth.shape[:2]
    top, left = (80 - rows) // 2, (120 - cols) // 2
    np.testing.assert_array_equal(shot.truth, codes[top : top + rows, left : left + cols])


def test_a_given_trajectory_is_followed() -> None:
    t = np.linspace(0, 0.04, 9)
    path = rsvideo.Trajectory.through(t, np.stack([100 * t, 0 * t, 0 * t], axis=1))
    shot = rsvideo.simulate(SHARP, shutter=SHUTTER, camera=CAMERA, motion=path)
    assert shot.blur_px == pytest.approx(2, abs=0.1)
    np.testing.assert_allclose(shot.trajectory.at(t)[:, 0], 100 * (t - 0.02), atol=1e-6)


def test_a_distorted_lens_is_simulated_and_restored_through() -> None:
    camera = rsvideo.Camera(focal_px=90, distortion=(-0.12, 0.02, 0, 0))
    tiles = np.kron(np.random.default_rng(0).random((20, 30)), np.ones((4, 4)))
    shot = rsvideo.simulate(tiles, shutter=SHUTTER, camera=camera, motion={"x": [0, 8]}, size=(64, 96), noise=0)
    assert shot.camera.distortion is not None
    straight = rsvideo.Camera(focal_px=90)
    errors = []
    for lens in (camera, straight):
        result = rsvideo.deblur(shot.blurred, shutter=SHUTTER, camera=lens, trajectory=shot.trajectory)
        errors.append(np.abs(result.latent - shot.truth)[8:-8, 12:-12].mean())
    assert errors[0] < 0.9 * errors[1]


def test_a_profile_gives_lens_readout_direction_and_noise(tmp_path: Path) -> None:
    profile = tmp_path / "mine.yaml"
    profile.write_text(
        "name: Mine\nmode: {rows: 128, cols: 192}\nintrinsics: {fx: 201, fy: 202, cx: 96, cy: 63}\n"
        "timing: {readout_s: 0.016, direction: left-to-right}\nnoise: {read: 0.05, shot: 0.0}\n"
    )
    camera, shutter = rsvideo.Camera(profile=profile), rsvideo.Shutter(exposure=0.02)
    shot = rsvideo.simulate(SHARP, shutter=shutter, camera=camera, motion={"x": [0, 5]}, size=(64, 96))
    assert (shot.camera.fx, shot.camera.fy) == (100.5, 101.0)
    assert (shot.timing.readout, shot.timing.direction) == (pytest.approx(0.016), "left-to-right")
    quiet = rsvideo.simulate(SHARP, shutter=shutter, camera=camera, motion={"x": [0, 5]}, size=(64, 96), noise=0)
    assert np.std(shot.blurred - quiet.blurred) == pytest.approx(0.05, rel=0.1)


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ({"shutter": rsvideo.Shutter(exposure=0.02)}, "readout must be given to simulate"),
        ({"camera": rsvideo.Camera()}, "focal-px must be given to simulate"),
        ({"camera": rsvideo.Camera(focal_px=150, distortion=(0.1, 0, 0, 0))}, "size must be given to simulate with distortion"),
        ({"gain": 0.0}, "gain must lie in"),
        ({"noise": 8.0}, "is it in 8-bit codes"),
        ({"motion": {"z": [1.0]}}, "a polynomial has the axes x, y, roll"),
        ({"blur_px": 60.0}, "is the motion too large"),
        ({"transfer": "srgb"}, "linear light already"),
    ],
)
def test_what_cannot_be_rendered_is_refused(words: dict, line: str) -> None:
    with pytest.raises(ValueError, match=line):
        rsvideo.simulate(SHARP, **{"shutter": SHUTTER, "camera": CAMERA, **words})
