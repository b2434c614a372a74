"""Measure the readout of simulated clips under flickering lights and print how far it is off.

    python tests/benchmarks/flicker.py [--cases 60] [--seed 0] [--still] [--slip 2] [--hand 2]

Each case draws a readout of 5 to 35 ms, a light of 100 Hz to 2 kHz (a sine, or a square wave of any duty), an exposure of up to half its
period, a frame rate, a scene whose contrast along the rows is up to ten times that of the bands, a slow drift of the light, shot and
read noise, and 8-bit sRGB codes. --still keeps the first frame only; --slip states a frequency that is so many times the light's; --hand
moves the scene by so many px from frame to frame.
"""

import argparse

import numpy as np

from calibration import flicker
from calibration.timing.bands import measure, row_profile
from calibration.timing.cannot_tell import CannotTellError
from rsvideo.physics import tone
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.tone import Transfer

ROWS, COLS, FRAMES = 360, 160, 48


def scene(rng: np.random.Generator, contrast: float) -> np.ndarray:
    """Clouds with a 1/f spectrum and a few upright bars, of mean 0.3; `contrast` is the deviation of its rows' mean, relative."""
    f = np.hypot(*np.meshgrid(np.fft.fftfreq(COLS), np.fft.fftfreq(ROWS)))
    f[0, 0] = np.inf
    clouds = np.fft.ifft2(np.fft.fft2(rng.standard_normal((ROWS, COLS))) / f).real
    clouds += clouds.std() * (np.arange(COLS) // 20 % 2)
    clouds = clouds - clouds.mean()
    rows = clouds.mean(axis=1)
    light = 0.3 * np.exp(clouds * min(contrast / rows.std(), 0.9 / clouds.std()))
    return np.minimum(light, 0.9)[..., None]


def case(seed: int, frames: int, slip: float, hand: float) -> dict:
    """One clip, measured; its light is stated to be `slip` times as fast as it is."""
    rng = np.random.default_rng([seed, 7])
    readout = float(rng.uniform(5e-3, 35e-3))
    hertz = float(np.exp(rng.uniform(np.log(100), np.log(2000))))
    hertz = float(rng.choice([100.0, 120.0, round(hertz), 500.0, 1000.0]))
    exposure = float(rng.uniform(0.05, 0.5) / hertz)
    rates = [rate for rate in (24000 / 1001, 25.0, 30000 / 1001, 50.0, 60000 / 1001) if readout * rate <= 1]
    fps = float(rng.choice(rates))
    depth = float(np.exp(rng.uniform(np.log(0.02), np.log(0.9))))
    amplitudes = flicker.sine(depth) if rng.random() < 0.5 else depth * flicker.square(float(rng.uniform(0.2, 0.8))) / 2
    seen = abs(amplitudes[0]) * np.sinc(hertz * exposure)
    ratio = float(rng.uniform(0.1, 10))
    still = scene(rng, ratio * seen / np.sqrt(2))
    direction = Direction.TOP_TO_BOTTOM if rng.random() < 0.5 else Direction.BOTTOM_TO_TOP
    timing = ShutterTiming.from_readout(exposure=exposure, readout=readout, rows=ROWS, direction=direction)
    drift = rng.uniform(-0.01, 0.01)  # cycles a frame
    profiles, times = [], []
    wander = np.cumsum(hand * rng.standard_normal((frames, 2)), axis=0) * (hand > 0)
    for k in range(frames):
        moved = np.roll(still, tuple(np.round(wander[k]).astype(int)), axis=(0, 1))
        light = flicker.lit(moved, timing, flicker.gains(timing, k / fps, amplitudes, hertz=hertz, cycles=drift * k))
        light = light + rng.standard_normal(light.shape) * 0.005 * np.sqrt(0.5 + np.maximum(light, 0))
        codes = np.round(255 * tone.encode(Transfer.SRGB, np.clip(light, 0, 1).astype(np.float32)))
        profiles.append(row_profile(tone.decode(Transfer.SRGB, codes / np.float32(255))))
        times.append(k / fps)
    facts = {"readout": readout, "hertz": hertz, "fps": fps, "depth": depth, "scene / bands": ratio, "bands": readout * hertz}
    try:
        found = measure(profiles, times, slip * hertz, longest=1 / fps)
    except CannotTellError as error:
        return facts | {"reason": str(error)}
    wrong = found.direction is not None and found.direction is not direction
    return facts | {
        "error": found.readout / readout - 1,
        "std": found.std / found.readout,
        "direction": found.direction,
        "wrong way": wrong,
        "notes": found.notes,
    }


def main() -> None:
    """Run, and print a Markdown table with what came out of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--still", action="store_true")
    parser.add_argument("--slip", type=float, default=1.0)
    parser.add_argument("--hand", type=float, default=0.0)
    args = parser.parse_args()
    done = [case(args.seed + k, 1 if args.still else FRAMES, args.slip, args.hand) for k in range(args.cases)]
    print("| light Hz | fps | bands a frame | depth | scene / bands | readout ms | error % | stated std % | direction |")
    print("|---|---|---|---|---|---|---|---|---|")
    for one in done:
        facts = f"| {one['hertz']:.0f} | {one['fps']:.2f} | {one['bands']:.2f} | {one['depth']:.2f} | {one['scene / bands']:.1f} "
        facts += f"| {1e3 * one['readout']:.2f} |"
        answer = (
            "cannot tell |"
            if "reason" in one
            else f"{100 * one['error']:.3f} | {100 * one['std']:.3f} | {one['direction'] or 'cannot tell'} |"
        )
        print(facts, answer, one.get("reason", ""))
    answered = [one for one in done if "error" in one]
    errors = np.abs([one["error"] for one in answered])
    sigmas = errors / [one["std"] for one in answered]
    print(f"\n{len(answered)} of {len(done)} answered")
    if answered:
        high = 100 * np.quantile(errors, 0.9)
        print(f"median error {100 * np.median(errors):.3f} %, 90 % below {high:.3f} %, worst {100 * errors.max():.2f} %")
        print(f"error within 2 std: {np.mean(sigmas < 2):.0%}, within 3 std: {np.mean(sigmas < 3):.0%}")
        print(
            f"directions: {sum(one['direction'] is not None for one in answered)} told, {sum(one['wrong way'] for one in answered)} wrongly"
        )
        wrong = [one for one, error, sigma in zip(answered, errors, sigmas, strict=True) if error > 0.05 and sigma > 3]
        print(f"wrong harmonic: {len(wrong)}, {sum(bool(one['notes']) for one in wrong)} of them with a note of others")


if __name__ == "__main__":
    main()
