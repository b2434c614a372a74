"""Restore real global-shutter frames (Levin et al., CVPR 2009) with the installed command and print what was gained.

    python tests/benchmarks/global_shutter.py FOLDER -o RESULTS

FOLDER holds MATLAB files with the sharp picture x and the blurred one y, in [0, 1]. Their readout is 0; a shift explains them.
"""

import argparse
import json
import subprocess
from pathlib import Path

import numpy as np
import scipy.io
import tifffile

from rsvideo.report.metrics import psnr


def main() -> None:
    """Run, and print a Markdown table; a frame that fails is told and fails the run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    gains, failed = [], []
    print("| case | blurred dB | restored dB | gain dB | verdict | seconds |\n|---|---|---|---|---|---|")
    for file in sorted(args.folder.glob("*.mat")):
        data = scipy.io.loadmat(str(file))
        sharp, blurred = (np.clip(data[name], 0, 1).astype(np.float32)[..., None] for name in "xy")
        source, output = args.output / f"{file.stem}_blurred.tif", args.output / f"{file.stem}.tif"
        tifffile.imwrite(source, np.round(65535 * blurred[..., 0]).astype(np.uint16), photometric="minisblack")
        words = ["rsvideo", "deblur", source, "-o", output, "--exposure", "0.3", "--readout", "0", "--motion", "shift"]
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


if __name__ == "__main__":
    main()
