"""Bands of a flickering light: what they say of the readout, and when they say nothing."""

import re
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float

from calibration import flicker
from calibration.timing.bands import Bands, combined, measure, row_profile
from calibration.timing.cannot_tell import CannotTellError
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.stills import still

ROWS, COLS, FPS = 240, 48, 29.97
SINE = flicker.sine(0.2)


def scene(contrast: float) -> Float[np.ndarray, "rows cols channels"]:
    """Clouds with a spectrum that falls as 1/f, of mean 0.3; `contrast` is the relative deviation of its rows."""
    f = np.hypot(*np.meshgrid(np.fft.fftfreq(COLS), np.fft.fftfreq(ROWS)))
    f[0, 0] = np.inf
    clouds = np.fft.ifft2(np.fft.fft2(np.random.default_rng(5).standard_normal((ROWS, COLS))) / f).real
    return 0.3 * np.exp(clouds * contrast / max(float(clouds.mean(axis=1).std()), 1e-9))[..., None]


def film(
    *,
    readout: float = 0.02,
    hertz: float = 1000.0,
    exposure: float = 0.0002,
    frames: int = 16,
    fps: float = FPS,
    waves: Float[np.ndarray, " terms"] = SINE,
    contrast: float = 0.2,
    direction: Direction = Direction.TOP_TO_BOTTOM,
    drift: float = 0.005,  # cycles a frame
    noise: float = 0.003,
) -> tuple[list[np.ndarray], list[float]]:
    """Profiles and times of a clip under a flickering light."""
    timing = ShutterTiming.from_readout(exposure=exposure, readout=readout, rows=ROWS, direction=direction)
    rng, times = np.random.default_rng(1), [k / fps for k in range(frames)]
    lights = [flicker.lit(scene(contrast), timing, flicker.gains(timing, t, waves, hertz=hertz, cycles=drift * fps * t)) for t in times]
    return [row_profile(light + noise * rng.standard_normal(light.shape)) for light in lights], times


def found(profiles: list[np.ndarray], times: list[float], hertz: float = 1000.0, *, longest: float = 1 / FPS) -> Bands:
    """What is measured."""
    return measure(profiles, times, hertz, longest=longest)


def test_the_simulated_light_is_the_integral_over_each_exposure() -> None:
    timing = ShutterTiming(exposure=0.0013, row_time=2e-5, rows=7)
    waves = flicker.square(0.3, terms=9)
    fine = timing.row_start()[:, None] + np.linspace(0, timing.exposure, 20001)[None] + 0.25
    h = np.arange(1, 10)
    written_out = np.array([np.mean(1 + np.cos(2 * np.pi * np.outer(700 * row + 0.1, h)) @ waves) for row in fine])
    np.testing.assert_allclose(flicker.gains(timing, 0.25, waves, hertz=700, cycles=0.1), written_out, atol=3e-4)


@pytest.mark.parametrize(
    ("readout", "hertz", "exposure"), [(0.006, 400.0, 0.0002), (0.02, 1000.0, 0.0005), (0.031, 140.0, 0.003), (0.03, 2000.0, 0.0001)]
)
def test_wandering_bands_give_the_readout_whatever_the_scene(readout: float, hertz: float, exposure: float) -> None:
    bands = found(*film(readout=readout, hertz=hertz, exposure=exposure, contrast=1.0), hertz)
    assert bands.readout == pytest.approx(readout, rel=0.002)
    assert abs(bands.readout - readout) < 2 * bands.std
    assert bands.row_time == pytest.approx(bands.readout / ROWS)
    assert bands.period == pytest.approx(1 / (hertz * bands.row_time))


@pytest.mark.parametrize("direction", [Direction.TOP_TO_BOTTOM, Direction.BOTTOM_TO_TOP])
@pytest.mark.parametrize("frames", [2, 3, 16])
def test_the_way_in_which_bands_wander_tells_the_direction(direction: Direction, frames: int) -> None:
    assert found(*film(direction=direction, frames=frames)).direction is direction


@pytest.mark.slow
def test_bands_with_edges_are_counted_by_their_fundamental() -> None:
    for duty in (0.2, 0.5, 0.8):
        bands = found(*film(waves=0.5 * flicker.square(duty)))
        assert bands.readout == pytest.approx(0.02, rel=0.001)


def test_a_weak_fundamental_is_found_below_its_strong_harmonic() -> None:
    for frames in (1, 16):
        bands = found(*film(readout=0.01, waves=np.array([0.05, 0.3]), frames=frames, contrast=0.02, noise=0.001))
        assert bands.readout == pytest.approx(0.01, rel=0.005)


def test_a_photograph_of_a_wall_is_enough_and_its_std_is_honest() -> None:
    bands = measure(*film(frames=1, contrast=0.05), 1000.0)
    assert bands.notes == ("a readout of more than 108 ms was not thought of",)
    assert not measure(*film(frames=1, contrast=0.05), 300.0).notes  # up to 360 ms, which hardly any camera exceeds
    assert abs(bands.readout - 0.02) < 3 * bands.std < 0.02 * 0.02
    assert bands.direction is None


def test_bands_that_stand_still_are_told_from_the_scene_by_all_columns_sharing_them() -> None:
    assert found(*film(fps=25.0, drift=0.0, contrast=0.05)).readout == pytest.approx(0.02, rel=0.005)


def test_a_scene_without_bands_gives_no_answer() -> None:
    for frames in (1, 16):
        with pytest.raises(CannotTellError):
            found(*film(waves=flicker.sine(0.0), frames=frames, contrast=1.0))


def test_an_exposure_of_a_whole_period_leaves_no_bands_and_gives_no_answer() -> None:
    with pytest.raises(CannotTellError, match="exposure not a multiple of its period"):
        found(*film(exposure=0.001))


@pytest.mark.parametrize("slip", [0.9, 1.25, 0.5])
def test_a_light_of_another_frequency_than_was_said_is_noticed(slip: float) -> None:
    with pytest.raises(CannotTellError, match=r"frequency right|readout longer"):
        found(*film(), 1000.0 * slip)


@pytest.mark.slow
@pytest.mark.parametrize(("hertz", "said", "fps"), [(120.0, 100.0, 25.0), (634.0, 1268.0, 50.0), (1000.0, 1001.0, FPS)])
def test_a_light_that_is_said_almost_right_is_noticed_by_how_its_bands_wander(hertz: float, said: float, fps: float) -> None:
    clip = film(hertz=hertz, exposure=0.0003, readout=0.018, fps=fps, contrast=0.05)
    assert found(*clip, hertz, longest=1 / fps).readout == pytest.approx(0.018, rel=0.005)
    with pytest.raises(CannotTellError, match=r"of their period a frame otherwise|wander otherwise"):
        found(*clip, said, longest=1 / fps)


def test_a_readout_upwards_is_doubted_aloud() -> None:
    """A light of 120 Hz at 25 frames a second wanders as one of 180 Hz would under a readout the other way."""
    bands = found(*film(hertz=120.0, exposure=0.0003, fps=25.0, readout=0.03), 180.0, longest=1 / 25)
    assert bands.direction is Direction.BOTTOM_TO_TOP
    assert any("170 Hz, or of 25 Hz more or less" in note for note in bands.notes)
    assert not any("few cameras" in note for note in found(*film()).notes)


def test_mains_flicker_twice_a_cycle_and_what_else_it_may_be_is_told() -> None:
    bands = found(*film(hertz=100.0, exposure=0.002, readout=0.03, fps=24.0), 50.0, longest=1 / 24)
    assert bands.light == 100.0
    assert bands.readout == pytest.approx(0.03, rel=0.005)
    assert "mains of 50 Hz" in bands.notes[0]
    still_bands = found(*film(hertz=120.0, exposure=0.002, readout=0.03, fps=30.0, drift=0.0, contrast=0.01), 120.0, longest=1 / 15)
    assert re.search(r"60.\d+ ms if it flickers at 60 Hz and 15.\d+ ms if it flickers at 240 Hz", still_bands.notes[0])


def test_less_than_two_bands_that_stand_still_give_no_answer() -> None:
    with pytest.raises(CannotTellError):
        found(*film(hertz=100.0, readout=0.015, fps=25.0, drift=0.0), 100.0)


def test_too_few_rows_for_a_fast_light_are_refused() -> None:
    with pytest.raises(CannotTellError, match="240 rows are too few for a light of 20000 Hz"):
        found(*film(), 20000.0)


@pytest.mark.slow
def test_photographs_together_say_more_than_one_and_must_agree() -> None:
    each = [measure([one], [0.0], 1000.0) for one in film(contrast=0.05, frames=5)[0]]
    both = combined(each)
    assert abs(both.readout - 0.02) < 2 * both.std <= 2 * max(one.std for one in each)
    assert both.frames == 5
    other = measure(*film(contrast=0.05, frames=1, readout=0.022), 1000.0)
    with pytest.raises(CannotTellError, match="are all of one mode"):
        combined([*each, other])


def test_a_black_clip_is_refused() -> None:
    with pytest.raises(CannotTellError, match="is the light on"):
        measure([np.zeros((4, 240))], [0.0], 1000.0)


def test_every_frame_needs_its_time() -> None:
    with pytest.raises(ValueError, match="1 frames and 2 times"):
        measure([np.ones((4, 240))], [0.0, 0.1], 1000.0)


def test_the_published_readout_of_a_real_camera_is_met_within_what_is_stated(shared: Path) -> None:
    frame = still.read(shared / "real" / "flicker" / "nikon1j1_1080p30_1000Hz.png")
    bands = found([row_profile(frame.pixels)], [0.0])
    assert bands.readout == pytest.approx(0.015730, rel=0.0015)
    assert abs(bands.readout - 0.015730) < 2 * bands.std < 0.002 * bands.readout
