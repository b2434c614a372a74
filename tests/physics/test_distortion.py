"""What a lens bends comes back, and OpenCV bends it alike."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from rsvideo.physics.bent import bent, packed
from rsvideo.physics.camera import (
    Intrinsics,
    lever,
    pinhole_from_px,
    px_from_pinhole,
    px_from_ray,
    ray_from_px,
    resampled_at,
    turned,
)
from rsvideo.physics.distortion import Distortion
from rsvideo.physics.shutter import Direction

LENSES = {
    "barrel of four": Distortion(model="brown-conrady", coefficients=(-0.25, 0.08, 0.001, -0.002)),
    "moustache of five": Distortion(model="brown-conrady", coefficients=(-0.2, 0.25, -0.003, 0.004, -0.08)),
    "rational of eight": Distortion(model="brown-conrady", coefficients=(-0.3, 0.1, 0.001, -0.002, 0.01, 0.02, -0.01, 0.003)),
    "pincushion of twelve": Distortion(
        model="brown-conrady", coefficients=(0.1, 0.02, 0.01, -0.02, -0.01, 0.02, 0.01, 0.003, 0.001, 0.002, -0.003, 0.001)
    ),
    "fisheye": Distortion(model="fisheye", coefficients=(0.05, -0.02, 0.003, -0.001)),
}
BARE = Intrinsics(fx=400.0, fy=420.0, cx=330.0, cy=230.0, rows=480, cols=640)
POSE = np.array([24.0, -15.0, 0.06])


@pytest.fixture(params=LENSES.values(), ids=list(LENSES))
def camera(request: pytest.FixtureRequest) -> Intrinsics:
    return replace(BARE, distortion=request.param)


def pixels(c: Intrinsics) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.linspace(0, c.cols - 1, 17), np.linspace(0, c.rows - 1, 13))
    return x, y


def shown_by_opencv(c: Intrinsics, ray: np.ndarray) -> np.ndarray:
    """Where rays (n, 3) are shown."""
    assert c.distortion
    project = cv2.fisheye.projectPoints if c.distortion.model == "fisheye" else cv2.projectPoints
    return project(ray.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), c.matrix, np.array(c.distortion.coefficients))[0].reshape(-1, 2)


def test_opencv_shows_the_rays_at_the_same_pixels(camera: Intrinsics) -> None:
    x, y = pixels(camera)
    ray = ray_from_px(camera, x, y)
    u, v = ray[..., 0], ray[..., 1]
    expected = shown_by_opencv(camera, np.stack([u, v, np.ones_like(u)], axis=-1)).reshape(ray.shape)
    np.testing.assert_allclose(px_from_ray(camera, u, v), expected, atol=1e-9)


def test_opencv_finds_the_same_rays(camera: Intrinsics) -> None:
    assert camera.distortion
    x, y = pixels(camera)
    at, coefficients = np.stack([x, y], axis=-1).reshape(-1, 1, 2), np.array(camera.distortion.coefficients)
    if camera.distortion.model == "fisheye":
        expected = cv2.fisheye.undistortPoints(at, camera.matrix, coefficients)
    else:
        expected = cv2.undistortPoints(at, camera.matrix, coefficients, criteria=(3, 200, 1e-14))
    np.testing.assert_allclose(ray_from_px(camera, x, y).reshape(-1, 2), expected.reshape(-1, 2), atol=1e-9)


def test_a_pixel_comes_back_from_its_ray(camera: Intrinsics) -> None:
    x, y = pixels(camera)
    ray, ideal = ray_from_px(camera, x, y), pinhole_from_px(camera, x, y)
    for back in (px_from_ray(camera, ray[..., 0], ray[..., 1]), px_from_pinhole(camera, ideal[..., 0], ideal[..., 1])):
        np.testing.assert_allclose(back, np.stack([x, y], axis=-1), atol=1e-9)


def test_the_slopes_are_the_derivative(camera: Intrinsics) -> None:
    assert camera.distortion
    ray = ray_from_px(camera, *pixels(camera))
    u, v = ray[..., 0], ray[..., 1]
    along, J = np.array([0.6, -0.8]), camera.distortion.slopes(u, v)
    start = camera.distortion.distorted(u, v)
    errors = [
        np.abs(camera.distortion.distorted(u + h * along[0], v + h * along[1]) - start - h * J @ along).max() for h in (1e-2, 1e-3, 1e-4)
    ]
    np.testing.assert_allclose(np.log10(np.array(errors[:-1]) / errors[1:]), 2, atol=0.1)


def test_the_lever_is_the_derivative_of_turning_at_rest(camera: Intrinsics) -> None:
    x, y = pixels(camera)
    L = lever(camera, x, y, 3)
    errors = [np.abs(turned(camera, x, y, h * POSE[None, None]) - h * L @ POSE).max() for h in (1e-1, 1e-2, 1e-3)]
    np.testing.assert_allclose(np.log10(np.array(errors[:-1]) / errors[1:]), 2, atol=0.15)


def test_turning_undistorts_rotates_and_distorts(camera: Intrinsics) -> None:
    x, y = pixels(camera)
    ray = ray_from_px(camera, x, y).reshape(-1, 2)
    pitch_yaw_roll = np.array([-POSE[1] / camera.fy, POSE[0] / camera.fx, POSE[2]])
    after = np.column_stack([ray, np.ones(len(ray))]) @ cv2.Rodrigues(pitch_yaw_roll)[0].T
    expected = shown_by_opencv(camera, after / after[:, 2:])
    moved = np.stack([x, y], axis=-1) + turned(camera, x, y, POSE[None, None])
    np.testing.assert_allclose(moved.reshape(-1, 2), expected, atol=1e-8)
    np.testing.assert_allclose(resampled_at(camera, POSE, x, y).reshape(-1, 2), expected, atol=1e-8)


def test_a_shift_ignores_the_lens(camera: Intrinsics) -> None:
    x, y = pixels(camera)
    np.testing.assert_array_equal(turned(camera, x, y, POSE[None, None, :2]), np.broadcast_to(POSE[:2], (*x.shape, 2)))


def test_the_compiled_lens_is_the_lens(camera: Intrinsics) -> None:
    ideal = pinhole_from_px(camera, *pixels(camera)).reshape(-1, 2)
    lens, step = packed(camera), 1e-4
    for x, y in ideal[::7]:
        found = bent(x, y, lens)
        around = px_from_pinhole(camera, np.array([x, x + step, x]), np.array([y, y, y + step]))
        np.testing.assert_allclose(found[:2], around[0], atol=1e-10)
        np.testing.assert_allclose(np.reshape(found[2:], (2, 2)), ((around[1:] - around[0]) / step).T, atol=1e-5)
    assert bent(3.5, 4.5, packed(BARE)) == (3.5, 4.5, 1, 0, 0, 1)


@pytest.mark.parametrize("direction", list(Direction), ids=[d.value for d in Direction])
def test_the_camera_along_the_scanlines_sees_the_turned_picture(camera: Intrinsics, direction: Direction) -> None:
    def grids(c: Intrinsics) -> tuple[np.ndarray, np.ndarray]:
        x, y = np.meshgrid(np.arange(c.cols, dtype=float), np.arange(c.rows, dtype=float))
        return x, y

    small = camera.scaled(24, 32)
    rays = direction.scanlines(ray_from_px(small, *grids(small)))
    along = small.along(direction)
    turn = direction.pose_from_scanlines[:2, :2]  # of points, as of shifts
    found = ray_from_px(along, *grids(along))
    np.testing.assert_allclose(found @ turn.T, rays, atol=1e-12)
    back = px_from_ray(along, found[..., 0], found[..., 1])
    np.testing.assert_allclose(back, np.stack(grids(along), axis=-1), atol=1e-9)


def test_a_camera_keeps_its_lens_when_it_is_scaled_or_windowed(camera: Intrinsics) -> None:
    half = camera.scaled(camera.rows // 2, camera.cols // 2)
    x, y = np.array([10.0, 300.0]), np.array([20.0, 200.0])
    np.testing.assert_allclose(ray_from_px(half, x, y), ray_from_px(camera, 2 * x + 0.5, 2 * y + 0.5), atol=1e-12)
    window = replace(camera, cx=camera.cx - 100, cols=200)
    np.testing.assert_allclose(ray_from_px(window, x[:1], y[:1]), ray_from_px(camera, x[:1] + 100, y[:1]), atol=1e-12)


@pytest.mark.parametrize(
    ("lens", "focal", "why"),
    [
        (Distortion(model="brown-conrady", coefficients=(-0.25, 0.0, 0.0, 0.0)), 400.0, "folds over 49 degrees"),
        (Distortion(model="brown-conrady", coefficients=(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)), 400.0, "folds over 45 degrees"),
        (Distortion(model="brown-conrady", coefficients=(0.0, 0.0, 0.9, 0.0)), 400.0, "within it"),  # tangentially
        (Distortion(model="fisheye", coefficients=(-0.5, 0.0, 0.0, 0.0)), 400.0, "folds over 47 degrees"),
        (Distortion(model="fisheye", coefficients=(0.0, 0.0, 0.0, 0.0)), 250.0, "farther than 80 degrees"),
    ],
)
def test_a_lens_that_folds_over_inside_the_frame_is_refused(lens: Distortion, focal: float, why: str) -> None:
    with pytest.raises(ValueError, match=why) as caught:
        replace(BARE, fx=focal, fy=focal, distortion=lens)
    assert len(str(caught.value).splitlines()) == 1
    replace(BARE, fx=4000.0, fy=4000.0, distortion=lens)  # of a longer lens only the middle is seen


def test_beyond_the_fold_rays_go_on_outwards() -> None:
    lens = Distortion(model="brown-conrady", coefficients=(-0.25, 0.0, 0.0, 0.0))
    assert math.tan(lens.reach) == pytest.approx(math.sqrt(4 / 3))
    u = np.linspace(0, 4, 100)
    assert (np.diff(lens.distorted(u, 0 * u)[:, 0]) >= 0).all()


@pytest.mark.parametrize(("model", "coefficients"), [("fisheye", (0.1,)), ("brown-conrady", (0.1,) * 6), ("fisheye", (math.nan,) * 4)])
def test_coefficients_that_are_none_are_refused(model, coefficients) -> None:
    with pytest.raises(ValueError, match="coefficients"):
        Distortion(model=model, coefficients=coefficients)
