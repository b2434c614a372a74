"""Times of the device's stages beside what their traffic of memory takes at least, and how far its frames agree with the processor's.

    python tests/benchmarks/gpu.py [--cases 800x450:12,1920x1080:12,1920x1080:40,3840x2160:80] [--most-compared 2.2] [--json FILE]

A case is COLSxROWS:BLUR, with the longest blur in px. Every stage is timed on all tiles and the three channels at once, the median of
several runs after one that compiles. Its floor is the bytes that it has to read and write, each once, at the rate at which the device
copies an array: a kernel at twice its floor moves bytes at half that rate. Then whole frames: seconds on the device and on the
processor, PSNR of both against the truth, and the largest difference of a pixel; the processor's only up to so many megapixels.

Without a device the same runs in numba-cuda's simulator, in a minute or two and with few steps:

    NUMBA_ENABLE_CUDASIM=1 python tests/benchmarks/gpu.py --cases 12x9:2

That shows that the script works and how far both agree. Its times mean nothing.
"""

import argparse
import statistics
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import published
import speed

from rsvideo.gpu import device

if why := device.unavailable():
    raise SystemExit(f"there is no device: {why}")

from rsvideo.gpu import arrays
from rsvideo.gpu.arrays import xp
from rsvideo.gpu.frame import DeviceFrame, System
from rsvideo.gpu.row_fourier import row_fourier
from rsvideo.physics import simulate
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, Trajectory
from rsvideo.report.metrics import psnr
from rsvideo.restoration import device_frame, nonblind, settings
from rsvideo.restoration.settings import Settings

EXPOSURE, READOUT, FOCAL = 0.02, 0.02, 0.8  # seconds; focal length per longer side
PATH = np.array([[0.0, 0.0, 0.0], [4.0, -3.0, 0.004], [1.0, 1.5, -0.002], [-0.4, 0.3, 0.0]])  # px and rad, by Legendre polynomials
NOISE = 2e-3
RUNS = 5
WAKING = 0.1  # seconds
ADMM_STEPS = 1 if arrays.SIMULATED else 10
COLUMNS = {
    "case": "",
    "prior": "",
    "tiles": "",
    "device_s": ".3f",
    "device_db": ".2f",
    "processor_s": ".2f",
    "processor_db": ".2f",
    "largest_difference": ".1e",
}


class Case(NamedTuple):
    """A frame, its truth and its motion."""

    pixels: np.ndarray
    truth: np.ndarray
    camera: Camera
    path: Trajectory


class Stage(NamedTuple):
    """A part of the work: what does it, and the bytes that it has to move."""

    name: str
    run: Callable[[], Any]
    moved: int


def case(cols: int, rows: int, blur: float) -> Case:
    """A detailed picture, blurred along a path whose longest PSF spans `blur` px."""
    timing = ShutterTiming.from_readout(exposure=EXPOSURE, readout=READOUT, rows=rows)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=FOCAL * max(cols, rows), rows=rows, cols=cols))
    drawn = Polynomial(t0=0.0, t1=timing.interval[1], coefficients=PATH)
    path = simulate.scaled_to(blur, camera=camera, trajectory=drawn)
    down, across = simulate.margin(camera=camera, trajectory=path)
    sharp = speed.scene(cols + 2 * across, rows + 2 * down)[..., ::-1]
    noise, rng = Noise.at_half(NOISE), np.random.default_rng(0)
    made = simulate.render((sharp / 255) ** 2.2, camera=camera, trajectory=path, noise=noise, rng=rng, samples=24)
    return Case(made.blurred, made.truth, camera, path)


def stages(frame: DeviceFrame) -> Iterator[Stage]:
    """The parts of the final image, in the order of their work."""
    system, offsets, reach = frame.system(slice(0, len(frame.cut))), frame.offsets, frame.reach
    op, band = system.op, system.normal.band
    factor = system.factor(nonblind.TV_RHO, nonblind.TV_FLOOR)
    latent = xp.zeros((op.tiles, frame.shape[2], op.latent_rows, op.period), xp.float32)
    wide, seen = op.spectrum(latent), op.spectrum(system.frame)
    picture = frame.blended(latent + 0.5)
    matches = frame.match(picture)
    yield Stage("symbol", lambda: row_fourier(offsets, reach), op.symbol.nbytes)
    yield Stage("normal matrix", op.gram, op.symbol.nbytes + band.nbytes)
    yield Stage("factor", lambda: system.factor(nonblind.TV_RHO, nonblind.TV_FLOOR), 2 * band.nbytes)
    yield Stage("solve", lambda: factor.solve(wide), 2 * band.nbytes + 2 * wide.nbytes)
    yield Stage("blur", lambda: op.forward(wide), op.symbol.nbytes + wide.nbytes + seen.nbytes)
    yield Stage("its adjoint", lambda: op.adjoint(seen), op.symbol.nbytes + wide.nbytes + seen.nbytes)
    yield Stage("Fourier transform", lambda: op.spectrum(latent), latent.nbytes + wide.nbytes)
    yield Stage(
        "factor, steps of ADMM",
        lambda: system.total_variation(7e-4, frame.weights, ADMM_STEPS),
        _admm(system, wide, seen),
    )
    yield Stage("matching", lambda: frame.match(picture), picture.nbytes)
    yield Stage("filtering", lambda: frame.denoise(picture, 0.02, pilot=picture, matches=matches), 3 * picture.nbytes)


def _admm(system: System, wide: Any, seen: Any) -> int:
    """A factor, and in each step a solve, the blur and its adjoint, four transforms, and the differences with their copy and multiplier."""
    op, band = system.op, system.normal.band.nbytes
    image = 2 * wide.nbytes
    step = 2 * band + 2 * wide.nbytes + 2 * (op.symbol.nbytes + wide.nbytes + seen.nbytes) + 4 * image + 6 * wide.nbytes
    return 2 * band + ADMM_STEPS * step


def seconds(run: Callable[[], Any]) -> float:
    """The median of several runs, after others that compile and wake the device, whose clock is slow while it rests."""
    took: list[float] = []
    while len(took) < 1 + (RUNS if not arrays.SIMULATED else 0) or sum(took[1:-RUNS]) < WAKING * (not arrays.SIMULATED):
        arrays.finish()
        begun = time.perf_counter()
        run()
        arrays.finish()
        took.append(time.perf_counter() - begun)
    return statistics.median(took[-RUNS:])


def bandwidth() -> float:
    """Bytes a second that the device reads and writes when it copies an array."""
    one, other = (xp.zeros(1 << (16 if arrays.SIMULATED else 28), xp.float32) for _ in range(2))
    return 2 * one.nbytes / seconds(lambda: xp.copyto(other, one))


def compared(name: str, shot: Case, frame: DeviceFrame, prior: Any, most_pixels: float) -> dict[str, Any]:
    """Whole frames on both."""

    def restored(on: Any) -> np.ndarray:
        return on.to_host(deque(nonblind.deblur(on, Settings(prior=prior), NOISE), maxlen=1).pop())

    row: dict[str, Any] = {"case": name, "prior": prior, "tiles": len(frame.cut), "device_s": seconds(lambda: restored(frame))}
    there = restored(frame)
    row["device_db"] = psnr(_codes(there), _codes(shot.truth))
    if shot.pixels[..., 0].size <= most_pixels:
        begun = time.perf_counter()
        here = restored(nonblind.tiled(*_words(shot), **_how()))
        row |= {"processor_s": time.perf_counter() - begun, "processor_db": psnr(_codes(here), _codes(shot.truth))}
        row["largest_difference"] = float(np.abs(here - there).max())
    return row


def _words(shot: Case) -> tuple[Any, ...]:
    return shot.pixels, shot.pixels >= 1, shot.path, shot.camera


def _how() -> dict[str, Any]:
    return {"samples": Settings().samples, "tolerance": Settings().tolerance}


def _codes(light: np.ndarray) -> np.ndarray:
    return np.clip(light, 0, 1) ** (1 / 2.2)


def main() -> None:
    """Print two Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", default="800x450:12,1920x1080:12,1920x1080:40,3840x2160:80")
    parser.add_argument("--most-compared", type=float, default=2.2, help="megapixels")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    if arrays.SIMULATED:
        sys.setswitchinterval(1e-5)  # its threads wait for each other all the time
        settings.TV_FIRST_STEPS = 1
        settings.EFFORTS["normal"] = replace(settings.EFFORTS["normal"], tv_steps=2, splittings=2)
    rate = bandwidth()
    print(f"{arrays.name()}, copies {rate / 1e9:.0f} GB/s, reads and writes counted; Python {sys.version.split()[0]}\n")
    print("| case | tiles | band | stage | ms | GB at least | times its floor |\n|---|---:|---:|---|---:|---:|---:|", flush=True)
    by_stage, by_frame = [], []
    for name in args.cases.split(","):
        size, blur = name.split(":")
        cols, rows = map(int, size.split("x"))
        shot = case(cols, rows, float(blur))
        frame = device_frame.tiled(*_words(shot), **_how())
        assert isinstance(frame, DeviceFrame)
        for stage in stages(frame):
            took, least = seconds(stage.run), stage.moved / rate
            row = {"case": name, "tiles": len(frame.cut), "band": frame.reach.width, "stage": stage.name}
            by_stage.append({**row, "ms": 1e3 * took, "gb": stage.moved / 1e9, "times_floor": took / least})
            print(f"| {' | '.join(map(str, row.values()))} | {1e3 * took:.2f} | {stage.moved / 1e9:.3f} | {took / least:.1f} |", flush=True)
        for prior in ("tv", "denoiser"):
            by_frame.append(compared(name, shot, frame, prior, 1e6 * args.most_compared))
    print("\n| case | prior | tiles | device s | device dB | processor s | processor dB | largest difference |")
    print("|---|---|---:|---:|---:|---:|---:|---:|")
    for row in by_frame:
        print(f"| {' | '.join(f'{row[key]:{form}}' if key in row else '' for key, form in COLUMNS.items())} |")
    if args.json:
        published.write(args.json, {"gpu_stages": by_stage, "gpu_frames": by_frame})


if __name__ == "__main__":
    main()
