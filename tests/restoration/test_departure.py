"""What neighbours show of the scene says what is missing of a frame's path, as far as blur shows it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import skimage.data

from rsvideo.physics import simulate
from rsvideo.physics.blur import BlurOperator
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, Trajectory, centred
from rsvideo.restoration.departure import changes, departure
from rsvideo.restoration.nonblind import tiled
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.path_from_neighbours import STRONG, WEAKER
from rsvideo.restoration.predicted_blur import Predicted
from rsvideo.restoration.rectification import displaced

ROWS, COLS = 120, 240
TIMING = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=ROWS)
CAMERA = Camera(timing=TIMING, intrinsics=Intrinsics.centred(focal=300.0, rows=ROWS, cols=COLS))
TRUE = np.array([[0.0, 0.0, 0.0], [5.0, -2.5, 0.003], [0.8, 1.2, 0.0], [-0.3, 0.2, 0.0]])
DOUBTS = [np.array([[0.0] * 3, [0.0] * 3, move, [0.0] * 3]) for move in ([0.5, 0.0, 0.0], [0.0, 0.5, 0.0])]
EVERYWHERE = np.ones((ROWS, COLS), bool)


def path(coefficients: np.ndarray) -> Trajectory:
    return centred(Polynomial(t0=0.0, t1=TIMING.interval[1], coefficients=coefficients), TIMING.middle)


@pytest.fixture(scope="module")
def taken() -> simulate.Rendering:
    light = (skimage.data.astronaut()[20:220, 60:380] / 255) ** 2.2
    how = {"camera": CAMERA, "trajectory": path(TRUE), "noise": Noise.at_half(0.002), "rng": np.random.default_rng(0), "samples": 32}
    return simulate.render(light, **how)


def predicted(taken: simulate.Rendering, found: Trajectory, *, camera: Camera = CAMERA, target: np.ndarray | None = None) -> Predicted:
    clipped = np.zeros(taken.blurred.shape, bool)
    frame = tiled(taken.blurred.astype(np.float32), clipped, found, camera, samples=16, tolerance=0.25)
    sharp = taken.truth.mean(axis=-1).astype(np.float32) if target is None else target
    still = displaced(found, camera)(sharp)
    observed = taken.blurred.mean(axis=-1).astype(np.float32)
    inner = EVERYWHERE.copy()
    inner[:8], inner[-8:], inner[:, :8], inner[:, -8:] = (False,) * 4
    return Predicted(observed=observed, target=sharp, blurred=frame.blurred(sharp), displaced=still, shown=inner)


def corrected(start: Trajectory, doubts: list[np.ndarray], seen: Predicted) -> Trajectory:
    """The likeliest path, each doubt being a standard deviation long."""
    found = departure(start, np.stack(doubts), seen, CAMERA)
    missing = np.linalg.solve(np.eye(len(doubts)) + found.covariance, found.missing)
    return start.with_coefficients(start.coefficients + np.tensordot(missing, np.stack(doubts), 1))


def moved(found: Trajectory, start: Trajectory) -> np.ndarray:
    return (found.coefficients - start.coefficients)[2, :2]


WRONG = path(TRUE - 0.4 * DOUBTS[0] / 0.5 + 0.3 * DOUBTS[1] / 0.5)


@pytest.mark.parametrize("axes", [2, 3])
def test_the_blur_changes_as_the_operators_derivative_says(taken: simulate.Rendering, axes: int) -> None:
    """Less what displaces scanlines."""
    along = path(TRUE[:, :axes])
    target = cv2.GaussianBlur(taken.truth.mean(axis=-1).astype(np.float32), (0, 0), 1.0)
    move = np.array([[0.0] * 3, [0.3, -0.2, 0.0], [0.5, 0.4, 0.0], [-0.2, 0.1, 0.0]])[:, :axes]
    bent, slopes = changes(along, move[None], target, CAMERA, None)
    operator = BlurOperator.covering(along, camera=CAMERA, samples=16)
    exact = operator.jacobian(np.pad(target, [(side, side) for side in operator.margin], mode="edge"))
    means = (along.basis(TIMING.sample_times(16)).mean(axis=1) @ move)[:, :2]
    expected = np.tensordot(move[:, :2], exact[:, :2], 2) - np.einsum("ra,arc->rc", means, exact[0, :2])
    inner = np.s_[..., 8:-8, 8:-8]
    for one, other in ((slopes, exact[0, :2]), (bent[0], expected)):
        assert np.linalg.norm((one - other)[inner]) < 0.1 * np.linalg.norm(other[inner])


def test_what_moves_beside_the_path_moves_the_change_too(taken: simulate.Rendering) -> None:
    """A field that undoes the path's motion leaves what a camera at rest would see."""
    target = cv2.GaussianBlur(taken.truth.mean(axis=-1).astype(np.float32), (0, 0), 1.0)
    even = Polynomial(t0=0.0, t1=TIMING.interval[1], coefficients=np.array([[0.0, 0.0], [5.0, 0.0]]))
    speed = (even.at(np.array([0.03])) - even.at(np.array([0.01])))[0] / 0.02
    points = np.array([[x, y] for x in (0.0, 120.0, 239.0) for y in (0.0, 60.0, 119.0)])
    flow = Flow(points=points, weights=np.zeros_like(points), length=1e4)
    one = replace(flow, weights=np.full_like(points, 1.0)).at(points[:1])[0, 0]
    undone = replace(flow, weights=np.tile(speed / one, (len(points), 1)))
    move = [np.array([[0.0, 0.0], [1.0, 0.0]])]
    rest = even.with_coefficients(0 * even.coefficients)
    still, _ = changes(rest, np.stack(move), target, CAMERA, None)
    beside, _ = changes(even, np.stack(move), target, CAMERA, undone)
    without, _ = changes(even, np.stack(move), target, CAMERA, None)
    inner = np.s_[0, 12:-12, 12:-12]
    assert np.abs(beside - still)[inner].mean() < 0.1 * np.abs(without - still)[inner].mean()


def test_a_path_is_corrected_to_the_true_one(taken: simulate.Rendering) -> None:
    found = corrected(WRONG, DOUBTS, predicted(taken, WRONG))
    np.testing.assert_allclose(moved(found, WRONG), [0.4, -0.3], atol=0.06)
    np.testing.assert_array_equal((found.coefficients - WRONG.coefficients)[[1, 3]], 0)


def test_a_right_path_stays(taken: simulate.Rendering) -> None:
    right = path(TRUE)
    np.testing.assert_allclose(moved(corrected(right, DOUBTS, predicted(taken, right)), right), 0, atol=0.05)


def test_what_points_do_not_doubt_stays(taken: simulate.Rendering) -> None:
    sure = [move / 1000 for move in DOUBTS]
    assert np.abs(moved(corrected(WRONG, sure, predicted(taken, WRONG)), WRONG)).max() < 0.02


def test_soft_neighbours_do_not_shorten_a_path(taken: simulate.Rendering) -> None:
    """Nor does where they have been aligned to."""
    soft = cv2.GaussianBlur(taken.truth.mean(axis=-1).astype(np.float32), (0, 0), 0.7)
    aside = cv2.warpAffine(soft, np.array([[1.0, 0.0, 0.3], [0.0, 1.0, -0.2]]), (COLS, ROWS), borderMode=cv2.BORDER_REPLICATE)
    long = [np.array([[0.0] * 3, [0.5, -0.25, 0.0], [0.0] * 3, [0.0] * 3]), *DOUBTS]
    right = path(TRUE)
    found = corrected(right, long, predicted(taken, right, target=aside))
    assert np.linalg.norm((found.coefficients - right.coefficients)[1:3, :2]) < 0.15


def test_blur_weaker_than_the_path_predicts_shows(taken: simulate.Rendering) -> None:
    """As of an exposure that is twice too long."""
    twice = CAMERA.exposed(2 * TIMING.exposure)
    longer = twice.timing.interval[1] / TIMING.interval[1]
    start = Polynomial(t0=0.0, t1=twice.timing.interval[1], coefficients=longer * WRONG.coefficients)
    assert departure(start, np.stack(DOUBTS), predicted(taken, start, camera=twice), twice).strength < WEAKER
    assert departure(WRONG, np.stack(DOUBTS), predicted(taken, WRONG), CAMERA).strength > STRONG


def test_what_moves_by_itself_counts_little(taken: simulate.Rendering) -> None:
    seen = predicted(taken, WRONG)
    passing = seen.observed.copy()
    passing[30:80, 40:100] = np.random.default_rng(1).uniform(0, 1, (50, 60)).astype(np.float32)
    found = corrected(WRONG, DOUBTS, replace(seen, observed=passing))
    np.testing.assert_allclose(moved(found, WRONG), [0.4, -0.3], atol=0.1)
