"""Clips written as their originals were: times, tags, sound and rotation kept, and nothing under the final name until it is verified."""

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType

import av.error
import numpy as np

from rsvideo.config.files import UnreadableError, digest
from rsvideo.config.placing import Made, aside, place
from rsvideo.video import colour as tint
from rsvideo.video import sequence, verification
from rsvideo.video.container_writer import ContainerWriter
from rsvideo.video.output_format import SEQUENCES, Encoding, chosen
from rsvideo.video.part import Part
from rsvideo.video.stream import Colour, Picture, Stream

_MOST_ERRNO = 1000  # FFmpeg has numbers of its own, which are larger than the system's


class Writer:
    """Writes pictures in order; on a clean exit the file is verified by decoding it and appears under its name, else nothing does.

    `first` and `last` say which part of the stream is written; a part begins at time 0, and at its own timecode. `notes` names what
    could not be kept. With `within`, a folder of our own beside `path`, what was made stays there: `made` is to be placed by the caller.
    """

    def __init__(
        self,
        path: Path,
        stream: Stream,
        encoding: Encoding | None = None,
        *,
        first: int = 0,
        last: int | None = None,
        within: Path | None = None,
    ) -> None:
        self._path, self._stream, self._encoding = path, stream, encoding or Encoding()
        self._part = Part(stream=stream, first=first, last=stream.frames if last is None else last)
        self._codec, self.colour, notes = chosen(path, stream, self._encoding)
        self._notes = list(notes)
        self._within, self._own = within, contextlib.ExitStack()
        self._written = 0
        self._container: ContainerWriter | None = None  # None: a sequence of pictures

    @property
    def notes(self) -> tuple[str, ...]:
        """What was not kept; complete after the exit."""
        return tuple(self._notes)

    @property
    def made(self) -> Made:
        """The clip, complete after the exit."""
        replaced = sequence.older(self._path, self._stream) if self._codec in SEQUENCES else ()
        return Made(at=self._file, path=self._path, sha256=digest(self._file), replaced=replaced)

    def __enter__(self) -> "Writer":
        try:
            with _as_oserror(self._path):
                self._file = (self._within or self._own.enter_context(aside(self._path.parent))) / self._path.name
                if self._codec in SEQUENCES:
                    self._file.mkdir()
                else:
                    self._container = ContainerWriter(self._file, self._path, self._part, self._codec, self.colour, self._encoding)
                    self._notes += self._container.notes
        except BaseException:
            self._own.close()
            raise
        return self

    def write(self, picture: Picture) -> None:
        """The next picture; planes in the stream's layout, or already in the writer's own `colour`."""
        stream, index = self._stream, self._part.first + self._written
        if picture.pts != stream.times[index]:
            raise ValueError(f"pictures must come in order, picture {index} has pts {stream.times[index]}, got {picture.pts}")
        if not _fits(picture, self.colour, stream):
            picture = tint.relaid(picture, stream.colour, self.colour)
        self._written += 1
        with _as_oserror(self._path):
            if self._container is not None:
                self._container.write(picture)
            else:
                sequence.write(self._file, sequence.stem(stream, index, self._path), self._codec, picture)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            if kind is None:
                self._finish()
        finally:
            with contextlib.suppress(Exception):  # the first error is the one to report
                if self._container is not None:
                    self._container.close()
            self._own.close()

    def _finish(self) -> None:
        """Complete the file, read it back, and give it its name unless that is for the caller."""
        if self._written != self._part.count:
            raise ValueError(f"{self._path} must hold {self._part.count} pictures, {self._written} were written")
        with _as_oserror(self._path):
            if self._container is not None:
                self._container.finish()
            self._verify()
            if self._file.is_file():
                with self._file.open("rb+") as file:
                    os.fsync(file.fileno())
        if self._within is None:
            place([self.made])

    def _verify(self) -> None:
        rate = self._stream.rate
        if self._container is None:  # pictures that are counted
            verification.read_back(self._file, self._path, rate, np.arange(self._part.count), 1 / rate)
            return
        base = self._container.base
        try:
            written = verification.read_back(self._file, self._path, rate, self._part.times(base), base)
        except OSError as error:
            if error.errno != errno.EIO or not any(track.copied for track in self._stream.tracks):
                raise
            held = f"{self._stream.path} holds sound or other tracks that cannot be carried over"
            raise UnreadableError(f"{held}: {error.strerror}") from error
        self._notes.extend(verification.lost(self._part, written, self.colour))


@contextlib.contextmanager
def _as_oserror(path: Path) -> Iterator[None]:
    """FFmpeg's errors as the system's; all with the name of a file."""
    try:
        yield
    except av.error.FFmpegError as error:
        number = error.errno if error.errno and error.errno < _MOST_ERRNO else errno.EIO
        raise OSError(number, error.strerror, str(path)) from error
    except OSError as error:  # a failed write does not say of which file, and one of our own folder's has another name
        raise OSError(error.errno, error.strerror, str(path)) from error


def _fits(picture: Picture, colour: Colour, stream: Stream) -> bool:
    """Whether the planes have the layout of `colour`; same-shaped ones of the source do where the layouts agree."""
    source = stream.colour
    if colour.pixel_format == source.pixel_format and colour.transfer == source.transfer:
        return True
    if (source.depth > 8) == (colour.depth > 8) and source.subsampling == colour.subsampling:
        return False  # nothing tells the source's layout from the other
    rows, cols = picture.planes[0].shape
    down, across = colour.chroma_shift
    chroma = (-(-rows // (1 << down)), -(-cols // (1 << across)))
    shapes = [(rows, cols)] if colour.subsampling == "4:0:0" else [(rows, cols), chroma, chroma]
    kind = np.float32 if colour.floating else np.uint8 if colour.depth <= 8 else np.uint16
    return [plane.shape for plane in picture.planes] == shapes and picture.planes[0].dtype == kind
