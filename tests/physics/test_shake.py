"""The hand-shake model has the spectrum and the strength that it is documented with."""

import itertools

import numpy as np
import pytest
from scipy.signal import welch

from rsvideo.physics.shake import AXES, rate_spectrum, shake

RATE = 200.0


def rates(seed, duration=100.0, **options):
    return np.diff(shake(np.random.default_rng(seed), duration, RATE, **options), axis=0) * RATE


def test_the_spectrum_of_the_rates_is_the_documented_one():
    power = np.mean([welch(rates(seed)[:, 1] / 0.03, RATE, nperseg=1024)[1] for seed in range(20)], axis=0)
    f = np.fft.rfftfreq(1024, 1 / RATE)
    inside = (f > 0.5) & (f < 30)  # differences of samples dull the highest frequencies
    whole = np.linspace(0.05, RATE / 2, 10_000)
    documented = rate_spectrum(f[inside]) / np.trapezoid(rate_spectrum(whole), whole)
    np.testing.assert_allclose(power[inside], documented, rtol=0.25)
    assert abs(np.mean(power[inside] / documented) - 1) < 0.02


def test_the_arm_s_peak_lies_below_5_hz_and_the_hand_s_between_6_and_12():
    f = np.linspace(0.5, 40, 4001)
    S = rate_spectrum(f)
    arm, hand = f[1:-1][(S[1:-1] > S[:-2]) & (S[1:-1] > S[2:])]
    assert 2 < arm < 5
    assert 6 < hand < 12


def test_each_axis_turns_as_fast_as_asked():
    squares = np.mean([np.mean(rates(seed, rms=0.5) ** 2, axis=0) for seed in range(20)], axis=0)
    np.testing.assert_allclose(np.sqrt(squares), 0.5 * np.array(AXES), rtol=0.03)


def test_a_longer_shake_is_no_faster():
    assert np.std(rates(1, duration=5)) == pytest.approx(np.std(rates(1, duration=300)), rel=0.3)


def test_a_seed_gives_one_motion_and_another_seed_another():
    assert np.array_equal(rates(3, duration=1), rates(3, duration=1))
    assert not np.allclose(rates(3, duration=1), rates(4, duration=1))


def test_it_starts_at_rest_position_and_covers_the_duration():
    angles = shake(np.random.default_rng(0), 0.0401, 1000.0)
    assert angles.shape == (42, 3)
    assert not angles[0].any()


@pytest.mark.parametrize(
    ("duration", "rate", "rms", "slip"),
    [
        (0.0, 1000.0, 0.1, "duration"),
        (-1.0, 1000.0, 0.1, "duration"),
        (float("nan"), 1000.0, 0.1, "duration"),
        (40e3, 1000.0, 0.1, "milliseconds"),
        (1.0, 10.0, 0.1, "rate"),
        (3600.0, 100e3, 0.1, "samples"),
        (1.0, 1000.0, -0.1, "rms"),
        (1.0, 1000.0, float("inf"), "rms"),
    ],
)
def test_it_refuses_what_no_hand_does(duration, rate, rms, slip):
    with pytest.raises(ValueError, match=slip):
        shake(np.random.default_rng(0), duration, rate, rms=rms)


def test_the_model_follows_a_recording_within_3_db(shared):
    log = np.loadtxt(shared / "real" / "gyro" / "gyro_train.txt")
    t = (log[:, 0] - log[0, 0]) * 1e-9
    at = np.arange(0, t[-1], 1 / 210)
    recorded = np.stack([np.interp(at, t, w) for w in log[:, 1:].T], axis=1)
    f, power = welch(recorded / recorded.std(axis=0), 210, nperseg=2048, axis=0)
    whole = np.linspace(0.05, 105, 10_000)
    model = rate_spectrum(f) / np.trapezoid(rate_spectrum(whole), whole)
    edges = np.geomspace(0.2, 45, 40)
    bands = [(f >= a) & (f < b) for a, b in itertools.pairwise(edges)]
    decibel = np.array([10 * np.log10(model[band].mean() / power[band].mean()) for band in bands if band.any()])
    assert np.abs(decibel).max() < 3
    assert np.sqrt(np.mean(decibel**2)) < 1.4
