"""Film scenes of several depths, with things that move by themselves, by a rolling shutter, as cases for footage.py.

    python tests/benchmarks/layers.py PHOTOS --gyro LOG -o CASES [--clips 26] [--frames 16] [--half choose] [--seed 0]
        [--vibration PX] [--pan PX] [--scale 1] [--repeat N] [--flat]

PHOTOS is a folder of sharp pictures. Each scene has a photograph far away, up to two others cut out as pillars, ground or pebbles and
nearer by up to ten times, and in one of two scenes a thing that moves by itself: so motion changes abruptly at borders, where no smooth
field follows it. The camera turns as a random moment of LOG says, at 0.3 to 1.5 times its speed, and walks. Exposure is 4 to 33 ms, readout
5 to 30 ms, at 30 frames a second; noise, clipping and H.264 as a camera's. --vibration adds a shake of 25 to 90 Hz and up to so many px,
--pan a steady turn by 0.4 to 1 times so many px from frame to frame, mostly sideways; photographs are mirrored at their borders.
Clips are of 640 x 360 px, and the numbers above those of such clips; --scale makes them larger, all px with them. With --repeat, every
Nth picture repeats the one before, as converters of the frame rate leave it where a frame was lost. With --flat, a scene is one photograph,
and CASES gets the camera's path too, motion.csv, for paths.py.
Photographs of one half only are taken (corpus.py): what is chosen by the one can be reported by the other. CASES gets a folder a clip
with clip.mp4, truth.mp4, the sharp scene at the middle of each frame's interval, and case.json. The blur of a frame is that of its middle
scanline, in px at a depth between far and near.
"""

import argparse
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
from corpus import half

from rsvideo.physics import gyro
from rsvideo.physics.gyro import GyroLog
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.tone import Transfer, decode
from rsvideo.pipeline.simulated_case import shutter_facts
from rsvideo.video import colour, tags
from rsvideo.video.output_format import Encoding
from rsvideo.video.stream import Matrix, Picture, Stream
from rsvideo.video.writer import Writer

ROWS, COLS, MARGIN, RATE = 360, 640, 160, 30
SAMPLES = 24  # of an exposure, at least
EXPOSURE, READOUT, SPEED, FOCAL = (4e-3, 33e-3), (5e-3, 30e-3), (0.3, 1.5), (0.8, 1.2)  # s, s, of the log's rates, of the columns
FARTHEST, NEAR, BETWEEN = 0.2, (0.6, 2.0), 0.4  # of the camera's walk, by which a layer moves
WALK, DRIFT, THINGS = (0, 2, 5, 10), (0, 20, 60), (30, 100, 200)  # px, px/s, px/s
MOST_TURN, MOST_WALK = 110, 25  # px, for which photographs have a margin
PAN = (0.4, 1.0)  # of the fastest
TILT = 0.15  # of a pan, its standard deviation up and down
STEP = 1 / 2000  # s, between which the camera's motion is interpolated
LEAD = 0.03  # s of motion before the first frame
VIBRATION = (25, 90)  # Hz
NOISE, GAINS, QUALITY, TRUTH = (1.5e-3, 8e-3), (1.0, 1.0, 1.0, 1.6), (16, 20, 23), 4.0  # at white; the last two constant rate factors

Pose = Callable[[np.ndarray, float], tuple[np.ndarray, np.ndarray, np.ndarray]]  # px, px and rad at times, of a layer


@dataclass(frozen=True, kw_only=True, eq=False)
class Layer:
    """A photograph at a depth, and where it covers what lies behind."""

    light: np.ndarray
    depth: float
    covers: np.ndarray | None = None  # 0 to 1; None: everywhere
    velocity: np.ndarray | None = None  # px/s, of a thing that moves by itself


def log_uniform(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    return float(np.exp(rng.uniform(*np.log(bounds))))


def photograph(rng: np.random.Generator, photographs: list[Path], scale: float) -> np.ndarray:
    """A part of one, in linear light, as large as a scene."""
    rows, cols = (round(scale * (side + 2 * MARGIN)) for side in (ROWS, COLS))
    codes = cv2.imread(str(photographs[rng.integers(len(photographs))]), cv2.IMREAD_COLOR)
    assert codes is not None
    fits = max(rows / codes.shape[0], cols / codes.shape[1])
    factor = max(fits, min(1.0, fits * rng.uniform(1.0, 1.3)))
    codes = cv2.resize(codes, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    codes = cv2.resize(codes, (max(cols, codes.shape[1]), max(rows, codes.shape[0])))  # which rounding may have taken
    y, x = (int(rng.integers(there - wanted + 1)) for there, wanted in zip(codes.shape, (rows, cols), strict=False))
    return decode(Transfer.SRGB, codes[y : y + rows, x : x + cols, ::-1].astype(np.float32) / 255)


def covered(rng: np.random.Generator) -> np.ndarray:
    """Where something near is: pillars, the ground, or pebbles."""
    mask, kind = np.zeros((ROWS + 2 * MARGIN, COLS + 2 * MARGIN), np.float32), rng.integers(3)
    if kind == 0:
        for left, width in zip(rng.integers(0, mask.shape[1], 3), rng.integers(8, 90, rng.integers(1, 4)), strict=False):
            mask[:, left : left + width] = 1
    elif kind == 1:
        mask[rng.integers(MARGIN + ROWS // 2, MARGIN + ROWS) :] = 1
    else:
        for _ in range(rng.integers(1, 6)):
            ellipse(mask, rng.integers((0, 0), mask.shape[::-1]), rng.integers(10, 90, 2), rng.uniform(0, 180))
    return cv2.GaussianBlur(mask, (0, 0), 0.6)


def ellipse(mask: np.ndarray, middle: np.ndarray, axes: np.ndarray, turned: float = 0.0) -> None:
    cv2.ellipse(mask, (int(middle[0]), int(middle[1])), (int(axes[0]), int(axes[1])), turned, 0, 360, 1, -1, cv2.LINE_AA)


def scene(rng: np.random.Generator, photographs: list[Path], scale: float, flat: bool) -> list[Layer]:
    """From the farthest layer to the nearest, and what moves by itself."""
    layers = [Layer(light=photograph(rng, photographs, scale), depth=FARTHEST)]
    if flat:
        return layers
    for _ in range(rng.integers(0, 3)):
        layers.append(Layer(light=photograph(rng, photographs, scale), covers=covered(rng), depth=float(rng.uniform(*NEAR))))
    if rng.uniform() < 0.5:
        mask = np.zeros((ROWS + 2 * MARGIN, COLS + 2 * MARGIN), np.float32)
        ellipse(mask, MARGIN + rng.integers((0, ROWS // 3), (COLS, ROWS)), rng.integers((15, 40), (50, 120)))
        velocity = rng.normal(size=2) * rng.choice(THINGS)
        layers.append(
            Layer(light=photograph(rng, photographs, scale), covers=cv2.GaussianBlur(mask, (0, 0), 0.6), depth=1.0, velocity=velocity)
        )
    return layers


def walk(rng: np.random.Generator, times: np.ndarray) -> np.ndarray:
    """Sideways motion of the camera: slow waves, and a drift."""
    hertz, phase = rng.uniform(0.3, 4, 8), rng.uniform(0, 2 * np.pi, (8, 2))
    waves = rng.normal(size=(8, 2)) / hertz[:, None]
    waves *= rng.choice(WALK) / np.sqrt((waves**2).sum() / 2)
    out = (np.sin(2 * np.pi * hertz[:, None] * times[:, None, None] + phase) * waves).sum(axis=1)
    return out + times[:, None] * rng.normal(size=2) * rng.choice(DRIFT)


def within(motion: np.ndarray, most: float) -> np.ndarray:
    """The motion about its middle, made smaller where it leads too far."""
    motion = motion - motion[len(motion) // 2]
    return motion / max(1.0, float(np.abs(motion).max()) / most)


def camera(rng: np.random.Generator, log: GyroLog, seconds: float, vibration: float, pan: float) -> Pose:
    """How a layer is shifted and turned at any time: the log's turns, the walk by the layer's depth, vibration and a pan."""
    times = np.arange(0, seconds, STEP)
    start = rng.uniform(2, log.times[-1] - seconds - 2)
    turns = (gyro.integrals(log)(start + times))[:, rng.permutation(3)] * log_uniform(rng, SPEED)
    rolls = rng.uniform() > 0.3
    turned = within(turns * np.array([1, 1, rolls]) * COLS * rng.uniform(*FOCAL), MOST_TURN)
    walked = within(walk(rng, times), MOST_WALK)
    hertz, phase = rng.uniform(*VIBRATION, 2), rng.uniform(0, 2 * np.pi, 2)
    shaken = np.sin(2 * np.pi * hertz * times[:, None] + phase) * rng.uniform(0.3, 1, 2) * vibration
    if pan:
        shaken += times[:, None] * RATE * pan * rng.uniform(*PAN) * np.array([rng.choice((-1, 1)), rng.normal(0, TILT)])

    def pose(at: np.ndarray, depth: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        shift = turned[:, :2] + depth * walked + shaken
        return np.interp(at, times, shift[:, 0]), np.interp(at, times, shift[:, 1]), np.interp(at, times, turned[:, 2] / COLS)

    return pose


def shown(layers: list[Layer], pose: Pose, at: np.ndarray, scale: float) -> np.ndarray:
    """The scene at a time for each scanline."""
    rows, cols = len(at), round(scale * COLS)
    x, y = np.meshgrid((np.arange(cols) - (cols - 1) / 2) / scale, (np.arange(rows) - (rows - 1) / 2) / scale)
    out = np.zeros((rows, cols, 3), np.float32)
    for layer in layers:
        right, down, roll = (value[:, None] for value in pose(at, layer.depth))
        if layer.velocity is not None:
            right, down = right - layer.velocity[0] * (at[:, None] - LEAD), down - layer.velocity[1] * (at[:, None] - LEAD)
        u = (x - roll * y + right + MARGIN + (COLS - 1) / 2).astype(np.float32)
        v = (y + roll * x + down + MARGIN + (ROWS - 1) / 2).astype(np.float32)
        source = np.float32(scale) * np.stack([u, v]) + np.float32((scale - 1) / 2)
        light = cv2.remap(layer.light, source[0], source[1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        share = 1 if layer.covers is None else cv2.remap(layer.covers, u, v, cv2.INTER_LINEAR)[..., None]
        out += share * (light - out)
    return np.clip(out, 0, 1)


def stream(path: Path, frames: int, rows: int, cols: int) -> Stream:
    """What is written: H.264 of BT.709."""
    return Stream(
        path=path,
        codec="h264",
        rows=rows,
        cols=cols,
        rate=Fraction(RATE),
        time_base=Fraction(1, RATE),
        times=np.arange(frames),
        end=frames,
        colour=tags.untagged("yuv420p", rows, matrix=Matrix.BT709, full_range=False),
        files=(path,),  # pictures that no container holds
    )


def repeats(k: int, every: int) -> bool:
    """Whether picture k shows the frame before once more."""
    return bool(every and k and k % every == 0)


def made(case: Path, photographs: list[Path], log: GyroLog, args: argparse.Namespace, number: int) -> None:
    """The folder of one clip."""
    rng = np.random.default_rng([args.seed, number, args.half == "choose"])
    rows, cols = round(args.scale * ROWS), round(args.scale * COLS)
    timing = ShutterTiming.from_readout(exposure=log_uniform(rng, EXPOSURE), readout=rng.uniform(*READOUT), rows=rows)
    pose = camera(rng, log, 2 * LEAD + args.frames / RATE + 0.1, args.vibration, args.pan)
    layers, gain, noise = scene(rng, photographs, args.scale, args.flat), float(rng.choice(GAINS)), log_uniform(rng, NOISE)
    qualities = {"clip.mp4": float(rng.choice(QUALITY)), "truth.mp4": TRUTH}
    samples = max(math.ceil(args.scale * SAMPLES), math.ceil(args.scale * args.pan * RATE * timing.exposure))
    scanlines, when = np.arange(rows) * timing.row_time, (np.arange(samples) + 0.5) / samples * timing.exposure
    middle = (rows // 2) * timing.row_time + np.linspace(0, timing.exposure, SAMPLES)
    case.mkdir(parents=True)
    clip, truth = (
        Writer(case / n, stream(case / n, args.frames, rows, cols), Encoding(codec="h264", crf=crf)) for n, crf in qualities.items()
    )
    light, sharp, blur = np.zeros(0), np.zeros(0), []
    with clip, truth:
        for k in range(args.frames):
            opens = LEAD + (k - repeats(k, args.repeat)) / RATE
            if not repeats(k, args.repeat):
                light = np.mean([shown(layers, pose, opens + scanlines + t, args.scale) for t in when], axis=0)
                light = np.minimum(gain * light, 1)
                light += noise * np.sqrt(0.3 + light) * rng.normal(size=light.shape)
                sharp = gain * shown(layers, pose, np.full(rows, opens + timing.middle), args.scale)
            for writer, pixels in ((clip, light), (truth, sharp)):
                picture = Picture(planes=(), index=k, pts=k, duration=1, time=k / RATE)
                writer.write(colour.encoded(np.clip(pixels, 0, 1).astype(np.float32), picture, writer.colour))
            right, down, _ = pose(opens + middle, BETWEEN)
            blur.append(round(args.scale * float(np.hypot(np.diff(right), np.diff(down)).sum()), 3))
    shape = {"rows": rows, "cols": cols, "fps": RATE, "frames": args.frames, "transfer": "bt709"}
    facts = {"kind": "clip", **shutter_facts(timing), **shape, "blur_extent_px": float(np.median(blur)), "blur_px": blur}
    facts["layers"] = [{"depth": layer.depth, "moves": layer.velocity is not None} for layer in layers]
    if args.flat:
        times = np.arange(0, args.frames / RATE + 2 * LEAD, STEP)
        right, down, roll = pose(LEAD + times, FARTHEST)
        path = np.stack([times, args.scale * right, args.scale * down, roll], axis=1)
        np.savetxt(case / "motion.csv", path, "%.8g", ",", header="t_s,x_px,y_px,roll_rad", comments="")
    (case / "case.json").write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
    print(f"{case.name}: {1e3 * timing.exposure:.1f} ms, {np.median(blur):.1f} px of blur, {len(layers)} layers", flush=True)


def main() -> None:
    """Make the clips that are not there."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photographs", type=Path, metavar="PHOTOS")
    parser.add_argument("--gyro", type=Path, required=True, metavar="LOG")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="CASES")
    parser.add_argument("--clips", type=int, default=26, metavar="N")
    parser.add_argument("--frames", type=int, default=16, metavar="N")
    parser.add_argument("--half", choices=("choose", "report"), default="choose")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--vibration", type=float, default=0.0, metavar="PX")
    parser.add_argument("--pan", type=float, default=0.0, metavar="PX")
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--repeat", type=int, default=0, metavar="N")
    parser.add_argument("--flat", action="store_true")
    args = parser.parse_args()
    photographs = sorted(p for p in args.photographs.glob("*.jpg") if half(p) == args.half)
    log = gyro.parse(args.gyro.read_text().splitlines())
    scale = args.scale if args.scale != 1 else 0
    options = {"vibration": args.vibration, "pan": args.pan, "scale": scale, "repeat": args.repeat, "flat": args.flat}
    for number in range(args.clips):
        moved = "".join(f"-{name}{value:g}" for name, value in options.items() if value)
        case = args.output / f"layers-{args.half}-{args.seed}-{number:03}{moved}"
        if not (case / "case.json").is_file():
            made(case, photographs, log, args, number)


if __name__ == "__main__":
    main()
