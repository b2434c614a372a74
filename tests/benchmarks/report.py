"""What a report costs: how much longer it takes than its methods do, how much it weighs, and how soon it opens.

    python tests/benchmarks/report.py CLIP -o REPORT [--methods none,uniform,...] --exposure 20ms --readout 20ms --focal-px 1200

All other options are those of `rsvideo compare`. The page is opened in Debian's Chromium, three times, from the request to the
moment when it says that it can be used.
"""

import argparse
import json
import statistics
import subprocess
import time
from pathlib import Path

from installed import RSVIDEO
from playwright.sync_api import sync_playwright

CHROMIUM = Path("/usr/bin/chromium")
METHODS = "none,uniform,stitch,rectify,rectify+uniform,rsvideo"


def opening(page: Path) -> float:
    """Seconds until the page can be used, the median of three."""
    took = []
    with sync_playwright() as program:
        browser = program.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        for _ in range(3):
            tab = browser.new_page(viewport={"width": 1024, "height": 800})
            started = time.monotonic()
            tab.goto(page.as_uri())
            tab.wait_for_selector("html[data-ready]")
            took.append(time.monotonic() - started)
            tab.close()
        browser.close()
    return statistics.median(took)


def main() -> None:
    """Run, and print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clip", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--methods", default=METHODS)
    args, options = parser.parse_known_args()
    started = time.monotonic()
    words = [RSVIDEO, "compare", str(args.clip), "-o", str(args.output), "--methods", args.methods, "--overwrite", *options]
    done = subprocess.run(words, capture_output=True, text=True, timeout=7200)
    if done.returncode:
        raise SystemExit(done.stderr)
    whole = time.monotonic() - started
    entries = json.loads((args.output / "report.json").read_text(encoding="utf-8"))["entries"]
    methods = sum(entry["seconds"] or 0 for entry in entries)
    page = args.output / "index.html"
    print("| methods | frames | of the methods s | in all s | times | page MB | opens in s |\n|---|---|---|---|---|---|---|")
    figures = f"{methods:.0f} | {whole:.0f} | {whole / methods:.2f} | {page.stat().st_size / 1e6:.1f} | {opening(page):.2f}"
    print(f"| {args.methods} | {max(len(entry['frames']) for entry in entries)} | {figures} |")


if __name__ == "__main__":
    main()
