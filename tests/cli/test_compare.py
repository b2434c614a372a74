"""`rsvideo compare`: with quick methods through a real command, and what it refuses."""

import csv
import json
import subprocess
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from rsvideo.cli import app, exit_codes, options
from rsvideo.comparison import method_run
from rsvideo.progress import ignore
from tests.cli.forked import call
from tests.pipeline.moving import Moving, encode, planes

CLIP = Moving(frames=3, rows=64, cols=96, reach=6.0)
GOOD = ("--exposure", "1/50", "--readout", "20ms", "--focal-px", str(CLIP.lens.fx))
STAND_IN = Path(__file__).with_name("compare_stand_in.py")


def compare(*words: object) -> subprocess.CompletedProcess[str]:
    return call("compare", *words, program=STAND_IN)


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of cases with one clip and one still."""
    folder = tmp_path_factory.mktemp("cases")
    said = {"exposure_s": 0.02, "row_time_s": 0.02 / 64, "focal_px": CLIP.lens.fx, "kind": "what else is said does not matter"}
    for home in (folder / "clips" / "sway_64", folder / "stills" / "shift_00"):
        home.mkdir(parents=True)
        (home / "case.json").write_text(json.dumps(said))
    CLIP.clip(folder / "clips/sway_64/clip.mp4")
    encode(folder / "clips/sway_64/truth.mp4", [planes(r.truth) for r in CLIP.renderings])
    for name, light in (("blurred", CLIP.renderings[0].blurred), ("truth", CLIP.renderings[0].truth)):
        codes = np.rint(255 * np.clip(light[..., 0], 0, 1) ** (1 / 2.2)).astype(np.uint8)
        cv2.imwrite(str(folder / "stills" / "shift_00" / f"{name}.png"), codes)
    return folder


@pytest.fixture
def clip(case: Path) -> Path:
    return case / "clips" / "sway_64" / "clip.mp4"


def refused(*words: object) -> tuple[int, str]:
    """The exit code and the line of a request that comes to nothing."""
    with pytest.raises(Exception) as error:  # noqa: PT011 # the tests check its kind
        app(["compare", *map(str, words)], standalone_mode=False)
    return exit_codes.code_and_line(error.value)


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Methods run here, one after the other: starting processes takes longer than what they do."""

    def runs_of(orders, *, most, quiet, observe) -> Iterator[method_run.MethodRun]:
        for order in orders:
            order.request.output.parent.mkdir(parents=True, exist_ok=True)
            yield method_run.carried_out(order, observe)

    monkeypatch.setattr(method_run, "runs_of", runs_of)


@pytest.mark.slow
def test_each_method_stands_in_the_report_and_a_failing_one_fails_alone(clip: Path, tmp_path: Path) -> None:
    report, truth = tmp_path / "report", clip.with_name("truth.mp4")
    words = (clip, "-o", report, "--truth", truth, "--methods", "rsvideo,uniform,stitch", *GOOD, "--crop", "8,8,32,24")
    done = compare(*words, "--json", "-j", 3)
    assert done.returncode == 1, done.stderr
    assert sorted(path.name for path in report.iterdir()) == ["index.html", "report.csv", "report.json", "results"]
    held = json.loads(done.stdout)
    entries = {entry["name"]: entry for entry in held["entries"]}
    assert list(entries) == ["recorded", "rsvideo", "uniform", "stitch", "truth"]
    assert entries["uniform"]["fault"] == "no kernel was found"
    assert "killed by SIGKILL" in entries["stitch"]["fault"]
    assert [frame["verdict"] for frame in entries["rsvideo"]["frames"]] == ["restored"] * 3
    assert all(frame["psnr"] > 10 and 0 <= frame["whiteness"] <= 1 for frame in entries["rsvideo"]["frames"])
    assert entries["rsvideo"]["seconds"] > 0
    assert 50e6 < entries["rsvideo"]["peak_bytes"] < 4e9
    assert held["crops"][0] == [8, 8, 32, 24]
    assert "no kernel was found" in (report / "index.html").read_text(encoding="utf-8")
    with (report / "report.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 9  # the recording, rsvideo and the truth, three frames each
    assert "uniform failed: no kernel was found" in done.stderr
    code, line = refused(*words)
    assert (code, "give --overwrite" in line) == (4, True)


@pytest.mark.slow
def test_what_was_done_is_taken_over_unless_the_request_has_changed(clip: Path, tmp_path: Path) -> None:
    def order(readout: str = "20ms") -> method_run.Order:
        given = {"deblur.method": "none", "camera.exposure": "1/50", "camera.readout": readout}
        return method_run.Order(request=options.request(clip, tmp_path / "none" / "clip.mp4", given))

    (made,) = method_run.all_of([order()], observe=ignore)
    assert made.fault is None
    taken = method_run.kept(order())
    assert taken == made
    assert method_run.kept(order(readout="10ms")) is None
    made.output.unlink()
    assert method_run.kept(order()) is None


@pytest.mark.usefixtures("in_this_process")
def test_a_table_has_a_row_a_case_and_a_dash_where_a_method_does_not_apply(case: Path, tmp_path: Path) -> None:
    table = tmp_path / "table.md"
    assert app(["compare", "--table", str(case), "-o", str(table), "--methods", "none,rectify"], standalone_mode=False) == 0
    header, _, still, moving, *means = table.read_text().splitlines()
    assert header == "| PSNR, dB | none | rectify |"
    assert still.split("|")[1:4:2] == [" shift_00 ", " - "]
    assert moving.startswith("| sway_64 |")
    assert "**" in moving
    assert any("rectify: sees the motion between frames" in line for line in means)
    results = tmp_path / "table_results"
    assert (results / "rectify" / "sway_64.mp4").exists()
    assert (results / "none" / "shift_00.png").read_bytes() == (case / "stills/shift_00/blurred.png").read_bytes()


@pytest.mark.usefixtures("in_this_process")
def test_every_clip_of_a_job_gets_a_page_and_all_an_index(clip: Path, tmp_path: Path) -> None:
    job = tmp_path / "job.yaml"
    job.write_text(
        f"report: {{ methods: [none], truth: 'truth{{ext}}', crops: [[8, 8, 32, 24]] }}\n"
        f"clips:\n  - source: {clip}\n    camera: {{ exposure: 1/50, readout: 20ms, focal_px: {CLIP.lens.fx} }}\n"
    )
    assert app(["compare", str(job), "-o", str(tmp_path / "report")], standalone_mode=False) == 0
    (told,) = json.loads((tmp_path / "report" / "report.json").read_text())["inputs"]
    assert told["truth"] == str(clip.with_name("truth.mp4"))
    assert told["crops"][0] == [8, 8, 32, 24]
    index = (tmp_path / "report" / "index.html").read_text()
    assert 'href="clip_rsvideo/index.html"' in index
    assert (tmp_path / "report" / "clip_rsvideo" / "index.html").exists()


def test_a_method_that_is_not_known_is_named_with_the_one_that_was_meant(clip: Path, tmp_path: Path) -> None:
    assert refused(clip, "-o", tmp_path / "r", "--methods", "none,unifrom") == (2, "there is no method unifrom; did you mean uniform?")


@pytest.mark.parametrize(
    ("words", "code", "part"),
    [
        (("--methods", " , "), 2, "--methods must name at least one method"),
        (("--crop", "1,2,3"), 2, "crop must read like 120,80,160,120"),
        (("--crop", "80,8,64,32", *GOOD), 2, "crop must lie within the picture of 96 x 64 px"),
        (("--truth", "gone.mp4", *GOOD), 3, "gone.mp4"),
        (("--methods", "gyro", "--gyro", "gone.gcsv", *GOOD), 3, "gone.gcsv"),
        (("--set", "camera.exposure=1/50"), 2, "--set is for a job's file"),
        (("--methods", "gyro", "--gyro", "LOG", "--gyro-offset", "1000", "--gyro-axes", "XYZ", *GOOD), 2, "gyro log must cover the clip"),
    ],
    ids=["no methods", "half a crop", "crop outside", "no truth", "no log", "set", "log of another time"],
)
def test_a_wrong_request_is_one_line(clip: Path, tmp_path: Path, words: tuple[str, ...], code: int, part: str) -> None:
    methods = () if "--methods" in words else ("--methods", "none")
    log = tmp_path / "short.csv"
    log.write_text("".join(f"{k * 10**6} {0.2 * np.sin(k / 7)} {0.3 * np.cos(k / 9)} 0.1\n" for k in range(60)))
    words = tuple(str(log) if word == "LOG" else word for word in words)
    told = refused(clip, "-o", tmp_path / "r", *methods, *words)
    assert told[0] == code, told
    assert part in told[1]
    assert "\n" not in told[1]
    assert not (tmp_path / "r").exists()


def test_a_photograph_that_does_not_say_its_exposure_is_refused(case: Path, tmp_path: Path) -> None:
    code, line = refused(case / "stills/shift_00/blurred.png", "-o", tmp_path / "r", "--methods", "uniform")
    assert (code, "exposure must be given" in line) == (2, True), line


@pytest.mark.usefixtures("in_this_process")
def test_methods_get_one_shutter_where_nobody_states_it(clip: Path, tmp_path: Path) -> None:
    app(["compare", str(clip), "-o", str(tmp_path / "r"), "--methods", "none,rectify,uniform"], standalone_mode=False)
    frames = [json.loads((tmp_path / f"r/results/{name}/clip.rsvideo.json").read_text())["frames"] for name in ("rectify", "uniform")]
    shutters = [[frame["timing"] for frame in each] for each in frames]
    assert len(shutters[0]) == 3
    assert shutters[0] == shutters[1]


def test_a_truth_of_another_size_or_length_is_refused(clip: Path, tmp_path: Path) -> None:
    other = Moving(frames=2, rows=64, cols=96)
    shorter = other.clip(tmp_path / "shorter.mp4")
    wide = Moving(frames=3, rows=64, cols=128).clip(tmp_path / "wide.mp4")
    for truth, words in ((shorter, "must have as many frames as the input, 3,"), (wide, "must be of the input's size, 96 x 64,")):
        code, line = refused(clip, "-o", tmp_path / "r", "--methods", "none", "--truth", truth)
        assert (code, words in line) == (2, True), line


def test_a_still_is_not_rectified(case: Path, tmp_path: Path) -> None:
    code, line = refused(case / "stills/shift_00/blurred.png", "-o", tmp_path / "r", "--methods", "rectify", *GOOD)
    assert (code, "concerns clips" in line) == (2, True), line


def test_a_report_that_cannot_be_written_is_refused_before_the_work(clip: Path, tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("not a folder")
    places = [(file, "it is a file"), (tmp_path / "no" / "where", "the folder it lies in does not exist")]
    if Path("/proc").is_dir():  # into which even root cannot write
        places.append((Path("/proc/report"), "must be writable"))
    for where, why in places:
        code, line = refused(clip, "-o", where, "--methods", "none")
        assert (code, why in line) == (2, True), line


@pytest.mark.parametrize(
    ("made", "code", "part"),
    [
        ("nothing", 3, "does not exist"),
        ("empty", 3, "must hold cases"),
        ("damaged", 3, "exposure_s"),
    ],
)
def test_a_folder_without_cases_is_refused(tmp_path: Path, made: str, code: int, part: str) -> None:
    folder = tmp_path / "cases"
    if made != "nothing":
        folder.mkdir()
    if made == "damaged":
        (folder / "stills" / "a").mkdir(parents=True)
        (folder / "stills" / "a" / "case.json").write_text('{"row_time_s": 0}')
    told = refused("--table", folder, "-o", tmp_path / "t.md")
    assert told[0] == code
    assert part in told[1]


def test_a_table_says_its_format_by_its_ending(case: Path, tmp_path: Path) -> None:
    assert refused("--table", case, "-o", tmp_path / "t.doc")[0] == 2
    assert refused("--table", case, "-o", tmp_path / "t.md", "--exposure", "1/50")[0] == 2
