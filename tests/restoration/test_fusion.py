"""Neighbours give back what a frame's own blur has destroyed, and nothing that does not belong to it."""

import numpy as np
import pytest
import skimage.data

from rsvideo.physics import simulate
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, centred
from rsvideo.restoration.fusion import PosedImage, fused, helpful
from rsvideo.restoration.nonblind import deblur, tiled
from rsvideo.restoration.predicted_blur import confirmed
from rsvideo.restoration.rectification import read_out, scanline_poses
from rsvideo.restoration.settings import Settings

ROWS, COLS = 96, 192
TIMING = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=ROWS)
CAMERA = Camera(timing=TIMING, intrinsics=Intrinsics.centred(focal=300.0, rows=ROWS, cols=COLS))
LONG = np.array([[0.0, 0.0, 0.0], [6.0, -3.0, 0.01], [1.0, 1.5, 0.0], [-0.4, 0.3, 0.0]])
SHORT = LONG / 8
AWAY = np.array([3.3, -2.6, 0.01])  # px, px, rad: where the neighbour looks


def path(coefficients):
    return centred(Polynomial(t0=0.0, t1=TIMING.interval[1], coefficients=coefficients), TIMING.middle)


def taken(coefficients, photograph, *, pose=(0.0, 0.0, 0.0)):
    return simulate.render(
        (photograph / 255) ** 2.2,
        camera=CAMERA,
        trajectory=path(coefficients).shifted(np.array(pose)),
        noise=Noise.at_half(0.004),
        rng=np.random.default_rng(0),
        samples=32,
    )


def alone(case, coefficients):
    frame = tiled(
        case.blurred,
        np.zeros(case.blurred.shape, bool),
        path(coefficients),
        CAMERA,
        samples=24,
        tolerance=0.25,
    )
    *_, latent = deblur(frame, Settings(), 0.004)
    return frame, np.clip(latent, 0, 1).astype(np.float32)


def psnr(image, truth):
    one, other = (np.clip(a[16:-16, 16:-16], 0, 1) ** (1 / 2.2) for a in (image, truth))
    return float(-10 * np.log10(np.mean((one - other) ** 2)))


@pytest.fixture(scope="module")
def long():
    return taken(LONG, skimage.data.astronaut()[20:180, 60:310])


def test_a_sharper_neighbour_that_looks_elsewhere_gives_detail_back(long):
    near = taken(SHORT, skimage.data.astronaut()[20:180, 60:310], pose=AWAY)
    frame, own = alone(long, LONG)
    other = PosedImage(latent=alone(near, SHORT)[1], pose=AWAY + np.array([0.3, 0.2, 5e-4]), length=1.5)  # nearly
    both = fused(frame, PosedImage(latent=own, pose=np.zeros(3), length=12.0), [other], CAMERA.intrinsics, 0.004)
    assert both.explained[16:-16, 16:-16].mean() > 0.8
    assert psnr(both.solved(), long.truth) > psnr(own, long.truth) + 2


def test_a_neighbour_helps_as_far_as_the_borders(long):
    """There a frame knows least of itself: the blur has carried light in and out."""
    near = taken(SHORT, skimage.data.astronaut()[20:180, 60:310])
    frame, own = alone(long, LONG)
    other = PosedImage(latent=alone(near, SHORT)[1], pose=np.zeros(3), length=1.5)
    both = fused(frame, PosedImage(latent=own, pose=np.zeros(3), length=12.0), [other], CAMERA.intrinsics, 0.004)
    below = np.s_[-8:-2, 16:-16]
    assert both.shown[below].all()
    assert np.abs(both.solved() - long.truth)[below].mean() < 0.7 * np.abs(own - long.truth)[below].mean()


def test_a_neighbour_that_shows_something_else_counts_for_nothing(long):
    frame, own = alone(long, LONG)
    stranger = PosedImage(latent=np.ascontiguousarray(own[:, ::-1]), pose=np.zeros(3), length=1.5)
    both = fused(frame, PosedImage(latent=own, pose=np.zeros(3), length=12.0), [stranger], CAMERA.intrinsics, 0.004)
    assert np.median(both.explained[16:-16, 16:-16]) < 0.1
    assert psnr(both.solved(), long.truth) > psnr(own, long.truth) - 0.5


def test_what_moves_before_plain_ground_is_found_out_though_edges_elsewhere_leave_room_for_the_paths_error(long):
    """A neighbour may differ where its edges may be off, and not where the frame has none."""
    photograph = np.array(skimage.data.astronaut()[20:180, 60:310])
    photograph[:, :125] = photograph[:, :125] // 32 + 120
    case = taken(SHORT, photograph)
    frame, own = alone(case, SHORT)
    other = own.copy()
    other[20:76, 24:56] += 0.015
    first = PosedImage(latent=own, pose=np.zeros(3), length=3.0)
    near = PosedImage(latent=other, pose=np.zeros(3), length=1.5)
    explained = fused(frame, first, [near], CAMERA.intrinsics, 0.004, 0.3).explained
    assert np.median(explained[26:70, 30:50]) < 0.2
    assert np.median(explained[20:76, 130:170]) > 0.9


def test_what_moves_otherwise_than_the_camera_is_found_out_by_what_its_own_image_leaves(long):
    """Bars that the camera follows stand sharp in the blurred frame."""
    barred = long.blurred.copy()
    barred[30:66, 70:118] = np.where(np.arange(48) // 6 % 2, 0.9, 0.02)[None, :, None]

    def astray(blurred):
        frame = tiled(blurred, np.zeros(blurred.shape, bool), path(LONG), CAMERA, samples=24, tolerance=0.25)
        *_, latent = deblur(frame, Settings(), 0.004)
        first = PosedImage(latent=np.clip(latent, 0, 1).astype(np.float32), pose=np.zeros(3), length=12.0)
        return fused(frame, first, [first], CAMERA.intrinsics, 0.004, 0.2).astray

    assert not astray(long.blurred).any()
    found = astray(barred)
    assert found[30:66, 70:118].all()
    assert found[48, 62]  # as far as the blur rings
    assert not found[16:-16, 150:].any()


@pytest.mark.parametrize(
    ("found", "least", "most"),
    [(LONG, 0.9, 1.1), (1.6 * LONG, 0.3, 0.75), (LONG[:, [1, 0, 2]] * [1.0, -1.0, 1.0], 0.0, 0.85)],
    ids=["right", "exposure too long", "across"],
)
def test_neighbours_tell_a_right_path_from_one_of_a_wrong_exposure_or_another_motion(long, found, least: float, most: float) -> None:
    near = taken(SHORT, skimage.data.astronaut()[20:180, 60:310])
    frame, own = alone(long, found)
    poses = scanline_poses(path(found), CAMERA)
    both = fused(
        frame,
        PosedImage(latent=own, pose=np.zeros(3), length=12.0),
        [PosedImage(latent=alone(near, SHORT)[1], pose=np.zeros(3), length=1.5)],
        CAMERA.intrinsics,
        0.004,
        displaced=lambda image: read_out(image[..., None], poses, CAMERA)[..., 0],
    )
    assert both.predicted is not None
    assert least < confirmed(both.predicted).whole < most


def test_neighbours_of_far_longer_blur_do_not_help() -> None:
    def of(length: float) -> PosedImage:
        return PosedImage(latent=np.zeros((8, 8, 3), np.float32), pose=np.zeros(3), length=length)

    others = [of(length) for length in (9.0, 2.0, 40.0, 5.0)]
    assert [o.length for o in helpful(of(4.0), others)] == [2.0, 5.0, 9.0]
    assert helpful(of(2.0), [of(12.0)]) == []


def test_the_blur_of_the_truth_is_the_frame(long):
    frame, _ = alone(long, LONG)
    np.testing.assert_allclose(
        frame.blurred(np.ascontiguousarray(long.truth[..., 1], np.float32))[16:-16, 16:-16], long.blurred[16:-16, 16:-16, 1], atol=0.03
    )


def test_weights_are_summed_in_single_precision_whatever_shares_are_kept_in(long):
    frame, own = alone(long, LONG)
    first, other = (PosedImage(latent=own, pose=np.zeros(3), length=length) for length in (12.0, 7.0))
    share = np.full((ROWS, COLS), 0.75, np.float16)
    half, single = (fused(frame, first, [other], CAMERA.intrinsics, 0.004, own=each) for each in (share, share.astype(np.float32)))
    np.testing.assert_allclose(half.solved(), single.solved(), atol=1e-6)
