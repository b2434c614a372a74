"""A page in a real browser."""

import contextlib
import re
from collections.abc import Iterator

from playwright.sync_api import Browser, Page

PATIENCE = 180_000  # ms that a test waits for what has to be computed first, loops compiled anew beside other tests


@contextlib.contextmanager
def tab(browser: Browser, address: str, *, width: int = 1024, dark: bool = False) -> Iterator[Page]:
    """A page; what it complains about, and whatever it asks of anybody else, fails the test."""
    page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme="dark" if dark else "light", reduced_motion="reduce")
    complaints, asked = [], []
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(address)
    page.wait_for_selector("html[data-ready]")
    yield page
    assert complaints == []
    origin = re.match(r"http://127\.0\.0\.1:\d+/", address)
    assert origin
    assert [url for url in asked if not url.startswith(origin[0])] == []
    page.close()
