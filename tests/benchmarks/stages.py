"""Where the time of a frame goes: the stages of a cold photograph and of a clip, and the kernels' work beside their floor.

    python tests/benchmarks/stages.py [--sizes 480x270,800x450,1920x1080,3840x2160] [--blur 12] [--frames 8] [--json FILE]

The frames are rendered by the project's own simulator from scikit-image's pictures, with a random hand-shake. Seconds of a stage are
those of the command's own thread, its inner stages left out; loops are shared out among `RSVIDEO_THREADS` threads. Of each kernel the
script counts operations, and the bytes of the arrays that it has to read and write once. The floor is the larger of both over what a
core of this machine does, measured by a matrix product and by a copy of arrays that lie in memory.
"""

import argparse
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any
from unittest.mock import patch

import av
import cv2
import numpy as np
import published
from speed import scene

from rsvideo.allocation import keep_freed_memory
from rsvideo.config.request import Request, Sections
from rsvideo.physics import row_fourier, staging
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.row_fourier import RowFourier
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.simulate import extent, margin, render
from rsvideo.physics.tone import Transfer, decode, encode
from rsvideo.physics.trajectory import Trajectory, fit, still
from rsvideo.pipeline import clip_frames, deblur, photograph
from rsvideo.pipeline import prepare as preparing
from rsvideo.progress import ignore
from rsvideo.restoration import clip_motion, multi_frame, nonblind, search, single_frame
from rsvideo.solvers.banded import BandedFactor, BandedHermitian
from rsvideo.video import colour
from rsvideo.video.writer import Writer

EXPOSURE, READOUT, RATE, SEED, NOISE = 0.02, 0.02, 25, 5, 0.003  # s, s, frames/s, of the hand's shake, at half of white
FOCAL = 1.2  # of the columns
TERMS = 7  # of each frame's piece of the shake
COMPLEX, REAL = 8, 4  # bytes
PRODUCT, COPIED, AGAIN = 1024, 1 << 26, 5  # rows of a matrix product, floats copied, and how often: the quickest counts

Stages = dict[str, tuple[tuple[Any, str], ...]]  # of each the functions, with their homes
STAGES: Stages = {
    "decode": ((clip_frames, "pictures"), (clip_frames, "frame"), (preparing, "prepare")),
    "tracks": ((clip_motion, "gather"), (clip_motion, "path_from_tracks")),
    "spectra": ((search, "spectral_paths"),),
    "candidates": ((search, "estimate"),),
    "refinement": ((search, "_answer"), (clip_motion, "refined_by_blur"), (clip_motion, "refined_by_neighbours")),
    "verdict": ((single_frame, "judge"), (clip_motion, "evidence"), (clip_motion, "votes"), (multi_frame, "_judged")),
    "latent image": ((nonblind, "deblur"), (single_frame, "tiled_frame"), (multi_frame, "tiled_frame")),
    "denoiser": ((nonblind, "denoise"), (nonblind, "match")),
    "fusion": ((multi_frame, "fused"), (multi_frame, "straightened")),
    "encode": ((colour, "codes"), (Writer, "write"), (Writer, "_finish"), (Writer, "_verify"), (photograph, "_encoded")),
}


class Watch:
    """Seconds of stages, each without the stages within it, in the thread that made the watch."""

    def __init__(self) -> None:
        self.seconds = defaultdict[str, float](float)
        self._thread, self._within, self._since = threading.get_ident(), ["rest"], time.perf_counter()

    def _change(self) -> None:
        now = time.perf_counter()
        self.seconds[self._within[-1]] += now - self._since
        self._since = now

    @contextmanager
    def on(self, stage: str) -> Iterator[None]:
        if threading.get_ident() != self._thread:
            yield
            return
        self._change()
        self._within.append(stage)
        try:
            yield
        finally:
            self._change()
            self._within.pop()

    def timed(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, or the generator that it returns, watched."""

        def steps(generator: Iterator[Any]) -> Iterator[Any]:
            while True:
                with self.on(stage):
                    value = next(generator, self)
                if value is self:
                    return
                yield value

        def called(*args: Any, **kwargs: Any) -> Any:
            with self.on(stage):
                answer = function(*args, **kwargs)
            return steps(answer) if isinstance(answer, Iterator) else answer

        return called

    @contextmanager
    def watching(self, stages: Stages) -> Iterator[None]:
        with ExitStack() as patches:
            for stage, functions in stages.items():
                for home, name in functions:
                    patches.enter_context(patch.object(home, name, self.timed(stage, getattr(home, name))))
            yield
        self._change()


class Work:
    """Operations, bytes and CPU seconds of kernels, in whatever thread they run."""

    def __init__(self) -> None:
        self.rows: dict[str, dict[str, float]] = defaultdict(lambda: dict.fromkeys(("calls", "operations", "bytes", "seconds"), 0.0))
        self._lock = threading.Lock()

    @staticmethod
    def of(kernel: str, op: Any) -> tuple[float, float]:
        """Operations and bytes of one call; a complex product with its sum counts 8 operations, and a band its upper half."""
        blocks, rows, width, lanes = op.re.shape
        systems = blocks * lanes
        band = systems * rows * width * COMPLEX
        vector = systems * rows * COMPLEX
        return {
            "symbol": (0.0, band),
            "gram": (4 * systems * rows * width**2, 2 * band),
            "factor": (4 * systems * rows * width**2, 2 * band),
            "solve": (16 * systems * rows * width, 2 * band + 2 * vector),
            "forward": (8 * systems * rows * width, band + 2 * vector),
            "adjoint": (8 * systems * rows * width, band + 2 * vector),
            "Fourier transform": (2.5 * systems * 2 * rows * np.log2(systems * 2), 2 * vector),
        }[kernel]

    def counted(self, kernel: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def called(*args: Any, **kwargs: Any) -> Any:
            begun = time.thread_time()
            answer = function(*args, **kwargs)
            took = time.thread_time() - begun
            operations, moved = self.of(kernel, answer if kernel == "symbol" else args[0])
            if kernel == "symbol":
                operations = 4 * row_fourier.TAPS * args[0].shape[1] * answer.rows * answer.frequencies
            with self._lock:
                row = self.rows[kernel]
                for name, value in (("calls", 1.0), ("operations", operations), ("bytes", moved), ("seconds", took)):
                    row[name] += value
            return answer

        return called

    @contextmanager
    def counting(self) -> Iterator[None]:
        kernels = {
            "gram": (RowFourier, "gram"),
            "factor": (BandedHermitian, "factor"),
            "solve": (BandedFactor, "solve"),
            "forward": (RowFourier, "forward"),
            "adjoint": (RowFourier, "adjoint"),
        }
        with ExitStack() as patches:
            for kernel, (home, name) in kernels.items():
                patches.enter_context(patch.object(home, name, self.counted(kernel, getattr(home, name))))
            for name in ("spectrum", "image"):
                patches.enter_context(patch.object(RowFourier, name, self.counted("Fourier transform", getattr(RowFourier, name))))
            patches.enter_context(patch.object(nonblind, "row_fourier", self.counted("symbol", row_fourier.row_fourier)))
            yield


def peak() -> tuple[float, float]:
    """Operations and bytes a second of one core."""
    a = np.ones((PRODUCT, PRODUCT), np.float32)
    source, target = np.ones(COPIED, np.float32), np.zeros(COPIED, np.float32)

    def quickest(call: Callable[[], Any]) -> float:
        times = []
        for _ in range(AGAIN):
            begun = time.perf_counter()
            call()
            times.append(time.perf_counter() - begun)
        return min(times)

    return 2 * PRODUCT**3 / quickest(lambda: a @ a), 2 * REAL * COPIED / quickest(lambda: np.copyto(target, source))


def filmed(path: Path, cols: int, rows: int, blur: float, frames: int) -> None:
    """A photograph, or a clip of several frames, with up to `blur` px of blur."""
    timing = ShutterTiming.from_readout(exposure=EXPOSURE, readout=READOUT, rows=rows)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=FOCAL * cols, rows=rows, cols=cols))
    lasting = ShutterTiming.from_readout(exposure=EXPOSURE, readout=READOUT + frames / RATE, rows=rows)
    motion = staging.hand(SEED)(replace(camera, timing=lasting))
    times = np.linspace(*timing.interval, 6 * TERMS)
    rest = still(timing.interval, degree=TERMS - 1, axes=3)
    pieces = [fit(rest, times, motion.at(times + k / RATE)) for k in range(frames)]
    scale = blur / max(extent(camera=camera, trajectory=piece) for piece in pieces)
    middle = motion.at(np.array([lasting.middle if frames > 1 else timing.middle]))[0]
    moved = [piece.shifted(-middle) for piece in pieces]
    moved = [piece.with_coefficients(piece.coefficients * scale) for piece in moved]
    down, across = np.max([margin(camera=camera, trajectory=piece) for piece in moved], axis=0)
    sharp = decode(Transfer.SRGB, scene(int(cols + 2 * across), int(rows + 2 * down))[..., ::-1].astype(np.float32) / 255)
    rng = np.random.default_rng(SEED)

    def shown(piece: Trajectory) -> np.ndarray:
        blurred = render(sharp, camera=camera, trajectory=piece, noise=Noise.at_half(NOISE), rng=rng).blurred
        return np.round(encode(Transfer.SRGB, blurred) * 255).astype(np.uint8)

    if frames == 1:
        cv2.imwrite(str(path), shown(moved[0])[..., ::-1])
        return
    with av.open(path, "w") as container:
        stream = container.add_stream("libx264", rate=Fraction(RATE), options={"crf": "12", "preset": "veryfast"})
        stream.width, stream.height, stream.pix_fmt = cols, rows, "yuv420p"
        for piece in moved:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(shown(piece)), format="rgb24")))
        container.mux(stream.encode(None))


def restored(source: Path, cols: int, *, device: str = "cpu", stages: Stages = STAGES) -> tuple[Watch, Work, float]:
    """The stages and kernels of one restoration, and its seconds."""
    camera = {"exposure": EXPOSURE, "readout": READOUT, "focal_px": FOCAL * cols, "transfer": "srgb"}
    output = source.with_name(f"restored-{source.name}")
    request = Request.of(source, output, Sections.model_validate({"camera": camera, "deblur": {"device": device}}), overwrite=True)
    watch, work = Watch(), Work()
    begun = time.perf_counter()
    with watch.watching(stages), work.counting():
        deblur.carry_out(preparing.prepare(request), ignore)
    return watch, work, time.perf_counter() - begun


def by_stage(watch: Watch, seconds: float, frames: int, stages: Stages = STAGES) -> dict[str, float]:
    """Seconds a frame of all, and of each stage, by the names of their columns."""
    return {"seconds": seconds / frames} | {f"{stage.replace(' ', '_')}_s": watch.seconds[stage] / frames for stage in (*stages, "rest")}


def main() -> None:
    """Print the stages' table and the kernels'."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", default="480x270,800x450,1920x1080,3840x2160")
    parser.add_argument("--blur", type=float, default=12.0, metavar="PX")
    parser.add_argument("--frames", type=int, default=8, help="of a clip; 0 restores photographs only")
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    keep_freed_memory()
    speed, bandwidth = peak()
    stages, kernels = [], []
    with tempfile.TemporaryDirectory() as folder:
        for name, frames in (("warm.png", 1), ("warm.mp4", 3)):  # compiles, and reads compiled loops
            filmed(warm := Path(folder) / name, 160, 120, 4, frames)
            restored(warm, 160)
        for cols, rows in (map(int, size.split("x")) for size in args.sizes.split(",")):
            for frames in [1] + [args.frames] * (args.frames > 1):
                source = Path(folder) / ("frame.png" if frames == 1 else "clip.mp4")
                filmed(source, cols, rows, args.blur, frames)
                watch, work, seconds = restored(source, cols)
                what = f"{cols} x {rows}, {'a photograph' if frames == 1 else 'a frame of a clip'}"
                stages.append({"what": what} | by_stage(watch, seconds, frames))
                for kernel, of in sorted(work.rows.items(), key=lambda each: -each[1]["seconds"]):
                    floor = max(of["operations"] / speed, of["bytes"] / bandwidth)
                    row = {"what": what, "kernel": kernel, "calls": round(of["calls"] / frames), "gflop": of["operations"] / frames / 1e9}
                    kernels.append(row | {"gb": of["bytes"] / frames / 1e9, "seconds": of["seconds"] / frames, "floor": floor / frames})
                print(f"{what}: {seconds / frames:.1f} s", flush=True)
    published.print_rows(stages)
    published.print_rows(kernels)
    print(f"one core: {speed / 1e9:.0f} GFLOP/s, {bandwidth / 1e9:.1f} GB/s")
    if args.json:
        published.write(args.json, {"stages": stages, "kernels": kernels})


if __name__ == "__main__":
    main()
