"""The blur operator writes what Eq. (2) integrates, transposes exactly and knows its own derivative."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rsvideo.physics import simulate
from rsvideo.physics.blur import BlurOperator
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.distortion import Distortion
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.trajectory import Polynomial, Spline, still

ROWS, COLS = 17, 23
LENS = Intrinsics(fx=60.0, fy=50.0, cx=10.3, cy=8.8, rows=ROWS, cols=COLS)
WAYS = list(Direction)
BARREL = Distortion(model="brown-conrady", coefficients=(-0.6, 0.5, 0.02, -0.03, 0.1))
FISHEYE = Distortion(model="fisheye", coefficients=(-0.3, 0.2, 0.1, -0.1))


def timing(way=Direction.TOP_TO_BOTTOM, readout=0.02):
    lines = ROWS if way in (Direction.TOP_TO_BOTTOM, Direction.BOTTOM_TO_TOP) else COLS
    return ShutterTiming.from_readout(exposure=0.01, readout=readout, rows=lines, direction=way)


def path(axes, *, seed=0, scale=2.0, when=None):
    t0, t1 = (when or timing()).interval
    c = np.random.default_rng(seed).normal(size=(4, axes)) * scale / np.arange(1, 5)[:, None]
    if axes == 3:
        c[:, 2] *= 0.03
    return Polynomial(t0=t0, t1=t1, coefficients=c)


def operator(axes, way=Direction.TOP_TO_BOTTOM, *, readout=0.02, samples=7, lens=None):
    when = timing(way, readout)
    camera = Camera(timing=when, intrinsics=replace(LENS, distortion=lens))
    return BlurOperator.covering(path(axes, when=when), camera=camera, samples=samples)


def noise(shape, seed=1):
    return np.random.default_rng(seed).random(shape)


def written_out(K: BlurOperator, latent, exact_rotation):
    """Eq. (2)-(4) pixel by pixel; nothing shared but the path and the timing."""
    C = LENS.matrix
    way, when = K.camera.timing.direction, K.camera.timing
    out = np.zeros((ROWS, COLS))
    for y in range(ROWS):
        for x in range(COLS):
            line = {WAYS[0]: y, WAYS[1]: ROWS - 1 - y, WAYS[2]: x, WAYS[3]: COLS - 1 - x}[way]
            for k in range(K.samples):
                t = line * when.row_time + (k + 0.5) * when.exposure / K.samples
                pose = K.trajectory.at(np.array([t]))[0]
                if exact_rotation:
                    R = Rotation.from_rotvec([-pose[1] / LENS.fy, pose[0] / LENS.fx, pose[2]]).as_matrix()
                    u, v, w = C @ R @ np.linalg.inv(C) @ [x, y, 1]
                    u, v = u / w, v / w
                else:
                    u, v = x + pose[0], y + pose[1]
                u, v = u + K.margin[1], v + K.margin[0]
                c, r = int(np.floor(u)), int(np.floor(v))
                a, b = u - c, v - r
                out[y, x] += (1 - b) * ((1 - a) * latent[r, c] + a * latent[r, c + 1]) / K.samples
                out[y, x] += b * ((1 - a) * latent[r + 1, c] + a * latent[r + 1, c + 1]) / K.samples
    return out


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("axes", [2, 3])
def test_blur_is_the_integral_written_out(axes, way):
    K = operator(axes, way)
    latent = noise(K.latent_shape)
    np.testing.assert_allclose(K.forward(latent), written_out(K, latent, axes == 3), rtol=1e-12)


@pytest.mark.parametrize("readout", [0.02, 0.0])
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("axes", "lens"), [(2, None), (3, None), (3, BARREL), (3, FISHEYE)])
def test_adjoint_is_the_transpose(axes, lens, way, readout):
    K = operator(axes, way, readout=readout, lens=lens)
    latent, frame = noise(K.latent_shape), noise((ROWS, COLS), 2)
    assert np.vdot(K.forward(latent), frame) == pytest.approx(np.vdot(latent, K.adjoint(frame)), rel=1e-12)


@pytest.mark.parametrize("axes", [2, 3])
def test_adjoint_is_the_transpose_where_the_path_leaves_the_latent_image(axes):
    roomy = operator(axes)
    K = BlurOperator(camera=roomy.camera, trajectory=roomy.trajectory, samples=7, margin=(1, 0))
    latent, frame = noise(K.latent_shape), noise((ROWS, COLS), 2)
    assert np.vdot(K.forward(latent), frame) == pytest.approx(np.vdot(latent, K.adjoint(frame)), rel=1e-12)
    assert K.forward(np.ones(K.latent_shape)).min() < 0.9


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("axes", "lens"), [(2, None), (3, None), (3, BARREL), (3, FISHEYE)])
def test_the_latent_image_holds_all_that_the_frame_sees(axes, lens, way):
    K = operator(axes, way, lens=lens)
    np.testing.assert_allclose(K.forward(np.ones(K.latent_shape)), 1, rtol=1e-12)


@pytest.mark.parametrize("lens", [None, BARREL, FISHEYE], ids=["pinhole", "barrel", "fisheye"])
@pytest.mark.parametrize("way", WAYS)
def test_turning_agrees_with_the_simulator_where_interpolation_is_exact(way, lens):
    K = operator(3, way, lens=lens)
    rows, cols = K.latent_shape
    ramp = 0.3 * np.arange(cols)[None, :] - 0.2 * np.arange(rows)[:, None]
    seen = simulate.blur(ramp[..., None], camera=K.camera, trajectory=K.trajectory, samples=7)
    np.testing.assert_allclose(K.forward(ramp), seen[..., 0], atol=1e-9)


@pytest.mark.parametrize("way", WAYS)
def test_far_away_a_turn_is_a_shift(way):
    far = Intrinsics.centred(focal=1e6, rows=ROWS, cols=COLS)
    shift = operator(2, way)
    three = np.hstack([shift.trajectory.coefficients, np.zeros((4, 1))])
    camera = replace(shift.camera, intrinsics=far)
    trajectory = path(3, when=camera.timing).with_coefficients(three)
    turn = BlurOperator(camera=camera, trajectory=trajectory, samples=7, margin=shift.margin)
    latent = noise(shift.latent_shape)
    np.testing.assert_allclose(turn.forward(latent), shift.forward(latent), atol=2e-3)
    np.testing.assert_allclose(turn.jacobian(latent)[:, :2].mean(axis=(2, 3)), shift.jacobian(latent).mean(axis=(2, 3)), atol=2e-3)


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("axes", "lens"), [(2, None), (3, None), (3, BARREL), (3, FISHEYE)])
def test_between_cells_the_jacobian_is_the_difference_quotient(axes, lens, way):
    """On x y, which bilinear interpolation reproduces, a shift's central differences are exact and a turn's err by h^2."""
    K = operator(axes, way, lens=lens)
    rows, cols = K.latent_shape
    latent = np.outer(np.arange(rows) / rows, np.arange(cols) / cols)
    J = K.jacobian(latent)
    direction = np.random.default_rng(3).normal(size=K.trajectory.coefficients.shape)
    direction[:, 2:] *= 0.03
    slope = np.tensordot(direction, J, 2)

    def error(h):
        ends = [
            BlurOperator(
                camera=K.camera,
                trajectory=K.trajectory.with_coefficients(K.trajectory.coefficients + s * h * direction),
                samples=7,
                margin=K.margin,
            ).forward(latent)
            for s in (1, -1)
        ]
        return np.abs((ends[0] - ends[1]) / (2 * h) - slope).max()

    if axes == 2:
        assert error(0.1) < 1e-12
    else:
        for coarse, fine in pairwise([error(h) for h in (0.4, 0.2, 0.1)]):
            assert coarse / fine == pytest.approx(4, rel=0.15)


@pytest.mark.parametrize("axes", [2, 3])
def test_single_precision_stays_single_and_near(axes):
    K = operator(axes)
    latent, frame = noise(K.latent_shape), noise((ROWS, COLS), 2)
    for method, value in ((K.forward, latent), (K.adjoint, frame), (K.jacobian, latent)):
        single = method(value.astype(np.float32))
        assert single.dtype == np.float32
        np.testing.assert_allclose(single, method(value), atol=2e-5)


def test_readout_zero_gives_every_row_the_same_blur():
    K = operator(2, readout=0.0)
    np.testing.assert_allclose(K.psf(2, 5), K.psf(13, 11), atol=1e-12)
    assert np.abs(operator(2).psf(2, 5).shape[0] - operator(2).psf(14, 5).shape[0]) > 0


def test_a_camera_moving_right_and_down_leaves_its_psf_left_and_up():
    when = timing()
    moved = still(when.interval, degree=1, axes=2).shifted(np.array([3.0, 1.0]))
    K = BlurOperator.covering(moved, camera=Camera(timing=when, intrinsics=LENS), samples=3)
    expected = np.zeros((7, 7))
    expected[3 - 1, 3 - 3] = 1
    np.testing.assert_allclose(K.psf(8, 9), expected, atol=1e-12)


@pytest.mark.parametrize("axes", [2, 3])
def test_a_psf_is_what_a_point_becomes_up_to_the_change_between_rows(axes):
    K = operator(axes)
    latent = noise(K.latent_shape)
    k = K.psf(8, 9)
    half = len(k) // 2
    r, c = 8 + K.margin[0], 9 + K.margin[1]
    around = np.pad(latent, half)[r : r + 2 * half + 1, c : c + 2 * half + 1]
    assert K.forward(latent)[8, 9] == pytest.approx((k[::-1, ::-1] * around).sum(), rel=1e-12)
    assert k.sum() == pytest.approx(1)


def test_a_spline_may_move_the_camera():
    t0, t1 = timing().interval
    curve = Spline(t0=t0, t1=t1, coefficients=np.random.default_rng(0).normal(size=(6, 2)))
    K = BlurOperator.covering(curve, camera=Camera(timing=timing(), intrinsics=LENS), samples=7)
    latent = noise(K.latent_shape)
    np.testing.assert_allclose(K.forward(latent), written_out(K, latent, False), rtol=1e-12)


def test_a_shutter_of_other_rows_is_refused():
    shutter = ShutterTiming(exposure=0.01, row_time=0.0, rows=ROWS, direction=Direction.LEFT_TO_RIGHT)
    with pytest.raises(ValueError, match="reads 17 scanlines, the frame has 23 left-to-right"):
        BlurOperator(camera=Camera(timing=shutter, intrinsics=LENS), trajectory=path(2), margin=(9, 9))
