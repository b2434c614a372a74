"""Tiny clips made by real encoders, each with what one test needs: `from tests.video.clips import make`."""

import struct
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import tifffile
from av.audio.frame import AudioFrame
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

FRAMES = 8
ROWS, COLS = 48, 64


def scene(index: int, rows: int = ROWS, cols: int = COLS, layout: str = "yuv420p") -> VideoFrame:
    """A picture with texture that moves: smooth waves and a little noise, in 16 bits, brought into `layout`."""
    rng = np.random.default_rng(index)
    y, x = np.mgrid[:rows, :cols].astype(float)
    waves = [np.sin((x + 3 * index) / a) * np.cos((y - index) / b) for a, b in ((7, 5), (5, 9), (9, 7))]
    rgb = 0.5 + 0.3 * np.stack(waves, axis=-1) + 0.02 * rng.standard_normal((rows, cols, 3))
    codes = np.ascontiguousarray(np.clip(65535 * rgb, 0, 65535).astype("<u2"))
    return VideoFrame.from_ndarray(codes, format="rgb48le").reformat(format=layout)


def planes(frame: VideoFrame) -> list[np.ndarray]:
    """The planes of a frame in FFmpeg's order."""
    kind = np.uint8 if frame.format.components[0].bits <= 8 else np.uint16
    views = [(np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size), plane) for plane in frame.planes]
    return [lines[: plane.height].view(kind)[:, : plane.width].copy() for lines, plane in views]


def make(
    path: Path,
    *,
    codec: str = "libx264",
    layout: str = "yuv420p",
    rows: int = ROWS,
    cols: int = COLS,
    frames: int = FRAMES,
    rate: Fraction | int = 24,
    times: Sequence[int] | None = None,  # pts in `base`
    base: Fraction | None = None,
    options: dict[str, str] | None = None,
    rotation: int | None = None,
    colour: tuple[int, int, int, int] = (1, 1, 1, 1),  # primaries, transfer, matrix, range
    aspect: Fraction | None = None,
    sound: bool = False,
    tags: dict[str, str] | None = None,
    timecode: str | None = None,
    chapters: bool = False,
    video: bool = True,
    muxer: dict[str, str] | None = None,
) -> Path:
    """A clip of `scene`s; the codec's own defaults unless told otherwise."""
    base = base or 1 / Fraction(rate)
    container = {".mp4": "mp4", ".mov": "mov", ".mkv": "matroska"}[path.suffix]
    timescale = {} if container == "matroska" else {"video_track_timescale": str(base.denominator)}
    with av.open(str(path), "w", format=container, container_options=timescale | {"movflags": "use_metadata_tags"} | (muxer or {})) as file:
        file.metadata.update(tags or {})
        stream: VideoStream | None = None
        if video:
            options = dict(options or {})
            if codec == "libx265":  # of two pictures it gives the second a dts behind its pts
                own = options.pop("x265-params", "pools=1")
                options["x265-params"] = f"log-level=none:{own}" + (":bframes=0" if frames < 8 else "")
            added = file.add_stream(codec, rate=rate, options=options, time_base=base)
            assert isinstance(added, VideoStream)
            stream = added
            stream.width, stream.height, stream.pix_fmt = cols, rows, layout
            context = stream.codec_context
            context.thread_count = 1
            context.color_primaries, context.color_trc, context.colorspace, context.color_range = colour
            if aspect:
                context.sample_aspect_ratio = aspect
            if rotation is not None:
                stream.set_display_rotation(rotation)
            if timecode:
                stream.metadata["timecode"] = timecode
        voice = file.add_stream("aac", rate=48000) if sound else None
        if chapters:
            file.set_chapters([{"id": 1, "start": 0, "end": 100, "time_base": Fraction(1, 1000), "metadata": {"title": "a beginning"}}])
        if stream is not None:
            for index in range(frames):
                frame = scene(index, rows, cols, layout)
                frame.pts, frame.time_base = times[index] if times is not None else index, base
                frame.color_range = colour[3]
                file.mux(stream.encode(frame))
            file.mux(stream.encode(None))
        if voice is not None:
            tone = (0.3 * np.sin(np.arange(48000 * frames // int(rate)) / 20)).astype(np.float32)
            for at in range(0, len(tone), 1024):
                part = AudioFrame.from_ndarray(np.stack([tone[at : at + 1024]] * 2), format="fltp", layout="stereo")
                part.sample_rate, part.pts, part.time_base = 48000, at, Fraction(1, 48000)
                file.mux(voice.encode(part))
            file.mux(voice.encode(None))
    return path


def still(path: Path, *, rows: int, cols: int, frames: int) -> Path:
    """One grey picture all the time, in H.264: a few bytes a picture, however large."""
    with av.open(str(path), "w") as file:
        track = file.add_stream("libx264", rate=24)
        assert isinstance(track, VideoStream)
        track.width, track.height, track.pix_fmt = cols, rows, "yuv420p"
        frame = VideoFrame.from_ndarray(np.full((rows * 3 // 2, cols), 128, np.uint8), format="yuv420p")
        for frame.pts in range(frames):
            file.mux(track.encode(frame))
        file.mux(track.encode(None))
    return path


def retimed(source: Path, path: Path, pts: Mapping[int, int]) -> Path:
    """The same packets in another file, those of the picture shown at a pts at the one it stands for."""
    with av.open(str(source)) as file, av.open(str(path), "w") as out:
        copies = {stream.index: out.add_stream_from_template(stream) for stream in file.streams}
        for packet in file.demux():
            if packet.size and packet.pts is not None:
                if packet.stream.type == "video":
                    packet.pts = pts.get(packet.pts, packet.pts)
                packet.stream = copies[packet.stream_index]
                out.mux_one(packet)
    return path


def before_0(path: Path, steps: int) -> Path:
    """An MP4 without its edit lists, whose pictures are shown `steps` of the track's time base before 0."""
    data = bytearray(path.read_bytes().replace(b"edts", b"free"))
    table = data.index(b"ctts") + 8
    runs = range(table + 8, table + 4 + 8 * struct.unpack_from(">I", data, table)[0], 8)
    begins = struct.unpack_from(">i", data, runs[0])[0]
    for at in runs:
        struct.pack_into(">i", data, at, struct.unpack_from(">i", data, at)[0] - begins - steps)
    path.write_bytes(data)
    return path


def packets(path: Path, kind: str) -> list[tuple[Fraction, bytes]]:
    """When each packet of a kind of track is due, in seconds, and its bytes."""
    with av.open(str(path)) as file:
        tracks = [track for track in file.streams if track.type == kind]
        found = [packet for packet in file.demux(tracks) if packet.size] if tracks else []
        return [((packet.pts or 0) * packet.time_base, bytes(packet)) for packet in found]


def raw(path: Path, *, neutral: tuple[float, float, float] = (0.5, 1.0, 0.7), rows: int = ROWS, cols: int = COLS, seed: int = 0) -> Path:
    """A DNG of 12 bits with a Bayer pattern, whose camera says that `neutral` is grey; CinemaDNG's 24000/1001 a second."""
    cells = (1000 + 1000 * np.random.default_rng(seed).random((rows, cols))).astype(np.uint16)
    tags = [
        (33421, 3, 2, (2, 2), True),  # CFARepeatPatternDim
        (33422, 1, 4, (0, 1, 1, 2), True),  # CFAPattern: red, green, green, blue
        (50706, 1, 4, (1, 4, 0, 0), True),  # DNGVersion
        (50708, 2, 0, "Some Camera", True),  # UniqueCameraModel
        (50714, 4, 1, 64, True),  # BlackLevel
        (50717, 4, 1, 4095, True),  # WhiteLevel
        (50721, 10, 9, (1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1), True),  # ColorMatrix1
        (50728, 5, 3, tuple(n for value in neutral for n in (round(1000 * value), 1000)), True),  # AsShotNeutral
        (51044, 10, 1, (24000, 1001), True),  # FrameRate
    ]
    tifffile.imwrite(path, cells, photometric="cfa", compression=None, extratags=tags)
    return path
