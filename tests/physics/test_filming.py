"""A clip filmed anew: against the renderer of photographs, and facts that any camera obeys."""

import weakref
from dataclasses import replace

import numpy as np
import pytest
import skimage.data

from rsvideo.physics import tone
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.filming import Pace, filmed
from rsvideo.physics.noise import Noise
from rsvideo.physics.scene_between import SceneBetween
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.simulate import blur, still
from rsvideo.physics.tone import Transfer
from rsvideo.physics.trajectory import Polynomial

ROWS, COLS, PERIOD = 96, 144, 1 / 30
VELOCITY = np.array([90.0, 36.0])  # px/s right and down, of the camera
QUIET = Noise(read=0.0, shot=0.0)
INNER = (slice(12, -12), slice(12, -12), slice(None))  # what stays in the picture


def timing(exposure=0.02, readout=0.02, direction=Direction.TOP_TO_BOTTOM):
    rows = ROWS if direction.by_row else COLS
    return ShutterTiming.from_readout(exposure=exposure, readout=readout, rows=rows, direction=direction)


def film(sharp, shutter, *, speed=1.0, frames=1, noise=QUIET, seed=0, growth=1.0):
    pace = Pace(timing=shutter, period=PERIOD, speed=speed, growth=growth)
    return list(filmed(sharp, pace, frames=frames, noise=noise, rng=np.random.default_rng(seed)))


@pytest.fixture(scope="module")
def scene():
    photograph = skimage.data.astronaut()[40:300, 60:400]
    return tone.decode(Transfer.SRGB, photograph.astype(np.float32) / 255).astype(np.float64)


LENS = Intrinsics.centred(focal=1e6, rows=ROWS, cols=COLS)  # so long that a turn is a shift


def path(begin, shutter, speed):
    """The camera's path in px over the interval of a frame that begins `begin` s after the first sharp one."""
    end = shutter.interval[1]
    half = 0.5 * speed * end * VELOCITY
    return Polynomial(t0=0.0, t1=end, coefficients=np.stack([VELOCITY * begin + half, half / np.sqrt(3)]))


@pytest.fixture(scope="module")
def sharp(scene):
    """Instants of the scene, a period apart."""
    return [still(scene, intrinsics=LENS, pose=VELOCITY * k * PERIOD).astype(np.float32) for k in range(8)]


def decibels(one, other):
    return -10 * np.log10(np.mean((one[INNER] - other[INNER]) ** 2))


@pytest.mark.parametrize("direction", list(Direction))
@pytest.mark.parametrize("speed", [1.0, 2.5])
def test_a_scene_that_moves_evenly_becomes_what_the_renderer_of_photographs_makes_of_it(scene, sharp, direction, speed):
    shutter = timing(direction=direction)
    shots = film(sharp, shutter, speed=speed, frames=2)
    for frame, shot in enumerate(shots):
        trajectory = path(frame * speed * PERIOD, shutter, speed)
        rendered = blur(scene, camera=Camera(timing=shutter, intrinsics=LENS), trajectory=trajectory)
        assert decibels(shot.blurred, rendered) > 43
        assert decibels(shot.truth, still(scene, intrinsics=LENS, pose=trajectory.at(np.array([shutter.middle]))[0])) > 40
        assert shot.blur == pytest.approx(np.hypot(*VELOCITY) * 0.02 * speed, rel=0.03)


@pytest.mark.parametrize("growth", [0.7, 1.5])
def test_automatic_exposure_changes_the_blur_of_each_frame_and_when_it_opens_not_when_it_closes(scene, sharp, growth):
    shots = film(sharp, timing(exposure=0.012), frames=4, growth=growth)
    for frame, shot in enumerate(shots):
        shutter = timing(exposure=0.012 * growth**frame)
        opens = frame * PERIOD + 0.012 - shutter.exposure
        trajectory = path(opens, shutter, 1.0)
        rendered = blur(scene, camera=Camera(timing=shutter, intrinsics=LENS), trajectory=trajectory)
        assert decibels(shot.blurred, rendered) > 40
        assert decibels(shot.truth, still(scene, intrinsics=LENS, pose=trajectory.at(np.array([shutter.middle]))[0])) > 40
        assert shot.blur == pytest.approx(np.hypot(*VELOCITY) * shutter.exposure, rel=0.03)


@pytest.mark.parametrize("direction", list(Direction))
def test_each_scanline_shows_its_own_instant(scene, sharp, direction):
    shutter = timing(exposure=1e-4, readout=0.03, direction=direction)
    shot = film(sharp, shutter, speed=2.0)[0]
    lines = direction.scanlines(shot.blurred)
    for i in range(12, shutter.rows - 12, 17):
        right, wrong = (still(scene, intrinsics=LENS, pose=VELOCITY * 2 * shutter.row_start()[k]) for k in (i, shutter.rows - 1 - i))
        right, wrong = (direction.scanlines(each)[i, 12:-12] for each in (right, wrong))
        error = np.mean((lines[i, 12:-12] - right) ** 2)
        assert error < 2e-4
        if abs(i - shutter.rows / 2) > shutter.rows / 4:
            assert np.mean((lines[i, 12:-12] - wrong) ** 2) > 5 * error


@pytest.mark.parametrize(("direction", "sign"), [(Direction.TOP_TO_BOTTOM, 1), (Direction.BOTTOM_TO_TOP, -1)])
def test_an_edge_that_moves_right_leans_right_towards_the_rows_read_later(direction, sign):
    texture = np.random.default_rng(0).uniform(0, 0.3, (ROWS, 1))
    x = np.arange(COLS)
    frames = [(1 / (1 + np.exp(40 + 4 * k - x)) * 0.6 + texture).astype(np.float32)[..., None] for k in range(4)]
    shutter = timing(exposure=1e-4, readout=0.03, direction=direction)
    shown = film(frames, shutter)[0].blurred[..., 0] - texture
    edge = [np.interp(0.3, row[20:70], x[20:70]) for row in shown]
    slope = np.polyfit(np.arange(ROWS), edge, 1)[0]
    assert slope == pytest.approx(sign * 4 / PERIOD * shutter.row_time, rel=0.05)


@pytest.mark.parametrize("speed", [0.3, 1.0, 2.7])
def test_a_scene_that_brightens_evenly_has_on_each_row_the_mean_light_of_its_exposure(speed):
    sharp = [np.full((ROWS, COLS, 1), 0.1 + 0.05 * k, np.float32) for k in range(14)]
    shutter = timing(exposure=0.025, readout=0.03)
    shots = film(sharp, shutter, speed=speed, frames=4)
    for k, shot in enumerate(shots):
        middles = k * speed + speed / PERIOD * (shutter.row_start() + 0.5 * shutter.exposure)
        np.testing.assert_allclose(shot.blurred[:, 7, 0], 0.1 + 0.05 * middles, atol=1e-5)
        np.testing.assert_allclose(shot.truth, 0.1 + 0.05 * (k * speed + speed / PERIOD * shutter.middle), atol=1e-5)


def test_a_still_clip_comes_back_as_it_is(sharp):
    for shot in film([sharp[0]] * 6, timing(), speed=1.5, frames=2):
        np.testing.assert_allclose(shot.blurred, sharp[0], atol=1e-6)
        np.testing.assert_allclose(shot.truth, sharp[0], atol=1e-6)
        assert shot.blur == 0


def even_flow(right):
    """Of everything, so many px to the right."""
    return np.broadcast_to(np.array([right, 0], np.float32), (24, 60, 2)).copy()


def test_a_line_that_sweeps_leaves_an_even_streak():
    line = np.zeros((24, 60, 1), np.float32)
    line[:, 20] = 1
    between = SceneBetween(before=line, after=np.roll(line, 12, axis=1), forward=even_flow(12), backward=even_flow(-12))
    streak = between.exposed(np.zeros(24), np.ones(24), np.repeat(np.arange(24)[:, None], 60, axis=1))[12, 22:31, 0]
    np.testing.assert_allclose(streak, 1 / 12, rtol=0.05)


def moving(*, begins: float, right: float) -> SceneBetween:
    """A texture that has moved by `begins` px, and moves `right`."""
    x, y = np.meshgrid(np.arange(60), np.arange(24))
    before, after = (0.5 + 0.3 * np.sin((x - p) / 2.5 + np.sin(y / 3)).astype(np.float32)[..., None] for p in (begins, begins + right))
    return SceneBetween(before=before, after=after, forward=even_flow(right), backward=even_flow(-right))


def test_a_scene_that_accelerates_moves_along_a_parabola():
    pairs = [moving(begins=k * k, right=2 * k + 1) for k in range(4)]  # places of 0, 1, 4, 9 and 16 px
    for k in (1, 2):
        between = pairs[k].beside(pairs[k - 1], pairs[k + 1])
        for u in (0.25, 0.5, 0.8):
            there = moving(begins=(k + u) ** 2, right=1).before
            inside = np.s_[4:-4, 10:-10]
            assert np.abs(between.at(u) - there)[inside].max() < 0.01
            assert np.abs(pairs[k].at(u) - there)[inside].max() > 0.015
            assert between.usual_motion(0, u) == pytest.approx((k + u) ** 2 - k * k, abs=1e-4)


def test_velocity_does_not_jump_from_frame_to_frame():
    pairs = [moving(begins=0, right=right) for right in (1.0, 4.0, -2.0, 3.0)]
    before, after = (pairs[k].beside(pairs[k - 1], pairs[k + 1]) for k in (1, 2))
    speeds = before.usual_motion(0.99, 1.0), after.usual_motion(0.0, 0.01)
    assert speeds[0] == pytest.approx(speeds[1], abs=0.002)
    assert abs(pairs[1].usual_motion(0.99, 1.0) - pairs[2].usual_motion(0.0, 0.01)) > 0.015


def test_frames_of_another_scene_do_not_accelerate_this_one():
    here = moving(begins=0, right=3)
    stranger = replace(moving(begins=0, right=40), backward=even_flow(20))
    assert stranger.astray > 0.25
    assert here.beside(stranger, stranger).usual_motion(0, 0.5) == pytest.approx(1.5)


def test_noise_is_drawn_by_the_seed_and_as_strong_as_stated(sharp):
    noise = Noise.at_half(0.02)
    quiet = film([sharp[0]] * 4, timing())[0]
    one, same, other = (film([sharp[0]] * 4, timing(), noise=noise, seed=seed)[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.blurred, same.blurred)
    assert (one.blurred != other.blurred).any()
    middling = (quiet.blurred > 0.2) & (quiet.blurred < 0.8)
    drawn = (one.blurred - quiet.blurred)[middling] / noise.at(quiet.blurred[middling])
    assert np.std(drawn) == pytest.approx(1, abs=0.03)
    np.testing.assert_array_equal(one.truth, quiet.truth)


def test_what_does_not_move_as_one_scene_is_astray(sharp):
    assert film(sharp, timing())[0].astray < 0.1
    strangers = [np.random.default_rng(k).permutation(sharp[0].reshape(-1, 3)).reshape(sharp[0].shape) for k in range(4)]
    assert film(strangers, timing())[0].astray > 0.5


@pytest.mark.parametrize("speed", [0.3, 1.0, 2.5, 7.0])
@pytest.mark.parametrize("frames", [1, 2, 5, 40])
@pytest.mark.parametrize("growth", [1.0, 0.9])
def test_sharp_frames_suffice_for_the_frames_that_need_them_and_one_less_does_not(frames, speed, growth):
    pace = Pace(timing=timing(exposure=1 / 30, readout=1 / 30), period=PERIOD, speed=speed, growth=growth)
    assert pace.frames(pace.needed(frames)) >= frames
    assert pace.frames(pace.needed(frames) - 1) < frames


@pytest.mark.parametrize("speed", [0.5, 6.0])
def test_a_few_sharp_frames_are_held_however_many_go_by(speed):
    alive: list[weakref.ref] = []
    most = 0

    def frames():
        nonlocal most
        for k in range(40):
            frame = np.full((ROWS, COLS, 1), 0.01 * k, np.float32)
            alive.append(weakref.ref(frame))
            most = max(most, sum(each() is not None for each in alive))
            yield frame

    pace = Pace(timing=timing(exposure=0.03, readout=0.03), period=PERIOD, speed=speed)
    for _ in filmed(frames(), pace, frames=4, noise=QUIET, rng=np.random.default_rng(0)):
        pass
    assert len(alive) <= pace.needed(4) + 1  # one more says how the scene accelerates
    assert most <= 5


def test_too_few_sharp_frames_are_refused(sharp):
    with pytest.raises(ValueError, match="9 frames need 11 sharp ones"):
        film(sharp, timing(), frames=9)


@pytest.mark.parametrize("speed", [0, -1, float("nan"), 1000])
def test_a_speed_that_nobody_means_is_refused(speed):
    with pytest.raises(ValueError, match="speed must lie in"):
        Pace(timing=timing(), period=PERIOD, speed=speed)


def test_what_enters_at_the_border_is_taken_from_the_frame_that_has_it():
    texture = np.random.default_rng(0).uniform(0.2, 0.8, (24, 72, 1)).astype(np.float32)

    between = SceneBetween(before=texture[:, :60].copy(), after=texture[:, 12:].copy(), forward=even_flow(-12), backward=even_flow(12))
    np.testing.assert_allclose(between.at(0.5), texture[:, 6:66], atol=1e-5)
