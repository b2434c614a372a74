"""The simulator renders what a rolling-shutter camera would record."""

import json
from dataclasses import replace
from functools import partial

import cv2
import imageio.v3 as iio
import numpy as np
import pytest

from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.distortion import Distortion
from rsvideo.physics.gyro import angles_from_poses, poses_from_angles, spline_through
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.simulate import blur, extent, homographies, margin, render, scaled_to
from rsvideo.physics.simulate import still as sharp
from rsvideo.physics.trajectory import Polynomial, still

ROWS, COLS = 40, 60
TIMING = ShutterTiming.from_readout(exposure=0.01, readout=0.02, rows=ROWS)
LENS = Intrinsics.centred(focal=60.0, rows=ROWS, cols=COLS)
WIDE = Camera(timing=TIMING, intrinsics=LENS)
FAR = Camera(timing=TIMING, intrinsics=Intrinsics.centred(focal=1e6, rows=ROWS, cols=COLS))  # where a turn is a shift
SCENE = np.random.default_rng(0).random((ROWS + 40, COLS + 40, 3))
FRAME = SCENE[20:-20, 20:-20]


def moving(velocity, *, pose=(0.0, 0.0, 0.0), timing=TIMING):
    """A pose that changes evenly by `velocity` (px, px, rad) a second and is `pose` at the middle."""
    t0, t1 = timing.interval
    return Polynomial(t0=t0, t1=t1, coefficients=np.array([pose, np.array(velocity) * (t1 - t0) / 2 / np.sqrt(3)], float))


def test_a_still_camera_gives_the_input_back():
    blurred = blur(SCENE, camera=WIDE, trajectory=still(TIMING.interval, degree=3, axes=3))
    np.testing.assert_allclose(blurred, FRAME, atol=1e-9)


def test_an_even_scene_stays_even():
    blurred = blur(np.full_like(SCENE, 0.7), camera=WIDE, trajectory=moving((300, -200, 3.0)))
    np.testing.assert_allclose(blurred, 0.7, atol=1e-12)


def test_a_camera_moving_right_moves_the_image_left():
    seen = sharp(SCENE, intrinsics=FAR.intrinsics, pose=np.array([5.0, 0.0, 0.0]))
    np.testing.assert_allclose(seen, SCENE[20:-20, 25:-15], atol=1e-4)


def test_a_camera_moving_down_moves_the_image_up():
    seen = sharp(SCENE, intrinsics=FAR.intrinsics, pose=np.array([0.0, 5.0, 0.0]))
    np.testing.assert_allclose(seen, SCENE[25:-15, 20:-20], atol=1e-4)


def test_positive_roll_takes_the_right_from_below():
    x, y = homographies(np.array([[0.0, 0.0, 0.01]]), intrinsics=LENS)[0, :2] @ [LENS.cx + 20, LENS.cy, 1]
    assert (x, y) == pytest.approx((LENS.cx + 20, LENS.cy + 0.2), abs=0.002)


def test_positive_yaw_looks_right_and_positive_pitch_looks_up():
    yaw, pitch = homographies(poses_from_angles(np.array([[0, 0.01, 0], [0.01, 0, 0]]), camera=LENS), intrinsics=LENS)
    assert (yaw @ [LENS.cx, LENS.cy, 1])[:2] == pytest.approx([LENS.cx + 0.6, LENS.cy], abs=0.003)
    assert (pitch @ [LENS.cx, LENS.cy, 1])[:2] == pytest.approx([LENS.cx, LENS.cy - 0.6], abs=0.003)


def test_a_wide_lens_moves_its_corners_further_than_its_centre():
    x = (homographies(np.array([[6.0, 0.0, 0.0]]), intrinsics=LENS)[0] @ np.array([[0, LENS.cx], [LENS.cy] * 2, [1, 1]])).T
    corner, centre = x[:, 0] / x[:, 2] - [0, LENS.cx]
    assert centre == pytest.approx(60 * np.tan(0.1), rel=1e-9)
    assert corner > 1.15 * centre


EDGE_AT = 49.5  # in the scene's columns: between 49 and 50, column 29.5 of the frame


def edge():
    return np.repeat((np.arange(COLS + 40) > EDGE_AT).astype(float)[None, :, None], ROWS + 40, axis=0)


def dark_columns(blurred):
    """Where the edge stands in each row: the width of a step at x from 0 is x + 1/2."""
    return (1 - blurred[..., 0]).sum(axis=1) - 0.5


def test_linear_motion_draws_the_known_ramp_on_an_edge():
    timing = ShutterTiming(exposure=0.01, row_time=0.0, rows=ROWS)
    blurred = blur(edge(), camera=replace(FAR, timing=timing), trajectory=moving((800, 0, 0), timing=timing), samples=512)
    ramp = np.clip((np.arange(COLS) - 29.5) / 8 + 0.5, 0, 1)  # 8 px wide about 29.5
    np.testing.assert_allclose(blurred[..., 0], np.tile(ramp, (ROWS, 1)), atol=0.02)


def test_a_global_shutter_has_no_skew():
    timing = ShutterTiming(exposure=0.01, row_time=0.0, rows=ROWS)
    blurred = blur(edge(), camera=replace(FAR, timing=timing), trajectory=moving((800, 0, 0), timing=timing))
    np.testing.assert_allclose(blurred, blurred[:1].repeat(ROWS, axis=0), atol=1e-6)
    np.testing.assert_allclose(dark_columns(blurred), 29.5, atol=1e-3)


def test_a_rolling_shutter_leans_an_edge_by_speed_times_readout():
    blurred = blur(edge(), camera=FAR, trajectory=moving((400, 0, 0)))
    opened = TIMING.row_start() + TIMING.exposure / 2 - TIMING.middle
    np.testing.assert_allclose(dark_columns(blurred), 29.5 - 400 * opened, atol=0.02)  # camera to the right, edge to the left


def test_the_middle_of_the_interval_is_the_truth():
    rendering = render(
        SCENE,
        camera=FAR,
        trajectory=moving((400, 0, 0), pose=(3, 0, 0)),
        noise=Noise.at_half(0),
        rng=np.random.default_rng(0),
    )
    np.testing.assert_allclose(rendering.truth, SCENE[20:-20, 23:-17], atol=1e-4)


OPENCV = {
    None: (cv2.undistortPoints, cv2.projectPoints),
    "brown-conrady": (partial(cv2.undistortPoints, criteria=(3, 200, 1e-14)), cv2.projectPoints),
    "fisheye": (cv2.fisheye.undistortPoints, cv2.fisheye.projectPoints),
}


def wave(x, y):
    return 0.5 + 0.2 * np.cos(0.21 * x + 0.13 * y) + 0.2 * np.sin(0.17 * y - 0.05 * x)


@pytest.mark.parametrize("model", [None, "brown-conrady", "fisheye"])
def test_blur_matches_the_integral_written_out(model):
    y, x = np.mgrid[-20 : ROWS + 20, -20 : COLS + 20].astype(float)
    p, coefficients = moving((200, -150, 2.0)), np.array([-0.2, 0.05, 0.01, -0.02])
    lens = Distortion(model=model, coefficients=tuple(coefficients)) if model else None
    undistort, distort = OPENCV[model]
    camera = replace(WIDE, intrinsics=replace(LENS, distortion=lens))
    blurred = blur(wave(x, y)[..., None], camera=camera, trajectory=p, samples=16)
    C = np.array([[60, 0, (COLS - 1) / 2], [0, 60, (ROWS - 1) / 2], [0, 0, 1.0]])
    for row, col in [(0, 0), (0, 59), (13, 31), (39, 0), (39, 59)]:
        total = 0.0
        for k in range(16):
            t = row * 0.02 / ROWS + (k + 0.5) * 0.01 / 16
            px, py, roll = p.at(np.array([t]))[0]
            R = cv2.Rodrigues(np.array([-py / 60, px / 60, roll]))[0]
            ray = undistort(np.array([[[col, row]]], float), C, coefficients if model else np.zeros(4)).ravel()
            after = (R @ [*ray, 1]).reshape(1, 1, 3)
            u, v = distort(after, np.zeros(3), np.zeros(3), C, coefficients if model else np.zeros(4))[0].ravel()
            total += wave(u, v)
        assert blurred[row, col, 0] == pytest.approx(total / 16, abs=5e-5)


def test_the_error_of_the_time_samples_falls_as_their_number_squared():
    y, x = np.mgrid[-20 : ROWS + 20, -20 : COLS + 20].astype(float)
    scene, p = wave(x, y)[..., None], moving((400, -250, 3.0))
    finest = blur(scene, camera=WIDE, trajectory=p, samples=512)
    coarse, fine = (np.abs(blur(scene, camera=WIDE, trajectory=p, samples=k) - finest).max() for k in (4, 8))
    assert coarse / fine == pytest.approx(4, rel=0.1)


@pytest.mark.parametrize("direction", list(Direction), ids=[d.value for d in Direction])
def test_a_direction_is_the_turned_frame_of_a_top_to_bottom_camera(direction):
    scene = SCENE[2:, 3:]  # no symmetry
    scene = scene[: ROWS + 20, : COLS + 20]
    lines, along = direction.scanlines(np.zeros((ROWS, COLS))).shape
    timing = ShutterTiming.from_readout(exposure=0.01, readout=0.02, rows=lines, direction=direction)
    p = moving((250, -120, 1.5), pose=(1, 2, 0.02), timing=timing)
    blurred = blur(scene, camera=replace(WIDE, timing=timing), trajectory=p)
    upright = Camera(
        timing=ShutterTiming.from_readout(exposure=0.01, readout=0.02, rows=lines),
        intrinsics=Intrinsics.centred(focal=60.0, rows=lines, cols=along),
    )
    turned = blur(
        np.ascontiguousarray(direction.scanlines(scene)),
        camera=upright,
        trajectory=p.with_coefficients(p.coefficients @ direction.pose_from_scanlines),  # p = P q, and P's inverse is P^T
    )
    np.testing.assert_allclose(direction.scanlines(blurred), turned, atol=1e-12)


def test_bottom_up_readout_leans_the_other_way():
    timing = ShutterTiming.from_readout(exposure=0.01, readout=0.02, rows=ROWS, direction=Direction.BOTTOM_TO_TOP)
    down = dark_columns(blur(edge(), camera=FAR, trajectory=moving((400, 0, 0))))
    up = dark_columns(blur(edge(), camera=replace(FAR, timing=timing), trajectory=moving((400, 0, 0))))
    np.testing.assert_allclose(up, down[::-1], atol=1e-9)
    assert down[0] > down[-1] + 5


@pytest.mark.parametrize("light", [0.1, 0.5, 0.8])
def test_noise_has_the_asked_variance(light):
    timing = ShutterTiming(exposure=0.01, row_time=0.0, rows=180)
    rendering = render(
        np.full((200, 200, 3), light),
        camera=Camera(timing=timing, intrinsics=Intrinsics.centred(focal=100.0, rows=180, cols=180)),
        trajectory=still((0.0, 0.01), degree=0, axes=3),
        noise=Noise.at_half(0.01),
        rng=np.random.default_rng(5),
        samples=1,
    )
    assert np.var(rendering.blurred - light) == pytest.approx(1e-4 * (0.5 + light), rel=0.03)
    assert np.mean(rendering.blurred) == pytest.approx(light, abs=2e-4)
    np.testing.assert_allclose(rendering.truth, light, atol=1e-6)


def test_light_above_white_clips_after_it_is_blurred():
    options = {
        "camera": FAR,
        "trajectory": moving((800, 0, 0)),
        "noise": Noise.at_half(0),
        "rng": np.random.default_rng(0),
    }
    plain, bright = render(SCENE, **options), render(SCENE, gain=2.0, **options)
    np.testing.assert_allclose(bright.blurred, np.clip(2 * plain.blurred, 0, 1), atol=1e-5)
    np.testing.assert_allclose(bright.truth, np.clip(2 * plain.truth, 0, 1), atol=1e-5)
    assert (bright.truth == 1).mean() > 0.3


@pytest.mark.parametrize("bend", [0.0, -0.3, 0.3])
def test_no_sample_falls_outside_the_margin(bend):
    p = moving((300, 200, 2.0), pose=(1, -2, 0))
    lens = replace(LENS, distortion=Distortion(model="brown-conrady", coefficients=(bend, 0.1, 0.0, 0.0)) if bend else None)
    camera = replace(WIDE, intrinsics=lens)
    rows, cols = margin(camera=camera, trajectory=p)
    scene = np.full((ROWS + 2 * rows + 2, COLS + 2 * cols + 2, 1), np.nan)
    scene[1:-1, 1:-1] = 0.5
    np.testing.assert_allclose(blur(scene, camera=camera, trajectory=p), 0.5)
    assert rows < 20
    assert cols < 20


def test_the_extent_is_the_longest_row_s_and_not_the_frame_s():
    assert extent(camera=FAR, trajectory=moving((300, 400, 0))) == pytest.approx(500 * 0.01)
    corner = np.hypot((COLS - 1) / 2, (ROWS - 1) / 2)
    assert extent(camera=FAR, trajectory=moving((0, 0, 2.0))) == pytest.approx(corner * 2.0 * 0.01)


def test_scaling_gives_the_asked_blur_about_the_middle():
    p = scaled_to(12.5, camera=WIDE, trajectory=moving((30, 40, 0.4), pose=(7, 7, 0)))
    assert extent(camera=WIDE, trajectory=p) == pytest.approx(12.5)
    np.testing.assert_allclose(p.at(np.array([TIMING.middle]))[0], 0, atol=1e-9)


def test_a_motionless_path_cannot_be_scaled():
    with pytest.raises(ValueError, match="does it move"):
        scaled_to(10, camera=WIDE, trajectory=still(TIMING.interval, degree=2, axes=3))


@pytest.mark.parametrize("pixels", [-1.0, float("nan"), float("inf")])
def test_an_impossible_blur_is_refused(pixels):
    with pytest.raises(ValueError, match="blur must be"):
        scaled_to(pixels, camera=WIDE, trajectory=moving((30, 40, 0.4)))


@pytest.mark.parametrize("sigma", [-0.1, 1.0, 3.0, float("nan")])
def test_impossible_noise_is_refused(sigma):
    with pytest.raises(ValueError, match="8-bit codes"):
        Noise.at_half(sigma)


def test_a_scene_smaller_than_the_frame_is_refused():
    with pytest.raises(ValueError, match="at least as large"):
        blur(SCENE[:30], camera=WIDE, trajectory=moving((0, 0, 0)))


def test_a_shutter_of_another_frame_is_refused():
    timing = ShutterTiming(exposure=0.01, row_time=0, rows=ROWS + 1)
    with pytest.raises(ValueError, match="scanlines"):
        blur(SCENE, camera=replace(WIDE, timing=timing), trajectory=moving((0, 0, 0)))


@pytest.mark.parametrize("name", ["shift_00", "rotation_02"])
def test_it_agrees_with_an_independent_renderer(shared, name):
    folder = shared / "cases" / "stills" / name
    case = json.loads((folder / "case.json").read_text())
    motion = np.loadtxt(folder / "motion.csv", delimiter=",", skiprows=1)
    blurred, truth = (
        np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
        for v in (iio.imread(folder / f"{kind}.png") / 255.0 for kind in ("blurred", "truth"))
    )
    lens = Intrinsics.centred(focal=case["focal_px"], rows=case["rows"], cols=case["cols"])
    timing = ShutterTiming(exposure=case["exposure_s"], row_time=case["row_time_s"], rows=case["rows"])
    camera = Camera(timing=timing, intrinsics=lens)
    p = spline_through(poses_from_angles(motion[:, 1:], camera=lens), duration=float(motion[-1, 0]), spacing=0.002)
    np.testing.assert_allclose(angles_from_poses(p.at(motion[:, 0]), camera=lens), motion[:, 1:], atol=1e-5)
    error = (blur(truth, camera=camera, trajectory=p) - blurred)[60:-60, 60:-60]
    assert np.sqrt(np.mean(error**2)) < 0.005  # the case's own noise is 0.003, before 8-bit codes
    backwards = p.with_coefficients(-p.coefficients)
    error = (blur(truth, camera=camera, trajectory=backwards) - blurred)[60:-60, 60:-60]
    assert np.sqrt(np.mean(error**2)) > 0.03
