"""Seconds, peak memory and gain of a cold frame, by size and by length of blur, through the installed command.

    python tests/benchmarks/speed.py [--cases 480x270:15,1920x1080:100] [--against COMMAND] [--picture FILE.svg] [--json FILE]

A case is COLSxROWS:BLUR, with the longest blur in px. The frames are rendered by `rsvideo simulate` from scikit-image's pictures, laid
side by side and mirrored to the size wanted. COMMAND is the `rsvideo` of another installation, which restores the same frames, each
right before ours. Seconds are those of the whole command, with kernels that are compiled already: both restore a small frame first.
FILE.svg gets the curves over pixels and over blur; FILE the figures, for tests/benchmarks/moved.py.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import matplotlib.pyplot as plt
import numpy as np
import published
import skimage.data
from installed import RSVIDEO
from quality import codes

from rsvideo.report.metrics import psnr

SMALL = "160x120:6"
BY_SIZE = ("480x270:15", "800x450:15", "1280x720:15", "1920x1080:15")
BY_BLUR = ("800x450:10", "800x450:15", "800x450:20", "800x450:40")
LONG = ("1920x1080:100",)
CASES = ",".join(dict.fromkeys(BY_SIZE + BY_BLUR + LONG))
CAMERA = ["--exposure", "1/50", "--readout", "20ms", "--focal-px", "1400"]


def scene(cols: int, rows: int) -> np.ndarray:
    """A detailed sharp picture of the size wanted."""
    pictures = [cv2.resize(p, (512, 512), interpolation=cv2.INTER_AREA) for p in (skimage.data.astronaut(), skimage.data.coffee())]
    pair = np.concatenate(pictures, axis=1)
    wall = np.concatenate([pair, pair[:, ::-1]], axis=0)
    return np.pad(wall, ((0, max(0, rows - wall.shape[0])), (0, max(0, cols - wall.shape[1])), (0, 0)), "symmetric")[:rows, :cols, ::-1]


def rendered(folder: Path, case: str) -> None:
    """Write blurred.png and truth.png of a case."""
    size, blur = case.split(":")
    cols, rows = map(int, size.split("x"))
    margin = 3 * int(blur) + 16
    cv2.imwrite(str(folder / "sharp.png"), scene(cols + 2 * margin, rows + 2 * margin))
    words = ["simulate", str(folder / "sharp.png"), "-o", str(folder / "blurred.png"), *CAMERA, "--size", size]
    subprocess.run([RSVIDEO, *words, "--shake", "--seed", "5", "--blur-px", blur], check=True, capture_output=True)


def ran(words: Sequence[str]) -> tuple[float, float]:
    """Seconds and peak GB of a command; what it says where it fails ends this process."""
    begun = time.perf_counter()
    with tempfile.TemporaryFile() as said, subprocess.Popen(words, stdout=said, stderr=said) as work:
        _, status, used = os.wait4(work.pid, 0)
        work.returncode = os.waitstatus_to_exitcode(status)
        seconds = time.perf_counter() - begun
        if work.returncode:
            said.seek(0)
            sys.exit(said.read().decode())
    return seconds, used.ru_maxrss / 1e6


def restored(folder: Path, command: str) -> tuple[float, float, float]:
    """Seconds, peak GB and dB gained of one blind restoration."""
    figures = ran([command, "deblur", str(folder / "blurred.png"), "-o", str(folder / "out.png"), *CAMERA, "--overwrite"])
    before, after, truth = (codes(folder / name) for name in ("blurred.png", "out.png", "truth.png"))
    return *figures, psnr(after, truth) - psnr(before, truth)


def measured(case: str, against: str | None) -> dict[str, Any]:
    """A row of the table."""
    size, blur = case.split(":")
    row: dict[str, Any] = {"frame": size.replace("x", " x "), "blur_px": int(blur)}
    with tempfile.TemporaryDirectory() as folder:
        rendered(Path(folder), case)
        former = restored(Path(folder), against) if against else (None, None, None)
        row |= zip(("former_s", "former_gb", "former_db"), former, strict=True)
        row |= zip(("seconds", "peak_gb", "gain_db"), restored(Path(folder), RSVIDEO), strict=True)
    return row


def growth(rows: Sequence[Mapping[str, Any]], of: str, over: Sequence[float]) -> float:
    """The power with which a figure grows: the slope of a line through the logarithms."""
    return float(np.polyfit(np.log(over), np.log([row[of] for row in rows]), 1)[0])


def drawn(file: Path, rows: Mapping[str, Mapping[str, Any]]) -> None:
    """Draw the curves that the measured cases allow, and print how they grow."""
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    for axis, cases, title in zip(
        axes, (BY_SIZE, BY_BLUR), ("megapixels of the frame, 15 px of blur", "px of blur, 800 x 450"), strict=True
    ):
        line = [rows[case] for case in cases if case in rows]
        over = [np.prod([int(side) for side in row["frame"].split(" x ")]) / 1e6 if cases is BY_SIZE else row["blur_px"] for row in line]
        for of, label, style in (("former_s", "former", "o--"), ("seconds", "present", "o-")):
            if len(line) > 1 and line[0][of] is not None:
                power = growth(line, of, over)
                axis.loglog(over, [row[of] for row in line], style, label=f"{label}, power {power:.2f}")
                print(f"{label}: seconds grow with the {power:.2f}th power of {title.partition(',')[0]}")
        axis.set(xlabel=title, ylabel="seconds")
        axis.grid(visible=True, which="both", alpha=0.3)
        axis.legend()
    figure.savefig(file, metadata={"Date": None})


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", default=CASES)
    parser.add_argument("--against", metavar="COMMAND")
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    measured(SMALL, args.against)
    rows: dict[str, dict[str, Any]] = {}
    for case in args.cases.split(","):
        rows[case] = measured(case, args.against)
        print(
            " | ".join(f"{name} {value:.3g}" if isinstance(value, float) else f"{name} {value}" for name, value in rows[case].items()),
            flush=True,
        )
    published.print_rows(list(rows.values()))
    if args.picture:
        drawn(args.picture, rows)
    if args.json:
        published.write(args.json, {"speed": list(rows.values())})


if __name__ == "__main__":
    main()
