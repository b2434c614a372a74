"""Render hand-held clips of known readout and lens, follow their points, and print the readout and the focal length that these show.

    python tests/benchmarks/selfcal.py [--cases 24] [--seed 0] [--frames 25]

Each case draws a photograph (of scikit-image's), a hand-shake of 0.01 to 0.4 rad/s, a readout of 4 to 33 ms, an exposure of 1 to 8 ms,
a lens, read and shot noise, and 8-bit sRGB codes of 320 x 240 pixels at 30 frames a second; every fifth camera stands on a tripod.
"""

import argparse
import time

import cv2
import numpy as np
import skimage.data

from calibration.intrinsics.from_motion import VAGUE, focal_length
from calibration.timing.cannot_tell import CannotTellError
from calibration.timing.pair_motion import Pair
from calibration.timing.self_calibration import explain
from rsvideo.physics import gyro, shake, simulate, tone
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.tone import Transfer
from rsvideo.progress import ignore
from rsvideo.restoration import tracks

ROWS, COLS, FPS = 240, 320, 30.0
SCENES = ("astronaut", "coffee", "rocket", "brick", "gravel", "cat", "immunohistochemistry", "grass")


def scene(name: str) -> np.ndarray:
    """A photograph in linear light, grey, large enough for the frame and its wandering."""
    photo = np.atleast_3d(getattr(skimage.data, name)()).astype(np.float32) / 255
    light = tone.decode(Transfer.SRGB, photo).mean(axis=2)
    factor = max(1.0, 480 / light.shape[0], 640 / light.shape[1])
    light = cv2.resize(light, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
    padded = cv2.copyMakeBorder(light, 200, 200, 200, 200, cv2.BORDER_REFLECT)
    return np.clip(padded, 0, 1).astype(float)[..., None]


def case(seed: int, frames: int) -> tuple[dict, str]:
    """One clip: its facts, and why no readout was found, if none was."""
    rng = np.random.default_rng([seed, 3])
    name = SCENES[seed % len(SCENES)]
    readout, exposure = float(rng.uniform(4e-3, 33e-3)), float(rng.uniform(1e-3, 8e-3))
    rms = 1e-6 if seed % 5 == 4 else float(np.exp(rng.uniform(np.log(0.01), np.log(0.4))))
    camera = Intrinsics.centred(focal=float(rng.uniform(250, 500)), rows=ROWS, cols=COLS)
    timing = ShutterTiming.from_readout(exposure=exposure, readout=readout, rows=ROWS)
    angles = shake.shake(rng, frames / FPS + 0.1, 2000.0, rms=rms)
    angles = angles - angles.mean(axis=0)
    path = gyro.spline_through(gyro.poses_from_angles(angles, camera=camera), duration=(len(angles) - 1) / 2000, spacing=0.004)
    light = scene(name)
    pairs, before = [], None
    for k in range(frames):
        times = timing.sample_times(3) + k / FPS + 0.02
        maps = simulate.homographies(path.at(times.ravel()), intrinsics=camera).reshape(*times.shape, 3, 3)
        x, y = np.meshgrid(np.arange(COLS, dtype=float), np.arange(ROWS, dtype=float))
        frame = simulate._sampled_through(light, x, y, maps, intrinsics=camera, observe=ignore)[..., 0]
        frame = frame + 0.004 * rng.standard_normal(frame.shape) * np.sqrt(0.5 + np.maximum(frame, 0))
        stored = np.round(255 * tone.encode(Transfer.SRGB, np.clip(frame, 0, 1).astype(np.float32)))
        codes = tracks.codes(tone.decode(Transfer.SRGB, stored / np.float32(255)).astype(float))
        if before is not None:
            found = tracks.track(before, codes)
            pairs.append(Pair(before=found.before, after=found.after, begins=((k - 1) / FPS, k / FPS)))
        before = codes
    lens = focal_length(pairs, ROWS, COLS)
    facts = {"scene": name, "readout": readout, "rms": rms, "exposure": exposure, "points": np.median([len(pair.before) for pair in pairs])}
    facts |= {"focal": camera.fx / COLS, "focal_error": lens.pixels / camera.fx - 1, "focal_deviation": lens.deviation}
    try:
        explained = explain(pairs, rows=ROWS, cols=COLS, period=1 / FPS)
    except CannotTellError as error:
        return facts, str(error)
    return facts | {"error": explained.readout / readout - 1, "std": explained.std / readout}, ""


def main() -> None:
    """Run, and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--frames", type=int, default=25)
    args = parser.parse_args()
    print(
        "| scene | shake rad/s | exposure ms | points | focal / cols | error % | stated % | readout ms | error % | stated std % | seconds |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    answered, lenses, still = [], [], 0
    for k in range(args.cases):
        start = time.perf_counter()
        facts, why = case(args.seed + k, args.frames)
        line = f"| {facts['scene']} | {facts['rms']:.3f} | {1e3 * facts['exposure']:.1f} | {facts['points']:.0f} "
        line += f"| {facts['focal']:.2f} | {100 * facts['focal_error']:.1f} | {100 * facts['focal_deviation']:.1f} "
        line += f"| {1e3 * facts['readout']:.2f} |"
        lenses += [facts] if facts["focal_deviation"] <= VAGUE else []
        answer = "cannot tell | " if why else f"{100 * facts['error']:.1f} | {100 * facts['std']:.1f}"
        print(line, answer, f"| {time.perf_counter() - start:.0f} |", why, flush=True)
        answered += [] if why else [facts]
        still += facts["rms"] < 1e-3
    errors = np.abs([facts["error"] for facts in answered])
    sigmas = errors / [facts["std"] for facts in answered]
    print(f"\n{len(answered)} of {args.cases} answered ({still} stood on a tripod)")
    if answered:
        print(f"median error {100 * np.median(errors):.1f} %, worst {100 * errors.max():.1f} %, above 15 %: {np.sum(errors > 0.15)}")
        print(f"error within 2 std: {np.mean(sigmas < 2):.0%}, within 3 std: {np.mean(sigmas < 3):.0%}")
    print(f"\nfocal length: {len(lenses)} of {args.cases} answered")
    if lenses:
        errors = np.abs([facts["focal_error"] for facts in lenses])
        within = np.mean(errors < 2 * np.array([facts["focal_deviation"] for facts in lenses]))
        print(f"median error {100 * np.median(errors):.1f} %, worst {100 * errors.max():.1f} %, within 2 deviations: {within:.0%}")


if __name__ == "__main__":
    main()
