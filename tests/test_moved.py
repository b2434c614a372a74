"""tests/benchmarks/moved.py says which of a run's figures differ from the published ones."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parent.parent
PUBLISHED = json.loads((CHECKOUT / "docs" / "results.json").read_text(encoding="utf-8"))["sections"]
CASE = PUBLISHED["stills"]["rows"][0]
DB, PX, S = CASE["blind_db"], CASE["path_error_px"], CASE["seconds"]
LATER = round(1.25 * S)  # s, whole as they are published


def moved(file: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, CHECKOUT / "tests" / "benchmarks" / "moved.py", file, *options]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


@pytest.fixture
def run(tmp_path):
    def written(**changes: float) -> Path:
        file = tmp_path / "run.json"
        file.write_text(json.dumps({"options": [], "sections": {"stills": {"rows": [CASE | changes]}}}))
        return file

    return written


def test_the_same_figures_have_not_moved(run):
    done = moved(run(), "--fail")
    assert (done.returncode, done.stdout) == (0, "")
    assert "0 moved" in done.stderr


def test_a_hundredth_of_a_decibel_and_five_hundredths_of_a_time_are_no_move(run):
    assert moved(run(blind_db=DB + 0.01, seconds=1.05 * S), "--fail").returncode == 0


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"blind_db": DB - 0.02}, f"| {CASE['case']} | restored, blind, dB | {DB:g} | {round(DB - 0.02, 2):g} | -0.02 |"),
        ({"path_error_px": PX + 0.02}, f"| {CASE['case']} | path error, px | {PX:g} | {round(PX + 0.02, 2):g} | +0.02 |"),
        ({"seconds": LATER}, f"| {CASE['case']} | time, s | {S:.0f} | {LATER} | +{LATER - S:.2f} (+{LATER / S - 1:.0%}) |"),
    ],
)
def test_what_moved_is_printed_with_before_and_now(run, changes, line):
    done = moved(run(**changes), "--fail")
    assert done.returncode == 1
    assert done.stdout.splitlines()[2:] == [line]
    assert moved(run(**changes)).returncode == 0


def test_a_comparison_is_read_from_its_csv(tmp_path):
    row = PUBLISHED["comparison"]["rows"][0]
    file = tmp_path / "table.csv"
    file.write_text(f"kind,case,none,rsvideo,rectify\npaper800,{row['case']},{row['none']},{row['rsvideo'] + 1},\n")
    done = moved(file)
    assert f"| {row['case']} | rsvideo, dB | {row['rsvideo']:g} | {row['rsvideo'] + 1:g} | +1.00 (" not in done.stdout
    assert f"| {row['case']} | rsvideo, dB | {row['rsvideo']:g} | {row['rsvideo'] + 1:g} | +1.00 |" in done.stdout
    assert "2 figures compared, 1 moved" in done.stderr


def test_a_run_without_published_figures_fails_where_that_is_asked(tmp_path):
    file = tmp_path / "run.json"
    file.write_text(json.dumps({"options": ["--degree", "3"], "sections": {"stills": {"rows": [{"case": "another", "blind_db": 30.0}]}}}))
    done = moved(file, "--fail")
    assert done.returncode == 1
    assert "--degree 3" in done.stderr
