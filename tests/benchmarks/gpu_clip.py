"""What a clip takes with its latent images on a GPU: seconds a frame by stage in one process, and frames/s of several on one card.

    python tests/benchmarks/gpu_clip.py [--size 1920x1080] [--blur 12] [--frames 8] [--jobs 4,12] [--device cuda] [--source FILE]
        [--json FILE]

The clip is that of `stages.py`; it is rendered into `--source` if that is not there, which takes longer than all the rest. Its stages
are those of the command's own thread, which waits for the card where it fetches pictures: at the ends of the latent image, of the
neighbours and of straightening. Then as many clips of so many frames as workers are restored by `rsvideo run -j`, from start to end, what
each worker loads and compiles included. A small clip before compiles what is kept on disk.
With `--device cpu` the same is the processor's.
"""

import argparse
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import batch
import published
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


def at_once(source: Path, cols: int, jobs: int, device: str) -> float:
    """Seconds that so many workers take for a copy of the clip each."""
    with tempfile.TemporaryDirectory(dir=source.parent) as folder:
        clips = [Path(shutil.copy(source, Path(folder) / f"clip{k}.mp4")) for k in range(jobs)]
        camera = f"{{exposure: {EXPOSURE}, readout: {READOUT}, focal_px: {FOCAL * cols:g}, transfer: srgb}}"
        defaults = f"{{camera: {camera}, deblur: {{device: {device}}}}}"
        return batch.run(Path(folder), clips, workers=jobs, cores=os.sched_getaffinity(0), defaults=defaults)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--blur", type=float, default=12.0, metavar="PX")
    parser.add_argument("--frames", type=int, default=8)
    parser.add_argument("--jobs", default="4,12", help="workers, one run each")
    parser.add_argument("--device", choices=("cuda", "cpu"), default="cuda")
    parser.add_argument("--source", type=Path, metavar="FILE", help="the clip, from a run of the same size, blur and frames")
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    keep_freed_memory()
    cols, rows = map(int, args.size.split("x"))
    with tempfile.TemporaryDirectory() as folder:
        filmed(warm := Path(folder) / "warm.mp4", *WARM)
        restored(warm, WARM[0], device=args.device)
        source = args.source or Path(folder) / "clip.mp4"
        if not source.exists():
            filmed(source, cols, rows, args.blur, args.frames)
        source = Path(shutil.copy(source, Path(folder) / "filmed.mp4"))
        watch, _, seconds = restored(source, cols, device=args.device, stages=PARTS)
        took = {stage: share for stage, share in by_stage(watch, seconds, args.frames, PARTS).items() if share}
        print("| stage | s a frame |\n|---|---:|")
        print("\n".join(f"| {stage.removesuffix('_s')} | {seconds:.3f} |" for stage, seconds in took.items()), flush=True)
        print("\n| workers | frames | s | frames/s |\n|---:|---:|---:|---:|", flush=True)
        several = []
        for jobs in map(int, filter(None, args.jobs.split(","))):
            try:
                seconds = at_once(source, cols, jobs, args.device)
            except subprocess.CalledProcessError as error:
                raise SystemExit(f"rsvideo run ended with {error.returncode}: {error.stderr.decode()[-2000:]}") from error
            several.append({"workers": jobs, "frames": jobs * args.frames, "s": seconds, "frames_per_s": jobs * args.frames / seconds})
            print(f"| {jobs} | {jobs * args.frames} | {seconds:.1f} | {jobs * args.frames / seconds:.2f} |", flush=True)
    if args.json:
        published.write(args.json, {"gpu_clip": [{"case": f"{args.size}:{args.blur:g}"} | took], "gpu_workers": several})


if __name__ == "__main__":
    main()
