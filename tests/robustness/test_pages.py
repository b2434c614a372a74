"""Hostile names and metadata in a report, in a real browser: they stay text."""

import json
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from rsvideo.cli import app
from tests.cli.test_compare import in_this_process as in_this_process
from tests.video.clips import make

_MARK = "window.hit=1"
ATTACKS = (
    f"<img src=x onerror={_MARK}>",
    f"<svg onload={_MARK}>",
    f'"><script>{_MARK}</script>',
    f"' autofocus onfocus='{_MARK}",
    f"javascript:{_MARK}",
    f"${{{_MARK}}}`{{{{7*7}}}}",
    f"</title></style></textarea><iframe srcdoc='<script>parent.{_MARK}</script>'>",
    "<base href=http://127.0.0.1:9/><meta http-equiv=refresh content='0;url=http://127.0.0.1:9/'>",
    "<!-- ]]>&lt;&#60;script>%3Cscript%3E",
)
_ELEMENTS = (
    "img[src=x], iframe, base, meta[http-equiv=refresh], svg[onload], [onfocus], [onerror], [onload], [onmouseover], a[href^=javascript]"
)


@pytest.fixture
def pages(tmp_path: Path, in_this_process: None) -> list[Path]:
    """The pages of a job whose folder, clips and tags attack."""
    folder = tmp_path / ATTACKS[1]
    folder.mkdir()
    clips = []
    for number, attack in enumerate(ATTACKS[::2]):
        tags = {tag: ATTACKS[number - k] for k, tag in enumerate(("title", "make", "model", "artist", "comment"))}
        name = attack.replace("/", "\u2215").replace("#", "").replace("*", "")[:120] + ".mp4"
        make(folder / "plain.mp4", frames=2, rows=64, cols=96, tags=tags, rate=24).rename(folder / name)
        clips.append({"source": name, "name": f"{number}" + "{ext}"})
    job = folder / "job.yaml"
    camera = {"exposure": "1/50", "readout": "20ms", "focal_px": 90}
    job.write_text(json.dumps({"report": {"methods": ["none"]}, "defaults": {"camera": camera}, "clips": clips}))
    report = folder / "report"
    assert app(["compare", str(job), "-o", str(report)], standalone_mode=False) == 0
    found = sorted(report.rglob("index.html"))
    assert len(found) == len(clips) + 1
    return found


def heard(browser: Browser, page: Path) -> list[str]:
    """What a page does besides showing itself, when it is opened and touched."""
    tab = browser.new_page()
    found: list[str] = []
    tab.on("dialog", lambda dialog: found.append(f"dialog {dialog.message}"))
    tab.on("pageerror", lambda error: found.append(f"error {error}"))
    tab.on("console", lambda message: found.append(f"console {message.text}"))
    tab.on("request", lambda request: found.append(request.url))
    tab.goto(page.as_uri())
    tab.mouse.move(200, 200)
    tab.keyboard.press("Tab")
    tab.wait_for_timeout(50)  # milliseconds, for a script that waits
    if tab.evaluate("window.hit") is not None:
        found.append("a script ran")
    found += [element.evaluate("e => e.outerHTML") for element in tab.query_selector_all(_ELEMENTS)]
    tab.close()
    return [words for words in found if words != page.as_uri() and not words.startswith(("data:", "blob:"))]


@pytest.mark.slow
def test_no_name_and_no_tag_becomes_an_element_or_runs(browser: Browser, pages: list[Path]) -> None:
    assert {page.parent.name: heard(browser, page) for page in pages} == {page.parent.name: [] for page in pages}


def test_the_browser_tells_a_page_that_is_not_safe(browser: Browser, tmp_path: Path) -> None:
    page = tmp_path / "index.html"
    page.write_text(f"<title>{ATTACKS[0]}</title>{ATTACKS[0]}")
    assert "a script ran" in heard(browser, page)
