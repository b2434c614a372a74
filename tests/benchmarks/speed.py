"""Seconds and peak memory of a cold frame, by size and by length of blur, through the installed command.

    python tests/benchmarks/speed.py [--sizes 480x270,800x450,1280x720,1920x1080] [--blurs 10,20,40] [--json FILE]

The frames are rendered by `rsvideo simulate` from scikit-image's pictures, laid side by side and mirrored to the size wanted.
FILE gets the figures, for tests/benchmarks/moved.py.
"""

import argparse
import json
import resource
import subprocess
import tempfile
from pathlib import Path

import cv2
import numpy as np
import published
import skimage.data

CAMERA = ["--exposure", "1/50", "--readout", "20ms", "--focal-px", "1400"]


def scene(cols: int, rows: int) -> np.ndarray:
    """A detailed sharp picture of at least the size wanted."""
    pictures = [cv2.resize(p, (512, 512), interpolation=cv2.INTER_AREA) for p in (skimage.data.astronaut(), skimage.data.coffee())]
    pair = np.concatenate(pictures, axis=1)
    wall = np.concatenate([pair, pair[:, ::-1]], axis=0)
    return np.pad(wall, ((0, max(0, rows - wall.shape[0])), (0, max(0, cols - wall.shape[1])), (0, 0)), "symmetric")[:rows, :cols, ::-1]


def measured(folder: Path, cols: int, rows: int, blur: int) -> tuple[float, float, str]:
    """Seconds, peak GB and verdict of one blind restoration."""
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
    command = ["rsvideo", "deblur", str(blurred), "-o", str(folder / "out.png"), *CAMERA, "--overwrite", "--json"]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    frame = json.loads(done.stdout)["frames"][0]
    return frame["seconds"], resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6, frame["verdict"]


def main() -> None:
    """Print a Markdown table; sizes grow, so that the peak memory is each row's own."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", default="480x270,800x450,1280x720,1920x1080")
    parser.add_argument("--blurs", default="10,20,40")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    sizes = [tuple(map(int, size.split("x"))) for size in args.sizes.split(",") if size]
    runs = [(*size, 15) for size in sizes[:2]] + [(800, 450, int(blur)) for blur in args.blurs.split(",") if blur]
    runs += [(*size, 15) for size in sizes[2:]]
    print("| frame | longest blur px | seconds | peak memory so far GB | verdict |\n|---|---|---|---|---|", flush=True)
    measured_rows = []
    with tempfile.TemporaryDirectory() as folder:
        for cols, rows, blur in runs:
            seconds, memory, verdict = measured(Path(folder), cols, rows, blur)
            print(f"| about {cols} x {rows} | {blur} | {seconds:.0f} | {memory:.2f} | {verdict} |", flush=True)
            measured_rows.append({"frame": f"{cols} x {rows}", "blur_px": blur, "seconds": seconds, "peak_gb": memory})
    if args.json:
        published.write(args.json, {"speed": measured_rows})


if __name__ == "__main__":
    main()
