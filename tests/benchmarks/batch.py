"""What a batch needs: memory by the length and the size of a clip, and how much faster two workers are than one.

    python tests/benchmarks/batch.py [--frames 100,1000] [--large 8] [--workers 16]

The clips show a panning camera over scikit-image's pictures, open half of the time; each is restored by `rsvideo run`.
Memory is that of the largest process. One worker on one core is set against two on two, with a clip of --workers frames each.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from installed import RSVIDEO
from speed import scene

STEP = 12.0  # px that the camera moves from frame to frame, at most
OPEN = 0.5  # of the time between frames
SAMPLES = 12  # of an exposure
DEFAULTS = "{camera: {exposure: 1/50, readout: 0, focal_px: 800}}"  # of the job


def clip(path: Path, rows: int, cols: int, frames: int) -> None:
    """A camera that swings to and fro over a picture."""
    sharp = scene(2 * cols, 2 * rows)[..., ::-1]
    with av.open(path, "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(25), options={"crf": "12", "preset": "veryfast"})
        stream.width, stream.height, stream.pix_fmt = cols, rows, "yuv420p"
        for k in range(frames):
            times = k + OPEN * (np.arange(SAMPLES) + 0.5) / SAMPLES
            places = [np.array([[1, 0, x], [0, 1, rows / 2]], np.float32) for x in cols / 2 * (1 + np.sin(2 * STEP * times / cols))]
            light = [cv2.warpAffine(sharp, at, (cols, rows), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP) for at in places]
            shown = np.sqrt(np.mean([(each / 255.0) ** 2 for each in light], axis=0))
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.round(255 * shown).astype(np.uint8), format="rgb24")))
        container.mux(stream.encode(None))


def run(folder: Path, clips: list[Path], *, workers: int, cores: set[int], defaults: str = DEFAULTS) -> float:
    """Seconds that `rsvideo run` takes for the clips on these cores."""
    job = folder / "job.yaml"
    job.write_text(f"output: {{folder: out}}\ndefaults: {defaults}\nclips: [{', '.join(c.name for c in clips)}]\n")
    started = time.monotonic()
    subprocess.run(
        [RSVIDEO, "run", str(job), "-j", str(workers), "--overwrite", "--fresh", "--progress", "none"],
        check=True,
        capture_output=True,
        timeout=7200,
        preexec_fn=lambda: os.sched_setaffinity(0, cores),
    )
    return time.monotonic() - started


def peak() -> float:
    """GB of the largest process so far."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6


def main() -> None:
    """Print two Markdown tables; what is measured grows from row to row, so that the peak memory is each row's own."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", default="100,1000")
    parser.add_argument("--large", type=int, default=8)
    parser.add_argument("--workers", type=int, default=16)
    args = parser.parse_args()
    cores = sorted(os.sched_getaffinity(0))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print("| clip | frames | peak memory GB | seconds |\n|---|---|---|---|")
        for frames in [int(n) for n in args.frames.split(",")]:
            clip(folder / "a.mp4", 120, 192, frames)
            seconds = run(folder, [folder / "a.mp4"], workers=1, cores=set(cores))
            print(f"| 192 x 120 | {frames} | {peak():.3f} | {seconds:.0f} |", flush=True)
        clip(folder / "a.mp4", 1080, 1920, args.large)
        seconds = run(folder, [folder / "a.mp4"], workers=1, cores=set(cores))
        print(f"| 1920 x 1080 | {args.large} | {peak():.3f} | {seconds:.0f} |", flush=True)
        if len(cores) < 2:
            sys.exit("two cores are needed to compare one worker with two")
        clips = [folder / f"{n}.mp4" for n in "ab"]
        for path in clips:
            clip(path, 360, 640, args.workers)
        print("\n| workers | cores | seconds | times one |\n|---|---|---|---|")
        one = 0.0
        for workers, used in ((1, cores[:1]), (1, cores[:2]), (2, cores[:2])):
            seconds = run(folder, clips, workers=workers, cores=set(used))
            one = one or seconds
            print(f"| {workers} | {len(used)} | {seconds:.0f} | {one / seconds:.2f} |", flush=True)


if __name__ == "__main__":
    main()
