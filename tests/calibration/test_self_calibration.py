"""The readout from points that were followed through hand-held footage."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from calibration.timing import self_calibration
from calibration.timing.cannot_tell import CannotTellError, StabilisedError
from calibration.timing.pair_motion import TERMS, Pair, summarise
from calibration.timing.path_evidence import PathFit, chunked
from calibration.timing.self_calibration import Explained, explain
from rsvideo.physics.shake import shake
from rsvideo.physics.shutter import Direction

ROWS, COLS, FPS, FOCAL = 360, 640, 30.0, 700.0
MIDDLE = np.array([(COLS - 1) / 2, (ROWS - 1) / 2])


def film(
    readout: float,
    *,
    frames: int = 17,
    rms: float = 0.15,
    noise: float = 0.1,
    seed: int = 3,
    points: int = 200,
    pan: float = 0.0,
    tone: float = 0.0,
) -> list[Pair]:
    """Points on a distant scene, each observed where its row is read; a negative readout runs upwards. `pan` is in px/s.

    A `tone` of so many Hz shakes the camera sideways by 2 px.
    """
    rng = np.random.default_rng(seed)
    angles = shake(rng, frames / FPS + 0.1, 2000.0, rms=max(rms, 1e-9))
    angles[:, 1] += 2 / FOCAL * np.sin(2 * np.pi * tone * np.arange(len(angles)) / 2000)
    path = CubicSpline(np.arange(len(angles)) / 2000, angles)

    def observed(scene: np.ndarray, begins: float) -> np.ndarray:
        t = np.full(len(scene), begins)
        at = scene
        for _ in range(8):  # a point's row and its time depend on each other
            pitch, yaw, roll = path(t).T
            at = scene + np.stack([-FOCAL * yaw + roll * scene[:, 1] + pan * t, FOCAL * pitch - roll * scene[:, 0]], axis=1)
            t = begins + readout / ROWS * at[:, 1]
        return at + MIDDLE + noise * rng.standard_normal(at.shape)

    pairs = []
    for k in range(frames - 1):
        begins = (k / FPS + 0.04, (k + 1) / FPS + 0.04)
        now = FOCAL * path(begins[0])
        scene = rng.uniform(-1, 1, (points, 2)) * MIDDLE + np.array([now[1], -now[0]])
        before, after = (observed(scene, at) for at in begins)
        inside = ((np.minimum(before, after) > 5) & (np.maximum(before, after) < 2 * MIDDLE - 5)).all(axis=1)
        pairs.append(Pair(before=before[inside], after=after[inside], begins=begins))
    return pairs


def found(pairs: list[Pair]) -> Explained:
    """What is found in a clip."""
    return explain(pairs, rows=ROWS, cols=COLS, period=1 / FPS)


@pytest.mark.parametrize(
    ("readout", "seed"), [pytest.param(0.012, 1, marks=pytest.mark.long), (0.022, 2), pytest.param(0.031, 5, marks=pytest.mark.long)]
)
def test_a_hands_motion_tells_the_readout(readout: float, seed: int) -> None:
    explained = found(film(readout, seed=seed))
    assert explained.readout == pytest.approx(readout, rel=0.05)
    assert abs(explained.readout - readout) < 3 * explained.std
    assert explained.direction is Direction.TOP_TO_BOTTOM
    assert explained.curvature > 0
    assert explained.over_global > 20


def test_near_a_readout_that_is_nearly_right_the_same_one_is_found_with_fewer_tried() -> None:
    pairs = film(0.022, seed=2)
    whole = found(pairs)
    near = explain(pairs, rows=ROWS, cols=COLS, period=1 / FPS, near=0.024)
    assert near.readout == pytest.approx(whole.readout, rel=2e-3)
    assert near.std == pytest.approx(whole.std, rel=0.05)
    assert len(near.readouts) < len(whole.readouts) / 4
    assert near.direction is Direction.TOP_TO_BOTTOM


@pytest.mark.slow
def test_an_engines_vibration_tells_the_readout() -> None:
    explained = found(film(0.014, tone=56.6))
    assert explained.readout == pytest.approx(0.014, rel=0.05)


def test_what_tones_add_is_the_ratio_of_two_likelihoods() -> None:
    chunks = chunked(summarise(film(0.014, frames=6, points=80, tone=56.0), ROWS, COLS), ROWS)
    tones, hyper = np.array([31.0, 56.0]), np.log([10.0, 0.1, 1.0])
    for chunk in chunks:
        alone = chunk.evidence(0.014 / ROWS, hyper)[0]
        together = [replace(chunk, tones=(float(tone),)).evidence(0.014 / ROWS, hyper)[0] for tone in tones]
        assert chunk.gains(0.014 / ROWS, hyper, tones) == pytest.approx(np.array(together) - alone, rel=1e-6, abs=1e-6)


@pytest.fixture(scope="module")
def upwards() -> Explained:
    """Of a clip that is read upwards in 20 ms."""
    return found(film(-0.02))


@pytest.mark.slow
def test_a_readout_upwards_is_told_from_one_downwards(upwards: Explained) -> None:
    explained = upwards
    assert explained.readout == pytest.approx(0.02, rel=0.05)
    assert explained.direction is Direction.BOTTOM_TO_TOP


@pytest.mark.slow
def test_a_global_shutter_is_told_as_no_readout_and_no_direction() -> None:
    explained = found(film(0.0))
    assert explained.readout < 3 * explained.std < 0.002
    assert explained.direction is None


def test_the_cost_is_lowest_near_the_readout_and_told_for_all_that_was_tried(upwards: Explained) -> None:
    explained = upwards
    assert abs(explained.readouts[np.argmin(explained.costs)] + 0.02) < 0.004
    assert explained.readouts[0] < -1 / FPS < 1 / FPS < explained.readouts[-1]


@pytest.mark.slow
def test_a_steady_pan_says_nothing() -> None:
    with pytest.raises(CannotTellError, match="its motion does not show it"):
        found(film(0.02, rms=0.0, pan=60.0))


def test_a_tripod_says_nothing() -> None:
    with pytest.raises(CannotTellError, match="its motion does not show it") as told:
        found(film(0.02, rms=0.0))
    assert told.value.likeliest is None


@pytest.mark.slow
def test_a_short_clip_makes_a_readout_likely_and_is_no_answer() -> None:
    with pytest.raises(CannotTellError, match="ms is likeliest, give or take") as told:
        found(film(0.012, rms=0.05, noise=0.3, frames=10))
    likeliest = told.value.likeliest
    assert likeliest is not None
    assert abs(likeliest.readout - 0.012) < 2 * likeliest.std < 0.004


@pytest.mark.slow
def test_a_readout_that_seems_longer_than_a_period_is_no_answer_and_long() -> None:
    with pytest.raises(CannotTellError, match="ms is likeliest, give or take") as told:
        found(film(1.15 / FPS, rms=0.05))
    assert told.value.likeliest is not None
    assert told.value.likeliest.readout == pytest.approx(1.15 / FPS, rel=0.05)


def test_a_readout_with_likely_others_is_less_certain() -> None:
    best, near, far = (PathFit(row_time=t, value=-cost, hyper=(np.zeros(3), np.zeros(3))) for t, cost in ((1e-4, 0), (8e-5, 2), (2e-5, 9)))
    assert self_calibration._spread(best, [], 100, 1.0) == 0
    alone, both = (self_calibration._spread(best, others, 100, 1.0) for others in ([near], [near, far]))
    assert alone == pytest.approx(0.002 * np.exp(-1))
    assert alone < both < self_calibration._spread(best, [near, far], 100, 4.0)


def stabilised(pairs: list[Pair]) -> list[Pair]:
    """The same, if each frame is shifted so that the picture stays where it is."""
    shift, out = np.zeros(2), []
    for pair in pairs:
        further = shift + np.median(pair.after - pair.before, axis=0)
        out.append(Pair(before=pair.before - shift, after=pair.after - further, begins=pair.begins))
        shift = further
    return out


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.long), pytest.param(4, marks=pytest.mark.long)])
def test_frames_that_were_shifted_after_they_were_read_show_no_readout(seed: int) -> None:
    pairs = film(0.022, seed=seed)
    with pytest.raises(StabilisedError, match="was it stabilised") as told:
        found(stabilised(pairs))
    assert told.value.likeliest is None
    assert found(pairs).readout == pytest.approx(0.022, rel=0.05)


def test_a_shift_of_each_pair_adds_its_variance_to_the_mean_displacements_alone() -> None:
    chunk = chunked(summarise(film(0.014, frames=4, points=80), ROWS, COLS), ROWS)[0]
    hyper = np.log([10.0, 0.1, 1.0])
    without, shifted = (replace(chunk, shift=shift)._covariances(0.014 / ROWS, hyper)[2] for shift in (0.0, 5.0))
    constant = np.arange(len(without)) % TERMS == 0
    assert shifted - without == pytest.approx(25.0 * np.diag(constant.astype(float)))


def test_points_that_are_too_few_say_nothing() -> None:
    with pytest.raises(CannotTellError, match="only 0 pairs of frames have 48 points"):
        found(film(0.02, points=30))
    with pytest.raises(CannotTellError, match="only 6 pairs of frames have 48 points"):
        found(film(0.02, frames=7))


@pytest.mark.long
def test_a_moving_thing_in_a_part_of_the_picture_does_not_mislead() -> None:
    pairs = film(0.02)
    moved = [np.where(p.before[:, :1] > 570, p.after + np.array([6.0, 3.0]), p.after) for p in pairs]
    explained = found([Pair(before=p.before, after=after, begins=p.begins) for p, after in zip(pairs, moved, strict=True)])
    assert explained.readout == pytest.approx(0.02, rel=0.07)
