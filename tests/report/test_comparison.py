import csv
import io
import json
import math

import pytest

from rsvideo.report import numbers
from rsvideo.report.comparison import best
from rsvideo.report.numbers import as_csv, as_json
from rsvideo.report.summary import summary
from tests.report.comparisons import FRAMES, comparison, entry


def test_the_nearest_to_the_truth_is_told_with_its_lead() -> None:
    first, *_ = summary(comparison())
    assert "rsvideo comes closest to the truth, 31.00 dB on average over 3 frames" in first
    assert "10.00 dB more than the recording" in first
    assert "3.00 dB more than uniform" in first


def test_frames_on_which_another_method_wins_are_named() -> None:
    assert "Another method is closer on 1 frame: 2." in summary(comparison())


def test_a_baseline_that_wins_is_said_to_win() -> None:
    entries = (entry("rsvideo", {"psnr": [30, 30, 30]}), entry("uniform", {"psnr": [33, 33, 33]}))
    told = summary(comparison(entries=entries))
    assert told[0].startswith("uniform comes closest to the truth, 33.00 dB")
    assert "rsvideo is 3.00 dB behind uniform here." in told


def test_a_method_without_a_result_is_named() -> None:
    assert "stitch gave no result; why stands below." in summary(comparison())


def test_edges_sharper_than_the_truths_are_not_best() -> None:
    assert best(comparison(), "edge_width") == {"rsvideo"}  # 2.1 px, the truth has 2.0, uniform 1.5
    without = comparison(entries=comparison().entries[:-1], truth=None)
    assert best(without, "edge_width") == {"uniform"}
    assert "uniform has the better edge width (1.50 px against 2.10) and the better ringing (0.40 % against 0.50)." in summary(without)


def test_the_recording_never_wins_by_its_blur() -> None:
    assert best(comparison(), "ringing") == {"uniform"}  # 0.4 %, the recording has 0.1 %


def test_methods_that_read_the_same_share_the_first_place() -> None:
    entries = (entry("a", {"psnr": [30.001] * 3}), entry("b", {"psnr": [30.004] * 3}), entry("c", {"psnr": [29.9] * 3}))
    assert best(comparison(entries=entries), "psnr") == {"a", "b"}
    assert best(comparison(entries=entries[:1]), "psnr") == frozenset()  # who runs alone does not win


def test_without_truth_nobody_is_said_to_be_closest() -> None:
    entries = (entry("rsvideo", {"edge_width": [2.0] * 3}), entry("uniform", {"edge_width": [2.5] * 3}))
    assert "no truth" in summary(comparison(entries=entries, truth=None))[0]


def test_csv_and_json_hold_the_same_numbers() -> None:
    lines = list(csv.DictReader(io.StringIO(as_csv(comparison()).decode())))
    held = json.loads(as_json(comparison()))
    assert len(lines) == 4 * FRAMES
    for entry_ in held["entries"]:
        mine = [line for line in lines if line["entry"] == entry_["name"]]
        assert [float(line["psnr"]) if line["psnr"] else None for line in mine] == [frame["psnr"] for frame in entry_["frames"]]
    failed = next(entry_ for entry_ in held["entries"] if entry_["name"] == "stitch")
    assert (failed["fault"], failed["mean"]["psnr"]) == ("<b>no</b> texture", None)
    assert held["best"]["psnr"] == ["rsvideo"]
    assert "NaN" not in as_json(comparison()).decode()


def test_several_comparisons_share_their_files() -> None:
    several = [comparison(), comparison(title="other.mp4")]
    lines = list(csv.DictReader(io.StringIO(numbers.all_csv(several).decode())))
    assert [line["input"] for line in lines[:: 4 * FRAMES]] == ["clip.mp4", "other.mp4"]
    assert len(json.loads(numbers.all_json(several))["inputs"]) == 2


def test_frames_without_a_measure_do_not_count_in_its_mean() -> None:
    some = entry("a", {"flicker": [math.nan, 0.2, 0.4]})
    assert some.mean("flicker") == pytest.approx(0.3)
    assert some.worst("flicker") == 0.4
    assert math.isnan(some.mean("psnr"))
