"""Who says when a clip's rows collect light, and what is refused."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsvideo.config.request import Camera, Measured
from rsvideo.physics.shutter import Direction
from rsvideo.shooting.fact import Fact
from rsvideo.shooting.readout_table import Readout
from rsvideo.shooting.timing import Sources, exposure_of, readout_of, resolve

TABLE = Readout(median=0.014, low=0.013, high=0.016, n=7, direction=Direction.TOP_TO_BOTTOM, mode="640 x 480 at 25 fps")
STATED = Sources(
    rows=480,
    cols=640,
    fps=25.0,
    exposure=Fact(value=0.01, source="the clip's metadata"),
    readout=Fact(value=0.012, source="GoPro's telemetry"),
    profile_readout=Fact(value=0.013, source="the profile of Test 1", within=(0.0129, 0.0131)),
    table=TABLE,
)
NOTHING = Sources(rows=480, cols=640, fps=25.0)


def without(*names: str) -> Sources:
    return replace(STATED, **dict.fromkeys(names))


@pytest.mark.parametrize(
    ("camera", "missing", "readout", "source"),
    [
        (Camera(readout=0.011), (), 0.011, "explicit"),
        (Camera(row_time=1e-5), (), 0.0048, "explicit"),
        (Camera(scanlines_total=600), (), 480 / (25 * 600), "frame rate and 600 total scanlines"),
        (Camera(), (), 0.012, "GoPro's telemetry"),
        (Camera(), ("readout",), 0.013, "the profile of Test 1"),
        (Camera(), ("readout", "profile_readout"), 0.014, "public table, the median of 7 owners for 640 x 480 at 25 fps"),
        (Camera(), ("readout", "profile_readout", "table"), 0.04, "frame rate"),
    ],
)
def test_the_first_source_that_answers_wins(camera: Camera, missing: tuple[str, ...], readout: float, source: str) -> None:
    resolved = resolve(camera, without(*missing))
    assert resolved.timing.readout == pytest.approx(readout)
    assert resolved.readout.source == source
    assert resolved.source == f"exposure: the clip's metadata; readout: {source}"


def test_uncertainty_comes_along() -> None:
    assert resolve(Camera(), without("readout")).readout.within == (0.0129, 0.0131)
    assert resolve(Camera(), without("readout", "profile_readout")).readout.within == (0.013, 0.016)


@pytest.mark.parametrize(
    ("camera", "exposure"), [(Camera(exposure=0.02), 0.02), (Camera(shutter_angle=90), 0.01), (Camera(shutter_angle=360), 0.04)]
)
def test_exposure_is_given_as_time_or_as_angle(camera: Camera, exposure: float) -> None:
    assert resolve(camera, STATED).timing.exposure == pytest.approx(exposure)


def test_one_source_of_both_is_told_once() -> None:
    assert resolve(Camera(exposure=0.02, readout=0.01), STATED).source == "explicit"


def test_the_frame_rate_alone_is_an_upper_bound_and_is_flagged() -> None:
    resolved = resolve(Camera(exposure=0.02), NOTHING)
    assert resolved.timing.readout == pytest.approx(1 / 25)
    assert resolved.readout.within == (0.0, 1 / 25)
    assert any("only its upper bound" in note and "--scanlines-total" in note for note in resolved.notes)


@given(st.integers(480, 2000), st.floats(1, 240))
def test_stored_rows_and_delay_fill_the_period(total: int, fps: float) -> None:
    timing = resolve(Camera(exposure=0.5 / fps, scanlines_total=total), replace(NOTHING, fps=fps)).timing
    delay = (total - 480) * timing.row_time  # t_d of Forssen & Ringaby
    assert timing.readout + delay == pytest.approx(1 / fps)


def test_sources_that_differ_are_told() -> None:
    notes = resolve(Camera(), STATED).notes
    assert notes == (
        "readout 12 ms by GoPro's telemetry, but 13 ms by the profile of Test 1",
        "readout 12 ms by GoPro's telemetry, but 14 ms by public table, the median of 7 owners for 640 x 480 at 25 fps",
    )
    vague = replace(TABLE, low=0.010)
    assert all("public table" not in note for note in resolve(Camera(), replace(STATED, table=vague)).notes)
    assert resolve(Camera(readout=0.02), STATED).notes == ()


@pytest.mark.parametrize(
    ("stated", "why"),
    [
        (
            {"readout": 0.0405},
            r"readout must be at most one frame's period, 40 ms at 25 fps, got 40.5 ms; is it in milliseconds|slowed down",
        ),
        ({"readout": 20.0}, r"readout must lie in \[0, 1\] s, got 20 s; is it in milliseconds\?"),
        ({"readout": 0.9}, r"readout must be at most one frame's period.*got 900 ms; is it in milliseconds\?"),
        ({"readout": -0.01}, r"readout must not be negative"),
        ({"readout": float("nan")}, r"readout must be a time"),
        ({"row_time": 0.0157}, r"row-time must let 480 rows be read in 1 s, got 0.0157 s a row; is it in milliseconds or microseconds\?"),
        ({"row_time": -1e-5}, r"row_time must not be negative"),
        ({"scanlines_total": 479}, r"scanlines-total must be at least the 480 that are stored, got 479"),
        (
            {"readout": 0.01, "row_time": 1e-5},
            r"only one of --readout, --row-time, --scanlines-total may be given, got --readout and --row-time",
        ),
        ({"exposure": 0.02, "shutter_angle": 180}, r"only one of --exposure and --shutter-angle"),
        ({"exposure": 0.041}, r"exposure must be at most one frame's period"),
        ({"exposure": 20.0}, r"exposure must lie in \(0, 1\] s, got 20 s; is it in milliseconds\?"),
        ({"exposure": 0.0}, r"exposure must lie in"),
        ({"shutter_angle": 0}, r"shutter_angle must lie in \(0, 360\] degrees, got 0"),
        ({"shutter_angle": 361}, r"shutter_angle must lie in \(0, 360\] degrees, got 361"),
        ({"shutter_angle": float("nan")}, r"shutter_angle must lie in"),
    ],
)
def test_what_cannot_be_is_refused_with_the_likely_slip(stated: dict[str, float], why: str) -> None:
    with pytest.raises(ValueError, match=why):
        resolve(Camera.model_validate(stated), STATED)


def test_rounding_may_exceed_the_period_by_a_hundredth() -> None:
    assert resolve(Camera(readout=0.0403, exposure=0.0403), STATED).timing.readout == pytest.approx(0.0403)


def test_force_takes_times_beyond_the_period() -> None:
    timing = resolve(Camera(readout=0.06, exposure=0.05, force=True), STATED).timing
    assert (timing.readout, timing.exposure) == (pytest.approx(0.06), 0.05)


def test_a_source_that_says_what_cannot_be_is_passed_over_with_a_note() -> None:
    odd = replace(STATED, readout=Fact(value=20.6, source="GoPro's telemetry"))
    resolved = resolve(Camera(), odd)
    assert resolved.readout.source == "the profile of Test 1"
    assert resolved.notes[0].startswith(
        "passed over what GoPro's telemetry says: readout must lie in [0, 1] s, got 20.6 s; is it in milliseconds?"
    )
    slow = replace(STATED, exposure=Fact(value=0.5, source="EXIF"))
    with pytest.raises(ValueError, match="exposure must be given"):
        resolve(Camera(), slow)


def test_an_exposure_that_nobody_says_is_asked_for() -> None:
    with pytest.raises(ValueError, match=r"exposure must be given.*--shutter-angle 180"):
        resolve(Camera(), NOTHING)


def test_a_photograph_needs_a_readout() -> None:
    photograph = Sources(rows=480, cols=640, exposure=Fact(value=0.01, source="EXIF"))
    with pytest.raises(ValueError, match="readout must be given"):
        resolve(Camera(), photograph)
    for camera in (Camera(scanlines_total=500), Camera(shutter_angle=180, readout=0.01)):
        with pytest.raises(ValueError, match="needs a frame rate, a photograph has none"):
            resolve(camera, photograph)
    assert resolve(Camera(readout=0.0), photograph).timing.row_time == 0


def test_a_sideways_readout_counts_columns() -> None:
    resolved = resolve(Camera(readout=0.016, direction=Direction.LEFT_TO_RIGHT), STATED)
    assert (resolved.timing.rows, resolved.timing.row_time) == (640, pytest.approx(25e-6))
    assert resolved.direction.source == "explicit"


def test_the_direction_has_its_own_first_source() -> None:
    upwards = Fact(value=Direction.BOTTOM_TO_TOP, source="the profile of Test 1")
    assert resolve(Camera(), STATED).direction == Fact(value=Direction.TOP_TO_BOTTOM, source="assumed", assumed=True)
    assert resolve(Camera(), replace(STATED, profile_direction=upwards)).timing.direction is Direction.BOTTOM_TO_TOP
    downwards = Fact(value=Direction.TOP_TO_BOTTOM, source="metadata")
    assert resolve(Camera(), replace(STATED, profile_direction=upwards, direction=downwards)).direction is downwards
    table = replace(TABLE, direction=Direction.BOTTOM_TO_TOP)
    assert resolve(Camera(), replace(STATED, table=table)).direction.source == "public table"


def test_nothing_is_asked_of_a_photograph_that_says_nothing() -> None:
    assert readout_of(Camera(), Sources(rows=4, cols=4)) == (None, ())


MEASURED = replace(NOTHING, measured=Measured(exposure=0.004, deviation=0.0002, least=0.003, readout=0.016))


def test_what_nobody_states_is_measured() -> None:
    found = resolve(Camera(), MEASURED)
    assert (found.exposure.value, found.readout.value) == (0.004, 0.016)
    assert found.exposure.source == "measured from the clip's blur"
    assert not any(fact.assumed for fact in (found.exposure, found.readout))
    assert found.exposure.within == pytest.approx((0.0036, 0.0044))


def test_what_is_measured_is_taken_without_softness() -> None:
    """Too long a stated one gives way to it, too, where blur contradicts that by itself, softness included."""
    assert MEASURED.measured is not None
    soft = replace(NOTHING, measured=MEASURED.measured.model_copy(update={"sharp": 0.0035}))
    taken = resolve(Camera(), soft)
    assert (taken.exposure.value, taken.by_blur) == (0.0035, True)
    found, (note,) = exposure_of(Camera(exposure=0.02), soft)
    assert found is not None
    assert found.value == 0.0035
    assert "5 times shorter" in note
    assert "is it 1/286 s? 3.5 ms is taken" in note


def test_what_cannot_be_measured_is_assumed_short() -> None:
    found = resolve(Camera(), replace(NOTHING, measured=Measured(unclear=("too little blur",))))
    assert (found.exposure.value, found.readout.value) == (0.01, 0.01)
    assert all(fact.assumed for fact in (found.exposure, found.readout))


def test_no_readout_is_taken_where_motion_shows_none() -> None:
    shown = Measured(readout=0.0, readout_deviation=0.02, unclear=("readout: was it stabilised?",))
    found = resolve(Camera(), replace(NOTHING, measured=shown)).readout
    assert (found.value, found.assumed, found.within, shown.readout_guessed) == (0.0, True, (0.0, 0.04), True)
    assert "shows none" in found.source
    assert not Measured(readout=0.0).readout_guessed  # of a global shutter that was measured


def test_a_readout_that_is_only_likely_is_assumed_within_its_spread() -> None:
    likely = Measured(readout=0.016, readout_deviation=0.003, unclear=("readout: too few frames",))
    found = resolve(Camera(), replace(NOTHING, measured=likely)).readout
    assert (found.value, found.assumed) == (0.016, True)
    assert found.within == pytest.approx((0.010, 0.022))
    short = likely.model_copy(update={"readout": 0.004})
    assert resolve(Camera(), replace(NOTHING, measured=short)).readout.within == pytest.approx((0.0, 0.010))


def test_what_blur_bounds_is_assumed_no_longer() -> None:
    bounded = replace(NOTHING, measured=Measured(most=0.004, unclear=("too little blur",)))
    assert resolve(Camera(), bounded).exposure.value == 0.004
    found, (note,) = exposure_of(Camera(exposure=0.02), bounded)
    assert found is not None
    assert found.value == 0.004
    assert "at least 5 times shorter than an exposure of 1/50 s" in note
    for stated in (0.001, 0.0045):
        assert exposure_of(Camera(exposure=stated), bounded)[1] == ()
    loose = replace(NOTHING, measured=Measured(most=0.03, unclear=("too little blur",)))
    assert resolve(Camera(), loose).exposure.value == 0.01


@pytest.mark.parametrize(("stated", "words"), [(0.02, "5 times shorter than an exposure of 1/50 s"), (0.0008, "5 times longer")])
def test_an_exposure_that_the_blur_contradicts_is_not_taken(stated: float, words: str) -> None:
    found, (note,) = exposure_of(Camera(exposure=stated), MEASURED)
    assert found is not None
    assert found.value == 0.004
    assert words in note
    assert "is it 1/250 s?" in note
    forced, notes = exposure_of(Camera(exposure=stated, force=True), MEASURED)
    assert forced is not None
    assert (forced.value, notes) == (stated, ())


@pytest.mark.parametrize("stated", [None, Direction.TOP_TO_BOTTOM, Direction.BOTTOM_TO_TOP])
def test_motion_tells_the_direction_where_nobody_states_it_and_contradicts_one_that_is_stated(stated: Direction | None) -> None:
    shown = replace(NOTHING, measured=Measured(exposure=0.004, readout=0.016, direction=Direction.BOTTOM_TO_TOP))
    found = resolve(Camera(direction=stated, readout=0.02), shown)
    assert found.direction.value is found.timing.direction is (stated or Direction.BOTTOM_TO_TOP)
    assert any("its readout runs bottom-to-top" in note for note in found.notes) == (stated is Direction.TOP_TO_BOTTOM)


def test_a_stated_readout_of_a_stabilised_clip_is_taken_and_the_user_is_told() -> None:
    shown = replace(NOTHING, measured=Measured(exposure=0.004, readout=0.02, stabilised=True))
    found = resolve(Camera(readout=0.02), shown)
    assert found.readout.value == 0.02
    assert any("was it stabilised? 20 ms is taken as given" in note for note in found.notes)
    assert not any("stabilised" in note for note in resolve(Camera(), shown).notes)


@pytest.mark.parametrize(
    ("contrary", "words"), [(0.01, "motion shows one of 10 ms: that is taken"), (0.0, "as if it was stabilised: none is taken")]
)
def test_what_the_clip_shows_against_a_readout_is_taken_where_nobody_typed_that_in(contrary: float, words: str) -> None:
    shown = replace(STATED, measured=Measured(readout=contrary, readout_deviation=0.0 if contrary else 0.02, contrary=contrary))
    found, notes = readout_of(Camera(), shown)
    assert found is not None
    assert found.value == contrary
    assert any("12 ms by GoPro's telemetry" in note and words in note for note in notes)
    assert readout_of(Camera(force=True), shown)[0] == readout_of(Camera(), STATED)[0]
    typed, notes = readout_of(Camera(readout=0.02), shown)
    assert typed is not None
    assert typed.value == 0.02
    assert any("20 ms is taken as given" in note for note in notes)
    assert readout_of(Camera(readout=0.02, force=True), shown)[1] == ()


def test_softness_explains_a_shorter_exposure_and_the_user_is_told() -> None:
    explained = "softness of lens or codec, or blur from before, explains"
    for least, taken, words in ((0.002, 0.0025, explained), (0.003, 0.004, "is it 1/250 s?")):
        soft = replace(NOTHING, measured=Measured(exposure=0.004, deviation=0.0002, least=least))
        found, (note,) = exposure_of(Camera(exposure=0.0025), soft)
        assert found is not None
        assert found.value == taken
        assert "1.6 times longer than an exposure of 1/400 s" in note
        assert words in note


def test_an_exposure_that_nothing_checks_is_taken_as_given_and_the_user_is_told() -> None:
    shown = Measured(most=0.004, unclear=("focal length: vague", "exposure: its motion leaves too little blur"))
    found, (note,) = exposure_of(Camera(exposure=0.002), replace(NOTHING, measured=shown))
    assert found is not None
    assert found.value == 0.002
    assert note.endswith("1/500 s is taken as given, since the clip does not show its own: its motion leaves too little blur")


def test_an_exposure_that_an_uncertain_one_contradicts_is_taken_as_given_and_the_user_is_told() -> None:
    vague = replace(NOTHING, measured=Measured(exposure=0.004, deviation=0.0005, least=0.003))
    found, (note,) = exposure_of(Camera(exposure=0.002), vague)
    assert found is not None
    assert found.value == 0.002
    assert note.endswith("1/500 s is taken as given, though the clip may contradict it: its blur shows 4 ms, give or take 0.5 ms")
    assert exposure_of(Camera(exposure=0.0035), vague)[1] == ()


@pytest.mark.parametrize(("least", "told"), [(0.004, True), (0.0022, False)])
def test_an_exposure_that_even_softness_does_not_lengthen_to_the_clips_blur_is_told_though_blur_does_not_show_it(
    least: float, told: bool
) -> None:
    shown = Measured(most=0.02, least=least, unclear=("exposure: its motion leaves too little blur",))
    found, (note,) = exposure_of(Camera(exposure=0.002), replace(NOTHING, measured=shown))
    assert found is not None
    assert found.value == 0.002
    assert ("at least 2 times longer than softness and an exposure of 1/500 s leave; is it 1/250 s or longer?" in note) == told


@pytest.mark.parametrize("stated", [0.0034, 0.0045])
def test_an_exposure_that_the_blur_bears_out_is_taken(stated: float) -> None:
    found, notes = exposure_of(Camera(exposure=stated), MEASURED)
    assert found is not None
    assert (found.value, notes) == (stated, ())
