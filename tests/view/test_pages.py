"""The pages in a real browser: a clip tried, saved as a job, run, watched by a page that comes later, and its result found."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from rsvideo.batch import plan, status
from tests.batch import clusters, runs
from tests.robustness import jobs
from tests.view.servers import STAND_IN, Server, serving
from tests.view.tabs import PATIENCE, tab

pytestmark = pytest.mark.slow
SAMPLES = Path(__file__).resolve().parents[2] / "samples"
HOSTILE = "<img src=x onerror=document.title='run'> & \"q\" \u202e4gpj\x1b.mp4"
SHOWN = HOSTILE.replace("\u202e", "\\u202e").replace("\x1b", "\\x1b")
PACE = 0.25  # seconds that a frame of the stand-in takes
JOB = "defaults: {camera: {exposure: 1/50, readout: 20ms, focal_px: 300}}\nclips: [other.mp4]\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clip, and one whose name is hostile."""
    inside = tmp_path_factory.mktemp("clips")
    for name in ("walk.mp4", HOSTILE):
        (inside / name).write_bytes((SAMPLES / "clip" / "blurred.mp4").read_bytes())
    return inside


@pytest.fixture(scope="module")
def server(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with serving(folder, state=tmp_path_factory.mktemp("state"), PACE=PACE) as running:
        yield running


def previewed(page: Page) -> bytes:
    """The picture on the right once the preview is complete."""
    page.wait_for_selector("html[data-preview='done full']", timeout=PATIENCE)
    return page.request.get(page.evaluate("document.getElementById('right-image').src")).body()


def test_a_clip_is_tried_saved_run_and_found_by_a_page_that_comes_later(browser: Browser, server: Server, folder: Path) -> None:
    with tab(browser, server.address) as page:
        page.click("text=walk.mp4")
        page.wait_for_selector("html[data-ready]")
        page.fill("#field-camera-exposure", "1/50")
        page.fill("#field-camera-readout", "20ms")
        page.fill("#field-camera-focal_px", "300")
        page.click("#preview")
        first = previewed(page)
        assert "20 ms: typed in" in page.inner_text("#facts")
        page.click("#keep")
        page.evaluate("delete document.documentElement.dataset.preview")
        page.fill("#field-camera-exposure", "1/100")
        page.press("#field-camera-exposure", "Tab")
        second = previewed(page)
        assert first != second
        assert "10 ms: typed in" in page.inner_text("#facts")
        assert page.inner_text("#left-tag").startswith("A: ")
        assert page.inner_text("#right-tag").startswith("B: ")
        page.set_viewport_size({"width": 390, "height": 900})  # two settings have long names
        assert page.evaluate("document.documentElement.scrollWidth") == 390
        page.click("#save")
        page.wait_for_selector("#to-job")
        page.click("#to-job")
        page.wait_for_selector("#wanted[data-state=ready]")
        page.click("#wanted button:text-is('Start')")
        page.wait_for_selector("#wanted[data-state=running] >> text=restoring", timeout=PATIENCE)
    text = (folder / "walk.yaml").read_text()
    assert "# How long each row collects light" in text
    assert "exposure: 1/100" in text
    with tab(browser, f"{server.address}jobs") as page:  # in the middle of the run
        page.wait_for_selector("article[data-name='walk.yaml'][data-state=done]", timeout=PATIENCE)
        page.click("article[data-name='walk.yaml'] a.result")
        page.wait_for_selector("html[data-ready]")
        assert page.inner_text("h1") == "walk_rsvideo.mp4"
        page.wait_for_selector("#track-box svg")
        assert "restored" in page.inner_text("#strip-words")
    assert status.read(plan.working_of(folder / "walk.yaml", "restored")) is None


def test_a_newer_preview_takes_the_place_of_an_older_one(browser: Browser, server: Server) -> None:
    wish = {"at": "0/walk.mp4", "first": 2, "last": 9}
    camera = {"readout": "20ms", "focal_px": "300"}
    older = server.tell("api/preview", **wish, settings={"camera": camera | {"exposure": "1/50"}})
    while json.loads(server.ask(f"api/preview/{older['id']}?version=0")[1])["state"] != "working":
        time.sleep(0.05)
    newer = server.tell("api/preview", **wish | {"last": 2}, settings={"camera": camera | {"exposure": "1/60"}})
    states = {}
    for name, preview in (("older", older), ("newer", newer)):
        values = preview
        while values["state"] in ("waiting", "working"):
            values = json.loads(server.ask(f"api/preview/{preview['id']}?version={values['version']}")[1])
        states[name] = values["state"]
    assert states == {"older": "replaced", "newer": "done"}
    again = server.tell("api/preview", **wish | {"last": 2}, settings={"camera": camera | {"exposure": "1/60"}})
    assert again["id"] == newer["id"]  # what was made is kept


@pytest.mark.long
def test_a_run_that_somebody_else_started_is_watched_paused_and_cancelled(browser: Browser, server: Server, folder: Path) -> None:
    (folder / "other.mp4").write_bytes((SAMPLES / "clip" / "blurred.mp4").read_bytes())
    (folder / "other.yaml").write_text(JOB)
    line = [sys.executable, str(STAND_IN), "run", str(folder / "other.yaml"), "--progress", "none"]

    with (
        subprocess.Popen(line, env=os.environ | {"PACE": "0.4"}, stderr=subprocess.DEVNULL) as run,
        tab(browser, f"{server.address}jobs") as page,
    ):
        article = "article[data-name='other.yaml']"
        page.wait_for_selector(f"{article}[data-state=running] >> text=restoring", timeout=PATIENCE)
        assert "memory" in page.inner_text(f"{article} .numbers")
        page.click(f"{article} button:text-is('Pause')")
        page.wait_for_selector(f"{article}[data-state=paused]", timeout=PATIENCE)
        page.click(f"{article} button:text-is('Resume')")
        page.wait_for_selector(f"{article}[data-state=running]", timeout=PATIENCE)
        page.click(f"{article} button:text-is('Cancel')")
        page.wait_for_selector(f"{article}[data-state=ready]", timeout=PATIENCE)  # its one chunk was not done: nothing is kept
        assert run.wait(timeout=20) == 128 + signal.SIGTERM


@pytest.mark.long
def test_a_run_on_the_workers_of_a_scheduler_is_watched_and_cancelled(browser: Browser, server: Server, folder: Path) -> None:
    job = jobs.make(folder / "farm")
    tally = folder / "farm" / "tally"
    words = ("run", job, "--scheduler", "local", "--progress", "none")
    with (
        runs.under_way(*words, PACE=0.4, TALLY=tally, PYTHONPATH=clusters.EVERYWHERE["PYTHONPATH"]) as run,
        tab(browser, f"{server.address}jobs") as page,
    ):
        article = "article[data-name='job.yaml']"
        page.wait_for_selector(f"{article}[data-state=running] >> text=local", timeout=PATIENCE)
        runs.begun(tally, 2)
        assert "one.mp4" in page.inner_text(article)
        page.click(f"{article} button:text-is('Cancel')")
        page.wait_for_selector(f"{article}:not([data-state=running])", timeout=PATIENCE)
        assert run.wait(timeout=20) == 128 + signal.SIGTERM


@pytest.mark.long
def test_a_run_outlives_the_server(tmp_path: Path) -> None:
    folder = tmp_path / "clips"
    folder.mkdir()
    (folder / "other.mp4").write_bytes((SAMPLES / "clip" / "blurred.mp4").read_bytes())
    (folder / "other.yaml").write_text(JOB)
    with serving(folder, state=tmp_path / "state", PACE=0.2) as server:
        answer = server.tell("api/jobs/start", at="0/other.yaml")
        assert answer["status"] == 200
        while not status.read(plan.working_of(folder / "other.yaml", "restored")):
            time.sleep(0.05)
    end = time.monotonic() + 40
    while not (folder / "restored" / "other_rsvideo.mp4").exists():
        assert time.monotonic() < end
        time.sleep(0.1)


def test_a_job_that_cannot_be_run_says_why(browser: Browser, server: Server, folder: Path) -> None:
    (folder / "bad.yaml").write_text("clips: [other.mp4]\ndefaults: {camera: {exposre: 1/50}}\n")
    (folder / "late.yaml").write_text("output: {folder: out}\nclips:\n  - source: broken.mp4\n    camera: {exposure: 1/50}\n")
    (folder / "broken.mp4").write_bytes(b"no clip")
    server.tell("api/jobs/start", at="0/late.yaml")
    with tab(browser, f"{server.address}jobs") as page:
        assert "there is no such key" in page.inner_text("article[data-name='bad.yaml'] .error")
        page.wait_for_selector("article[data-name='late.yaml'] td.error", timeout=PATIENCE)
        assert "broken.mp4" in page.inner_text("article[data-name='late.yaml'] td.error")
    (folder / "broken.mp4").unlink()  # of which other pages show a picture


def test_no_name_runs_as_script(browser: Browser, server: Server, folder: Path) -> None:
    (folder / "<b>job<b>.yaml").write_text("output: {folder: '<script>x</script>'}\nclips: ['<img src=x>.mp4']\n")
    with tab(browser, server.address) as page:
        page.click("#names b:has-text('<img')")
        page.wait_for_selector("html[data-ready]")
        assert page.inner_text("h1") == SHOWN
        assert "run" not in page.title().replace("onerror=document.title='run'", "")
        page.goto(f"{server.address}jobs")
        page.wait_for_selector("html[data-ready]")
        assert "<b>job<b>.yaml" in page.inner_text("#jobs")
        assert page.locator("#jobs b:text('job')").count() == 0


def test_a_strangers_report_cannot_run_its_script(browser: Browser, server: Server, folder: Path) -> None:
    (folder / "report").mkdir()
    (folder / "report" / "report.json").write_text("{}")
    (folder / "report" / "index.html").write_text("<title>still</title><script>document.title = 'run'</script><p>words</p>")
    page = browser.new_page()
    page.goto(f"{server.address}jobs")
    page.click("#reports a:text-is('report')")
    page.wait_for_selector("text=words")
    assert page.title() == "still"
    page.close()


def test_the_slider_and_the_frames_work_by_keyboard(browser: Browser, server: Server) -> None:
    with tab(browser, f"{server.address}clip?at=0/walk.mp4") as page:
        page.focus("#divider")
        page.keyboard.press("Home")
        assert page.eval_on_selector("#over", "e => e.style.clipPath") == "inset(0px 100% 0px 0px)"
        page.focus("#picker")
        page.keyboard.press("Home")
        page.keyboard.press("ArrowRight")
        assert page.input_value("#frame") == "1"
        page.focus("#preview")
        reached = []
        for _ in range(60):
            page.keyboard.press("Tab")
            reached.append(page.evaluate("document.activeElement.id"))
        assert {"field-camera-exposure", "field-camera-readout", "track"} <= set(reached)


@pytest.mark.parametrize("width", [390, *(pytest.param(each, marks=pytest.mark.long) for each in (1024, 1920))])
def test_nothing_sticks_out_and_words_can_be_read(browser: Browser, server: Server, width: int) -> None:
    contrast = (Path(__file__).with_name("contrast.js")).read_text()
    for dark in (False, True):
        for address in ("", "clip?at=0/walk.mp4", "jobs", "calibrate"):
            with tab(browser, server.address + address, width=width, dark=dark) as page:
                assert page.evaluate("document.documentElement.scrollWidth") == width, address
                assert page.evaluate(contrast) == [], (address, dark)
