"""With a known path the sharp image comes back, whatever clips, and tiles leave no seam."""

from typing import Literal

import numpy as np
import pytest
import skimage.data
from scipy.ndimage import binary_dilation

from rsvideo.physics import simulate, tiles
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.row_fourier import extent
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, centred, fit, still
from rsvideo.restoration import nonblind, settings
from rsvideo.restoration.nonblind import OVERLAP, TiledFrame, TileSystem, deblur, finished, tile_system, tiled, total_variation
from rsvideo.restoration.parallax import Flow, displacement
from rsvideo.restoration.settings import Settings

ROWS, COLS = 96, 192
TIMING = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=ROWS)
CAMERA = Camera(timing=TIMING, intrinsics=Intrinsics.centred(focal=300.0, rows=ROWS, cols=COLS))
SHIFT = np.array([[0.0, 0.0], [4.0, -2.0], [1.0, 1.5], [-0.4, 0.3]])
TURN = np.hstack([SHIFT, [[0.0], [0.02], [-0.006], [0.0]]])


def path(coefficients):
    return centred(Polynomial(t0=0.0, t1=TIMING.interval[1], coefficients=coefficients), TIMING.middle)


def photograph():
    return (skimage.data.astronaut()[20:180, 60:310] / 255) ** 2.2


def taken(coefficients, *, sigma=0.0, scene=None, gain=1.0):
    return simulate.render(
        photograph() if scene is None else scene,
        camera=CAMERA,
        trajectory=path(coefficients),
        noise=Noise.at_half(sigma),
        rng=np.random.default_rng(0),
        samples=32,
        gain=gain,
    )


def restored(frame, coefficients, *, clipped=None, prior: Literal["tv", "denoiser"] = "denoiser", noise=1e-3, mu=7e-4):
    clipped = np.zeros(frame.shape, bool) if clipped is None else clipped
    *_, last = deblur(
        tiled(frame, clipped, path(coefficients), CAMERA, samples=24, tolerance=0.25),
        Settings(prior=prior, mu_final=mu),
        noise,
    )
    return last


def psnr(image, truth):
    """On the codes of a screen, without the border of 12 px that no path has seen whole."""
    one, other = (np.clip(a[12:-12, 12:-12], 0, 1) ** (1 / 2.2) for a in (image, truth))
    return float(-10 * np.log10(np.mean((one - other) ** 2)))


@pytest.mark.parametrize(("prior", "least"), [("tv", 40.0), ("denoiser", 40.0)])
def test_a_camera_at_rest_gives_the_frame_back(prior, least):
    frame = taken(0 * SHIFT).blurred
    assert psnr(restored(frame, 0 * SHIFT, prior=prior, mu=1e-4), frame) > least


@pytest.mark.parametrize("coefficients", [SHIFT, TURN], ids=["shift", "rotation"])
def test_a_known_motion_is_undone(coefficients):
    case = taken(coefficients, sigma=0.002)
    image = restored(case.blurred, coefficients, noise=0.002)
    assert psnr(image, case.truth) > psnr(case.blurred, case.truth) + 8


def test_points_that_all_move_alike_blur_as_a_camera_does_that_moves_back():
    velocity = np.array([150.0, -80.0])  # px/s
    frame = taken(SHIFT).blurred
    alike = Flow(points=np.zeros((1, 2)), weights=velocity[None], length=1e9)
    rest, clipped, t = still(TIMING.interval, degree=1, axes=2), np.zeros(frame.shape, bool), np.linspace(*TIMING.interval, 9)
    moved = fit(rest, t, -(t[:, None] - TIMING.middle) * velocity)
    by_points = tiled(frame, clipped, rest, CAMERA, samples=24, tolerance=0.25, flow=alike)
    by_camera = tiled(frame, clipped, moved, CAMERA, samples=24, tolerance=0.25)
    grey = np.ascontiguousarray(frame.mean(axis=2))
    np.testing.assert_allclose(by_points.blurred(grey), by_camera.blurred(grey), atol=2e-3)
    assert np.abs(by_camera.blurred(grey) - grey).max() > 0.05


def test_another_path_than_the_true_one_restores_less():
    case = taken(SHIFT, sigma=0.002)
    back = SHIFT * np.array([1, -1, 1, -1])[:, None]
    assert psnr(restored(case.blurred, SHIFT, noise=0.002), case.truth) > psnr(restored(case.blurred, back, noise=0.002), case.truth) + 5


def test_the_denoiser_restores_more_of_a_noisy_frame_than_total_variation():
    case = taken(SHIFT, sigma=0.01)
    smooth = max(psnr(restored(case.blurred, SHIFT, prior="tv", mu=mu), case.truth) for mu in (7e-4, 2e-3, 5e-3))
    assert psnr(restored(case.blurred, SHIFT, noise=0.01), case.truth) > smooth + 0.5


@pytest.mark.parametrize("prior", ["tv", "denoiser"])
def test_clipped_lamps_do_not_ring(prior):
    scene = 0.2 * photograph()
    for x in range(60, 190, 30):
        scene[75:81, x : x + 3] = 3.0  # lamps brighter than white
    case = taken(SHIFT, scene=scene, sigma=0.001)
    clipped = case.blurred >= 1
    lit = clipped.any(axis=2) | (case.truth > 0.5).any(axis=2)  # there the lamps hide what was behind them
    lit = binary_dilation(lit, iterations=3)
    around = np.logical_and(binary_dilation(lit, iterations=12), np.logical_not(lit))
    errors = [
        float(np.sqrt(np.mean((restored(case.blurred, SHIFT, clipped=known, prior=prior) - case.truth)[around] ** 2)))
        for known in (clipped, np.zeros_like(clipped))
    ]
    assert errors[0] < 0.65 * errors[1]


def test_total_variation_reaches_the_least_of_its_energy():
    """Any step away from the answer costs."""
    frame = taken(SHIFT).blurred[:40, :60, 0]
    camera = Camera(
        timing=ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=40),
        intrinsics=Intrinsics.centred(focal=300.0, rows=40, cols=60),
    )
    tile = tiles.split(60, 1, 0)[0]
    system = tile_system(tiles.displacement(tile, path(SHIFT), camera, 16), frame, np.ones_like(frame))
    op, mu = system.op, 2e-3

    def cost(latent):
        b = op.image(op.forward(op.spectrum(latent.astype(np.float32))))[:, op.left : op.left + 60]
        variation = np.abs(np.roll(latent, -1, 1) - latent).sum() + np.abs(np.diff(latent, axis=0)).sum()
        return 0.5 * float(np.sum((b - frame) ** 2)) + mu * float(variation)

    found = total_variation(system, mu, steps=400)
    rng = np.random.default_rng(0)
    for scale in (0.001, 0.01):
        assert cost(found) < cost(found + scale * rng.standard_normal(found.shape))
    assert cost(found) < cost(total_variation(system, mu, steps=10))
    assert cost(found) < cost(total_variation(system, 2 * mu, steps=400))
    assert cost(found) < cost(total_variation(system, mu / 2, steps=400))


def test_what_no_scanline_saw_and_what_clipped_is_completed_from_the_model():
    frame = taken(SHIFT).blurred[..., 0]
    valid = np.ones_like(frame)
    valid[30:40, 50:60] = 0
    tile = tiles.split(COLS, 1, 0)[0]
    system = tile_system(tiles.displacement(tile, path(SHIFT), CAMERA, 16), frame, valid)
    bright = np.full((ROWS, system.op.period), 2.0, np.float32)
    dark = np.zeros_like(bright)
    own = slice(system.op.left, system.op.left + COLS)
    for model, expected in ((bright, 2.0), (dark, frame[30:40, 50:60])):  # a clipped pixel is at least as bright as it reads
        out = system.complete(model)
        np.testing.assert_array_equal(out[:, own][30:40, 50:60], np.broadcast_to(expected, (10, 10)))
        np.testing.assert_array_equal(out[:, own][valid > 0], frame[valid > 0])
        np.testing.assert_array_equal(np.delete(out, np.r_[own], axis=1), np.delete(model, np.r_[own], axis=1))


def in_tiles(cut, systems) -> TiledFrame:
    blank = np.zeros((ROWS, COLS, 1), np.float32)
    return TiledFrame(pixels=blank, unclipped=blank[..., 0], cut=cut, grids=[system.op for system in systems], systems=systems)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_tiles_of_one_image_blend_into_it(count):
    whole = np.random.default_rng(0).random((ROWS, COLS)).astype(np.float32)
    cut = tiles.split(COLS, count, OVERLAP)
    systems, latents = [], []
    for tile in cut:
        part = whole[None, :, tile.first : tile.last]
        system: TileSystem = tile_system(np.zeros((ROWS, 1, 2)), part, np.ones_like(part))
        latent = np.full((1, system.op.latent_rows, system.op.period), 9.0, np.float32)
        system.crop(latent)[:] = part
        systems.append(system)
        latents.append(latent)
    np.testing.assert_allclose(in_tiles(cut, systems).blended(latents)[..., 0], whole, atol=1e-6)


def test_no_seam_shows_between_tiles():
    """Each tile's weight falls to its outermost column: next to it the neighbour holds the image."""
    cut = tiles.split(COLS, 2, OVERLAP)
    systems = []
    for tile in cut:
        part = np.zeros((1, ROWS, tile.last - tile.first), np.float32)
        systems.append(tile_system(np.zeros((ROWS, 1, 2)), part, np.ones_like(part)))
    ones = [np.full((1, s.op.latent_rows, s.op.period), float(i), np.float32) for i, s in enumerate(systems)]
    ramp = in_tiles(cut, systems).blended(ones)[0, :, 0]
    assert ramp[0] == 0
    assert ramp[-1] == 1
    assert np.diff(ramp).min() >= 0
    assert np.diff(ramp).max() < 1.5 / (2 * OVERLAP)


def test_what_no_latent_image_explains_is_counted_where_it_was_observed() -> None:
    """A frame that its latent image explains but for noise of a known power, also under clipped pixels, which do not count."""
    rng = np.random.default_rng(0)
    frame = np.full((ROWS, COLS, 1), 0.5, np.float32)
    noisy = frame + rng.normal(0, 0.03, frame.shape).astype(np.float32)
    clipped = np.zeros(frame.shape, bool)
    clipped[40:50] = True
    noisy[40:50] = 1.0
    cut = tiled(noisy, clipped, path(SHIFT), CAMERA, samples=24, tolerance=0.25)
    flat = [np.full((1, s.op.latent_rows, s.op.period), 0.5, np.float32) for s in cut.systems]
    assert cut.unexplained(flat) == pytest.approx(0.03**2, rel=0.05)


def test_a_frame_in_tiles_that_memory_does_not_hold_together_is_the_same(monkeypatch) -> None:
    case = taken(SHIFT, sigma=0.002)
    clipped = np.zeros(case.blurred.shape, bool)
    monkeypatch.setattr(nonblind, "LARGEST", 0.6 * extent(np.zeros((ROWS, 1, 2)), COLS).system_bytes)
    monkeypatch.setattr(nonblind, "KEPT", 0)
    cut = tiled(case.blurred, clipped, path(SHIFT), CAMERA, samples=24, tolerance=0.25)
    assert len(cut.cut) > 1
    assert isinstance(cut.systems, nonblind.MadeAnew)
    monkeypatch.setattr(nonblind, "KEPT", 1e9)
    whole = nonblind.tiled_from(cut.cut, lambda tile: (displacement(tile, path(SHIFT), None, CAMERA, 24), None), case.blurred, clipped)
    assert isinstance(whole.systems, list)
    for one, other in zip(deblur(cut, Settings(), 2e-3), deblur(whole, Settings(), 2e-3), strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(cut.towards(case.truth, 0.6), whole.towards(case.truth, 0.6))


def test_a_draft_is_what_the_denoiser_starts_from_but_for_a_few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    case = taken(SHIFT, sigma=0.002)
    clipped = np.zeros(case.blurred.shape, bool)
    cut = tiled(case.blurred, clipped, path(SHIFT), CAMERA, samples=24, tolerance=0.25)
    draft, normal = list(deblur(cut, Settings(quality="draft"), 2e-3)), list(deblur(cut, Settings(), 2e-3))
    assert len(draft) == 1
    assert len(normal) > 4
    apart, gained = (float(np.sqrt(np.mean((each - draft[0]) ** 2))) for each in (normal[0], normal[-1]))
    assert 0 < apart < gained / 4
    monkeypatch.setattr(settings, "TV_FIRST_STEPS", settings.EFFORTS["draft"].tv_steps)
    np.testing.assert_array_equal(draft[0], next(deblur(cut, Settings(), 2e-3)))


def test_a_latent_image_that_is_known_well_loses_its_noise_and_keeps_what_the_frame_shows() -> None:
    case, noise = taken(SHIFT, sigma=0.004), 4e-3
    clipped = np.zeros(case.blurred.shape, bool)
    cut = tiled(case.blurred, clipped, path(SHIFT), CAMERA, samples=24, tolerance=0.25)
    rng = np.random.default_rng(1)
    known = (case.truth + noise * rng.standard_normal(case.truth.shape)).astype(np.float32)
    assert psnr(finished(cut, known, noise), case.truth) > psnr(known, case.truth) + 0.5
    pale = (0.9 * case.truth).astype(np.float32)
    assert psnr(finished(cut, pale, noise), case.truth) > psnr(pale, case.truth) + 2  # as bright as the frame again


def test_blocks_that_compression_leaves_ring_less_than_noise_alone_would_let_them() -> None:
    """8 x 8 blocks at which detail is left out, deblurred with a noise that does not know of them."""
    case = taken(SHIFT, sigma=0.001)
    blocks = case.blurred[: ROWS // 8 * 8, : COLS // 8 * 8].reshape(ROWS // 8, 8, COLS // 8, 8, 3)
    means = blocks.mean(axis=(1, 3), keepdims=True)
    coarse = (means + np.round((blocks - means) * 20) / 20).reshape(case.blurred.shape).astype(np.float32)
    assert psnr(restored(coarse, SHIFT, noise=1e-3), case.truth) > psnr(coarse, case.truth)


@pytest.mark.parametrize("least", [1, 3])
def test_what_is_observed_of_a_latent_image_is_the_adjoint_of_what_is_data(monkeypatch, least) -> None:
    tiles_for = nonblind.cut_for
    monkeypatch.setattr(nonblind, "cut_for", lambda *words, **named: tiles_for(*words, **{**named, "least": least}))
    rng = np.random.default_rng(0)
    pixels, clipped = taken(SHIFT).blurred, np.zeros((ROWS, COLS, 3), bool)
    clipped[30:50, 60:100, 1] = True
    frame = tiled(pixels, clipped, path(SHIFT), CAMERA, samples=24, tolerance=0.25)
    covered, latent = frame.covered(), np.zeros((ROWS, COLS), np.float32)
    latent[16:-16, 16:-16] = rng.random((ROWS - 32, COLS - 32))
    light = float((frame.blurred(latent) * ~clipped.any(axis=2)).sum())
    assert light == pytest.approx(float((latent * covered).sum()), rel=1e-5 if least == 1 else 2e-3)
    assert covered[75:85, 30:-30] == pytest.approx(1, abs=0.1)  # scanlines lie closer here than there
    assert max(covered[36:44, 70:90].max(), covered[:2].min(), covered[-2:].min(), covered[:, :2].min(), covered[:, -2:].min()) < 0.6
