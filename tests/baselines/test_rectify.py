"""A frame read row by row becomes the one that a global shutter had taken, whichever way its rows were read."""

from dataclasses import replace

import numpy as np
import pytest

from rsvideo.baselines import rectify
from rsvideo.baselines.rectify import after
from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.physics.camera import Camera
from rsvideo.physics.shutter import Direction
from rsvideo.physics.simulate import Rendering
from rsvideo.physics.trajectory import Polynomial, Spline, Trajectory, fit
from rsvideo.restoration import rectification
from rsvideo.restoration.clip_motion import gather
from rsvideo.restoration.movement import Movement
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.scanlines import View, path_along_scanlines, to_scanlines
from rsvideo.restoration.settings import Settings
from rsvideo.restoration.tracks import codes, track
from tests.pipeline.moving import Moving

STILL = Polynomial(t0=0.0, t1=0.02, coefficients=np.zeros((2, 3)))


def sharp(frames: int, direction: Direction = Direction.TOP_TO_BOTTOM, reach: float = 10.0) -> Moving:
    """A clip of short exposures, whose rows are read over most of a frame's time."""
    return Moving(frames=frames, direction=direction, reach=reach, exposure=0.5e-3, readout=0.03)


def movement(moving: Moving, frames: list[Frame] | None = None) -> Movement:
    return rectify.movement(gather(moving.recorded if frames is None else frames, moving.camera, Settings(), blur=False))


def along(frame: Frame, path: Trajectory | None, camera: Camera) -> tuple[View, Trajectory | None]:
    """The frame and its path, given in image axes, along the scanlines."""
    return to_scanlines(frame, camera), path and path_along_scanlines(path, camera.timing.direction)


def rectified(frame: Frame, path: Trajectory, camera: Camera) -> Frame:
    view, path_along = along(frame, path, camera)
    assert path_along is not None
    return rectification.rectified(view, path_along).frame


def restored(frame: Frame, path: Trajectory | None, camera: Camera, flow: Flow | None = None) -> FrameResult:
    return rectify.restored(*along(frame, path, camera), flow=flow)


def drifting(moving: Moving, velocity: np.ndarray) -> list[Rendering]:
    """The frames of a camera that moves at `velocity`, px/s, besides."""
    t = np.linspace(moving.path.t0, moving.path.t1, 200)
    path = fit(moving.path, t, moving.path.at(t) + t[:, None] * velocity)
    assert isinstance(path, Spline)
    return [moving.shot(replace(path, t0=path.t0 - begin, t1=path.t1 - begin), k) for k, begin in enumerate(moving.begins)]


def astray(pixels: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """How far, in px, points of the truth lie from where they should be."""
    pair = track(codes(truth[..., 0]), codes(pixels[..., 0]))
    assert len(pair.before) >= 24
    return np.linalg.norm(pair.after - pair.before, axis=1)


@pytest.mark.parametrize("direction", list(Direction))
def test_the_true_path_brings_every_row_home(direction: Direction) -> None:
    moving = sharp(1, direction)
    frame, truth = moving.recorded[0], moving.renderings[0].truth
    found = rectified(frame, moving.way(0), moving.camera)
    assert np.sqrt((astray(frame.pixels, truth) ** 2).mean()) > 1.5
    assert np.median(astray(found.pixels, truth)) < 0.1
    assert np.sqrt((astray(found.pixels, truth) ** 2).mean()) < 0.15
    inner = np.s_[12:-12, 16:-16]
    assert np.sqrt(((found.pixels - truth)[inner] ** 2).mean()) < 0.15 * np.sqrt(((frame.pixels - truth)[inner] ** 2).mean())


def test_a_global_shutter_is_left_bit_for_bit() -> None:
    moving = Moving(frames=1)
    frame, camera = moving.recorded[0], replace(moving.camera, timing=after(moving.timing))
    assert camera.timing.interval == (0.0, moving.timing.exposure)
    found = rectified(frame, moving.way(0), camera)
    np.testing.assert_array_equal(found.pixels, frame.pixels)
    result = restored(frame, moving.way(0), camera)
    assert result.verdict is Verdict.SHARP
    np.testing.assert_array_equal(result.latent, frame.pixels)


def test_a_frame_that_stands_still_or_is_not_known_to_move_is_left_as_it_was() -> None:
    moving = sharp(1)
    frame = moving.recorded[0]
    for way, verdict in ((STILL, Verdict.SHARP), (None, Verdict.NO_TEXTURE)):
        result = restored(frame, way, moving.camera)
        assert result.verdict is verdict
        np.testing.assert_array_equal(result.latent, frame.pixels)
        assert not result.trajectory.at(np.array([0.01])).any()


def test_light_stays_between_black_and_white_and_what_is_clipped_moves_along() -> None:
    moving = sharp(1)
    edge = np.zeros((96, 160, 1), np.float32)
    edge[:, 80:] = 1
    frame = Frame(pixels=edge, clipped=edge > 0)
    timing = moving.timing
    drift = Polynomial(t0=0.0, t1=timing.interval[1], coefficients=np.array([[0.0, 0.0], [10.0, 0.0]]))  # to the right, all the while
    found = rectified(frame, drift, moving.camera)
    assert found.pixels.min() >= 0
    assert found.pixels.max() <= 1
    middle, top = found.pixels[48, :, 0], found.pixels[4, :, 0]
    assert abs(np.flatnonzero(middle > 0.5)[0] - 80) <= 1
    shift = float(drift.at(np.array([4 * timing.row_time]))[0, 0])  # -16: this row looked 16 px to the left, and saw the edge there later
    assert np.flatnonzero(top > 0.5)[0] == pytest.approx(80 + shift, abs=1)
    assert found.clipped[4, 150 + round(shift) :, 0].all()
    assert not found.clipped[48, 4:78].any()
    assert found.clipped[-4, :12].all()  # beyond the frame, where nothing was seen
    np.testing.assert_array_equal(found.pixels[4, -4:], 1)  # though the border is repeated there


def test_colours_are_moved_alike() -> None:
    moving = sharp(1)
    frame = moving.recorded[0]
    colour = replace(frame, pixels=np.repeat(frame.pixels, 3, axis=2), clipped=np.repeat(frame.clipped, 3, axis=2))
    grey, found = (rectified(f, moving.way(0), moving.camera) for f in (frame, colour))
    np.testing.assert_allclose(found.pixels, np.repeat(grey.pixels, 3, axis=2), atol=1e-6)
    assert found.clipped.shape == colour.pixels.shape


@pytest.mark.parametrize("direction", [Direction.TOP_TO_BOTTOM, Direction.RIGHT_TO_LEFT])
def test_what_tracks_show_takes_more_than_two_thirds_of_the_wobble_away(direction: Direction) -> None:
    moving = sharp(6, direction)
    found = movement(moving)
    before, now = [], []
    for k in range(1, 5):
        result = restored(moving.recorded[k], found.within[k], moving.camera)
        assert result.verdict is Verdict.RESTORED
        for pixels, into in ((moving.recorded[k].pixels, before), (result.latent, now)):
            into.append((astray(pixels, moving.renderings[k].truth) ** 2).mean())
    assert np.mean(before) > 1
    assert np.sqrt(np.mean(now)) < np.sqrt(np.mean(before)) / 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("direction", "there", "velocity"),
    [(Direction.TOP_TO_BOTTOM, np.s_[:, 120:], [120.0, 0.0, 0.0]), (Direction.LEFT_TO_RIGHT, np.s_[72:], [0.0, 120.0, 0.0])],
)
def test_a_near_thing_that_passes_by_is_put_right_too(direction: Direction, there: tuple[slice, ...], velocity: list[float]) -> None:
    """One half of the picture drifts before the other, as what is near does when the camera moves sideways."""
    moving = replace(sharp(4, direction), rows=144, cols=240)
    frames, truth = moving.recorded, [shot.truth.copy() for shot in moving.renderings]
    for frame, home, near in zip(frames, truth, drifting(moving, np.array(velocity)), strict=True):
        frame.pixels[there], home[there] = near.blurred[there], near.truth[there]
    found = movement(moving, frames)
    ours, plain, before = [], [], []
    for k in (1, 2):
        beyond = found.evidence[k].flow
        assert beyond
        shown = [restored(frames[k], found.within[k], moving.camera, flow=flow).latent for flow in (beyond, None)]
        for pixels, into in zip((*shown, frames[k].pixels), (ours, plain, before), strict=True):
            into.append(float((astray(pixels, truth[k]) ** 2).mean()))
    assert np.mean(ours) < np.mean(plain) / 4
    assert np.mean(ours) < np.mean(before) / 9


def test_frames_without_a_neighbour_have_no_way() -> None:
    moving = sharp(1)
    assert movement(moving).within == [None]
    flat = [Frame(pixels=np.full((96, 160, 1), 0.5, np.float32), clipped=np.zeros((96, 160, 1), bool), time=k / 24) for k in range(2)]
    assert movement(moving, flat).within == [None, None]
