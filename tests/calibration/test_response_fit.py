"""Tone, clipping and noise found again from the exposures that they made."""

import numpy as np
import pytest

from calibration.radiometry.exposure_series import Photograph, exact_times
from calibration.radiometry.response_fit import measure
from rsvideo.physics import tone
from rsvideo.physics.tone import Transfer

TIMES = (1 / 1000, 1 / 500, 1 / 250, 1 / 125, 1 / 60, 1 / 30, 1 / 15, 1 / 8)
READ, SHOT = 0.003, 2e-4


def own(light: np.ndarray) -> np.ndarray:
    """A curve with a shoulder that is in no standard."""
    return light**0.45 * (1 + 0.35 * (1 - light**0.45) * light**0.45 * np.sin(3 * light**0.45))


def series(curve, *, times=TIMES, seed: int = 0, top: int = 255, full: float = 1.0) -> list[Photograph]:
    """A wall of grey patches at several exposures, with noise, clipped at `full`."""
    rng = np.random.default_rng(seed)
    radiance = np.kron(3 * np.exp(rng.uniform(-3, 4.5, (15, 20))), np.ones((16, 16)))
    photographs = []
    for time in times:
        light = radiance * time
        light = np.clip(light + rng.normal(0, 1, light.shape) * np.sqrt(READ**2 + SHOT * light), 0, full)
        codes = np.rint(top * np.clip(curve(light.astype(np.float32)), 0, 1)).astype(np.uint8 if top == 255 else np.uint16)
        photographs.append(Photograph(name=f"{time:g}", samples=codes[..., None], exposure=time, linear=curve is linear))
    return photographs


def linear(light: np.ndarray) -> np.ndarray:
    return light


@pytest.mark.parametrize("transfer", [Transfer.SRGB, Transfer.BT709, Transfer.GAMMA22, Transfer.HLG, Transfer.SLOG3, Transfer.CLOG])
def test_a_standards_curve_is_recognised_by_name(transfer: Transfer) -> None:
    found = measure(series(lambda light: tone.encode(transfer, light)))
    assert found.transfer is transfer
    assert found.std < 0.03


def test_a_curve_of_its_own_is_found_by_debevec_and_malik() -> None:
    found = measure(series(own))
    assert found.transfer is None
    assert "no standard's curve fits" in found.notes[0]
    light = np.linspace(0, 1, 4001)
    codes = np.linspace(0, 1, len(found.curve))[10:62]  # below, the curve is guided by smoothness alone
    truth = np.interp(codes, own(light), light)
    assert np.abs(np.log(found.curve[10:62] / truth)).max() < 0.03


@pytest.mark.parametrize("pairs", [False, True])
def test_the_noise_is_found_from_flat_patches_and_from_pairs(pairs: bool) -> None:
    times = tuple(time for time in TIMES for _ in range(1 + pairs))
    found = measure(series(lambda light: tone.encode(Transfer.SRGB, light), times=times)).noise
    assert found is not None
    assert ("pairs" in found.how) == pairs
    assert found.read == pytest.approx(READ, rel=0.1)
    assert found.shot == pytest.approx(SHOT, rel=0.1)


def test_raw_is_found_linear_with_its_noise() -> None:
    found = measure(series(linear, top=65535))
    assert (found.transfer, found.notes) == (Transfer.LINEAR, ())
    assert found.noise is not None
    assert found.noise.read == pytest.approx(READ, rel=0.1)


def test_where_highlights_are_lost_is_the_plateaus_code() -> None:
    clipped = measure(series(lambda light: tone.encode(Transfer.SRGB, light), full=0.8)).clip
    assert clipped == pytest.approx(float(tone.encode(Transfer.SRGB, np.array([0.8], np.float32))[0]), abs=2 / 255)
    dark = measure(series(lambda light: tone.encode(Transfer.SRGB, light), times=(1 / 4000, 1 / 2000, 1 / 1000)))
    assert dark.clip is None
    assert "no picture is clipped" in dark.notes[-1]


def test_times_as_cameras_display_them_are_whole_thirds_of_a_stop() -> None:
    assert exact_times((1 / 60, 1 / 30, 1 / 15)) == pytest.approx((1 / 64, 1 / 32, 1 / 16))
    assert exact_times((1 / 61, 1 / 30)) == (1 / 61, 1 / 30)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda series: series[:1], "one scene at two exposures or more"),
        (
            lambda series: [series[0], Photograph(name="b", samples=series[1].samples[:-1], exposure=1)],
            "must be of one size, depth and kind, b is not",
        ),
        (
            lambda series: [series[0], Photograph(name="b", samples=series[1].samples, exposure=0)],
            "the exposure of b must lie in 1 us to an hour",
        ),
        (
            lambda series: [series[0], Photograph(name="b", samples=0 * series[1].samples, exposure=1)],
            "same places well exposed at two exposures",
        ),
    ],
)
def test_what_is_no_series_is_refused(change, line: str) -> None:
    with pytest.raises(ValueError, match=line):
        measure(change(series(lambda light: tone.encode(Transfer.SRGB, light))))


def test_tiny_pictures_are_refused_not_crashed_on() -> None:
    for side in (1, 7, 9):
        photographs = [Photograph(name=str(t), samples=np.full((side, side, 3), 100, np.uint8), exposure=t) for t in (0.01, 0.02)]
        with pytest.raises(ValueError, match="same places"):
            measure(photographs)
