"""What one blind kernel gains and harms, believed or not: photographs under a global shutter, and under a rolling one.

    python tests/benchmarks/one_kernel.py PHOTOS -o FILE.json [--half report] [--seed 0] [--jobs 2]

PHOTOS is a folder of sharp pictures. Of each one still is drawn with a global shutter, where one kernel is the truth but for roll, and one
with a rolling shutter, where none is: 4 to 22 px of blur by a random hand-shake, noise of 0.001 to 0.01, grey, 256 and 320 px wide.
The baseline `uniform` restores it with total variation. FILE gets a row a still: the gain of the kernel that was found, and what
`baselines.kernel_verdict` says of it. The half goes by a hash of the photograph's name, as in corpus.py.
"""

import argparse
import json
import os
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import published
from corpus import HARM, digest, half

import rsvideo
from rsvideo.baselines import kernel_verdict, uniform
from rsvideo.frame import Frame, Verdict
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.tone import Transfer, encode
from rsvideo.report.metrics import psnr
from rsvideo.restoration.scanlines import to_scanlines
from rsvideo.restoration.scene import scene_of, windowed
from rsvideo.restoration.settings import Settings

SHUTTERS = {"global": ((0.05, 0.3), (0.0, 0.0), 256), "rolling": ((0.01, 0.03), (0.01, 0.03), 320)}  # exposure and readout, s; px wide
FOCAL, BLUR, NOISE = (1.0, 3.0), (4.0, 22.0), (1e-3, 1e-2)  # of LARGE; px; at half of white
LARGE = 700  # px, at least, to which a photograph's sides are made smaller
SETTINGS = Settings(prior="tv")


def measured(photograph: Path, shutter: str, seed: int) -> dict | None:
    """A still, the gain of the kernel that is found for it, and what speaks for the kernel; None where there is no blur to undo."""
    rng = np.random.default_rng([seed, list(SHUTTERS).index(shutter), *digest(photograph)[:8]])
    codes = cv2.imread(str(photograph), cv2.IMREAD_GRAYSCALE)
    assert codes is not None
    scale = min(1.0, LARGE / min(codes.shape))
    light = (cv2.resize(codes, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA).astype(np.float32) / 255) ** 2.2
    exposures, readouts, side = SHUTTERS[shutter]
    exposure, readout = float(rng.uniform(*exposures)), float(rng.uniform(*readouts))
    focal = float(rng.uniform(*FOCAL)) * LARGE
    shot = rsvideo.simulate(
        light,
        shutter=rsvideo.Shutter(exposure=exposure, readout=readout),
        camera=rsvideo.Camera(focal_px=focal),
        blur_px=float(rng.uniform(*BLUR)),
        noise=float(rng.uniform(*NOISE)),
        seed=int(rng.integers(2**31)),
        size=(side, side),
    )
    blurred, truth = (np.asarray(picture, np.float32).reshape(side, side, 1) for picture in (shot.blurred, shot.truth))
    timing = ShutterTiming(exposure=exposure, row_time=readout / side, rows=side)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=focal, rows=side, cols=side))
    view = to_scanlines(Frame(pixels=blurred, clipped=blurred >= 1), camera)
    scene = scene_of(view, SETTINGS)
    if uniform.verdict_before(scene) is not Verdict.RESTORED:
        return None
    kernel = uniform.fitted(windowed(scene).frame, uniform.SIZES, uniform.KERNELS)
    latent = np.clip(uniform.deconvolved(view.pixels, view.clipped, kernel, SETTINGS, view.noise), 0, 1).astype(np.float32)
    before, after = (psnr(encode(Transfer.SRGB, light), encode(Transfer.SRGB, truth)) for light in (blurred, latent))
    mirror, focus = kernel_verdict.compared(scene, kernel)
    return {
        "photograph": photograph.stem,
        "shutter": shutter,
        "gain_db": after - before,
        "mirror": mirror,
        "focus": focus,
        "believed": kernel_verdict.believed(scene, kernel),
    }


def main() -> None:
    """Measure, and print a row for each shutter, with all kernels used and with those that are believed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photos", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--half", choices=("choose", "report"), default="report")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    request = parser.parse_args()
    os.environ |= {"RSVIDEO_THREADS": "1", "OMP_NUM_THREADS": "1"} if request.jobs > 1 else {}
    photographs = sorted(path for path in request.photos.rglob("*.jpg") if half(path) == request.half)
    stills, summary = [], []
    for shutter in SHUTTERS:
        with ProcessPoolExecutor(request.jobs) as pool:
            rows = [row for row in pool.map(partial(measured, shutter=shutter, seed=request.seed), photographs) if row]
        stills += rows
        summary += [
            summed(shutter, "all", rows, len(rows)),
            summed(shutter, "believed", [row for row in rows if row["believed"]], len(rows)),
        ]
    request.output.write_text(json.dumps({"summary": summary, "stills": stills}, indent=1) + "\n")
    published.print_rows(summary)


def summed(shutter: str, kernels: str, used: list[dict], stills: int) -> dict:
    """What these kernels do, over all stills with that shutter: a still whose kernel is not used gains nothing."""
    gains = [row["gain_db"] for row in used]
    return {
        "shutter": shutter,
        "kernels": kernels,
        "stills": stills,
        "used": len(used),
        "mean_gain_db": sum(gains) / stills,
        "harmed": sum(gain < -HARM for gain in gains),
        "least_db": min(gains, default=0.0),
    }


if __name__ == "__main__":
    main()
