"""One path through a run of frames: what tracks say of it, what blur adds, and how its pieces join."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from rsvideo.frame import Frame, Verdict
from rsvideo.physics.camera import Camera
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.trajectory import Polynomial, Trajectory
from rsvideo.progress import Observer, ignore
from rsvideo.restoration import multi_frame, single_frame
from rsvideo.restoration.clip_motion import gather
from rsvideo.restoration.clip_motion import movement as of_run
from rsvideo.restoration.fusion import PosedImage
from rsvideo.restoration.movement import Evidence, Movement, joined
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.scanlines import to_scanlines
from rsvideo.restoration.settings import Settings
from tests.pipeline.moving import RATE, Moving
from tests.restoration.swaying import BEGINS, END, TIMING, sway

STRANGER = np.s_[20:76, 50:110]
OBSERVED = np.s_[24:-24, 24:-24]  # away from the borders, where a frame's own data show less of what moves in


def pieces(path: Trajectory, timing: ShutterTiming) -> tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray]:
    """The motion within each frame and from each to the next."""
    local = np.linspace(*timing.interval, 60)
    middles = path.at(BEGINS + timing.middle)
    each = [(local, path.at(local + t) - middle) for t, middle in zip(BEGINS, middles, strict=True)]
    return each, np.vstack([np.diff(middles, axis=0), np.zeros((1, middles.shape[1]))])


def movement(frames: Iterable[Frame], camera: Camera, settings: Settings, observe: Observer = ignore) -> Movement:
    run = gather(frames, camera, settings, observe)
    return of_run(run).of_pictures(run.pictures)


def test_pieces_of_a_path_join_to_the_path() -> None:
    path = sway(3)
    t, poses = joined(BEGINS, *pieces(path, TIMING), TIMING)
    assert t[0] == 0
    assert t[-1] == pytest.approx(END, abs=1.1e-3)
    difference = (poses - path.at(t))[:, :2]
    assert np.abs(difference - difference.mean(axis=0)).max() < 1.0  # of a sway of 14 px
    at_middles = np.stack([np.interp(BEGINS + TIMING.middle, t, column) for column in poses.T], axis=1)
    np.testing.assert_allclose(at_middles - at_middles[0], path.at(BEGINS + TIMING.middle) - path.at(np.array([TIMING.middle])), atol=0.02)


def test_pieces_may_have_as_many_samples_as_their_exposures_need() -> None:
    each, steps = pieces(sway(3), TIMING)
    fewer = [(np.delete(t, range(20, 20 + k)), np.delete(path, range(20, 20 + k), axis=0)) for k, (t, path) in enumerate(each)]
    np.testing.assert_allclose(joined(BEGINS, fewer, steps, TIMING)[1], joined(BEGINS, each, steps, TIMING)[1], atol=0.5)


def test_pieces_that_disagree_fade_into_each_other() -> None:
    each, steps = pieces(sway(2), TIMING)
    bent = [(t, poses * (1.5 if k % 2 else 0.7)) for k, (t, poses) in enumerate(each)]
    t, poses = joined(BEGINS, bent, steps, TIMING)
    speed = np.abs(np.diff(poses, axis=0)).max() / np.diff(t).max()
    assert speed < 3 * np.abs(np.diff(sway(2).at(t), axis=0)).max() / np.diff(t).max()


@pytest.mark.slow
@pytest.mark.parametrize("direction", list(Direction))
def test_motion_comes_back_in_image_axes_whichever_way_the_rows_are_read(direction: Direction) -> None:
    moving = Moving(frames=5, direction=direction, reach=9.0)
    seen: list[int | None] = []
    found = movement(moving.recorded, moving.camera, Settings(), lambda at: seen.append(at.frame))
    assert seen == [0, 1, 2, 3, 4]
    middles = moving.path.at(moving.begins + moving.timing.middle)
    np.testing.assert_allclose(found.steps[:-1, :2], np.diff(middles, axis=0)[:, :2], atol=0.6)
    np.testing.assert_array_equal(found.steps[-1], 0)
    t = np.linspace(*moving.timing.interval, 33)
    for k, way in enumerate(found.within):
        assert way is not None
        true, wrong = (moving.way(k).at(t) - middles[k])[:, :2], way.at(t)[:, :2]
        outermost = k in (0, 4)  # which nothing before, or behind, holds in place
        assert np.sqrt(((wrong - true) ** 2).sum(axis=1).mean()) < (1.2 if outermost else 0.6)
        if np.linalg.norm(np.ptp(true, axis=0)) > 3:
            assert np.sqrt(((wrong + true) ** 2).sum(axis=1).mean()) > 2


@pytest.mark.parametrize("guessed", [False, True])
def test_scanlines_that_are_exposed_at_once_are_certain_unless_that_is_a_guess(guessed: bool) -> None:
    moving = Moving(frames=3, readout=0.0, reach=9.0)
    run = replace(gather(moving.recorded, moving.camera, Settings()), readout_guessed=guessed)
    beside = of_run(run).beside
    assert [each.certainty for each in beside if each] == [0.0 if guessed else 1.0] * 3
    rolling = replace(moving, readout=0.01)
    others = of_run(gather(rolling.recorded, rolling.camera, Settings())).beside
    assert all(0 < each.certainty < 1 for each in others if each)


@pytest.mark.slow
@pytest.mark.parametrize("readout", [0.0, 0.01])
def test_a_frame_that_is_not_deblurred_is_left_where_it_has_no_readout(readout: float) -> None:
    moving = Moving(frames=3, readout=readout, reach=9.0)
    path = movement(moving.recorded, moving.camera, Settings())
    doubted = replace(path, evidence=[each and replace(each, share=0.0) for each in path.beside])
    done = list(multi_frame.restored(moving.recorded, doubted, moving.camera, Settings(frames="alone", prior="tv")))
    assert all(each.verdict.straightened if readout else each.verdict is Verdict.LEFT for each in done)
    assert all(each.verdict.changed == (readout > 0) for each in done)


@pytest.mark.slow
@pytest.mark.parametrize(("times", "verdict"), [(1.0, Verdict.RESTORED), (2.0, Verdict.DISAGREES)])
def test_frames_are_deblurred_only_where_their_blur_shows_the_exposure(times: float, verdict: Verdict) -> None:
    moving = Moving(frames=8, rows=128, cols=192)
    assumed = replace(moving, exposure=times * moving.exposure)
    middles = (moving.exposure - assumed.exposure) / 2
    frames = [replace(frame, time=frame.time + middles) for frame in moving.recorded]
    found = movement(frames, assumed.camera, Settings())
    shares = [one.share for one in found.evidence]
    assert shares.pop(1) < 0.5  # that frame hardly moves
    assert set(shares) == {float(times == 1)}
    results = list(multi_frame.restored(frames[2:4], found.part(2, 4), assumed.camera, Settings(frames="alone", prior="tv")))
    assert [result.verdict for result in results] == [verdict, verdict]


def test_a_cut_ends_one_path_and_frames_without_a_neighbour_stand_alone() -> None:
    first, second = Moving(frames=3, reach=6.0), Moving(frames=3, reach=6.0, scene="coins")
    frames = first.recorded[:2] + [replace(f, time=(k + 2) / RATE, index=k + 2) for k, f in enumerate(second.recorded[:1])]
    found = movement(frames, first.camera, Settings())
    assert [way is None for way in found.within] == [False, False, True]
    np.testing.assert_array_equal(found.steps[1:], 0)
    assert np.abs(found.steps[0]).max() > 1
    alone = movement(frames[2:], first.camera, Settings())
    assert alone.within == [None]
    np.testing.assert_array_equal(alone.steps, np.zeros((1, 3)))


def test_no_path_leads_through_pictures_that_a_clip_says_to_be_shown_at_one_time() -> None:
    moving = Moving(frames=4)
    frames = moving.recorded
    frames[2] = replace(frames[2], time=frames[1].time + 1e-6)
    assert gather(frames, moving.camera, Settings()).tied == [True, False, True, False]


def twice() -> tuple[Moving, list[Frame]]:
    """A clip whose second frame is shown for a third, which was lost."""
    moving = Moving(frames=5, reach=12.0)
    frames = moving.recorded
    frames[2] = replace(frames[2], pixels=frames[1].pixels)
    return moving, frames


def test_a_picture_that_repeats_the_one_before_does_not_stop_the_camera() -> None:
    moving, frames = twice()
    run = gather(frames, moving.camera, Settings())
    assert run.pictures.tolist() == [0, 1, 1, 2, 3]
    np.testing.assert_array_equal(run.begins, moving.begins[[0, 1, 3, 4]])
    found = of_run(run).of_pictures(run.pictures)
    assert found.within[2] is found.within[1]
    assert found.tied == [True] * 4 + [False]
    np.testing.assert_array_equal(found.steps[1], 0)
    poses = moving.path.at(moving.begins + moving.timing.middle)
    np.testing.assert_allclose(found.steps[2, :2], (poses[3] - poses[1])[:2], atol=0.5)


def test_a_camera_that_stands_still_repeats_nothing() -> None:
    moving = Moving(frames=3)
    frames = [replace(frame, pixels=moving.recorded[0].pixels) for frame in moving.recorded]
    assert gather(frames, moving.camera, Settings()).pictures.tolist() == [0, 1, 2]


def test_a_repeated_picture_does_not_bear_out_its_own_restoration(monkeypatch: pytest.MonkeyPatch) -> None:
    moving, frames = twice()
    run, helped = gather(frames, moving.camera, Settings()), []

    def helpful(own: PosedImage, others: Sequence[PosedImage]) -> Sequence[PosedImage]:
        helped.append([bool((own.pose == other.pose).all()) for other in others])
        return others

    monkeypatch.setattr(multi_frame, "helpful", helpful)
    list(multi_frame.restored(frames, of_run(run).of_pictures(run.pictures), moving.camera, Settings(prior="tv")))
    assert helped
    assert not any(any(same) for same in helped)


def test_each_frame_is_restored_with_its_own_exposure() -> None:
    moving = Moving(frames=3, reach=12.0)
    middles = moving.path.at(moving.begins + moving.timing.middle)
    shutters = [replace(moving.timing, exposure=seconds) for seconds in (0.01, 0.02, 0.03)]
    path = [Polynomial(t0=0.0, t1=each.interval[1], coefficients=np.array([[0, 0, 0], [4.0, 0, 0]])) for each in shutters]
    steps = np.diff(middles, axis=0, append=middles[-1:])
    given = Movement(within=[*path], steps=steps, tied=[True, True, False], exposures=[0.01, 0.02, 0.03])
    results = list(multi_frame.restored(moving.recorded, given, moving.camera, Settings(quality="draft")))
    assert [result.timing.exposure for result in results] == [0.01, 0.02, 0.03]
    assert [result.trajectory.t1 for result in results] == pytest.approx([0.03, 0.04, 0.05])
    assert [camera.timing.exposure for camera in given.part(1, 3).cameras(moving.camera)] == [0.02, 0.03]


def with_a_stranger() -> tuple[Moving, list[Frame], Movement]:
    """A scene that the camera passes; the middle frame alone shows something else in a part of it."""
    moving, other = Moving(frames=5, reach=12.0), Moving(frames=5, reach=12.0, scene="page")
    frames = moving.recorded
    pixels = frames[2].pixels.copy()
    pixels[STRANGER] = other.recorded[2].pixels[STRANGER]
    frames[2] = replace(frames[2], pixels=pixels)
    middles = moving.path.at(moving.begins + moving.timing.middle)
    found = Movement(
        within=[moving.way(k).shifted(-middle) for k, middle in enumerate(middles)],
        steps=np.vstack([np.diff(middles, axis=0), np.zeros((1, 3))]),
        tied=[True] * (len(frames) - 1) + [False],
        evidence=[Evidence(flow=None, error=0.0, share=1.0, certainty=1.0)] * len(frames),
    )
    return moving, frames, found


@pytest.fixture
def in_focus(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each frame's own gradients believe every path."""
    monkeypatch.setattr(multi_frame, "trust", lambda scene, *_: np.ones(scene.frame.shape, np.float32))


@pytest.mark.slow
@pytest.mark.usefixtures("in_focus")
def test_what_no_neighbour_bears_out_is_not_deblurred(monkeypatch: pytest.MonkeyPatch) -> None:
    moving, frames, found = with_a_stranger()
    how = {"camera": moving.camera, "settings": Settings(prior="tv")}
    checked = list(multi_frame.restored(frames, found, **how))[2].latent
    monkeypatch.setattr(multi_frame, "agreement", lambda explained, *_: np.ones_like(explained))
    unchecked = list(multi_frame.restored(frames, found, **how))[2].latent
    inner = np.s_[STRANGER[0].start + 10 : STRANGER[0].stop - 10, STRANGER[1].start + 10 : STRANGER[1].stop - 10]
    deblurred, left = (np.abs(np.diff(each[inner], axis=1)).mean() for each in (unchecked, checked))
    assert deblurred > 1.3 * left
    apart = np.ones(checked.shape[:2], bool)
    apart[:, STRANGER[1].start - 24 : STRANGER[1].stop + 24] = False
    assert np.abs(checked - unchecked)[apart].mean() < 0.01


def with_a_brief_one() -> tuple[Moving, list[Frame], Movement]:
    """The middle frame alone is sharp, though it is given the path and the exposure of the others."""
    moving, _, found = with_a_stranger()
    frames, way, brief = moving.recorded, moving.way(2), 0.05 * moving.exposure
    later = (moving.exposure - brief) / 2  # so that each scanline is open about the same time
    shot = replace(moving, exposure=brief).shot(replace(way, t0=way.t0 - later, t1=way.t1 - later), 2)
    frames[2] = replace(frames[2], pixels=shot.blurred)
    return moving, frames, found


@pytest.mark.slow
@pytest.mark.usefixtures("in_focus")
@pytest.mark.parametrize(("sharp", "verdict"), [(False, Verdict.RESTORED), (True, Verdict.STRAIGHTENED)])
def test_a_frame_as_sharp_as_its_neighbours_is_not_deblurred_along_a_path_that_predicts_blur(sharp: bool, verdict: Verdict) -> None:
    moving, frames, found = with_a_brief_one()
    if not sharp:
        frames = moving.recorded
    results = list(multi_frame.restored(frames, found, moving.camera, Settings(prior="tv")))
    assert [results[k].verdict for k in (1, 2, 3)] == [Verdict.RESTORED, verdict, Verdict.RESTORED]


@pytest.mark.slow
@pytest.mark.usefixtures("in_focus")
def test_a_path_whose_blur_is_not_there_is_not_straightened_along_where_the_clip_has_shown_its_exposure() -> None:
    moving, frames, found = with_a_brief_one()

    def moved(shown: bool) -> float:
        believed = [replace(evidence, exposure_shown=shown) for evidence in found.evidence]
        results = list(multi_frame.restored(frames, replace(found, evidence=believed), moving.camera, Settings(prior="tv")))
        return float(np.abs(results[2].latent - frames[2].pixels)[8:-8, 16:-16].mean())

    assert moved(shown=True) < 1e-6 < 0.01 < moved(shown=False)


@pytest.mark.slow
@pytest.mark.usefixtures("in_focus")
def test_a_motion_that_was_given_is_followed_whatever_the_neighbours_show() -> None:
    moving, frames, found = with_a_stranger()
    how = {"camera": moving.camera, "settings": Settings(prior="tv")}
    found, given = (list(multi_frame.restored(frames, motion, **how))[2].latent for motion in (found, replace(found, evidence=[])))
    assert np.abs(np.diff(given[STRANGER], axis=1)).mean() > 1.2 * np.abs(np.diff(found[STRANGER], axis=1)).mean()


@pytest.mark.parametrize("blur", ["short", "long"])
@pytest.mark.parametrize("reach", ["together", "alone"])
def test_a_frame_without_neighbours_is_restored_by_itself_as_far_as_it_is_trusted(
    monkeypatch: pytest.MonkeyPatch, reach: Literal["together", "alone"], blur: str
) -> None:
    moving, frames, found = with_a_stranger()
    camera, one = moving.camera, found.part(2, 3)
    monkeypatch.setattr(multi_frame, "too_long", lambda *_: blur == "long")

    def shown(trusted: float) -> np.ndarray:
        monkeypatch.setattr(multi_frame, "trust", lambda scene, *_: np.full(scene.frame.shape, trusted, np.float32))
        (result,) = multi_frame.restored(frames[2:3], one, camera, Settings(frames=reach))
        return result.latent

    whole = single_frame.restore(to_scanlines(frames[2], camera), Settings(), trajectory=one.within[0]).latent
    quarter, half, full = (shown(trusted) for trusted in (0.25, 0.5, 1.0))
    np.testing.assert_allclose(full[OBSERVED], np.clip(whole, 0, 1)[OBSERVED], atol=1e-5)
    np.testing.assert_allclose(full - half, 2 * (half - quarter), atol=1e-5)


@pytest.mark.usefixtures("in_focus")
def test_a_frame_keeps_its_light_however_wrong_its_path_may_be() -> None:
    moving, frames, found = with_a_stranger()
    vague = [replace(evidence, error=2000.0) for evidence in found.evidence]
    first = next(iter(multi_frame.restored(frames, replace(found, evidence=vague), moving.camera, Settings())))
    assert first.latent.mean() == pytest.approx(frames[0].pixels.mean(), rel=0.05)


@pytest.mark.usefixtures("in_focus")
def test_what_neither_the_frame_nor_a_neighbour_observed_is_only_straightened(monkeypatch: pytest.MonkeyPatch) -> None:
    moving, frames, found = with_a_stranger()
    clipped = frames[2].clipped.copy()
    clipped[30:60, 40:90] = True
    frames[2] = replace(frames[2], clipped=clipped)
    camera, settings, hidden = moving.camera, Settings(prior="tv"), np.s_[40:50, 58:72]

    def shown(first: int, last: int) -> np.ndarray:
        return list(multi_frame.restored(frames[first:last], found.part(first, last), camera, settings))[2 - first].latent

    with_neighbours, alone = shown(0, 5), shown(2, 3)
    monkeypatch.setattr(multi_frame, "trust", lambda scene, *_: np.full(scene.frame.shape, 1e-6, np.float32))
    monkeypatch.setattr(multi_frame, "LEAST_SHARE", 0.0)
    straight = shown(2, 3)
    np.testing.assert_allclose(alone[hidden], straight[hidden], atol=1e-4)
    assert np.abs(with_neighbours[hidden] - straight[hidden]).mean() > 0.01


def test_a_frame_is_straightened_as_far_as_its_path_is_certain() -> None:
    moving = Moving(frames=1, reach=12.0)
    view, path = to_scanlines(moving.recorded[0], moving.camera), moving.way(0)
    near = Flow(points=np.array([[48.0, 32.0]]), weights=np.array([[300.0, 0.0]]), length=40.0)

    def moved(certainty: float, flow: Flow | None) -> float:
        seen = Evidence(flow=flow, error=0.0, share=1.0, certainty=certainty)
        return float(np.abs(multi_frame._straight(view, path, seen, 1.0, "cpu") - view.pixels).mean())

    for flow in (None, near):
        assert moved(0.0, flow) < 1e-6 < moved(0.3, flow) < moved(1.0, flow)
