"""One frame in, its path and its sharp image out, whichever way it is read."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import skimage.data

from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.physics import simulate, tone
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.distortion import Distortion
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.tone import Transfer
from rsvideo.physics.trajectory import Polynomial, Trajectory, centred, still
from rsvideo.progress import Progress
from rsvideo.restoration import initialise, single_frame
from rsvideo.restoration.correction import ApproximatePath
from rsvideo.restoration.energy import energy
from rsvideo.restoration.scanlines import to_scanlines
from rsvideo.restoration.scene import scene_of
from rsvideo.restoration.search import estimate
from rsvideo.restoration.settings import Settings
from rsvideo.restoration.verdict import COSTLIEST, judge

ROWS, COLS = 80, 120
LENS = Intrinsics(fx=310.0, fy=280.0, cx=63.0, cy=35.0, rows=ROWS, cols=COLS)
TURN = np.array([[0.0, 0.0, 0.0], [3.0, -2.0, 0.02], [1.0, 1.5, -0.006]])
KNOWN = Settings(prior="tv", samples=20)


def psnr(image, truth):
    one, other = (np.clip(a[10:-10, 10:-10], 0, 1) ** (1 / 2.2) for a in (image, truth))
    return float(-10 * np.log10(np.mean((one - other) ** 2)))


def sharp():
    return (skimage.data.astronaut()[20:260, 60:380] / 255) ** 2.2


def reading(way, lens=LENS) -> Camera:
    """A camera that reads its frame that way."""
    lines = lens.rows if way in (Direction.TOP_TO_BOTTOM, Direction.BOTTOM_TO_TOP) else lens.cols
    timing = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=lines, direction=way)
    return Camera(timing=timing, intrinsics=lens)


def path(camera, coefficients):
    timing = camera.timing
    return centred(Polynomial(t0=0.0, t1=timing.interval[1], coefficients=coefficients), timing.middle)


def taken(camera, trajectory, sigma=0.001):
    rng, noise = np.random.default_rng(0), Noise.at_half(sigma)
    return simulate.render(sharp(), camera=camera, trajectory=trajectory, noise=noise, rng=rng, samples=32)


def frame(pixels) -> Frame:
    return Frame(pixels=pixels, clipped=pixels >= 1)


def restore(frame, camera, settings, **how) -> FrameResult:
    return single_frame.restore(to_scanlines(frame, camera), settings, **how)


def observed(frame, camera, settings):
    return scene_of(to_scanlines(frame, camera), settings)


@pytest.mark.parametrize("lens", [None, Distortion(model="brown-conrady", coefficients=(-1.5, 2.5, 0.02, -0.03))], ids=["pinhole", "bent"])
@pytest.mark.parametrize("way", list(Direction))
def test_whichever_way_a_frame_is_read_its_known_motion_is_undone(way, lens):
    camera = reading(way, replace(LENS, distortion=lens))
    trajectory = path(camera, TURN)
    case = taken(camera, trajectory)
    result = restore(frame(case.blurred), camera, KNOWN, trajectory=trajectory)
    assert psnr(result.latent, case.truth) > psnr(case.blurred, case.truth) + 6
    np.testing.assert_allclose(result.trajectory.coefficients, trajectory.coefficients, atol=1e-12)


FLIPPED = {
    # what becomes of the picture, of the lens, and of a pose (x, y, roll)
    Direction.BOTTOM_TO_TOP: (lambda a: a[::-1], replace(LENS, cy=ROWS - 1 - LENS.cy), lambda p: p * [1, -1, -1]),
    Direction.LEFT_TO_RIGHT: (
        lambda a: a.transpose(1, 0, 2),
        Intrinsics(fx=LENS.fy, fy=LENS.fx, cx=LENS.cy, cy=LENS.cx, rows=COLS, cols=ROWS),
        lambda p: p[:, [1, 0, 2]] * [1, 1, -1],
    ),
    Direction.RIGHT_TO_LEFT: (  # a quarter turn
        lambda a: a.transpose(1, 0, 2)[:, ::-1],
        Intrinsics(fx=LENS.fy, fy=LENS.fx, cx=ROWS - 1 - LENS.cy, cy=LENS.cx, rows=COLS, cols=ROWS),
        lambda p: p[:, [1, 0, 2]] * [-1, 1, 1],
    ),
}


@pytest.mark.parametrize("way", list(FLIPPED))
def test_a_flipped_or_turned_frame_is_restored_to_the_flipped_or_turned_image(way):
    camera = reading(Direction.TOP_TO_BOTTOM)
    trajectory = path(camera, TURN)
    blurred = taken(camera, trajectory).blurred
    upright = restore(frame(blurred), camera, KNOWN, trajectory=trajectory)
    flip, lens, pose = FLIPPED[way]
    moved = trajectory.with_coefficients(pose(trajectory.coefficients))
    result = restore(frame(np.ascontiguousarray(flip(blurred))), reading(way, lens), KNOWN, trajectory=moved)
    np.testing.assert_allclose(result.latent, flip(upright.latent), atol=1e-4)
    np.testing.assert_allclose(result.trajectory.coefficients, moved.coefficients, atol=1e-12)


def test_what_is_known_of_a_frame_comes_back_with_it():
    camera = reading(Direction.TOP_TO_BOTTOM)
    trajectory = path(camera, TURN).shifted(np.array([5.0, 3.0, 0.1]))
    given = frame(taken(camera, path(camera, TURN)).blurred)
    before = given.pixels.copy()
    result = restore(given, camera, KNOWN, trajectory=trajectory)
    assert (result.frame, result.timing) == (given, camera.timing)
    assert result.verdict is Verdict.RESTORED
    np.testing.assert_allclose(result.trajectory.at(np.array([camera.timing.middle])), 0, atol=1e-12)
    np.testing.assert_array_equal(given.pixels, before)


@pytest.mark.parametrize("way", list(Direction))
@pytest.mark.parametrize("level", [0.0, 0.4, 1.0])
def test_a_frame_without_texture_is_left_as_it_was(way, level):
    pixels = np.full((ROWS, COLS, 3), level, np.float32)
    result = restore(frame(pixels), reading(way), Settings())
    assert result.verdict is Verdict.NO_TEXTURE
    np.testing.assert_array_equal(result.latent, pixels)
    assert np.ptp(result.trajectory.at(np.linspace(0, 0.04, 9)), axis=0).max() == 0


def test_a_degree_that_one_frame_does_not_determine_is_refused():
    with pytest.raises(ValueError, match=r"degree must lie in \[1, 12\], got 13"):
        Settings(degree=13)


def moved(bend: float) -> tuple[Camera, Trajectory]:
    """A camera, and a motion that is even but for `bend`."""
    camera = reading(Direction.TOP_TO_BOTTOM, Intrinsics.centred(focal=500.0, rows=128, cols=192))
    return camera, path(camera, np.array([[0.0, 0.0], [5.0, -2.5], [bend, bend]]))


@pytest.fixture(scope="module")
def blindly() -> tuple[simulate.Rendering, FrameResult, list[Progress], Trajectory]:
    """A frame, its restoration from the picture alone, what could be watched, and the truth."""
    camera, true = moved(1.2)
    case = taken(camera, true)
    seen: list[Progress] = []
    settings = Settings(motion="shift", degree=2, candidates=2, samples=20)
    result = restore(frame(case.blurred), camera, settings, observe=seen.append)
    return case, result, seen, true


def test_blindly_the_path_is_found_and_the_picture_gains(blindly):
    case, result, _, true = blindly
    t = np.linspace(0, result.timing.interval[1], 65)
    assert np.sqrt(((result.trajectory.at(t) - true.at(t)) ** 2).sum(axis=1).mean()) < 0.8
    assert psnr(result.latent, case.truth) > psnr(case.blurred, case.truth) + 5


def test_the_work_can_be_watched_from_its_start_to_its_end(blindly):
    seen = blindly[2]
    fractions = [at.fraction for at in seen]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1
    assert [seen[0].stage, seen[-1].stage] == ["spectra", "latent image"]


def test_the_objective_falls_from_step_to_step(blindly):
    values = blindly[1].convergence
    assert len(values) >= 2
    assert list(values) == sorted(values, reverse=True)


@pytest.mark.slow
@pytest.mark.parametrize("way", [Direction.TOP_TO_BOTTOM, Direction.RIGHT_TO_LEFT])
def test_a_path_that_is_known_to_some_extent_is_corrected(way):
    camera = reading(way, Intrinsics.centred(focal=300.0, rows=130, cols=190))
    true = path(camera, np.array([[0.0, 0.0, 0.0], [4.0, -3.0, 0.01], [1.0, 1.5, -0.003]]))
    case = taken(camera, true)
    wrong = path(camera, true.coefficients * 1.25 + np.array([[0, 0, 0], [0.3, 0.3, 0], [0, 0, 0]]))
    settings = replace(KNOWN, degree=3)
    plain = restore(frame(case.blurred), camera, settings, trajectory=wrong)
    better = restore(frame(case.blurred), camera, settings, start=ApproximatePath(trajectory=wrong, drift=0.5, share=0.1))
    t = np.linspace(*camera.timing.interval, 40)
    apart = [np.sqrt(((r.trajectory.at(t) - true.at(t))[:, :2] ** 2).sum(axis=1).mean()) for r in (plain, better)]
    assert apart[1] < 0.7 * apart[0]
    assert psnr(better.latent, case.truth) > psnr(plain.latent, case.truth) + 3
    assert better.verdict is Verdict.RESTORED


def test_finer_motion_than_the_correction_is_kept():
    camera = reading(Direction.TOP_TO_BOTTOM)
    fine = np.zeros((12, 3))
    fine[1], fine[11] = (5.0, 2.0, 0.0), (0.4, -0.4, 0.0)
    true = path(camera, fine)
    start = ApproximatePath(trajectory=true, drift=0.02, share=0.0)
    result = restore(frame(taken(camera, true).blurred), camera, KNOWN, start=start)
    t = np.linspace(*camera.timing.interval, 200)
    assert np.abs((result.trajectory.at(t) - true.at(t))[:, :2]).max() < 0.2


@pytest.mark.slow
def test_where_only_the_path_backwards_was_a_candidate_it_is_turned_round(monkeypatch):
    camera, true = moved(0.3)
    candidates = initialise.candidates

    def backwards(*given, **how):
        return (c for c in candidates(*given, **how) if (c.trajectory.coefficients[1] * true.coefficients[1]).sum() < 0)

    monkeypatch.setattr(initialise, "candidates", backwards)
    scene = observed(frame(taken(camera, true).blurred), camera, Settings())
    *_, last = estimate(scene, Settings(motion="shift", degree=2, samples=20, start="kernels"))
    np.testing.assert_allclose(last.trajectory.coefficients[1], true.coefficients[1], atol=1)


@pytest.mark.slow
def test_a_path_that_leads_out_of_the_frame_is_not_followed(monkeypatch):
    camera, true = moved(0.3)
    candidates = initialise.candidates

    def far(*given, **how):
        return (replace(c, trajectory=c.trajectory.with_coefficients(20 * c.trajectory.coefficients)) for c in candidates(*given, **how))

    monkeypatch.setattr(initialise, "candidates", far)
    given = frame(taken(camera, true).blurred)
    result = restore(given, camera, Settings(motion="shift", degree=2, samples=20, start="kernels"))
    assert result.verdict is Verdict.UNEXPLAINED
    np.testing.assert_array_equal(result.latent, given.pixels)


def test_a_picture_out_of_focus_is_not_restored_along_a_path_that_it_does_not_show():
    photograph = tone.decode(Transfer.SRGB, (skimage.data.coffee()[100:340, 60:380] / 255).astype(np.float32))
    noise = np.random.default_rng(0).normal(0, 0.003, photograph.shape)
    soft = frame(np.clip(cv2.GaussianBlur(photograph, (0, 0), 1.5) + noise, 0, 1).astype(np.float32))
    timing = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=240)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=400, rows=240, cols=320))
    scene = observed(soft, camera, Settings())
    straight = still(timing.interval, degree=2, axes=2)
    moved = straight.with_coefficients(np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 0.0]]))
    assert energy(scene, moved) < COSTLIEST * energy(scene, straight)  # the energy alone would have believed it
    assert judge(scene, moved) is Verdict.UNEXPLAINED


@pytest.mark.slow
def test_the_smallest_frames_can_be_restored():
    rng, timing = np.random.default_rng(0), ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=32)
    noise = cv2.GaussianBlur(rng.uniform(0, 1, (32, 32, 3)).astype(np.float32), (0, 0), 2)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=60, rows=32, cols=32))
    assert restore(frame(noise), camera, Settings()).latent.shape == noise.shape
