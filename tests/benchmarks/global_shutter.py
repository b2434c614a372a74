"""Restore real global-shutter frames (Levin et al., CVPR 2009) with the installed command and print what was gained.

    python tests/benchmarks/global_shutter.py FOLDER -o RESULTS
    python tests/benchmarks/global_shutter.py FOLDER --method uniform

FOLDER holds MATLAB files with the sharp picture x, the blurred one y, in [0, 1], and the kernel f, turned round. Their readout
is 0; a shift explains them. For the uniform kernel what is printed is the field's measure: the ratio of the squared error to that
with the true kernel, the same solver and the best translation, for total variation and for the denoiser.
"""

import argparse
import json
import subprocess
import time
from pathlib import Path

import numpy as np
import scipy.io
import tifffile
from installed import RSVIDEO

from rsvideo.baselines import uniform
from rsvideo.frame import Frame
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.report.metrics import psnr
from rsvideo.restoration.blind_kernel import centre, fitted
from rsvideo.restoration.scanlines import to_scanlines
from rsvideo.restoration.scene import scene_of
from rsvideo.restoration.settings import Settings


def main() -> None:
    """Run, and print a Markdown table; a frame that fails is told and fails the run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--method", choices=("rsvideo", "uniform"), default="rsvideo")
    args = parser.parse_args()
    if args.method == "uniform":
        return error_ratios(args.folder)
    if args.output is None:
        parser.error("a folder for the results is needed: -o RESULTS")
    args.output.mkdir(parents=True, exist_ok=True)
    gains, failed = [], []
    print("| case | blurred dB | restored dB | gain dB | verdict | seconds |\n|---|---|---|---|---|---|")
    for file in sorted(args.folder.glob("*.mat")):
        data = scipy.io.loadmat(str(file))
        sharp, blurred = (np.clip(data[name], 0, 1).astype(np.float32)[..., None] for name in "xy")
        source, output = args.output / f"{file.stem}_blurred.tif", args.output / f"{file.stem}.tif"
        tifffile.imwrite(source, np.round(65535 * blurred[..., 0]).astype(np.uint16), photometric="minisblack")
        words = [RSVIDEO, "deblur", source, "-o", output, "--exposure", "0.3", "--readout", "0", "--motion", "shift"]
        words += ["--transfer", "linear", "--overwrite", "--json"]
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=1800)
        if done.returncode:
            failed.append(file.stem)
            print(f"| {file.stem} | {done.stderr.strip()} |")
            continue
        frame = json.loads(done.stdout)["frames"][0]
        after = tifffile.imread(output).astype(np.float32).reshape(*blurred.shape[:2], -1).mean(axis=2, keepdims=True) / 65535
        before, now = psnr(blurred, sharp), psnr(after, sharp)
        gains.append(now - before)
        print(f"| {file.stem} | {before:.2f} | {now:.2f} | {now - before:.2f} | {frame['verdict']} | {frame['seconds']:.0f} |", flush=True)
    print(f"\nmean gain {np.mean(gains):.2f} dB, least {np.min(gains):.2f} dB; {len(failed)} of {len(gains) + len(failed)} failed")
    if failed:
        raise SystemExit(1)


def error_ratios(folder: Path) -> None:
    """Of the uniform kernel, and how many are at most 2."""
    solvers = {"tv": Settings(prior="tv"), "denoiser": Settings(prior="denoiser")}
    ratios: dict[str, list[float]] = {name: [] for name in solvers}
    print("| case | blurred dB | " + " | ".join(f"{name}: true dB | found dB | ratio" for name in solvers) + " | seconds |")
    print("|" + "---|" * (3 + 3 * len(solvers)))
    for file in sorted(folder.glob("*.mat")):
        data = scipy.io.loadmat(str(file))
        sharp, blurred = (np.clip(data[name], 0, 1).astype(np.float32)[..., None] for name in "xy")
        true = centre(np.ascontiguousarray(data["f"][::-1, ::-1], np.float32))
        frame = Frame(pixels=blurred, clipped=blurred >= 1)
        timing, lens = ShutterTiming(exposure=0.3, row_time=0.0, rows=len(blurred)), Intrinsics.centred(focal=255.0, rows=255, cols=255)
        view = to_scanlines(frame, Camera(timing=timing, intrinsics=lens))
        scene = scene_of(view, solvers["tv"])
        started = time.monotonic()
        found = fitted(scene.frame, uniform.SIZES, uniform.KERNELS)
        seconds = time.monotonic() - started
        cells = []
        for name, settings in solvers.items():
            best, own = (psnr(uniform.deconvolved(blurred, frame.clipped, k, settings, view.noise), sharp) for k in (true, found))
            ratios[name].append(10 ** ((best - own) / 10))
            cells.append(f"{best:.2f} | {own:.2f} | {ratios[name][-1]:.2f}")
        print(f"| {file.stem} | {psnr(blurred, sharp):.2f} | " + " | ".join(cells) + f" | {seconds:.1f} |", flush=True)
    for name, values in ratios.items():
        share = np.mean(np.array(values) <= 2)
        print(f"\n{name}: mean ratio {np.mean(values):.2f}, largest {np.max(values):.2f}, at most 2 in {share:.0%} of {len(values)}")


if __name__ == "__main__":
    main()
