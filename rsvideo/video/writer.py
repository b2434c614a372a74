"""Clips written as their originals were: times, tags, sound and rotation kept, and nothing under the final name until it is verified."""

import contextlib
import errno
import math
import os
import shutil
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from types import TracebackType

import av
import av.error
import av.stream
import cv2
import numpy as np
from av.container import InputContainer, OutputContainer
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from rsvideo.config.files import UnreadableError, part_of
from rsvideo.stills.ffmpeg import fill
from rsvideo.video import colour as tint
from rsvideo.video import decode, sequence
from rsvideo.video.output_format import CONTAINERS, ENCODERS, SEQUENCES, Encoding, chosen
from rsvideo.video.stream import Colour, Matrix, Picture, Stream
from rsvideo.video.timecode import later

_CRF = {"h264": 10.0, "hevc": 11.0}  # about the rate of a camera; 14 loses 0.7 dB of a dark forest at 34 dB
_AVX_512F = 13  # of OpenCV's CpuFeatures
_MILLISECOND = Fraction(1, 1000)  # Matroska's time base, as FFmpeg writes it
_NOT_CARRIED = {"major_brand", "minor_version", "compatible_brands", "encoder", "duration"}  # what a writer says of itself


class Writer:
    """Writes pictures in order; on a clean exit the file is verified by decoding it and appears under its name, else nothing does.

    `first` and `last` say which part of the stream is written; a part begins at time 0, and at its own timecode. `notes` tells what
    could not be kept.
    """

    def __init__(self, path: Path, stream: Stream, encoding: Encoding | None = None, *, first: int = 0, last: int | None = None) -> None:
        self._path, self._stream, self._encoding = path, stream, encoding or Encoding()
        self._first, self._last = first, stream.frames if last is None else last
        if not 0 <= self._first < self._last <= stream.frames:
            raise ValueError(f"the range must lie within the clip's {stream.frames} pictures, got {first} to {last}")
        self._codec, self.colour, notes = chosen(path, stream, self._encoding)
        self._notes = list(notes)
        self._part = part_of(path)
        self._shift = int(stream.times[first]) if first else 0
        passed = round(self._shift * stream.time_base * stream.rate)
        self._timecode = stream.timecode and later(stream.timecode, passed, stream.rate)
        self._written = 0
        self._base = 1 / stream.rate  # seconds a step of the written file's times
        self._stack = contextlib.ExitStack()

    @property
    def notes(self) -> tuple[str, ...]:
        """What was not kept; complete after the exit."""
        return tuple(self._notes)

    def __enter__(self) -> "Writer":
        self._remove()
        try:
            with _as_oserror(self._path):
                if self._codec in SEQUENCES:
                    self._part.mkdir()
                else:
                    self._open()
        except BaseException:
            self._stack.close()
            self._remove()
            raise
        return self

    def write(self, picture: Picture) -> None:
        """The next picture; planes in the stream's layout, or already in the writer's own `colour`."""
        index = self._first + self._written
        if picture.pts != self._stream.times[index]:
            raise ValueError(f"pictures must come in order, picture {index} has pts {self._stream.times[index]}, got {picture.pts}")
        if not _fits(picture, self.colour, self._stream):
            picture = tint.relaid(picture, self._stream.colour, self.colour)
        self._written += 1
        with _as_oserror(self._path):
            if self._codec in SEQUENCES:
                files = self._stream.files
                sequence.write(self._part, files[index].stem if files else f"{self._path.name}_{index:06d}", self._codec, picture)
            else:
                self._mux(self._video.encode(_frame(picture, self.colour, self._video, self._stream, self._shift)))

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            if kind is None:
                self._finish()
        finally:
            with contextlib.suppress(Exception):  # what went wrong first is what is told
                self._stack.close()
            self._remove()

    def _open(self) -> None:
        stream, family = self._stream, CONTAINERS[self._path.suffix.lower()][0]
        # else sound that begins before the picture moves the picture, and tracks get random numbers
        options = {"avoid_negative_ts": "disabled", "fflags": "+bitexact"}
        if family != "matroska":
            options = {"movflags": "use_metadata_tags", "video_track_timescale": str(stream.time_base.denominator)}
        self._out: OutputContainer = av.open(str(self._part), "w", format=family, container_options=options)
        self._stack.callback(self._out.close)
        self._base = _MILLISECOND if family == "matroska" else Fraction(1, stream.time_base.denominator)
        if family == "matroska" and any((int(t) * stream.time_base / _MILLISECOND).denominator > 1 for t in stream.times[:1000]):
            if (np.diff(self._expected()) <= 0).any():
                raise ValueError(f"{self._path} must keep pictures less than a millisecond apart, Matroska cannot; write .mov")
            self._notes.append("Matroska keeps times to the millisecond; they are rounded to that")
        self._video = self._video_stream()
        self._copies: dict[int, av.stream.Stream] = {}
        self._others: Iterator[av.Packet] = iter(())
        if not stream.files:
            source = self._stack.enter_context(av.open(str(stream.path), "r", metadata_errors="replace"))
            self._describe(source, family)
            self._others = self._copied(source)
        self._ahead = next(self._others, None)

    def _video_stream(self) -> VideoStream:
        stream, colour, codec = self._stream, self.colour, self._codec
        video = self._out.add_stream(
            ENCODERS[codec],
            rate=stream.rate,
            options=_options(self._encoding, codec, colour, stream, self._last - self._first),
            time_base=stream.time_base,
        )
        assert isinstance(video, VideoStream)  # so are all encoders named above
        context = video.codec_context
        video.width, video.height = stream.cols, stream.rows
        video.pix_fmt = "bgr0" if (codec, colour.pixel_format) == ("ffv1", "gbrp") else colour.pixel_format.replace("yuvj", "yuv")
        context.thread_count = self._encoding.threads
        context.sample_aspect_ratio = stream.sample_aspect_ratio
        context.color_primaries, context.color_trc, context.colorspace, context.color_range = colour.h273
        if colour.full_range and colour.matrix is not Matrix.RGB:
            context.color_range = 2
        if stream.display_matrix:
            video.set_display_matrix(stream.display_matrix)
        if codec == "hevc" and self._path.suffix.lower() != ".mkv":
            context.codec_tag = "hvc1"  # what Apple's players know
        return video

    def _describe(self, source: InputContainer, family: str) -> None:
        """Tags, chapters, timecode and the tracks that are copied; notes what is not."""
        stream = self._stream
        self._out.metadata.update({k: v for k, v in stream.metadata.items() if k not in _NOT_CARRIED})
        self._video.metadata.update({k: v for k, v in stream.tags.items() if k not in _NOT_CARRIED})
        if self._timecode:
            self._video.metadata["timecode"] = self._timecode
        if stream.created:
            self._out.metadata["creation_time"] = stream.created
        if (chapters := source.chapters()) and (self._first, self._last) == (0, stream.frames):
            self._out.set_chapters(chapters)
        elif chapters:
            self._notes.append("chapters are kept for whole clips only")
        for track in stream.tracks:
            named = f"track {track.index} ({', '.join(word for word in (track.kind, track.codec, track.name) if word)})"
            if not track.copied:
                if not (stream.timecode and track.codec == "tmcd"):  # which is written anew
                    self._notes.append(f"{named} is not carried over")
                continue
            theirs = source.streams[track.index]
            try:
                if track.kind == "data" and family == "matroska":
                    raise ValueError
                copy = self._out.add_stream_from_template(theirs)
            except (ValueError, av.error.FFmpegError):
                self._notes.append(f"{named} is not carried over; {family} does not hold it")
                continue
            copy.metadata.update({k: v for k, v in theirs.metadata.items() if k not in _NOT_CARRIED | {"timecode"}})
            copy.disposition = theirs.disposition
            self._copies[track.index] = copy

    def _copied(self, source: InputContainer) -> Iterator[av.Packet]:
        """Packets of the tracks that are copied, as they stand; of a part, those that begin within it."""
        for track in source.streams:
            if track.index not in self._copies:
                track.discard = av.stream.Discard.all
        stream = self._stream
        begin = int(stream.times[self._first]) * stream.time_base
        end = (int(stream.times[self._last]) if self._last < stream.frames else stream.end) * stream.time_base
        part = (self._first, self._last) != (0, stream.frames)
        for packet in source.demux([source.streams[i] for i in self._copies]) if self._copies else ():
            if not packet.size or packet.time_base is None:
                continue
            if part:
                at = (packet.pts if packet.pts is not None else packet.dts or 0) * packet.time_base
                if not begin <= at < end:
                    continue
                moved = round(self._shift * stream.time_base / packet.time_base)
                packet.pts = None if packet.pts is None else packet.pts - moved
                packet.dts = None if packet.dts is None else packet.dts - moved
            packet.stream = self._copies[packet.stream_index]
            yield packet

    def _mux(self, packets: list[av.Packet]) -> None:
        for packet in packets:
            now = (packet.dts or 0) * packet.time_base
            while self._ahead is not None and (self._ahead.dts or 0) * self._ahead.time_base <= now:
                self._out.mux_one(self._ahead)
                self._ahead = next(self._others, None)
            index = int(self._stream.times.searchsorted((packet.pts or 0) + self._shift))
            packet.duration = self._stream.spacing(min(index, self._stream.frames - 1))  # encoders guess it from the rate
            self._out.mux_one(packet)

    def _finish(self) -> None:
        if self._written != self._last - self._first:
            raise ValueError(f"{self._path} must hold {self._last - self._first} pictures, {self._written} were written")
        with _as_oserror(self._path):
            if self._codec not in SEQUENCES:
                self._mux(self._video.encode(None))
                while self._ahead is not None:
                    self._out.mux_one(self._ahead)
                    self._ahead = next(self._others, None)
                self._out.close()
                self._stack.close()
            self._verify()
            if self._part.is_file():
                with self._part.open("rb+") as file:
                    os.fsync(file.fileno())
            if self._path.is_dir():
                for file in sorted(self._part.iterdir()):
                    file.replace(self._path / file.name)
            else:
                self._part.replace(self._path)

    def _expected(self) -> np.ndarray:
        """The pts that the file must show, in its own time base; a sequence counts."""
        stream = self._stream
        if self._codec in SEQUENCES:
            return np.arange(self._last - self._first)
        exact = [(int(t) - self._shift) * stream.time_base / self._base for t in stream.times[self._first : self._last]]
        return np.array(
            [math.floor(abs(t) + Fraction(1, 2)) * (1 if t >= 0 else -1) for t in exact]
        )  # halves go outwards, as FFmpeg has it

    def _verify(self) -> None:
        """The written file decodes to as many pictures, at the times that were asked for."""
        try:
            written = decode.probe(self._part, self._stream.rate)
            found = [picture.pts * written.time_base / self._base for picture in decode.pictures(written)]
        except UnreadableError as error:
            raise OSError(errno.EIO, f"it does not read back: {error}", str(self._path)) from error
        expected = self._expected()
        if len(found) != len(expected) or any(a != b for a, b in zip(found, expected, strict=True)):
            at = next((k for k, (a, b) in enumerate(zip(found, expected, strict=False)) if a != b), min(len(found), len(expected)))
            raise OSError(errno.EIO, f"{len(expected)} pictures were written, {len(found)} read back; picture {at} is off", str(self._path))
        if self._codec not in SEQUENCES:
            self._notes.extend(_lost(self._stream, written, self.colour, self._timecode))

    def _remove(self) -> None:
        with contextlib.suppress(OSError):
            shutil.rmtree(self._part) if self._part.is_dir() else self._part.unlink(missing_ok=True)


def _lost(stream: Stream, written: Stream, colour: Colour, timecode: str | None) -> Iterator[str]:
    """What the container or the codec did not take of what it was given."""
    pairs = {
        "the aspect ratio of its pixels": (stream.sample_aspect_ratio, written.sample_aspect_ratio),
        "its rotation": (stream.display_matrix or (), written.display_matrix or ()),
        "its timecode": (timecode, written.timecode),
        "its date": (stream.created, written.created),
        "its colour tags": (colour.h273[:3], written.colour.h273[:3]),
        "its HDR10 metadata": (stream.mastering, written.mastering),
        "its range of codes": (colour.full_range, written.colour.full_range),
    }
    for name, (given, found) in pairs.items():
        if given and given != found:
            said = " ".join(map(str, given)) if isinstance(given, tuple) else str(given)
            yield f"{name} ({said}) is not kept: this container and codec do not hold it"


@contextlib.contextmanager
def _as_oserror(path: Path) -> Iterator[None]:
    """FFmpeg's errors as the system's; all with the name of a file."""
    try:
        yield
    except av.error.FFmpegError as error:
        number = error.errno if error.errno and error.errno < 1000 else errno.EIO  # FFmpeg has numbers of its own
        raise OSError(number, error.strerror, str(path)) from error
    except OSError as error:
        raise OSError(error.errno, error.strerror, error.filename or str(path)) from error  # a failed write does not say of which file


def _options(encoding: Encoding, codec: str, colour: Colour, stream: Stream, frames: int) -> dict[str, str]:
    crf = f"{_CRF.get(codec, 0.0) if encoding.quality is None else encoding.quality:g}"
    match codec:
        case "h264":
            # x264's routines for AVX-512 read memory that they never set, and the bytes differ from run to run
            slower = {"x264-params": "asm=avx2"} if cv2.checkHardwareSupport(_AVX_512F) else {}
            return {"crf": crf, "preset": "medium", **slower}
        case "hevc":
            few = ":bframes=0" if frames < 8 else ""  # of two pictures libx265 gives the second a dts behind its pts
            mastering = "".join(f":{said}" for said in stream.mastering)
            return {"crf": crf, "preset": "medium", "x265-params": f"log-level=error:pools={encoding.threads}{few}{mastering}"}
        case "prores":
            return {"profile": "hq" if colour.subsampling == "4:2:2" else "4444", "vendor": "apl0"}
        case "dnxhr":
            profiles = {("4:2:2", 8): "dnxhr_hq", ("4:2:2", 10): "dnxhr_hqx"}
            return {"profile": profiles.get((colour.subsampling, colour.depth), "dnxhr_444")}
        case _:
            return {"level": "3", "slicecrc": "1", "g": "1", "strict": "experimental"}


def _fits(picture: Picture, colour: Colour, stream: Stream) -> bool:
    """Whether the planes have the layout of `colour`; same-shaped ones of the source do where the layouts agree."""
    if colour.pixel_format == stream.colour.pixel_format and colour.transfer == stream.colour.transfer:
        return True
    rows, cols = picture.planes[0].shape
    down, across = colour.chroma_shift
    chroma = (-(-rows // (1 << down)), -(-cols // (1 << across)))
    shapes = [(rows, cols)] if colour.subsampling == "4:0:0" else [(rows, cols), chroma, chroma]
    kind = np.float32 if colour.floating else np.uint8 if colour.depth <= 8 else np.uint16
    source = stream.colour
    alike = (source.depth > 8) == (colour.depth > 8) and source.subsampling == colour.subsampling
    return not alike and [plane.shape for plane in picture.planes] == shapes and picture.planes[0].dtype == kind


def _frame(picture: Picture, colour: Colour, video: VideoStream, stream: Stream, shift: int) -> VideoFrame:
    layout = colour.pixel_format.replace("yuvj", "yuv")
    frame = VideoFrame(stream.cols, stream.rows, layout)
    planes = picture.planes
    ordered = (planes[1], planes[2], planes[0]) if layout.startswith("gbr") else planes
    fill(frame, ordered)
    if video.pix_fmt != layout:
        frame = frame.reformat(format=video.pix_fmt)
    frame.color_primaries, frame.color_trc, frame.colorspace = colour.h273[:3]
    frame.color_range = video.codec_context.color_range
    frame.pts, frame.time_base, frame.duration = picture.pts - shift, stream.time_base, picture.duration
    return frame
