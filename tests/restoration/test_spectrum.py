"""Spectra of a scene whose latent image is known show the path: even, with the true derivative, least at the truth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.simulate import render
from rsvideo.physics.trajectory import Polynomial, Trajectory, centred, fit, path_error
from rsvideo.restoration import spectral_paths as paths_room
from rsvideo.restoration import spectrum as spectrum_room
from rsvideo.restoration.scene import Scene, halved
from rsvideo.restoration.settings import Settings
from rsvideo.restoration.spectral_paths import mirrored, spectral_paths, turns
from rsvideo.restoration.spectrum import LINES, SAMPLES, SIDE, Spectrum, patches
from rsvideo.restoration.verdict import across

ROWS, COLS = 192, 288
TIMING = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=ROWS)
LENS = Intrinsics.centred(focal=400, rows=ROWS, cols=COLS)
CAMERA = Camera(timing=TIMING, intrinsics=LENS)
TIMES = np.linspace(*TIMING.interval, 65)


def fractal(rng: np.random.Generator, rows: int, cols: int) -> np.ndarray:
    """A Gaussian field whose power falls with |w|^-2.2, as photographs' does."""
    down, across_ = np.fft.fftfreq(rows)[:, None], np.fft.rfftfreq(cols)[None]
    amplitude = np.maximum(np.hypot(down, across_), 1 / cols) ** -1.1
    field = np.fft.irfft2(amplitude * np.fft.rfft2(rng.standard_normal((rows, cols))), (rows, cols))
    return np.clip(0.5 + 0.12 * (field - field.mean()) / field.std(), 0, 1)


def taken(path: Trajectory, sigma: float = 0.002) -> Scene:
    """The scene that a moving camera shows."""
    rng = np.random.default_rng(0)
    scene = np.repeat(fractal(rng, ROWS + 120, COLS + 120)[..., None], 3, axis=2)
    shot = render(scene, camera=CAMERA, trajectory=path, noise=Noise.at_half(sigma), rng=rng, samples=48)
    grey = shot.blurred.mean(axis=2)
    return Scene(frame=grey, valid=np.ones_like(grey), camera=CAMERA, samples=24, tiles=3, noise=sigma)


def moved(*coefficients: tuple[float, float, float]) -> Trajectory:
    """A path with these Legendre coefficients from the first degree on: px, px, rad."""
    terms = np.array([(0, 0, 0), *coefficients, *[(0, 0, 0)] * (4 - len(coefficients))], float)
    return centred(Polynomial(t0=TIMING.interval[0], t1=TIMING.interval[1], coefficients=terms), TIMING.middle)


PATH = moved((5, 3, 0.01), (-1, 1.5, 0), (0.4, 0, 0.002))


@pytest.fixture(scope="module")
def scene() -> Scene:
    return taken(PATH)


def spectrum_of(scene: Scene) -> Spectrum:
    observed = patches(scene)
    assert observed is not None
    return Spectrum(scene=scene, patches=observed, curve=PATH)


def test_the_derivative_is_that_of_the_misfit(scene: Scene) -> None:
    spectrum = spectrum_of(scene)
    at = 0.8 * PATH.coefficients[1:]
    slope = spectrum.misfit(at)[1]
    step = np.array([0.02, 0.02, 5e-5])
    for term, axis in [(0, 0), (0, 1), (0, 2), (1, 1), (3, 0)]:
        one, other = at.copy(), at.copy()
        one[term, axis] += step[axis]
        other[term, axis] -= step[axis]
        difference = (spectrum.misfit(one)[0] - spectrum.misfit(other)[0]) / (2 * step[axis])
        assert slope[term, axis] == pytest.approx(difference, rel=0.05, abs=1e-3 / step[axis] * 0.02)


def test_a_path_and_its_mirror_image_are_alike(scene: Scene) -> None:
    spectrum = spectrum_of(scene)
    assert spectrum.value(PATH) == pytest.approx(spectrum.value(mirrored(PATH)), abs=1e-5)


@pytest.mark.parametrize("other", [0.0, 0.75, 1.33, "across"])
def test_the_true_path_explains_the_spectra_best(scene: Scene, other: float | str) -> None:
    wrong = across(PATH) if isinstance(other, str) else PATH.with_coefficients(other * PATH.coefficients)
    spectrum = spectrum_of(scene)
    assert spectrum.value(PATH) < spectrum.value(wrong) - 0.02


@pytest.mark.parametrize("number", ["BELIEF", "FALL", "DIRECTED"])
def test_what_is_believed_of_the_scene_is_read_when_a_misfit_is_asked_for(
    scene: Scene, number: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    spectrum = spectrum_of(scene)
    before = spectrum.value(PATH)
    monkeypatch.setattr(spectrum_room, number, 0.5 * getattr(spectrum_room, number))  # tests/benchmarks/sensitivity.py does so
    assert spectrum.value(PATH) != before


def test_at_half_the_resolution_the_same_path_is_the_best(scene: Scene) -> None:
    spectrum = spectrum_of(halved(scene))
    factors = [0.6, 0.8, 1.0, 1.25, 1.6]
    values = [spectrum.value(PATH.with_coefficients(factor * PATH.coefficients)) for factor in factors]
    assert factors[int(np.argmin(values))] == 1.0


def test_blur_is_dark_where_the_psf_of_a_scanline_is(scene: Scene) -> None:
    """|k|^2 by its definition, for one scanline and frequency, against what the basis and the levers give."""
    spectrum = spectrum_of(scene)
    line, w = 4, np.array([0.7, -0.4])  # rad a px, down and right
    row = spectrum.patches.rows[line // len(LINES)] + LINES[line % len(LINES)]
    times = row * TIMING.row_time + (np.arange(SAMPLES) + 0.5) * TIMING.exposure / SAMPLES
    column = spectrum.patches.columns[line // len(LINES)]
    x, y, roll = PATH.at(times).T
    u, v = (column - LENS.cx) / LENS.fx, (row - LENS.cy) / LENS.fy
    right = (1 + u * u) * x + u * v * y - v * LENS.fx * roll
    down = u * v * x + (1 + v * v) * y + u * LENS.fx * roll
    direct = abs(np.exp(1j * (w[0] * down + w[1] * right)).mean()) ** 2
    q = np.einsum("sp,pa,ja->sj", spectrum.basis[line], PATH.coefficients[1:], spectrum.levers[line])
    assert abs(np.exp(1j * (w[0] * q[:, 1] + w[1] * q[:, 0])).mean()) ** 2 == pytest.approx(direct, abs=1e-9)


@pytest.mark.slow
def test_the_path_is_found_from_nothing_but_for_its_sign(scene: Scene) -> None:
    found = spectral_paths(scene, Settings())
    assert found is not None
    best = found[1][0]
    assert min(path_error(best.at(TIMES), sign * PATH.at(TIMES)) for sign in (1, -1)) < 0.8


@pytest.mark.slow
def test_a_frame_at_rest_shows_a_short_path_or_one_that_explains_no_more() -> None:
    scene = taken(moved((0, 0, 0)))
    found = spectral_paths(scene, Settings())
    assert found is not None
    spectrum = found[0].spectrum
    rest = spectrum.value(PATH.with_coefficients(0 * PATH.coefficients))
    assert all(spectrum.value(path) > rest - 0.02 for path in found[1])


@pytest.mark.parametrize(
    ("shown", "judging"),  # the falls of the misfit, and those beyond softness, at each resolution
    [
        ({0.25: (0.3, 0.2)}, 0.25),
        ({1.0: (0.2, 0.1), 0.5: (0.3, 0.2), 0.25: (0.2, 0.1)}, 0.5),
        ({1.0: (0.3, 0.2)}, 1.0),  # a short blur, which half the resolution hides
        ({1.0: (0.3, 0.01), 0.25: (0.1, 0.05)}, 0.25),  # softness falls most at the frame's own
        ({1.0: (0.3, 0.01)}, None),
        ({1.0: (0.05, 0.04)}, None),
        ({}, None),
        ({0.125: (0.2, 0.1)}, 0.125),
    ],
)
def test_a_large_frame_is_searched_where_its_spectra_show_motion_best(
    shown: dict[float, tuple[float, float]], judging: float | None, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows, cols = 4 * ROWS, 4 * COLS
    camera = Camera(timing=replace(TIMING, rows=rows), intrinsics=Intrinsics.centred(focal=cols, rows=rows, cols=cols))
    grey = fractal(np.random.default_rng(0), rows, cols).astype(np.float32)
    large = replace(scene, frame=grey, valid=np.ones_like(grey), camera=camera)

    def level(at: Scene, _: Settings) -> paths_room._Level:
        found = paths_room.SpectralPath(trajectory=moved((0.1, 0, 0)), misfit=0.0)
        return paths_room._Level(belief=paths_room.SpectralBelief(spectrum=spectrum_of(at)), paths=[found])

    monkeypatch.setattr(Spectrum, "drop", lambda self, _: shown.get(self.scene.scale, (0.0, 0.0))[self.soft])
    monkeypatch.setattr(paths_room, "LARGEST_SIDE", COLS)
    monkeypatch.setattr(paths_room, "_level", level)
    monkeypatch.setattr(paths_room, "_turned", lambda *_: [])
    found = spectral_paths(large, Settings())
    assert found is not None
    assert (found[0].spectrum.scene.scale if found[1] else None) == judging


def test_softness_explains_what_focus_leaves_and_not_what_motion_does(scene: Scene) -> None:
    at_rest = taken(moved((0, 0, 0)))
    soft = replace(at_rest, frame=gaussian_filter(at_rest.frame, 1.2))
    for each, least, most in ((soft, -0.3, 0.3), (scene, 0.7, 1.0)):
        level = paths_room._level(each, Settings())
        assert level is not None
        assert level.blurred
        assert least * level.drop < level.motion < most * level.drop


def test_a_frame_without_texture_or_smaller_than_a_patch_has_no_spectra(scene: Scene) -> None:
    flat = replace(scene, frame=np.full_like(scene.frame, 0.5))
    assert patches(flat) is None
    assert spectral_paths(flat, Settings()) is None
    small = replace(scene, frame=scene.frame[: SIDE - 1], valid=scene.valid[: SIDE - 1])
    assert patches(small) is None


def test_a_path_that_slows_down_may_turn_back_there() -> None:
    s = np.linspace(-1, 1, len(TIMES))
    slowing = fit(moved((0, 0, 0)), TIMES, np.stack([9 * s**3, -4 * s**3, 0 * s], axis=1))
    (turned,) = turns(slowing, TIMES)
    back = np.stack([-9 * abs(s) ** 3, 4 * abs(s) ** 3], axis=1)
    assert path_error(turned.at(TIMES)[:, :2], back) < 0.3


def test_a_motion_that_gathers_speed_turns_nowhere() -> None:
    assert list(turns(moved((7, -3, 0), (0.7, -0.3, 0)), TIMES)) == []
