"""Exposures that frames show by how their blur differs from each other."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.stats import norm

from rsvideo.frame import Frame
from rsvideo.restoration import exposure, relative_exposure
from rsvideo.restoration.clip_motion import beside, gather, path_from_tracks
from rsvideo.restoration.relative_blur import CARRIED, CARRIED_SPREAD, INDEPENDENT
from rsvideo.restoration.relative_exposure import APART, STEP, Pairs, compared
from rsvideo.restoration.settings import Settings
from tests.pipeline.moving import RATE, Moving

MOVING = Moving(frames=8, rows=128, cols=192)
PERIOD = 1 / RATE


def pairs_of(moving: Moving, frames: list[Frame]) -> Pairs:
    run = gather(frames, moving.camera.exposed(0.25 * PERIOD), Settings())
    path = path_from_tracks(run)
    return compared(run, path, lambda: beside(run, path), range(len(frames)), (PERIOD / 64, PERIOD))


def shown(pairs: Pairs) -> tuple[float, float]:
    """The likeliest exposure, s, that does not change, and how much likelier it is than the least likely one."""
    likelihood = pairs.likelihood(pairs.exposures, np.zeros(1))[:, 0]
    return float(pairs.exposures[np.argmax(likelihood)]), float(np.ptp(likelihood))


@pytest.mark.parametrize(("reach", "soft"), [(16.0, 0.0), (16.0, 1.2), (5.0, 1.2)])
def test_softness_lengthens_no_exposure_that_differing_blur_shows(reach: float, soft: float) -> None:
    moving = replace(MOVING, reach=reach)
    frames = [replace(frame, pixels=gaussian_filter(frame.pixels, (soft, soft, 0))) for frame in moving.recorded]
    assert shown(pairs_of(moving, frames))[0] == pytest.approx(moving.exposure, rel=0.12)


def test_frames_that_are_blurred_alike_show_nothing() -> None:
    """Of a clip of one picture, moved by whole pixels: whatever of that an exposure covers, up to half of the time between frames."""
    large = Moving(frames=1, rows=160, cols=260).recorded[0]
    seen = [np.s_[:128, 6 * k : 6 * k + 192] for k in range(8)]
    panned = [replace(large, pixels=large.pixels[at], clipped=large.clipped[at], index=k, time=k / RATE) for k, at in enumerate(seen)]
    pairs = pairs_of(MOVING, panned)
    up_to_half = pairs.exposures[pairs.exposures < PERIOD / 2]
    assert np.ptp(pairs.likelihood(up_to_half, np.zeros(1))) < 0.2
    assert shown(pairs_of(MOVING, MOVING.recorded))[1] > 10


def test_the_likelihood_is_that_of_each_frame_s_own_exposure() -> None:
    """Against the sum over pairs, for misfits that are quadratic in the mean of both logarithms, and rise evenly as these part."""
    tried, times, seen = np.geomspace(1e-3, 3e-2, 40), np.array([[-0.1, 0.0], [0.0, 0.13]]), np.log(0.008)
    apart = np.log(tried[1] / tried[0]) * np.array(APART)  # of the first frame; the second's is the opposite

    def misfit(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        return ((first + second) / 2 - seen) ** 2 + 2 * np.abs(first - second)

    x = np.log(tried)[:, None]
    pairs = Pairs(exposures=tried, times=times, misfits=np.array([misfit(x + apart, x - apart)] * 2))
    wanted, changes = np.geomspace(5e-3, 2e-2, 7), np.array([-0.8, 0.0, 1.6])
    first, second = (np.log(wanted)[:, None, None] + changes[:, None] * at for at in times.T)
    expected = -INDEPENDENT * misfit(first, second).sum(axis=-1)
    np.testing.assert_allclose(pairs.likelihood(wanted, changes), expected, atol=1e-9)


@pytest.mark.parametrize("bits", [15.0, 50.0, 400.0])
def test_compressed_frames_show_exposures_as_much_shorter_as_codecs_leave_them(bits: float) -> None:
    """Against the mean over a thousand of what is likely, for misfits that are quadratic in the mean of both logarithms."""
    tried, seen = np.geomspace(1e-3, 3e-2, 40), np.log(0.006)
    width = 0.1 * np.sqrt(2 * INDEPENDENT)  # of a likelihood whose standard deviation is 0.1
    misfits = np.repeat(((np.log(tried) - seen) / width)[:, None] ** 2, len(APART), axis=1)
    pairs = Pairs(exposures=tried, times=np.zeros((1, 2)), misfits=misfits[None], bits=bits)
    wanted = np.geomspace(4e-3, 1.2e-2, 9)
    shorter = np.exp(-bits / CARRIED + CARRIED_SPREAD * norm.ppf((np.arange(1000) + 0.5) / 1000))
    each = np.exp(-0.5 * ((np.log(wanted)[:, None] - shorter - seen) / 0.1) ** 2)
    found = np.exp(pairs.likelihood(wanted, np.zeros(1))[:, 0])
    np.testing.assert_allclose(found, each.mean(axis=1), atol=0.02)


def test_a_clip_s_bits_reach_the_likelihood_of_its_exposures() -> None:
    run = replace(gather(MOVING.recorded[:3], MOVING.camera, Settings()), bits=30.0)
    assert compared(run, path_from_tracks(run), lambda: [None] * 3, [0], (PERIOD / 64, PERIOD)).bits == 30.0


def test_exposures_that_are_tried_are_as_far_apart_as_pairs_are() -> None:
    pairs = pairs_of(MOVING, MOVING.recorded[:3])
    np.testing.assert_allclose(np.diff(np.log(pairs.exposures)), np.log(STEP), rtol=0.02)
    assert pairs.misfits.shape == (3, len(pairs.exposures), 5)


def test_a_pair_is_compared_once(monkeypatch: pytest.MonkeyPatch) -> None:
    run = gather(MOVING.recorded, MOVING.camera, Settings())
    path, asked = path_from_tracks(run), []
    whole = relative_exposure.ratios
    monkeypatch.setattr(relative_exposure, "ratios", lambda *given: asked.extend(given[-1]) or whole(*given))
    first = compared(run, path, lambda: [None] * 8, [0, 1], (PERIOD / 64, PERIOD))
    again = compared(run.exposed(np.full(8, 0.01)), path, lambda: [None] * 8, [0, 1, 2], (PERIOD / 64, PERIOD))
    assert len(asked) == len(set(asked)) == len(again.times) > len(first.times)
    assert all(set(pair) & {0, 1, 2} for pair in asked)


def test_frames_smaller_than_a_patch_show_nothing() -> None:
    small = Moving(frames=4, rows=48, cols=192)
    pairs = pairs_of(small, small.recorded)
    assert pairs.misfits.shape == (0, len(pairs.exposures), 5)
    assert not pairs.likelihood(np.array([0.01]), np.zeros(2)).any()


@pytest.mark.parametrize(("at", "taken"), [(10, 10), (2, 18)])
def test_what_differs_is_believed_unless_spectra_and_focus_contradict_it(at: int, taken: int) -> None:
    """Of frames whose spectra show the tenth exposure, vaguely, and the eighteenth, plainly."""
    numbers = np.arange(20.0)
    apart = -5.0 * (numbers[:, None] - at) ** 2 + 0 * exposure.CHANGES
    misfits = np.array([np.minimum(0.02 * (numbers - taken) ** 2, 1.0)] * 8)
    tried = exposure._Tried(
        exposures=exposure.RATIO**numbers,
        frames=[*range(8)],
        times=np.zeros(8),
        speeds=np.full(8, np.inf),
        misfits=misfits,
        relative=exposure._relative(apart),
    )
    assert exposure._mean(tried, exposure._without_softness(tried).sum(axis=1))[0] == pytest.approx(exposure.RATIO**taken, rel=0.05)
