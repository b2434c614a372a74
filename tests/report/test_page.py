"""The page, as values and in a real browser."""

import base64
import itertools
import re
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from rsvideo.report import page
from rsvideo.video.mosaic import Grid, Mosaic
from tests.report.comparisons import HOSTILE, comparison


def video() -> bytes:
    mosaic = Mosaic(Grid.fitting(4, 60, 80), Fraction(24), most_bytes=1_000_000, frames=3)
    for k in range(3):
        mosaic.write([np.full((60, 80, 3), 40 * k, np.uint8), None, None, None])
    return mosaic.close()


def test_a_hostile_name_stays_text() -> None:
    html = page.render(comparison(title=HOSTILE, source=HOSTILE)).decode()
    assert "<img src=x" not in html
    assert "&lt;/script&gt;" in html
    assert "<b>no</b>" not in html  # nor the reason of a failure


def test_nothing_is_asked_of_a_network() -> None:
    html = page.render(comparison(video=video())).decode()
    assert not re.search(r"""(src|href|action|url)\s*[=(]\s*["']?(https?:|//|ftp:)""", html)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', html)
    assert policy is not None
    assert policy[1].startswith("default-src &#39;none&#39;")
    assert "unsafe" not in policy[1]


def test_a_picture_stands_in_the_page_once() -> None:
    shown = comparison()
    html = page.render(shown)
    for frame in shown.key_frames:
        for picture in frame.pictures.values():
            assert html.count(base64.b64encode(picture)) == 1


def test_a_still_has_no_film_and_no_video() -> None:
    only = comparison(kind="still", key_frames=comparison().key_frames[:1], first_shown=0)
    html = page.render(only).decode()
    assert 'type="radio"' not in html
    assert "<video" not in html


def test_an_index_leads_to_each_page() -> None:
    html = page.index("job", [("a b", comparison()), ("c", comparison(title=HOSTILE))]).decode()
    assert 'href="a%20b/index.html"' in html
    assert "<img src=x" not in html


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "index.html"
    path.write_bytes(page.render(comparison(title=HOSTILE, video=video())))
    return path


@contextmanager
def opened(browser: Browser, report: Path, width: int = 1024, **how) -> Iterator[Page]:
    """The report in a window so wide; what it asks for and complains about fails the test."""
    tab = browser.new_page(viewport={"width": width, "height": 800}, reduced_motion="reduce", **how)
    said, asked = [], []
    tab.on("console", lambda message: said.append(message.text))
    tab.on("pageerror", lambda error: said.append(str(error)))
    tab.on("request", lambda request: asked.append(request.url))
    tab.goto(report.as_uri())
    tab.wait_for_selector("html[data-ready]")
    yield tab
    assert said == []
    assert [url for url in asked if not url.startswith("data:")] == [report.as_uri()]
    tab.close()


def places(tab: Page) -> list[list[str]]:
    """Where the pictures of all panels stand, and how large."""
    return tab.eval_on_selector_all(".pane img", "all => all.map(i => [i.style.left, i.style.top, i.style.width])")


@pytest.mark.parametrize("width", [390, 1024, 1920])
def test_nothing_sticks_out_at_any_width(browser: Browser, report: Path, width: int) -> None:
    with opened(browser, report, width, color_scheme="dark" if width == 1024 else "light") as tab:
        assert tab.evaluate("document.documentElement.scrollWidth") == width
        assert tab.title().startswith("</script>")


def test_the_slider_moves_with_the_keyboard(browser: Browser, report: Path) -> None:
    with opened(browser, report) as tab:
        tab.focus("#divider")
        shown = [tab.eval_on_selector(".over", "e => e.style.clipPath")]
        for key in ("ArrowRight", "End", "Home"):
            tab.keyboard.press(key)
            shown.append(tab.eval_on_selector(".over", "e => e.style.clipPath"))
        assert shown == ["inset(0px 50% 0px 0px)", "inset(0px 49.5% 0px 0px)", "inset(0px 0% 0px 0px)", "inset(0px 100% 0px 0px)"]


def test_all_panels_show_the_same_part(browser: Browser, report: Path) -> None:
    with opened(browser, report) as tab:

        def part() -> list[str]:
            first, *others = places(tab)
            assert len(others) == 3
            assert all(other == first for other in others)
            return first

        seen = [part()]
        tab.click(".crop >> nth=1")
        seen.append(part())
        assert tab.get_attribute(".crop >> nth=1", "aria-pressed") == "true"
        tab.focus("#panels")
        for key in ("ArrowLeft", "ArrowUp", "+"):
            tab.keyboard.press(key)
            seen.append(part())
        tab.locator(".pane").first.scroll_into_view_if_needed()
        box = tab.locator(".pane").first.bounding_box()
        assert box is not None
        tab.mouse.move(box["x"] + 100, box["y"] + 100)
        tab.mouse.down()
        tab.mouse.move(box["x"] + 60, box["y"] + 80)
        tab.mouse.up()
        seen.append(part())
        tab.fill("#x", "50")
        tab.press("#x", "Enter")
        seen.append(part())
        for before, after in itertools.pairwise(seen):
            assert before != after


def test_another_frame_changes_every_picture_and_its_motion(browser: Browser, report: Path) -> None:
    with opened(browser, report) as tab:
        sources = "all => all.map(i => i.src)"
        before = tab.eval_on_selector_all(".pane img, #under, #over", sources)
        tab.focus("input[name=frame]:checked")
        tab.keyboard.press("ArrowRight")
        after = tab.eval_on_selector_all(".pane img, #under, #over", sources)
        assert all(a != b for a, b in zip(before, after, strict=True))
        assert tab.inner_text(".frame-number") == "2"
        assert tab.locator("#motions article").count() == 1
        assert "32.00 dB" in tab.inner_text("#tag-right")


def test_the_video_plays_in_the_page(browser: Browser, report: Path) -> None:
    with opened(browser, report) as tab:
        tab.click("#play")
        expect(tab.locator("video")).not_to_have_js_property("currentTime", 0)
        assert tab.eval_on_selector("video", "v => v.error") is None


def test_a_chart_can_be_read_as_a_table(browser: Browser, report: Path) -> None:
    with opened(browser, report) as tab:
        tab.select_option("#measure", label="Edge width")
        assert tab.locator(".chart:visible").count() == 1
        tab.click(".chart:visible summary")
        assert tab.locator(".chart:visible tbody tr").first.inner_text().split() == ["0", "5.00", "2.10", "1.50", "2.00"]
