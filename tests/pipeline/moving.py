"""Tiny clips of a moving camera, rendered with known truth: `from tests.pipeline.moving import Moving`."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from pathlib import Path

import av
import numpy as np
import skimage.data
from av.audio.frame import AudioFrame
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from rsvideo.frame import Frame
from rsvideo.physics import gyro, tone
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.simulate import Rendering, render
from rsvideo.physics.tone import Transfer
from rsvideo.physics.trajectory import Spline, Trajectory, fit
from rsvideo.shooting.given_motion import COLUMNS
from rsvideo.stills.ffmpeg import fill
from rsvideo.video import colour, decode
from rsvideo.video.stream import Colour, Matrix, Picture

RATE = 24
GREY = Colour(
    matrix=Matrix.RGB, transfer=Transfer.BT709, primaries="bt709", full_range=True, depth=16, subsampling="4:4:4", pixel_format="gbrp16le"
)
H264 = replace(
    GREY,
    matrix=Matrix.BT709,
    full_range=False,
    depth=8,
    subsampling="4:2:0",
    pixel_format="yuv420p",
    chroma_shift=(1, 1),
    h273=(1, 1, 1, 1),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Moving:
    """A camera that sways before a photograph; frame k begins at k / RATE."""

    frames: int
    rows: int = 96
    cols: int = 160
    direction: Direction = Direction.TOP_TO_BOTTOM
    reach: float = 16.0  # px that it sways to either side
    scene: str = "camera"  # of scikit-image
    exposure: float = 0.02
    readout: float = 0.02

    @property
    def lens(self) -> Intrinsics:
        return Intrinsics.centred(focal=1.2 * self.cols, rows=self.rows, cols=self.cols)

    @property
    def timing(self) -> ShutterTiming:
        sideways = self.direction in (Direction.LEFT_TO_RIGHT, Direction.RIGHT_TO_LEFT)
        lines = self.cols if sideways else self.rows
        return ShutterTiming.from_readout(exposure=self.exposure, readout=self.readout, rows=lines, direction=self.direction)

    @property
    def camera(self) -> Camera:
        return Camera(timing=self.timing, intrinsics=self.lens)

    @property
    def begins(self) -> np.ndarray:
        return np.arange(self.frames) / RATE

    @cached_property
    def path(self) -> Spline:
        """Over the whole clip: some 8 px an exposure at its fastest, and slow enough for a few points at its ends."""
        end = float(self.begins[-1]) + self.timing.interval[1]
        t = np.linspace(0, end, 40 * self.frames)
        x, y = self.reach * np.sin(2 * np.pi * 3 * t + 0.4), 0.5 * self.reach * np.sin(2 * np.pi * 4 * t)
        blank = Spline(t0=0.0, t1=end, coefficients=np.zeros((8 * self.frames + 3, 3)))
        found = fit(blank, t, np.stack([x, y, 0.01 * np.sin(2 * np.pi * 2 * t)], axis=1))
        assert isinstance(found, Spline)
        return found

    def way(self, k: int) -> Spline:
        """The path in seconds of frame k."""
        begin = float(self.begins[k])
        return replace(self.path, t0=self.path.t0 - begin, t1=self.path.t1 - begin)

    @cached_property
    def renderings(self) -> list[Rendering]:
        return [self.shot(self.way(k), k) for k in range(self.frames)]

    @cached_property
    def light(self) -> np.ndarray:
        """The photograph, linear."""
        photograph = np.asarray(getattr(skimage.data, self.scene)()) / 255.0
        photograph = photograph if photograph.ndim == 2 else photograph[..., 1]
        return tone.decode(Transfer.SRGB, photograph.astype(np.float32))[..., None].astype(np.float64)

    def shot(self, way: Trajectory, k: int) -> Rendering:
        """Frame k of a camera that moves in this way instead."""
        noise, rng = Noise.at_half(0.002), np.random.default_rng(k)
        return render(self.light, camera=self.camera, noise=noise, samples=24, trajectory=way, rng=rng)

    @property
    def recorded(self) -> list[Frame]:
        """The frames in linear light."""
        return [
            Frame(pixels=r.blurred, clipped=np.zeros(r.blurred.shape, bool), time=float(t), index=k)
            for k, (t, r) in enumerate(zip(self.begins, self.renderings, strict=True))
        ]

    @property
    def truth(self) -> list[np.ndarray]:
        """The luma codes of each frame as it should have been."""
        return [planes(r.truth)[0] for r in self.renderings]

    def motion(self, path: Path) -> Path:
        """The motion as CSV."""
        t = np.arange(self.path.t0, self.path.t1, 0.5e-3)
        angles = gyro.angles_from_poses(self.path.at(t), camera=self.lens)
        lines = [f"{at:.6g}," + ",".join(f"{a:.9g}" for a in turn) for at, turn in zip(t, angles, strict=True)]
        path.write_text("\n".join([",".join(COLUMNS), *lines]) + "\n")
        return path

    def clip(self, path: Path, *, sound: bool = False, bits: float | None = None) -> Path:
        """The frames as a file of H.264, of so many bits a pixel if they are given, or of FFV1 in Matroska."""
        rate = bits and str(round(bits * self.rows * self.cols * RATE))
        small = {"preset": "veryfast", "b": rate, "maxrate": rate, "bufsize": rate} if rate else None
        return encode(path, [planes(r.blurred) for r in self.renderings], sound=sound, options=small)


def planes(light: np.ndarray) -> tuple[np.ndarray, ...]:
    """Y, U and V of grey light."""
    codes = np.rint(65535 * tone.encode(Transfer.BT709, light[..., 0])).astype(np.uint16)
    return colour.relaid(Picture(planes=(codes,) * 3, index=0, pts=0, duration=1, time=0.0), GREY, H264).planes


def luma(path: Path) -> list[np.ndarray]:
    """The luma codes of a clip's pictures."""
    return [picture.planes[0] for picture in decode.pictures(decode.probe(path))]


def encode(path: Path, pictures: Sequence[tuple[np.ndarray, ...]], *, sound: bool = False, options: dict[str, str] | None = None) -> Path:
    """Pictures at RATE, tagged as BT.709; of H.264 with `options`, if they are given."""
    rows, cols = pictures[0][0].shape
    lossless = path.suffix == ".mkv"
    with av.open(str(path), "w") as file:
        options = {"level": "3", "slicecrc": "1"} if lossless else options or {"crf": "8"}
        video = file.add_stream("ffv1" if lossless else "libx264", rate=RATE, options=options)
        assert isinstance(video, VideoStream)
        video.width, video.height, video.pix_fmt = cols, rows, "yuv420p"
        context = video.codec_context
        context.thread_count = 1
        context.color_primaries, context.color_trc, context.colorspace, context.color_range = H264.h273
        voice = file.add_stream("aac", rate=48000, layout="mono") if sound else None
        for index, parts in enumerate(pictures):
            frame = VideoFrame(cols, rows, "yuv420p")
            fill(frame, parts)
            frame.pts, frame.time_base, frame.color_range = index, Fraction(1, RATE), H264.h273[3]
            file.mux(video.encode(frame))
        file.mux(video.encode(None))
        if voice is not None:
            tune = (0.1 * np.sin(np.arange(48000 * len(pictures) // RATE) / 20)).astype(np.float32)
            for at in range(0, len(tune), 1024):
                part = AudioFrame.from_ndarray(tune[None, at : at + 1024], format="fltp", layout="mono")
                part.sample_rate, part.pts, part.time_base = 48000, at, Fraction(1, 48000)
                file.mux(voice.encode(part))
            file.mux(voice.encode(None))
    return path
