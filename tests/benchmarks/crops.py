"""Restore a photograph or a clip without known truth, and show parts of it before and after, beside what can be measured there.

    python tests/benchmarks/crops.py PHOTO -o RESULTS --crop 500,480,520,200 -- --exposure 60ms --readout 33ms --focal-px 2090
    python tests/benchmarks/crops.py CLIP -o RESULTS --frame 20 --frame 40 --crop 100,60,200,140 -- --range 0-2

A crop is x,y,width,height in px; there may be several, and several frames of a clip, counted from the range's first. RESULTS gets
the restored picture, or the clip beside its source, and NAME_crops.png: before, after.
Steepness is the 99th percentile of the gradient, overshoot what the restored crop reaches beyond the codes of the blurred one.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
from installed import RSVIDEO


def _picture(path: Path) -> np.ndarray:
    """A photograph's codes."""
    image = cv2.imread(str(path))
    if image is None:
        sys.exit(f"cannot read {path}")
    return image


def _of_clip(path: Path, frame: int) -> tuple[np.ndarray, np.ndarray]:
    """Both halves of a frame of a clip, its source's and its own."""
    clip = cv2.VideoCapture(str(path))
    if not all(clip.grab() for _ in range(frame + 1)):
        sys.exit(f"{path} has no frame {frame}")
    image = clip.retrieve()[1]
    return image[:, : image.shape[1] // 2], image[:, image.shape[1] // 2 :]


def main() -> None:
    """Run, print a Markdown table, write the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--crop", action="append", required=True)
    parser.add_argument("--frame", action="append", type=int, help="of a clip")
    args, options = parser.parse_known_args()  # the others are those of rsvideo deblur
    args.output.mkdir(parents=True, exist_ok=True)
    output = args.output / f"{args.source.stem}{'.mov' if args.frame else '.png'}"
    words = [RSVIDEO, "deblur", args.source, "-o", output, "--overwrite", "--json", *(word for word in options if word != "--")]
    words += ["--side-by-side", "--codec", "prores"] if args.frame else []
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=1800)
    if done.returncode:
        sys.exit(done.stderr)
    verdicts = [frame["verdict"] for frame in json.loads(done.stdout)["frames"]]
    pairs = []
    print("| frame | verdict | crop | steepness before | after | overshoot, 99th percentile, codes |\n|---|---|---|---|---|---|")
    for frame in args.frame or [0]:
        before, after = _of_clip(output, frame) if args.frame else (_picture(args.source), _picture(output))
        for crop in args.crop:
            x, y, width, height = map(int, crop.split(","))
            a, b = (image[y : y + height, x : x + width] for image in (before, after))
            greys = [cv2.cvtColor(part, cv2.COLOR_BGR2GRAY).astype(np.float32) for part in (a, b)]
            steep = [float(np.percentile(np.linalg.norm(np.array(np.gradient(grey)), axis=0), 99)) for grey in greys]
            low, high = np.percentile(greys[0], (1, 99))
            beyond = np.percentile(np.maximum(greys[1] - high, low - greys[1]), 99)
            print(f"| {frame} | {verdicts[frame]} | {crop} | {steep[0]:.1f} | {steep[1]:.1f} | {max(beyond, 0):.1f} |")
            pairs.append(np.hstack([a, b]))
    widest = max(pair.shape[1] for pair in pairs)
    cv2.imwrite(
        str(args.output / f"{args.source.stem}_crops.png"),
        np.vstack([np.pad(pair, ((0, 4), (0, widest - pair.shape[1]), (0, 0))) for pair in pairs]),
    )


if __name__ == "__main__":
    main()
