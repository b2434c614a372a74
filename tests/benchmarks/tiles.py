"""What column tiles cost: exact solves in each, against conjugate gradients with the exact operator of the whole frame.

    python tests/benchmarks/tiles.py CASES

CASES holds a folder a case, as `rsvideo simulate` writes them. The motion is given, the picture is grey, and both minimise the same
Eq. (15), total variation of one weight; the tiles as wide as the default tolerance lets them be.
"""

import argparse
from collections import deque
from pathlib import Path

import cv2
import numpy as np
from cases import cases_of, facts_of

from rsvideo.paper import latent_image
from rsvideo.physics import tone
from rsvideo.physics.blur import BlurOperator
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.luminance import luminance
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.tone import Transfer
from rsvideo.report.metrics import psnr
from rsvideo.restoration import nonblind
from rsvideo.restoration.settings import Settings
from rsvideo.shooting import given_motion

MU = 5e-4
CONVERGED = latent_image.LatentSettings(steps=40, inner_tolerance=1e-4)


def grey(path: Path) -> np.ndarray:
    """The luminance of a picture, in linear light."""
    image = cv2.imread(str(path))
    if image is None:
        raise SystemExit(f"cannot read {path}")
    return luminance(tone.decode(Transfer.SRGB, image[..., ::-1].astype(np.float32) / 255))


def gains(case: Path) -> tuple[int, float, float, float]:
    """How many tiles, and the dB of the blurred frame, by tiles, and by conjugate gradients."""
    facts = facts_of(case)
    frame, truth = grey(case / "blurred.png"), grey(case / "truth.png")
    timing = ShutterTiming(exposure=facts["exposure_s"], row_time=facts["row_time_s"], rows=facts["rows"])
    lens = Intrinsics.centred(focal=facts["focal_px"], rows=facts["rows"], cols=facts["cols"])
    camera = Camera(timing=timing, intrinsics=lens)
    path = given_motion.read(case / "motion.csv", camera)
    settings = Settings(prior="tv", mu_final=MU)
    unclipped = np.zeros((*frame.shape, 1), bool)
    tiles = nonblind.tiled(frame[..., None], unclipped, path, camera, samples=settings.samples, tolerance=settings.tolerance)
    by_tiles = deque(nonblind.deblur(tiles, settings, 0.003), maxlen=1).pop()[..., 0]
    K = BlurOperator.covering(path, camera=camera, samples=settings.samples)
    by_gradients = latent_image.restore(frame, K, mu=MU, settings=CONVERGED)[K.inside]

    def against_truth(light: np.ndarray) -> float:
        return psnr(*(tone.encode(Transfer.SRGB, image.astype(np.float32))[..., None] for image in (light, truth)))

    return len(tiles.cut), against_truth(frame), against_truth(by_tiles), against_truth(by_gradients)


def main() -> None:
    """Run, and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    args = parser.parse_args()
    print("| case | tiles | blurred dB | by tiles dB | by conjugate gradients dB |\n|---|---|---|---|---|")
    for case in cases_of(args.cases):
        cut, *measured = gains(case)
        print(f"| {case.name} | {cut} | {' | '.join(f'{value:.2f}' for value in measured)} |", flush=True)


if __name__ == "__main__":
    main()
