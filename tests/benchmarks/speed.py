"""Seconds, peak memory and gain of a cold frame, by size and by length of blur, through the installed command.

    python tests/benchmarks/speed.py [--cases 480x270:15,1920x1080:100] [--json FILE]

A case is COLSxROWS:BLUR, with the longest blur in px.
The frames are rendered by `rsvideo simulate` from scikit-image's pictures, laid side by side and mirrored to the size wanted.
FILE gets the figures, for tests/benchmarks/moved.py.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
import published
import skimage.data
from quality import codes

from rsvideo.report.metrics import psnr

CASES = "480x270:15,800x450:10,800x450:15,800x450:20,800x450:40,1280x720:15,1920x1080:15,1920x1080:100"
CAMERA = ["--exposure", "1/50", "--readout", "20ms", "--focal-px", "1400"]


def scene(cols: int, rows: int) -> np.ndarray:
    """A detailed sharp picture of at least the size wanted."""
    pictures = [cv2.resize(p, (512, 512), interpolation=cv2.INTER_AREA) for p in (skimage.data.astronaut(), skimage.data.coffee())]
    pair = np.concatenate(pictures, axis=1)
    wall = np.concatenate([pair, pair[:, ::-1]], axis=0)
    return np.pad(wall, ((0, max(0, rows - wall.shape[0])), (0, max(0, cols - wall.shape[1])), (0, 0)), "symmetric")[:rows, :cols, ::-1]


def measured(folder: Path, cols: int, rows: int, blur: int) -> tuple[float, float, float, str]:
    """Seconds, peak GB, dB gained and verdict of one blind restoration."""
    sharp, blurred = folder / "sharp.png", folder / "blurred.png"
    margin = 3 * blur + 16
    cv2.imwrite(str(sharp), scene(cols + 2 * margin, rows + 2 * margin))
    render = [
        "rsvideo",
        "simulate",
        str(sharp),
        "-o",
        str(blurred),
        *CAMERA,
        "--shake",
        "--seed",
        "5",
        "--blur-px",
        str(blur),
        "--overwrite",
    ]
    subprocess.run(render, check=True, capture_output=True)
    command = ["rsvideo", "deblur", str(blurred), "-o", str(folder / "out.png"), *CAMERA, "--overwrite"]
    with (folder / "words").open("wb") as words, subprocess.Popen(command, stdout=words, stderr=words) as work:
        _, status, used = os.wait4(work.pid, 0)
        work.returncode = os.waitstatus_to_exitcode(status)
    if work.returncode:
        sys.exit((folder / "words").read_text())
    frame = json.loads((folder / "out.rsvideo.json").read_text())["frames"][0]
    before, after, truth = (codes(folder / name) for name in ("blurred.png", "out.png", "truth.png"))
    return frame["seconds"], used.ru_maxrss / 1e6, psnr(after, truth) - psnr(before, truth), frame["verdict"]


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", default=CASES)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    print("| frame | longest blur px | seconds | peak memory GB | gain dB | verdict |\n|---|---|---|---|---|---|", flush=True)
    rows = []
    for case in args.cases.split(","):
        size, blur = case.split(":")
        wide, high = map(int, size.split("x"))
        with tempfile.TemporaryDirectory() as folder:
            seconds, memory, gain, verdict = measured(Path(folder), wide, high, int(blur))
        print(f"| {wide} x {high} | {blur} | {seconds:.0f} | {memory:.2f} | {gain:.2f} | {verdict} |", flush=True)
        rows.append({"frame": f"{wide} x {high}", "blur_px": int(blur), "seconds": seconds, "peak_gb": memory, "gain_db": gain})
    if args.json:
        published.write(args.json, {"speed": rows})


if __name__ == "__main__":
    main()
