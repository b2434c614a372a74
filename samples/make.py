"""Renders the samples that ship with the project: python samples/make.py [NAME ...]

Stills are made by the command `rsvideo simulate` from a photograph inside the scikit-image package, the clip by the simulator
behind it; README.md beside this file states their sources and licences. The same code and seed give the same pixels.
"""

import json
import subprocess
import sys
from collections.abc import Iterable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import skimage.data
from av.audio.frame import AudioFrame
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from rsvideo.physics import gyro, tone
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.shake import shake
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.simulate import extent, render
from rsvideo.physics.tone import Transfer
from rsvideo.physics.trajectory import Spline
from rsvideo.shooting.given_motion import COLUMNS
from rsvideo.stills import still
from rsvideo.stills.ffmpeg import fill
from rsvideo.video import colour
from rsvideo.video.stream import Colour, Matrix, Picture

HERE = Path(__file__).resolve().parent
PHOTOGRAPHS = Path(skimage.data.__file__).parent
COMMANDS = {
    # an ordinary hand-held photograph: the frame, timing and focal length of the README's first command
    "coffee": "coffee.png --exposure 1/50 --readout 20ms --focal-px 1400 --shake --seed 3 --blur-px 14",
    # a wide lens and a roll of the wrist: blur that differs from corner to corner
    "astronaut": "astronaut.png --exposure 1/60 --readout 25ms --focal-px 420 --polynomial x:0,9,-14,4;y:0,-12,9;roll:0,0.05,-0.02"
    " --blur-px 12 --seed 1",
    # grey, 16 bits, no roll (the model of the paper), read from the bottom up
    "photographer": "camera.png --exposure 1/40 --readout 16ms --direction bottom-to-top --focal-px 1400 --motion shift --shake --seed 8"
    " --blur-px 20 --bits 16 --noise 0.002",
}

# the clip: half a second of a vigorously held phone, frames blurred by very different amounts
FRAMES, RATE, ROWS, COLS = 12, 24, 216, 384
FOCAL, EXPOSURE, READOUT, NOISE = 400.0, 1 / 50, 0.02, 0.003
SEED, SHAKE = 4, 0.35  # rad/s
MOTION_STEP = 0.5e-3  # s

CODES = Colour(
    matrix=Matrix.RGB,
    transfer=Transfer.BT709,
    primaries="bt709",
    full_range=True,
    depth=16,
    subsampling="4:4:4",
    pixel_format="gbrp16le",
)
H264 = replace(
    CODES,
    matrix=Matrix.BT709,
    full_range=False,
    depth=8,
    subsampling="4:2:0",
    pixel_format="yuv420p",
    chroma_shift=(1, 1),
    h273=(1, 1, 1, 1),
)


def photograph(name: str, words: str) -> None:
    """Write the folder of a still."""
    source, *options = words.split()
    folder = HERE / name
    folder.mkdir(exist_ok=True)
    command = Path(sys.executable).parent / "rsvideo"
    subprocess.run([command, "simulate", PHOTOGRAPHS / source, "-o", folder / "blurred.png", "--overwrite", *options], check=True)


def clip(folder: Path) -> None:
    """Write the folder of the clip: one path through all its frames over one scene; frame k begins at k / RATE."""
    scene = still.read(PHOTOGRAPHS / "coffee.png").pixels
    timing = ShutterTiming.from_readout(exposure=EXPOSURE, readout=READOUT, rows=ROWS)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=FOCAL, rows=ROWS, cols=COLS))
    begins = np.arange(FRAMES) / RATE
    angles = shake(np.random.default_rng(SEED), float(begins[-1]) + timing.interval[1], 1 / MOTION_STEP, rms=SHAKE)
    angles -= angles.mean(axis=0)
    times = np.arange(len(angles)) * MOTION_STEP
    path = gyro.spline_through(gyro.poses_from_angles(angles, camera=camera.intrinsics), duration=float(times[-1]), spacing=0.0025)
    assert isinstance(path, Spline)

    ways = [replace(path, t0=path.t0 - begin, t1=path.t1 - begin) for begin in begins]
    rng = np.random.default_rng([SEED, 1])  # not the hand's numbers
    frames = [render(scene, camera=camera, trajectory=way, noise=Noise.at_half(NOISE), rng=rng) for way in ways]

    folder.mkdir(exist_ok=True)
    encode(folder / "blurred.mp4", (frame.blurred for frame in frames), sound=True)
    encode(folder / "truth.mp4", (frame.truth for frame in frames), sound=False)
    lines = [f"{t:.6g}," + ",".join(f"{angle:.9g}" for angle in turn) for t, turn in zip(times, angles, strict=True)]
    (folder / "motion.csv").write_text("\n".join([",".join(COLUMNS), *lines]) + "\n")
    case = {
        "kind": "clip",
        "source": "coffee.png",
        "exposure_s": EXPOSURE,
        "row_time_s": timing.row_time,
        "readout_s": READOUT,
        "rows": ROWS,
        "cols": COLS,
        "fps": RATE,
        "frames": FRAMES,
        "focal_px": FOCAL,
        "roll": True,
        "transfer": "bt709",
        "noise_sigma_linear": NOISE,
        "blur_extent_px": [round(extent(camera=camera, trajectory=way), 1) for way in ways],
    }
    (folder / "case.json").write_text(json.dumps(case, indent=1) + "\n")


def encode(path: Path, frames: Iterable[np.ndarray], *, sound: bool) -> None:
    """H.264 of linear light, tagged as BT.709, with a low tone beside it."""
    with av.open(str(path), "w", container_options={"movflags": "faststart"}) as file:
        video = file.add_stream("libx264", rate=RATE, options={"crf": "12", "preset": "veryslow"})
        assert isinstance(video, VideoStream)
        video.width, video.height, video.pix_fmt = COLS, ROWS, "yuv420p"
        context = video.codec_context
        context.thread_count = 1  # the same bytes on every machine
        context.color_primaries, context.color_trc, context.colorspace, context.color_range = H264.h273
        voice = file.add_stream("aac", rate=48000, layout="mono", options={"b": "48000"}) if sound else None
        for index, light in enumerate(frames):
            codes = np.rint(65535 * tone.encode(Transfer.BT709, light)).astype(np.uint16)
            planes = tuple(np.ascontiguousarray(codes[..., k]) for k in range(3))
            picture = colour.relaid(Picture(planes=planes, index=index, pts=index, duration=1, time=index / RATE), CODES, H264)
            frame = VideoFrame(COLS, ROWS, "yuv420p")
            fill(frame, picture.planes)
            frame.pts, frame.time_base = index, Fraction(1, RATE)
            frame.color_range = H264.h273[3]
            file.mux(video.encode(frame))
        file.mux(video.encode(None))
        if voice is not None:
            tune = 0.05 * np.sin(2 * np.pi * 440 * np.arange(48000 * FRAMES // RATE) / 48000)
            for at in range(0, len(tune), 1024):
                part = AudioFrame.from_ndarray(tune[None, at : at + 1024].astype(np.float32), format="fltp", layout="mono")
                part.sample_rate, part.pts, part.time_base = 48000, at, Fraction(1, 48000)
                file.mux(voice.encode(part))
            file.mux(voice.encode(None))


def main() -> None:
    """Write a folder a sample; of those that are named, or all."""
    for name in sys.argv[1:] or [*COMMANDS, "clip"]:
        if name == "clip":
            clip(HERE / name)
        else:
            photograph(name, COMMANDS[name])


if __name__ == "__main__":
    main()
