"""Screenshots of the pages for the documentation, of the samples and of a simulated camera's views.

    python tests/view/screenshots.py [-o docs/view] [--width 1024] [--dark]

Takes a few minutes: the preview, the motion, the run and the calibration are real.
"""

import argparse
import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
from playwright.sync_api import Page, sync_playwright

from calibration.boards.render import photographs

CHECKOUT = Path(__file__).resolve().parents[2]
CHROMIUM = "/usr/bin/chromium"
BOARD = "chessboard:9x6:25mm"
MINUTES = 60_000  # ms
VIEWS = 9


def filled(folder: Path) -> None:
    """The samples as somebody's folder of clips."""
    for source, name in (("clip/blurred.mp4", "cup.mp4"), ("clip/truth.mp4", "cup_sharp.mp4")):
        shutil.copy(CHECKOUT / "samples" / source, folder / name)
    for name in ("coffee", "astronaut", "photographer"):
        shutil.copy(CHECKOUT / "samples" / name / "blurred.png", folder / f"{name}.png")


@contextlib.contextmanager
def server(folder: Path, state: Path) -> Iterator[str]:
    """The address of the installed command's pages."""
    line = [str(Path(sys.executable).with_name("rsvideo")), "view", str(folder), "--no-browser"]
    with subprocess.Popen(line, stderr=subprocess.PIPE, text=True, env=os.environ | {"XDG_STATE_HOME": str(state)}) as process:
        assert process.stderr
        try:
            yield process.stderr.readline().split("at ")[1].split(";")[0]
        finally:
            process.send_signal(signal.SIGINT)


def clip(page: Page, address: str) -> None:
    """A clip with its frames judged, and two settings side by side."""
    page.goto(f"{address}clip?at=0/cup.mp4&frame=2")
    page.wait_for_selector("html[data-ready]")
    for name, value in (("exposure", "1/100"), ("readout", "20ms"), ("focal_px", "400")):
        page.fill(f"#field-camera-{name}", value)
    page.press("#field-camera-focal_px", "Tab")
    page.click("#preview")
    page.wait_for_selector("html[data-preview='done full']", timeout=5 * MINUTES)
    page.click("#keep")
    page.evaluate("delete document.documentElement.dataset.preview")
    page.fill("#field-camera-exposure", "1/50")
    page.press("#field-camera-exposure", "Tab")
    page.wait_for_selector("html[data-preview='done full']", timeout=5 * MINUTES)
    if not page.is_visible("#track-box svg"):
        page.click("#track")
    page.wait_for_selector("#track-box svg", timeout=5 * MINUTES)
    page.check("#show-motion")
    page.evaluate("document.getElementById('say').textContent = ''")
    page.wait_for_timeout(1500)


def job(page: Page, _: str) -> None:
    """A run in its middle."""
    page.fill("#job-name", "cup")
    page.check("#job-overwrite")
    page.click("#save")
    page.click("#to-job")
    page.wait_for_selector("#wanted")
    page.click("#wanted button:text-matches('^(Start|Go on|Start again)$')")
    page.wait_for_selector("#wanted[data-state=running] >> text=under way", timeout=2 * MINUTES)
    page.evaluate("scrollTo(0, 0)")


def calibrated(page: Page, address: str) -> None:
    """A lens measured on the views of a simulated camera."""
    page.goto(f"{address}calibrate")
    page.wait_for_selector("html[data-ready]")
    page.fill("#board", BOARD)
    page.click("#draw")
    page.wait_for_selector("#board-image:not([hidden])", timeout=MINUTES)
    with tempfile.TemporaryDirectory() as name:
        for number, picture in enumerate(photographs(BOARD, VIEWS, focal_px=700.0, rows=480, cols=640)):
            cv2.imwrite(f"{name}/view_{number:02}.png", picture)
        page.set_input_files("#files", sorted(Path(name).iterdir()))
        page.wait_for_selector(f"#views li:nth-child({VIEWS})", timeout=MINUTES)
    page.fill("#camera", "Simulated")
    page.click("#lens")
    page.wait_for_selector("#residuals:not([hidden])", timeout=5 * MINUTES)
    page.fill("#profile-name", "simulated_1080p")
    page.wait_for_timeout(1500)


def main() -> None:
    """Take them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", type=Path, default=CHECKOUT / "docs" / "view", help="where they go")
    parser.add_argument("--width", type=int, default=1024, help="px of the window")
    parser.add_argument("--only", help="some of calibrate,clip,jobs; jobs needs clip")
    parser.add_argument("--dark", action="store_true", help="as a dark desktop shows them")
    args = parser.parse_args()
    args.o.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name, sync_playwright() as program:
        top = Path(name)
        folder = top / "holiday"
        folder.mkdir()
        filled(folder)
        chromium = program.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = chromium.new_page(viewport={"width": args.width, "height": 800}, color_scheme="dark" if args.dark else "light")
        with server(folder, top / "state") as address:
            page.goto(address)
            page.wait_for_selector("html[data-ready]")
            page.wait_for_timeout(4000)
            page.screenshot(path=args.o / "clips.jpg", type="jpeg", quality=78)
            begun = time.monotonic()
            for what, steps in (("calibrate", calibrated), ("clip", clip), ("jobs", job)):
                if args.only is None or what in args.only.split(","):
                    steps(page, address)
                    page.screenshot(path=args.o / f"{what}.jpg", type="jpeg", quality=78, full_page=True)
                    print(f"{what}: {time.monotonic() - begun:.0f} s", flush=True)
        chromium.close()


if __name__ == "__main__":
    main()
