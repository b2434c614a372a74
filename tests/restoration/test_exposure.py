"""How long a clip was exposed, from its blur."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from rsvideo.frame import Frame
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.restoration import clip_motion, exposure
from rsvideo.restoration.clip_motion import COLS, Run, gather, scene_at
from rsvideo.restoration.exposure import Exposure, Unclear
from rsvideo.restoration.relative_exposure import Pairs
from rsvideo.restoration.settings import Settings
from tests.pipeline.moving import RATE, Moving

MOVING = Moving(frames=8, rows=128, cols=192)


@pytest.mark.slow
@pytest.mark.parametrize("assumed", [0.008, 0.03])
def test_the_exposure_of_a_clip_shows_in_its_blur(assumed: float) -> None:
    found = exposure.measured(taken(MOVING.recorded, assumed), 1 / RATE)
    assert isinstance(found, Exposure)
    assert found.value == pytest.approx(MOVING.exposure, rel=0.1)


@pytest.mark.parametrize(
    ("stated", "shown", "reach", "borne_out"),
    [(1.0, 0.25, 32.0, True), (1.0, 0.25, 16.0, False), (2.0, 1.0, 32.0, False), (0.5, 1.0, 48.0, False), (0.1, 0.05, 32.0, False)],
)
def test_the_focus_along_long_blurs_decides_between_two_exposures(stated: float, shown: float, reach: float, borne_out: bool) -> None:
    moving = replace(MOVING, reach=reach)
    run = taken(moving.recorded, moving.exposure)
    assert exposure.in_better_focus(run, stated * moving.exposure, shown * moving.exposure) == borne_out


@pytest.mark.slow
def test_an_exposure_between_two_that_are_tried_is_found() -> None:
    found = [exposure.measured(taken(MOVING.recorded, 0.02), period) for period in np.geomspace(1, exposure.RATIO, 5)[:-1] / RATE]
    answers = np.array([each.value for each in found if isinstance(each, Exposure)])
    assert len(answers) == len(found)
    assert np.ptp(np.log(answers)) < 0.3 * np.log(exposure.RATIO)


def test_blur_of_any_length_shows_the_exposure_where_softness_does_not_explain_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exposure, "PLAIN", 100.0)
    found = exposure.measured(taken(MOVING.recorded, 0.008), 1 / RATE)
    assert isinstance(found, Exposure)
    assert found.value == pytest.approx(MOVING.exposure, rel=0.1)


def test_blur_that_differs_leaves_softness_as_an_explanation() -> None:
    """For blur from before the exposure differs from frame to frame, too."""
    tried = blurred([10.0] * 8, speeds=np.full(8, 1.5 / exposure.RATIO**10))
    longer = np.full((len(tried.exposures), len(exposure.CHANGES)), -9.0)
    longer[10] = 0
    assert least_of(replace(tried, relative=longer)) == least_of(tried) < 0.7 * exposure.RATIO**10


def test_a_clip_that_hardly_moves_does_not_show_its_exposure() -> None:
    found = exposure.measured(taken(Moving(frames=5, reach=0.5).recorded, 0.02), 1 / RATE)
    assert isinstance(found, Unclear)


def test_a_clip_that_does_not_move_at_all_shows_no_exposure() -> None:
    still = [replace(frame, pixels=MOVING.recorded[0].pixels) for frame in MOVING.recorded[:4]]
    assert isinstance(exposure.measured(taken(still, 0.02), 1 / RATE), Unclear)


def test_frames_whose_path_is_wrong_are_outvoted() -> None:
    """Three of eight frames prefer another exposure, the rest agree to a step."""
    tried = np.arange(20.0)
    shown = exposure._shown(exposure._likelihoods(blurred([8, 8, 9, 8, 7, 2, 2, 15], depth=0.3)).sum(axis=0)).sum(axis=1)
    assert shown.sum() == pytest.approx(1)
    assert abs(float(shown @ tried) - 8) < 0.5
    assert float(np.sqrt(shown @ (tried - shown @ tried) ** 2)) < 1


@pytest.mark.parametrize(("dips", "agreed"), [([8, 8, 9, 8, 7, 8], True), ([4, 4, 4, 14, 14, 14], False)])
def test_frames_that_are_sure_and_disagree_leave_the_answer_open(dips: list[int], agreed: bool) -> None:
    tried = blurred(dips)
    assert (exposure._disagreement(exposure._likelihoods(tried), np.log(tried.exposures)) < exposure.VAGUE) == agreed


@pytest.mark.parametrize("soft", [0.0, 2.0])
def test_softness_makes_frames_seem_exposed_the_longer_the_slower_they_move(soft: float) -> None:
    """Frames of 1 to 4 px of blur, exposed for 10 steps; if all seem to be exposed alike, softness has not lengthened that."""
    true, speeds = exposure.RATIO**10, np.geomspace(1, 4, 8) / exposure.RATIO**10
    seen = np.hypot(true, soft / speeds)
    tried = blurred(np.log(seen) / np.log(exposure.RATIO), speeds=speeds)
    assert 0.5 * true < least_of(tried) <= true
    alike = blurred([np.log(seen.mean()) / np.log(exposure.RATIO)] * 8, speeds=speeds)
    assert least_of(alike) > 0.8 * seen.mean()


def test_frames_that_move_alike_do_not_tell_softness_from_a_longer_exposure() -> None:
    seen = exposure.RATIO**10
    for blur, told in ((1.5, False), (8.0, True)):
        tried = blurred([10.0] * 8, speeds=np.full(8, blur / seen))
        assert (least_of(tried) > 0.7 * seen) == told


@pytest.mark.parametrize("growth", [-1.0, 0.0, 0.8])
def test_automatic_exposure_shows_as_an_even_change_from_frame_to_frame(growth: float) -> None:
    steps = np.log(exposure.RATIO)
    times = np.linspace(-0.5, 0.5, 12)
    tried = blurred(10 + growth * times / steps, times=times)
    shown = exposure._shown(exposure._likelihoods(tried).sum(axis=0))
    assert shown.sum(axis=0) @ exposure.CHANGES == pytest.approx(growth, abs=0.15)
    assert shown.sum(axis=1) @ np.log(tried.exposures) == pytest.approx(10 * steps, abs=steps)


def test_a_change_that_hardly_shows_is_hardly_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    times = np.linspace(-0.2, 0.2, 12)
    likely = exposure._likelihoods(blurred(10 + 0.4 * times / np.log(exposure.RATIO), times=times, depth=0.1)).sum(axis=0)

    def change() -> float:
        return float(exposure._shown(likely).sum(axis=0) @ exposure.CHANGES)

    believed = change()
    monkeypatch.setattr(exposure, "STAYS", 0.0)
    assert 0 < believed < 0.7 * change()


@pytest.mark.parametrize(
    ("assumed", "spread", "change"), [(0.018, exposure.ABOUT, 0.8), (0.018, exposure.ABOUT, -0.8), (0.006, np.inf, 0.0)]
)
def test_each_frame_has_the_exposure_that_its_part_of_the_clip_shows(
    assumed: float, spread: float, change: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = taken(MOVING.recorded, assumed)
    true = 0.02 * np.exp(change * (run.begins - run.begins.mean()))
    monkeypatch.setattr(exposure, "compared", no_pairs)
    monkeypatch.setattr(exposure, "_misfits", lambda _run, _path, k, _flow, e: -np.exp(-(np.log(e / true[k]) ** 2) / 0.1))
    assert exposure.of_each(run, spread).exposures == pytest.approx(true, rel=0.1)  # one for all is off by 0.12


@pytest.mark.parametrize("soft", [0.0, 2.0])
def test_an_exposure_that_is_measured_is_without_softness_and_one_that_is_assumed_has_to_come_into_focus_first(
    soft: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of frames whose blur is as long as that of 12 ms, but for the softness in it, 0 or 2 px."""
    run, true, period = taken(MOVING.recorded, 0.018), 0.012, 1 / RATE
    path = exposure.path_from_tracks(run)
    seem = [np.hypot(true, soft * period / exposure._length(run, path, k, period)) for k in range(len(run.begins))]
    monkeypatch.setattr(exposure, "_misfits", lambda _run, _path, k, _flow, e: -np.exp(-(np.log(e / seem[k]) ** 2) / 0.02))
    measured = exposure.of_each(run)
    assert measured.exposures == pytest.approx(np.full(len(seem), true), rel=0.08)
    assert measured.seeming is not None
    assert (measured.seeming > 1.1 * true).all() == (soft > 0)
    assert (exposure.of_each(run, np.inf).exposures > 1.1 * true).all() == (soft > 0)


@pytest.mark.parametrize(("deviation", "shorter"), [(0.1, 0.0), (0.2, 0.2)])
def test_frames_are_restored_with_an_exposure_one_deviation_shorter_than_they_vaguely_show(
    deviation: float, shorter: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = taken(MOVING.recorded, 0.015)
    scale = 2 * len(run.begins) * exposure.INDEPENDENT * deviation**2
    monkeypatch.setattr(exposure, "_misfits", lambda _run, _path, _k, _flow, e: np.log(e / 0.015) ** 2 / scale)
    assert np.log(exposure.of_each(run, np.inf).exposures / 0.015).mean() == pytest.approx(-shorter, abs=0.03)


def test_frames_that_show_no_exposure_have_that_of_the_clip(monkeypatch: pytest.MonkeyPatch) -> None:
    run = taken(MOVING.recorded, 0.018)
    monkeypatch.setattr(exposure, "compared", no_pairs)
    monkeypatch.setattr(exposure, "_misfits", lambda *given: 0 * given[-1])
    for spread in (exposure.ABOUT, np.inf):
        np.testing.assert_array_equal(exposure.of_each(run, spread).exposures, np.full(8, 0.018))
    np.testing.assert_array_equal(exposure.of_each(taken(MOVING.recorded[:2], 0.018)).exposures, [0.018, 0.018])


def test_a_frames_blur_is_compared_once_whatever_is_believed_of_its_exposure(monkeypatch: pytest.MonkeyPatch) -> None:
    run, compared = taken(MOVING.recorded, 0.018), []
    monkeypatch.setattr(
        exposure, "_misfits", lambda _run, _path, k, _flow, e: compared.append(k) or -np.exp(-(np.log(e / 0.02) ** 2) / 0.1)
    )
    shown = exposure.of_each(run)
    np.testing.assert_allclose(exposure.of_each(shown, np.inf).exposures, exposure.of_each(run, np.inf).exposures, rtol=1e-5)
    assert sorted(compared) == list(range(8))


def test_an_exposure_far_below_those_that_are_tried_may_be_stated(monkeypatch: pytest.MonkeyPatch) -> None:
    run = taken(MOVING.recorded, 2e-5)
    monkeypatch.setattr(exposure, "_misfits", lambda _run, _path, _k, _flow, e: -np.exp(-(np.log(e / 0.002) ** 2) / 0.1))
    assert exposure.of_each(run, np.inf).exposures == pytest.approx(np.full(8, 2e-5))  # which leaves too little blur to tell


@pytest.mark.parametrize(("least", "kept"), [(0.012, 0.02), (0.009, 0.01)])
def test_softness_lengthens_no_exposure_but_bears_the_path_out(least: float, kept: float, monkeypatch: pytest.MonkeyPatch) -> None:
    run, shown = taken(MOVING.recorded, 0.01), 0.02
    monkeypatch.setattr(exposure, "_least", lambda *_: least)
    monkeypatch.setattr(exposure, "of_each", lambda run, _: run.exposed(np.full(len(run.begins), shown)))
    monkeypatch.setattr(clip_motion, "votes", lambda run, _path: [1e-3 if run.exposures[0] == shown else -1e-3] * len(run.begins))
    found = exposure.followed(run)
    np.testing.assert_array_equal(found.run.exposures, kept)
    assert found.votes == [1e-3] * len(run.begins)


def test_frames_come_into_focus_exposed_as_long_as_they_seem(monkeypatch: pytest.MonkeyPatch) -> None:
    run, seeming = taken(MOVING.recorded, 0.01), np.full(8, 0.014)
    monkeypatch.setattr(clip_motion, "votes", lambda run, _path: run.exposures.tolist())
    found = clip_motion.Followed.of(replace(run, seeming=seeming))
    assert found.votes == [0.014] * 8
    timing = run.camera.exposed(0.014).timing
    moving = clip_motion.movement_along(found)
    assert moving.exposures == [0.01] * 8
    for one in moving.evidence:
        assert one.seeming == 0.014
        assert one.focused is not None
        np.testing.assert_allclose((one.focused.t0, one.focused.t1), timing.interval)


def test_below_half_a_pixel_of_blur_the_focus_has_no_dip(monkeypatch: pytest.MonkeyPatch) -> None:
    run = taken(MOVING.recorded[:3], 0.018)
    path, tried = exposure.path_from_tracks(run), np.geomspace(2e-4, 0.02, 21)
    found = exposure._misfits(run, path, 1, None, tried)
    monkeypatch.setattr(exposure, "FAINT", 0.0)
    whole = exposure._misfits(run, path, 1, None, tried)
    np.testing.assert_allclose(found, whole, atol=0.01)
    assert (found != whole).any()


def test_a_part_of_a_frames_columns_shows_its_exposure_too(monkeypatch: pytest.MonkeyPatch) -> None:
    run, seen = taken(MOVING.recorded[:3], 0.02), []
    path, tried = exposure.path_from_tracks(run), np.geomspace(0.006, 0.03, 8)
    whole = exposure._misfits(run, path, 1, None, tried)
    run = replace(run, effort=replace(run.effort, exposure_pixels=96 * 128))
    value = exposure.sparsity.value
    monkeypatch.setattr(exposure.sparsity, "value", lambda scene, *given: seen.append(scene.frame.shape) or value(scene, *given))
    assert tried[np.argmin(exposure._misfits(run, path, 1, None, tried))] == tried[np.argmin(whole)]
    assert set(seen) == {(128, 96)}


def test_frames_are_exposed_about_the_middles_that_they_had() -> None:
    camera = camera_of(96, 601, readout=0.02, focal=700.0)
    run = gather(grain(96, 601), camera, Settings())
    changed = run.exposed(np.array([0.005, 0.03]))
    for k, seconds in enumerate([0.005, 0.03]):
        assert changed.timing(k).exposure == changed.scenes[k].camera.timing.exposure == changed.wide[k].camera.timing.exposure == seconds
        assert changed.opens(k) + changed.timing(k).middle == pytest.approx(run.begins[k] + camera.timing.middle)


@pytest.mark.parametrize("rows", [96, 129])
def test_frames_are_seen_as_the_camera_took_them_that_is_known_only_after_they_were_followed(rows: int) -> None:
    frames, camera, guessed = grain(rows, 601), camera_of(rows, 601, readout=0.038, focal=700.0), camera_of(rows, 601, 0.005, 300.0)
    again, known = gather(frames, guessed, Settings()).taken_by(camera), gather(frames, camera, Settings())
    for one, other in zip([*again.scenes, *again.wide], [*known.scenes, *known.wide], strict=True):
        assert one.camera == other.camera
        np.testing.assert_array_equal(one.frame, other.frame)


def test_a_long_blur_is_measured_over_the_whole_width_of_a_frame() -> None:
    run = gather(grain(200, 600), camera_of(200, 600, readout=0.02, focal=700.0), Settings())
    short, long = (scene_at(run, 0, None, blur) for blur in (3.0, 30.0))
    assert short.camera.intrinsics.cols == COLS
    assert (long.scale, long.camera.intrinsics.cols) == (0.5, 300)


def blurred(
    dips: Sequence[float], depth: float = 1.0, times: np.ndarray | None = None, speeds: np.ndarray | None = None
) -> exposure._Tried:
    """Frames whose misfits are least at the exposures of these numbers."""
    numbers = np.arange(20.0)
    misfits = depth * np.array([1 - np.exp(-((numbers - dip) ** 2) / 4) for dip in dips])
    times = np.zeros(len(misfits)) if times is None else times
    speeds = np.full(len(misfits), np.inf) if speeds is None else speeds
    return exposure._Tried(
        exposures=exposure.RATIO**numbers,
        frames=[*range(len(misfits))],
        times=times,
        speeds=speeds,
        misfits=misfits,
        relative=np.zeros((len(numbers), 1)),
    )


def no_pairs(*_: object) -> Pairs:
    return Pairs(exposures=np.geomspace(1e-3, 1e-1, 4), times=np.zeros((0, 2)), misfits=np.zeros((0, 4, 5)))


def least_of(tried: exposure._Tried) -> float:
    """The shortest exposure, s, that softness allows frames to have."""
    return exposure._least(tried)


def grain(rows: int, cols: int) -> list[Frame]:
    """Two frames of noise."""
    pictures = np.random.default_rng(1).random((2, rows, cols, 1), np.float32)
    return [Frame(pixels=each, clipped=np.zeros(each.shape, bool), time=k / RATE, index=k) for k, each in enumerate(pictures)]


def camera_of(rows: int, cols: int, readout: float, focal: float) -> Camera:
    """A camera with 20 ms of exposure."""
    timing = ShutterTiming.from_readout(exposure=0.02, readout=readout, rows=rows)
    return Camera(timing=timing, intrinsics=Intrinsics.centred(focal=focal, rows=rows, cols=cols))


def taken(frames: list[Frame], assumed: float) -> Run:
    """A run of frames with an assumed exposure, whose middles are where they are."""
    size = frames[0].pixels.shape
    moving = Moving(frames=1, rows=size[0], cols=size[1], exposure=assumed)
    shifted = [replace(frame, time=frame.time + (MOVING.exposure - assumed) / 2) for frame in frames]
    return gather(iter(shifted), moving.camera, Settings())
