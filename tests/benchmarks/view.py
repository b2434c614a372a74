"""What the pages cost: the first paint of a folder of 200 clips, a preview of a 1080p frame, and a server that nobody asks anything.

    python tests/benchmarks/view.py [--clips 200] [--previews 3] [--idle 20] [--json FILE]

paint: from the navigation to all names on the page, in Chromium, without any picture decoded. preview: of a clip that moves, at half
size and at full size, with exposure, readout and focal length stated, each time another exposure, in a process that is warm. idle: the
processor's time of the server and of its processes over some seconds, after all this.
"""

import argparse
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any
from urllib.request import Request, urlopen

import av
import cv2
import numpy as np
import published
from installed import RSVIDEO
from playwright.sync_api import sync_playwright

SAMPLES = Path(__file__).resolve().parents[2] / "samples"
CHROMIUM = "/usr/bin/chromium"
ROWS, COLS, FRAMES, RATE, STEPS = 1080, 1920, 12, 30, 24
OPEN = 15  # of the steps of a frame's period, which makes the exposure 1/48 s
TRIED = 10  # the frame


def moving(path: Path) -> None:
    """A 1080p clip of the samples' photographs, side by side, before a camera that is moved by hand."""
    truths = [cv2.imread(str(SAMPLES / name / "truth.png")) for name in ("astronaut", "coffee", "photographer")]
    tiles = [truth[:382, :484] for truth in truths if truth is not None]
    rows = [np.hstack([tiles[(row + col) % 3][:, :: 1 if (row + col) % 2 else -1] for col in range(5)]) for row in range(4)]
    light = np.vstack(rows).astype(np.float32) / 255
    light **= 2.2
    t = np.arange(FRAMES * STEPS) / (RATE * STEPS)
    x = 14 * np.sin(2 * np.pi * 1.7 * t) + 3 * np.sin(2 * np.pi * 4.1 * t + 1)
    y = 10 * np.sin(2 * np.pi * 2.1 * t + 2)
    with av.open(str(path), "w") as file:
        video = file.add_stream("libx264", rate=RATE, options={"crf": "16", "preset": "veryfast"})
        video.width, video.height, video.pix_fmt = COLS, ROWS, "yuv420p"
        for k in range(FRAMES):
            shown = np.zeros((ROWS, COLS, 3), np.float32)
            for i in range(k * STEPS, k * STEPS + OPEN):
                shown += cv2.warpAffine(light, np.array([[1, 0, -100 - x[i]], [0, 1, -80 - y[i]]]), (COLS, ROWS))
            codes = np.clip(255 * (shown / OPEN) ** (1 / 2.2) + 0.5, 0, 255).astype(np.uint8)
            file.mux(video.encode(av.VideoFrame.from_ndarray(codes, format="bgr24")))
        file.mux(video.encode())


@contextlib.contextmanager
def serving(folder: Path, state: Path) -> Iterator[tuple[str, int]]:
    """The address of the installed command's pages, and the process."""
    line = [RSVIDEO, "view", str(folder), "--no-browser"]
    with subprocess.Popen(line, stderr=subprocess.PIPE, text=True, env=os.environ | {"XDG_STATE_HOME": str(state)}) as process:
        assert process.stderr
        try:
            yield process.stderr.readline().split("at ")[1].split(";")[0], process.pid
        finally:
            process.send_signal(signal.SIGINT)


def asked(address: str, **values: Any) -> dict[str, Any]:
    """What the server answers."""
    body = json.dumps(values).encode() if values else None
    with urlopen(Request(address, data=body, headers={"Content-Type": "application/json"}), timeout=600) as answer:
        return json.load(answer)


def paint(address: str, clips: int) -> float:
    """Seconds until all names stand on the page; the median of five visits."""
    took = []
    with sync_playwright() as program:
        chromium = program.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        for _ in range(5):
            page = chromium.new_page(viewport={"width": 1024, "height": 800})
            begun = time.perf_counter()
            page.goto(address, wait_until="commit")
            page.wait_for_selector(f"#names li:nth-child({clips})")
            took.append(time.perf_counter() - begun)
            page.close()
        chromium.close()
    return median(took)


def preview(address: str, exposure: str) -> dict[str, float]:
    """Seconds until the picture of each size is there."""
    settings = {"camera": {"exposure": exposure, "readout": "0", "focal_px": "1500"}}
    begun = time.perf_counter()
    values = asked(f"{address}api/preview", at="0/moving.mp4", settings=settings, first=TRIED, last=TRIED)
    found: dict[str, float] = {}
    while values["state"] in ("waiting", "working"):
        values = asked(f"{address}api/preview/{values['id']}?version={values['version']}")
        for size in values["sizes"]:
            found.setdefault(size, time.perf_counter() - begun)
    if values["state"] != "done":
        sys.exit(values["error"])
    print(f"{exposure}: {found}, {values['sizes']['half']['frames'][0]['verdict']}", flush=True)
    return found


def processor(pid: int) -> float:
    """Seconds of processor time of a process and all that it started."""
    ticks, children = 0, {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdecimal():
            with contextlib.suppress(OSError):
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                children.setdefault(int(fields[1]), []).append((int(entry.name), int(fields[11]) + int(fields[12])))
                if int(entry.name) == pid:
                    ticks += int(fields[11]) + int(fields[12])
    left = [pid]
    while left:
        for child, used in children.get(left.pop(), []):
            ticks += used
            left.append(child)
    return ticks / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=int, default=200)
    parser.add_argument("--previews", type=int, default=3, help="of which the median counts, after one that is not counted")
    parser.add_argument("--idle", type=float, default=20, help="seconds")
    parser.add_argument("--json", type=Path, help="where the figures go")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "clips"
        folder.mkdir()
        for number in range(args.clips - 1):
            shutil.copy(SAMPLES / "clip" / "blurred.mp4", folder / f"clip_{number:03}.mp4")
        moving(folder / "moving.mp4")
        with serving(folder, Path(name) / "state") as (address, pid):
            rows = [{"what": f"first paint of a folder of {args.clips} clips", "seconds": paint(address, args.clips)}]
            preview(address, "1/40")  # the process starts, and compiled loops are loaded
            took = [preview(address, f"1/{47 + n}") for n in range(args.previews)]
            rows += [
                {"what": f"preview of a 1080p frame, {size} size, warm", "seconds": median(each[size] for each in took)}
                for size in ("half", "full")
            ]
            time.sleep(2)
            before = processor(pid)
            time.sleep(args.idle)
            used = processor(pid) - before
            rows.append({"what": f"processor time of the idle server in {args.idle:g} s", "seconds": used})
    published.print_rows(rows)
    if args.json:
        published.write(args.json, {"view": rows})


if __name__ == "__main__":
    main()
