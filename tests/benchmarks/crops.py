"""Restore a photograph without known truth, and show parts of it before and after, beside what can be measured there.

    python tests/benchmarks/crops.py PHOTO -o RESULTS --crop 500,480,520,200 -- --exposure 60ms --readout 33ms --focal-px 2090

A crop is x,y,width,height in px; there may be several. RESULTS gets the restored picture and NAME_crops.png: before, after.
Steepness is the 99th percentile of the gradient, overshoot what the restored crop reaches beyond the codes of the blurred one.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np


def main() -> None:
    """Run, print a Markdown table, write the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photo", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--crop", action="append", required=True)
    args, options = parser.parse_known_args()  # the others are those of rsvideo deblur
    args.output.mkdir(parents=True, exist_ok=True)
    output = args.output / f"{args.photo.stem}.png"
    words = ["rsvideo", "deblur", args.photo, "-o", output, "--overwrite", "--json", *(word for word in options if word != "--")]
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=1800)
    if done.returncode:
        sys.exit(done.stderr)
    print(json.loads(done.stdout)["frames"][0]["verdict"])
    before, after = cv2.imread(str(args.photo)), cv2.imread(str(output))
    if before is None or after is None:
        sys.exit(f"cannot read {args.photo} or {output}")
    pairs = []
    print("| crop | steepness before | after | overshoot, 99th percentile, codes |\n|---|---|---|---|")
    for crop in args.crop:
        x, y, width, height = map(int, crop.split(","))
        a, b = (image[y : y + height, x : x + width] for image in (before, after))
        greys = [cv2.cvtColor(part, cv2.COLOR_BGR2GRAY).astype(np.float32) for part in (a, b)]
        steep = [float(np.percentile(np.linalg.norm(np.array(np.gradient(grey)), axis=0), 99)) for grey in greys]
        low, high = np.percentile(greys[0], (1, 99))
        beyond = np.percentile(np.maximum(greys[1] - high, low - greys[1]), 99)
        print(f"| {crop} | {steep[0]:.1f} | {steep[1]:.1f} | {max(beyond, 0):.1f} |")
        pairs.append(np.hstack([a, b]))
    widest = max(pair.shape[1] for pair in pairs)
    cv2.imwrite(
        str(args.output / f"{args.photo.stem}_crops.png"),
        np.vstack([np.pad(pair, ((0, 4), (0, widest - pair.shape[1]), (0, 0))) for pair in pairs]),
    )


if __name__ == "__main__":
    main()
