"""What an engine shakes: tones beside a hand's path."""

import numpy as np
import pytest

from rsvideo.physics.camera import Camera
from rsvideo.physics.trajectory import Spline, VibratingSpline
from rsvideo.restoration import vibration
from rsvideo.restoration.camera_path import blank, follow, within
from rsvideo.restoration.point_equations import FIELDS, pairs_of
from rsvideo.restoration.vibration import Explained, exposed, vibrating
from tests.restoration.swaying import BEGINS, CAMERA, TIMING, exact, shaken, sway

TAKEN = Camera(timing=TIMING, intrinsics=CAMERA)
TIMES = (BEGINS[:, None] + np.linspace(*TIMING.interval, 60)).ravel()


@pytest.mark.parametrize("axes", [2, 3])
def test_a_tone_that_shakes_the_camera_is_found(axes: int) -> None:
    true = shaken(axes, hertz=43.0, reach=1.5)
    found = follow(exact(true), BEGINS, TAKEN, axes).spline
    assert isinstance(found, VibratingSpline)
    assert found.frequencies == pytest.approx([43.0], abs=0.5)
    apart = (found.at(TIMES) - true.at(TIMES))[:, :2]
    tone = (true.at(TIMES) - sway(axes).at(TIMES))[:, :2]
    assert np.std(apart, axis=0) == pytest.approx(0.0, abs=0.25)
    assert np.std(tone, axis=0)[0] > 1.0


@pytest.mark.parametrize("hertz", [0.0, 48.0])  # at twice the frame rate all frames are shaken alike
def test_a_hand_s_path_has_no_tones(hertz: float) -> None:
    assert not isinstance(follow(exact(shaken(3, hertz=hertz, reach=1.5)), BEGINS, TAKEN, 3).spline, VibratingSpline)


def test_a_readout_that_is_a_guess_shows_no_tones() -> None:
    found = follow(exact(shaken(2, hertz=43.0, reach=1.5)), BEGINS, TAKEN, 2, toned=False).spline
    assert not isinstance(found, VibratingSpline)


def test_points_show_the_same_of_a_tone_whatever_exposure_is_tried() -> None:
    path = vibrating(blank(BEGINS, TIMING, 2), [30.0, 70.0])
    steady = np.random.default_rng(3).standard_normal((2, 1, 2, 2)).repeat(path.nodes, axis=1).reshape(-1, 2)
    path = path.with_coefficients(np.vstack([np.zeros_like(path.smooth.coefficients), steady]))
    middles = BEGINS[1:] + TIMING.middle
    before, after = 0.002, 0.011  # s

    def seen(spline: Spline, exposure: float) -> np.ndarray:
        return spline.at(middles[:, None] + exposure * (np.arange(200) + 0.5 - 100) / 200).mean(axis=1)

    changed = exposed(path, before, after)
    np.testing.assert_allclose(seen(changed, after), seen(path, before), atol=1e-3)
    assert np.abs(seen(path, after) - seen(path, before)).max() > 0.3
    np.testing.assert_array_equal(exposed(path.smooth, before, after).coefficients, path.smooth.coefficients)


def test_a_frame_s_polynomial_follows_its_tones() -> None:
    path = vibrating(blank(BEGINS, TIMING, 2), [20.0, 95.0])
    path = path.with_coefficients(np.random.default_rng(1).standard_normal(path.coefficients.shape))
    inside = np.linspace(*TIMING.interval, 50)
    for begin in BEGINS:
        part = within(path, float(begin), TIMING)
        apart = part.at(inside) - path.at(inside + begin)
        assert np.abs(apart - apart.mean(axis=0)).max() < 0.05 * np.abs(path.coefficients).max()


def test_the_evidence_is_the_ratio_of_two_likelihoods() -> None:
    rng = np.random.default_rng(2)
    tracks = [type(pair)(before=pair.before[::9], after=pair.after[::9]) for pair in exact(sway(2))[:3]]
    smooth = blank(BEGINS[:4], TIMING, 2)
    unknowns, frequencies = smooth.coefficients.size, [31.0, 44.0]
    bank = vibrating(smooth, frequencies)
    pairs, wider = (pairs_of(tracks, BEGINS[:4], (), TAKEN, path) for path in (smooth, bank))
    weights = [rng.uniform(1, 4, len(pair.moved)) for pair in pairs]
    common, variance, prior = rng.standard_normal(FIELDS), rng.uniform(0.5, 2, FIELDS), 0.1 * np.eye(unknowns)
    precision, right = prior.copy(), np.zeros(unknowns)
    for pair, weight in zip(pairs, weights, strict=True):
        system = pair.system(weight, common, variance)
        precision[np.ix_(system.unknowns, system.unknowns)] += system.precision
        right[system.unknowns] += system.right
    path = smooth.with_coefficients(np.linalg.solve(precision, right).reshape(-1, 2))
    found = Explained(path=path, precision=precision, weights=weights, common=common, variance=variance)
    tones = [pair.design[:, len(smooth.coefficients) :] for pair in wider]
    shown = vibration._evidence(pairs, found, tones, len(frequencies))

    moved = np.concatenate([(pair.moved - pair.fields @ common).ravel() for pair in pairs])
    covariance = np.diag(1 / np.repeat(np.concatenate(weights), 2))
    start = 0
    for pair in pairs:
        part = slice(start, start := start + pair.moved.size)
        fields = pair.fields.reshape(-1, FIELDS)
        covariance[part, part] += fields * variance @ fields.T
    by_path = np.vstack([np.einsum("nca,nt->ncta", pair.levers, pair.design).reshape(pair.moved.size, -1) for pair in pairs])
    covariance += by_path @ np.linalg.solve(prior, by_path.T)
    without = log_density(moved, covariance)
    for k, tone in enumerate(np.split(np.vstack(tones), len(frequencies), axis=1)):
        for axis in range(2):
            along = np.zeros((len(tone), 2, tone.shape[1]))
            along[:, axis] = tone
            along = along.reshape(len(moved), -1)
            beside = log_density(moved, covariance + vibration.SPREAD**2 * along @ along.T)
            assert shown[k, axis] == pytest.approx(beside - without, rel=1e-4, abs=1e-4)


def log_density(at: np.ndarray, covariance: np.ndarray) -> float:
    """Of a normal distribution about 0, but for a constant."""
    return float(-0.5 * at @ np.linalg.solve(covariance, at) - 0.5 * np.linalg.slogdet(covariance)[1])
