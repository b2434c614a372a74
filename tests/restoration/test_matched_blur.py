"""Points between frames that are blurred differently are followed to the centres of their PSFs."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import skimage.data

from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Spline
from rsvideo.restoration import matched_blur
from rsvideo.restoration.matched_blur import Exposed, followed_again
from rsvideo.restoration.tracks import Tracks, track
from tests.restoration.swaying import spline

ROWS, COLS = 160, 240
LENS = Intrinsics.centred(focal=300.0, rows=ROWS, cols=COLS)
TIMING = ShutterTiming.from_readout(exposure=0.02, readout=0.012, rows=ROWS)
SECOND = 1 / 24  # s, when the second frame opens
REST = spline(np.linspace(0, 0.3, 100), np.zeros((100, 2)))


def turning_back(reach: float) -> Spline:
    """The first frame stands still, then the camera turns; within the second one's exposures it turns back."""
    t = np.linspace(0, 0.3, 600)
    swing = np.where(t > SECOND, np.cos(2 * np.pi * (t - SECOND) / 0.03) - 1, 0)
    return spline(t, reach / 2 * np.stack([swing, 0.4 * swing], axis=1), terms=150)


def exposed(path: Spline, opens: float) -> Exposed:
    """What a camera records of a photograph along a path of shifts."""
    photograph = np.asarray(skimage.data.camera()).astype(np.float32)
    x, y = np.meshgrid(np.arange(COLS, dtype=float), np.arange(ROWS, dtype=float))
    taken = TIMING.sample_times(48) + opens
    light = np.zeros((ROWS, COLS), np.float32)
    for times in taken.T:
        pose = path.at(times)
        at = x + pose[:, :1] + 130, y + pose[:, 1:] + 100
        light += cv2.remap(photograph, at[0].astype(np.float32), at[1].astype(np.float32), cv2.INTER_LINEAR)
    picture = np.round(light / len(taken.T)).astype(np.uint8)
    return Exposed(picture=picture, path=path, opens=opens, timing=TIMING, intrinsics=LENS)


def missed(tracks: Tracks, path: Spline) -> float:
    """Px, RMS, by which points miss the mean pose of their scanlines' exposures."""
    poses = [
        path.at(TIMING.sample_times(48)[0] + at[:, 1:] * TIMING.row_time + t).mean(axis=1)
        for at, t in zip((tracks.before, tracks.after), (0, SECOND), strict=True)
    ]
    return float(np.sqrt(((tracks.before + poses[0] - tracks.after - poses[1]) ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("scale", [1, 2])
def test_points_are_found_where_the_centre_of_their_blur_is(scale: int) -> None:
    path = turning_back(9.0)
    first, second = exposed(path, 0.0), exposed(path, SECOND)
    before = track(first.picture, second.picture)
    again = followed_again(replace(before, scale=scale), first, second)
    assert len(again.before) > 0.8 * len(before.before)
    assert missed(again, path) < 0.3 * missed(before, path)
    assert missed(followed_again(before, *(replace(frame, path=REST) for frame in (first, second))), path) > 0.9 * missed(before, path)


def test_frames_that_are_blurred_alike_show_their_points_where_they_were_found() -> None:
    still = exposed(REST, 0.0)
    found = track(still.picture, still.picture)
    again = followed_again(found, still, still)
    np.testing.assert_array_equal(again.before, found.before)
    assert np.abs(again.after - found.after).max() < 0.01


def test_points_that_lead_elsewhere_are_left_out_and_none_where_few_remain(monkeypatch: pytest.MonkeyPatch) -> None:
    still = exposed(REST, 0.0)
    found = track(still.picture, still.picture)
    astray = replace(found, after=found.after + np.where(np.arange(len(found.after))[:, None] % 4, 0.0, 12.0))
    again = followed_again(astray, still, still)
    assert len(found.before) / 2 < len(again.before) < len(found.before)
    far = replace(still, path=spline(np.linspace(0, 0.3, 100), np.outer(np.linspace(0, 1e5, 100), [1.0, 0.0])))
    np.testing.assert_array_equal(followed_again(found, still, far).after, found.after)  # of a path that leads nowhere
    few = Tracks(before=found.before[:20], after=found.after[:20])
    np.testing.assert_array_equal(followed_again(few, still, still).after, few.after)
    monkeypatch.setattr(matched_blur, "FARTHEST", 0.0)
    np.testing.assert_array_equal(followed_again(astray, still, still).after, astray.after)
