"""What a clip takes with its latent images on a GPU: seconds a frame by stage in one process, and frames/s of several on one card.

    python tests/benchmarks/gpu_clip.py [--size 1920x1080] [--blur 12] [--frames 8] [--jobs 4,12] [--prior denoiser,tv] [--no-stages]
        [--device cuda] [--source FILE] [--json FILE]

The clip is that of `stages.py`; it is rendered into `--source` if that is not there, which takes longer than all the rest. Its stages
are those of the command's own thread, which waits for the card where it fetches pictures: at the ends of the latent image, of the
neighbours and of straightening. Then as many clips of so many frames as workers are restored by `rsvideo run -j`, from start to end. What
passes until all are measured, once each, is told apart: the longer a clip is, the less it counts. A small clip before compiles what is
kept on disk. Processes share a card well where CUDA's Multi-Process Service (MPS) runs: `nvidia-cuda-mps-control -d`, which this script
leaves to whoever calls it.
With `--device cpu` the same is the processor's.
"""

import argparse
import json
import os
import shutil
import subprocess
import tempfile
import time
from itertools import product
from pathlib import Path

import published
from installed import RSVIDEO
from stages import EXPOSURE, FOCAL, READOUT, STAGES, by_stage, filmed, restored

from rsvideo.allocation import keep_freed_memory
from rsvideo.restoration import multi_frame, nonblind

PARTS = {
    **STAGES,
    "latent image": (*STAGES["latent image"], (nonblind, "finished")),
    "fusion": ((multi_frame, "fused"),),
    "straightening": ((multi_frame, "straightened"),),
}
WARM = 160, 120, 4.0, 3  # columns, rows, px of blur, frames
MPS = Path(os.environ.get("CUDA_MPS_PIPE_DIRECTORY", "/tmp/nvidia-mps"))  # is there while the service runs


def at_once(source: Path, cols: int, jobs: int, device: str, prior: str) -> tuple[float, float]:
    """Seconds that so many workers take for a copy of the clip each, and how many of them pass until the first frame is worked on."""
    with tempfile.TemporaryDirectory(dir=source.parent) as name:
        folder = Path(name)
        clips = [Path(shutil.copy(source, folder / f"clip{k}.mp4")).name for k in range(jobs)]
        camera = f"{{exposure: {EXPOSURE}, readout: {READOUT}, focal_px: {FOCAL * cols:g}, transfer: srgb}}"
        defaults = f"{{camera: {camera}, deblur: {{device: {device}, prior: {prior}}}}}"
        (job := folder / "job.yaml").write_text(f"output: {{folder: out}}\ndefaults: {defaults}\nclips: [{', '.join(clips)}]\n")
        command = [RSVIDEO, "run", str(job), "-j", str(jobs), "--progress", "jsonl"]
        begun, first = time.perf_counter(), None
        with (folder / "words").open("w+") as words, subprocess.Popen(command, stdout=subprocess.PIPE, stderr=words, text=True) as run:
            assert run.stdout
            for line in run.stdout:
                if first is None and json.loads(line)["event"] == "frame":
                    first = time.perf_counter() - begun
            seconds = time.perf_counter() - begun
            if run.wait():
                raise SystemExit(f"rsvideo run ended with {run.returncode}: {Path(words.name).read_text()[-2000:]}")
        assert first is not None
        return seconds, first


def by_one(source: Path, cols: int, frames: int, device: str, case: str) -> dict[str, float | str]:
    """Seconds a frame of each stage, in this process."""
    filmed(warm := source.with_name("warm.mp4"), *WARM)
    restored(warm, WARM[0], device=device)
    watch, _, seconds = restored(source, cols, device=device, stages=PARTS)
    return {"case": case} | {stage: share for stage, share in by_stage(watch, seconds, frames, PARTS).items() if share}


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--blur", type=float, default=12.0, metavar="PX")
    parser.add_argument("--frames", type=int, default=8)
    parser.add_argument("--jobs", default="4,12", help="workers, one run each; nothing: none")
    parser.add_argument("--prior", default="denoiser,tv", help="of the workers' runs, one after the other")
    parser.add_argument("--no-stages", action="store_true", help="the workers' runs alone")
    parser.add_argument("--device", choices=("cuda", "cpu"), default="cuda")
    parser.add_argument("--source", type=Path, metavar="FILE", help="the clip, from a run of the same size, blur and frames")
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    keep_freed_memory()
    cols, rows = map(int, args.size.split("x"))
    found: dict[str, list[dict]] = {"gpu_clip": [], "gpu_workers": []}
    with tempfile.TemporaryDirectory() as folder:
        source = args.source or Path(folder) / "clip.mp4"
        if not source.exists():
            filmed(source, cols, rows, args.blur, args.frames)
        source = Path(shutil.copy(source, Path(folder) / "filmed.mp4"))
        if not args.no_stages:
            found["gpu_clip"].append(by_one(source, cols, args.frames, args.device, f"{args.size}:{args.blur:g}"))
            published.print_rows(found["gpu_clip"])
        for prior, jobs in product(args.prior.split(","), map(int, filter(None, args.jobs.split(",")))):
            seconds, first = at_once(source, cols, jobs, args.device, prior)
            frames = jobs * args.frames
            row = {"prior": prior, "workers": jobs, "mps": "yes" if MPS.exists() else "no", "frames": frames}
            row |= {"seconds": seconds, "before_s": first}
            found["gpu_workers"].append(row | {"frames_per_s": frames / seconds, "then_per_s": frames / (seconds - first)})
            published.print_rows(found["gpu_workers"][-1:])
    if args.json:
        published.write(args.json, {name: rows for name, rows in found.items() if rows})


if __name__ == "__main__":
    main()
