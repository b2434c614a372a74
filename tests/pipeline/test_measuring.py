"""What a clip shows of its shutter, and what is usual of cameras."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import truncnorm

from calibration.timing.cannot_tell import CannotTellError, Likeliest, StabilisedError, TooFewPointsError
from calibration.timing.self_calibration import Explained
from rsvideo.config.request import Camera, Measured, Request, Sections
from rsvideo.physics.camera import Camera as Optics
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.pipeline import clip_facts, clip_frames, measuring, methods
from rsvideo.pipeline.measuring import with_usual
from rsvideo.pipeline.prepare import prepare
from rsvideo.pipeline.take import Take
from rsvideo.restoration import clip_motion, exposure
from rsvideo.restoration.clip_motion import Run, gather
from rsvideo.restoration.settings import Settings
from rsvideo.shooting.fact import Fact
from rsvideo.shooting.timing import Sources, exposure_of, resolve
from rsvideo.shooting.usual import MILD, READOUT, READOUT_SPREAD
from tests.pipeline.moving import RATE, Moving
from tests.video.clips import make

PERIOD = 1 / 30


@pytest.mark.parametrize(
    "shown", [Likeliest(readout=0.010, std=0.004), Likeliest(readout=0.020, std=0.002), Likeliest(readout=0.038, std=0.003)]
)
def test_a_vague_readout_is_drawn_to_the_usual_one_and_never_beyond_a_period(shown: Likeliest) -> None:
    usual, spread = READOUT * PERIOD, READOUT_SPREAD * PERIOD
    precision = shown.std**-2 + spread**-2
    mean, std = (shown.readout * shown.std**-2 + usual * spread**-2) / precision, precision**-0.5
    product = truncnorm(-mean / std, (PERIOD - mean) / std, loc=mean, scale=std)
    assert with_usual(shown, PERIOD) == pytest.approx((product.mean(), product.std()), abs=1e-5)


@pytest.mark.parametrize(
    "shown",
    [
        None,
        Likeliest(readout=-0.01, std=0.002),
        Likeliest(readout=0.03, std=0.011),
        Likeliest(readout=0.003, std=0.004),
        Likeliest(readout=0.006, std=0.004),
    ],
)
def test_no_readout_is_assumed_by_motion_that_shows_none_in_this_direction_or_less_than_is_usual(shown: Likeliest | None) -> None:
    assert with_usual(shown, PERIOD) == (None, 0.0)


@pytest.mark.parametrize(
    ("shown", "words", "spread"),
    [
        (Measured(exposure=0.02, readout=0.01), {}, exposure.ABOUT),
        (Measured(exposure=0.02, readout=0.01), {"exposure": 0.02}, None),
        (Measured(exposure=0.02, deviation=1e-4, readout=0.01), {"exposure": 0.04}, exposure.ABOUT),
        (Measured(readout=0.01), {}, np.inf),
        (Measured(), {}, None),
    ],
)
def test_frames_show_their_own_exposure_where_nobody_states_it_and_their_path_can_be_right(
    shown: Measured, words: dict[str, float], spread: float | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measuring, "measured", lambda *_: shown)
    source = make(tmp_path / "in.mkv")
    request = Request.of(source, tmp_path / "out.mkv", Sections.model_validate({"camera": words}))
    assert prepare(request).treatment.exposure_spread == spread


@pytest.mark.parametrize("in_focus", [True, False])
@pytest.mark.parametrize("shown", [Measured(exposure=0.005, deviation=1e-4, blur=6.0), Measured(most=0.004)])
def test_spectra_contradict_what_is_typed_in_only_where_that_is_not_in_focus(
    shown: Measured, in_focus: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exposure, "in_better_focus", lambda *_: in_focus)
    given, sources = Camera(exposure=0.02), Sources(rows=48, cols=64, fps=30.0)
    shutter = ShutterTiming.from_readout(exposure=0.02, readout=0.01, rows=48)
    run = gather([], Optics(timing=shutter, intrinsics=Intrinsics.centred(focal=60.0, rows=48, cols=64)), Settings())
    kept = measuring._unless_in_focus(shown, run, given, sources)
    taken, notes = exposure_of(given, replace(sources, measured=kept))
    assert taken is not None
    assert (taken.value == 0.02) == in_focus
    assert any("is taken as given" in note for note in notes) == in_focus
    assert any("in focus" in reason for reason in kept.unclear) == in_focus


FILMED = Moving(frames=12, rows=180, cols=240, exposure=0.025, readout=0.015, scene="coffee")


def test_points_in_windows_that_are_displaced_and_blurred_alike_show_a_readout_better() -> None:
    run, direction = gather(FILMED.recorded, FILMED.camera, Settings()), Direction.TOP_TO_BOTTOM
    rough = measuring._readout(run, 1 / RATE, direction)
    shown = exposure.Exposure(value=FILMED.exposure, deviation=0.0, blur=5.0, sharp=FILMED.exposure, least=FILMED.exposure)
    better = measuring._in_matched_blur(run, rough, shown, 1 / RATE, direction)
    assert rough.seconds
    assert better.seconds
    assert not better.unclear
    assert abs(better.seconds / FILMED.readout - 1) < 0.025 < 0.05 < abs(rough.seconds / FILMED.readout - 1)


UPWARDS = replace(FILMED, direction=Direction.BOTTOM_TO_TOP, exposure=0.015)


@pytest.mark.parametrize("stated", [None, Direction.TOP_TO_BOTTOM])
def test_a_readout_that_runs_the_other_way_is_measured_unless_a_direction_is_stated_which_is_contradicted(stated: Direction | None) -> None:
    sources = Sources(rows=UPWARDS.rows, cols=UPWARDS.cols, fps=RATE)
    take = Take(shutter=sources, profile=None, focal=None, notes=())
    given = Camera(direction=stated, focal_px=UPWARDS.lens.fx, exposure=UPWARDS.exposure)
    found = measuring.of_frames(take, given, lambda: UPWARDS.recorded)
    assert found is not None
    resolved = resolve(given, replace(sources, measured=found))
    if stated is Direction.TOP_TO_BOTTOM:
        assert found.readout is None
        assert any("runs bottom-to-top" in reason for reason in found.unclear)
        return
    assert resolved.direction.value is UPWARDS.direction
    assert resolved.readout.value == pytest.approx(UPWARDS.readout, rel=0.05)


@pytest.mark.parametrize(("readout", "turned"), [(-0.012, True), (-0.0025, False), (-0.0015, False), (0.012, False)])
def test_an_uncertain_readout_that_surely_runs_the_other_way_tells_the_direction(
    readout: float, turned: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unclear(*_args: object, **_words: object) -> None:
        raise CannotTellError("parts of the clip disagree", Likeliest(readout=readout, std=0.001 if readout < -0.002 else 0.0002))

    monkeypatch.setattr(measuring, "explain", unclear)
    shown = measuring._readout(gather(FILMED.recorded[:1], FILMED.camera, Settings()), PERIOD, Direction.TOP_TO_BOTTOM)
    assert shown.direction is (Direction.BOTTOM_TO_TOP if turned else None)
    assert (shown.seconds is not None) == (readout > 0)


@pytest.mark.parametrize("error", [CannotTellError("all alike"), StabilisedError("was it stabilised"), TooFewPointsError("only 0 pairs")])
def test_motion_that_shows_no_readout_gives_none_and_too_few_points_say_nothing(
    error: CannotTellError, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unclear(*_args: object, **_words: object) -> None:
        raise error

    monkeypatch.setattr(measuring, "explain", unclear)
    shown = measuring._readout(gather(FILMED.recorded[:1], FILMED.camera, Settings()), PERIOD, Direction.TOP_TO_BOTTOM)
    assert shown.seconds is None
    assert shown.taken == (None if isinstance(error, TooFewPointsError) else 0.0)
    assert Measured(readout=shown.taken, readout_deviation=shown.deviation).readout_guessed
    assert shown.stabilised == isinstance(error, StabilisedError)


@pytest.mark.parametrize(("direction", "seconds"), [(None, 0.0), (Direction.TOP_TO_BOTTOM, 0.0002)])
def test_a_readout_that_motion_shows_to_be_none_is_none(
    direction: Direction | None, seconds: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = Explained(
        readout=0.0002, std=0.0003, direction=direction, curvature=1.0, over_global=0.0, pairs=11, readouts=np.zeros(1), costs=np.zeros(1)
    )
    monkeypatch.setattr(measuring, "explain", lambda *_args, **_words: shown)
    found = measuring._readout(gather(FILMED.recorded[:1], FILMED.camera, Settings()), PERIOD, Direction.TOP_TO_BOTTOM)
    assert (found.seconds, found.taken, found.none) == (seconds, seconds, False)
    assert not Measured(readout=found.taken, readout_deviation=found.deviation).readout_guessed


def test_a_stated_readout_is_taken_and_motion_that_plainly_shows_another_is_told() -> None:
    sources = Sources(rows=FILMED.rows, cols=FILMED.cols, fps=RATE)
    given = Camera(readout=0.007, focal_px=FILMED.lens.fx)
    resolved = resolve(given, replace(sources, measured=measuring.measured(FILMED.recorded, given, sources, FILMED.lens.fx)))
    assert resolved.readout.value == 0.007
    assert any("motion shows a readout of" in note and "7 ms is taken as given" in note for note in resolved.notes)


@pytest.mark.parametrize(("seconds", "unclear"), [(0.013, ()), (0.012, ("vague",)), (None, ("not at all",))])
def test_a_readout_that_is_near_or_vague_contradicts_none(seconds: float | None, unclear: tuple[str, ...]) -> None:
    assert measuring._contrary(measuring._Readout(seconds=seconds, unclear=unclear), 0.017, PERIOD) is None
    assert measuring._contrary(measuring._Readout(seconds=0.012), 0.017, PERIOD) == 0.012
    assert measuring._contrary(measuring._Readout(seconds=0.0001), 0.001, PERIOD) is None
    assert measuring._contrary(NONE, 0.001, PERIOD) is None


IN_BLUR = exposure.Exposure(value=0.02, deviation=0.001, blur=4.0, sharp=0.02, least=0.018)
NONE = measuring._Readout(seconds=None, deviation=0.01, unclear=("readout: all alike",))


@pytest.mark.parametrize(
    ("shown", "contrary"),
    [
        (measuring._Readout(seconds=0.012), 0.012),
        (measuring._Readout(seconds=0.018), None),
        (NONE, 0.0),
        (replace(NONE, stabilised=True), 0.0),
        (measuring._Readout(seconds=None, unclear=("too few points",)), None),
    ],
)
@pytest.mark.parametrize("typed", [False, True])
def test_a_readout_that_nobody_typed_in_gives_way_where_motion_shows_another_or_none(
    shown: measuring._Readout, contrary: float | None, typed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measuring, "_readout", lambda *_args: shown)
    monkeypatch.setattr(clip_motion, "in_matched_blur", lambda run: run)
    monkeypatch.setattr(exposure, "measured", lambda *_: IN_BLUR)
    stated = Fact(value=0.02, source="the profile of Test 1")
    sources = Sources(rows=FILMED.rows, cols=FILMED.cols, fps=RATE, profile_readout=None if typed else stated)
    given = Camera(readout=stated.value if typed else None, focal_px=FILMED.lens.fx)
    taken = measuring.measured(FILMED.recorded, given, sources, FILMED.lens.fx)
    resolved = resolve(given, replace(sources, measured=taken))
    assert taken.contrary == contrary
    assert resolved.readout.value == (stated.value if typed or contrary is None else contrary)
    assert taken.readout_guessed == (not typed and contrary == 0)
    words = "taken as given" if typed else "--readout takes another"
    assert sum(words in note for note in resolved.notes) == (contrary is not None)
    assert measuring.measured(FILMED.recorded, given.model_copy(update={"force": True}), sources, FILMED.lens.fx).readout == stated.value


@pytest.mark.parametrize(
    ("found", "taken"),
    [
        (IN_BLUR, 0.02),
        (exposure.Unclear(reason="", most=0.03), MILD * PERIOD),
        (exposure.Unclear(reason="", most=0.002), 0.002),
        (exposure.Unclear(reason=""), MILD * PERIOD),
    ],
)
@pytest.mark.parametrize(
    "again", [measuring._Readout(seconds=0.012), measuring._Readout(seconds=0.008, deviation=0.001, unclear=("vague",))]
)
@pytest.mark.parametrize(
    "before", [measuring._Readout(seconds=0.01), measuring._Readout(seconds=0.01, deviation=0.002, unclear=("vague",))]
)
def test_an_answer_stays_where_points_in_matched_blur_give_none(
    before: measuring._Readout,
    again: measuring._Readout,
    found: exposure.Exposure | exposure.Unclear,
    taken: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    matched = list[Run]()
    monkeypatch.setattr(clip_motion, "in_matched_blur", lambda run: matched.append(run) or run)
    tried = list[float | None]()
    monkeypatch.setattr(measuring, "_readout", lambda *given: tried.append(given[-2]) or again)
    shutter = ShutterTiming.from_readout(exposure=0.02, readout=0.01, rows=48)
    run = gather([], Optics(timing=shutter, intrinsics=Intrinsics.centred(focal=60.0, rows=48, cols=64)), Settings())
    run = replace(run, begins=np.arange(3) * PERIOD, exposures=np.full(3, 0.02))
    better = measuring._in_matched_blur(run, before, found, PERIOD, Direction.TOP_TO_BOTTOM)
    assert better is (before if again.unclear and not before.unclear else again)
    np.testing.assert_allclose(matched[0].exposures, taken)
    assert tried == [None if before.unclear else 0.01]


def test_a_clip_s_bits_count_in_what_is_measured_and_in_what_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs = list[Run]()
    monkeypatch.setattr(exposure, "measured", lambda run, _: runs.append(run) or IN_BLUR)
    measuring.measured(FILMED.recorded, Camera(), Sources(rows=FILMED.rows, cols=FILMED.cols, fps=RATE, bits=50.0), FILMED.lens.fx)
    assert {run.bits for run in runs} == {50.0}
    path = make(tmp_path / "in.mkv", frames=4)
    assert 0 < (bits := clip_facts.gather(path).shutter.bits) < np.inf
    task = prepare(Request.of(path, tmp_path / "out.mkv", Sections()))
    monkeypatch.setattr(exposure, "of_each", lambda run, _: run)
    assert methods.run_of(task.treatment, clip_frames.decoded(task.stream, 0, 4)).bits == bits
