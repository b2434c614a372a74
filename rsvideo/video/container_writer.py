"""A clip's container: the encoded pictures at their own times, and all that travels along: sound, tags, chapters, timecode."""

import contextlib
from collections.abc import Iterator, Mapping
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import av
import av.error
import av.stream
from av.container import InputContainer

from rsvideo.config.files import UnreadableError
from rsvideo.video import container, decode, encoder
from rsvideo.video.output_format import CONTAINERS, MILLISECOND, Encoding, check_times
from rsvideo.video.part import Part
from rsvideo.video.stream import Colour, Picture, Track

if TYPE_CHECKING:
    from av.container.core import Chapter

_LOOKED_THROUGH = 1000  # times of which one may show that the clip's do not fall on whole milliseconds
_NOT_CARRIED = {"major_brand", "minor_version", "compatible_brands", "encoder", "duration"}  # what a writer says of itself


class ContainerWriter:
    """Writes the pictures of a part into `file`, a container named by the suffix of `path`; `notes` names what could not be kept.

    Everything is open from birth until `close`; what FFmpeg raises is not caught here.
    """

    def __init__(self, file: Path, path: Path, part: Part, codec: str, colour: Colour, encoding: Encoding) -> None:
        self._part, self._colour = part, colour
        self._stack = contextlib.ExitStack()
        self.notes: list[str] = []
        self._family = CONTAINERS[path.suffix.lower()][0]
        try:
            self._open(file, path, codec, encoding)
        except BaseException:
            self._stack.close()
            raise

    @property
    def base(self) -> Fraction:
        """Seconds a step of the file's times."""
        return MILLISECOND if self._family == "matroska" else Fraction(1, self._part.stream.time_base.denominator)

    def write(self, picture: Picture) -> None:
        """The next picture, in the layout of the writer's colour."""
        self._mux(self._video.encode(encoder.frame(picture, self._colour, self._video, self._part)))

    def finish(self) -> None:
        """Write what encoders and other tracks still hold, and the container's end."""
        self._mux(self._video.encode(None))
        while self._ahead is not None:
            self._add(self._ahead)
            self._ahead = next(self._others, None)
        self._out.close()
        self.close()

    def close(self) -> None:
        """Let go of all files."""
        self._stack.close()

    def _open(self, file: Path, path: Path, codec: str, encoding: Encoding) -> None:
        stream = self._part.stream
        # else sound that begins before the picture moves the picture, and tracks get random numbers
        options = {"avoid_negative_ts": "disabled", "fflags": "+bitexact"}
        if self._family != "matroska":
            options = {"movflags": "use_metadata_tags", "video_track_timescale": str(stream.time_base.denominator)}
        self._out = av.open(f"file:{file}", "w", format=self._family, container_options=options)
        self._stack.callback(self._out.close)
        if self._family == "matroska":
            self._check_milliseconds(path)
        quicktime = path.suffix.lower() != ".mkv"
        self._video = encoder.opened(self._out, self._part, codec, self._colour, encoding, quicktime=quicktime)
        self._copies: dict[int, av.stream.Stream] = {}
        self._others: Iterator[av.Packet] = iter(())
        if not (stream.files or stream.bare):
            source = self._stack.enter_context(decode.opened(stream.path, container.family(stream.path, strict=False)))
            self._describe(source)
            for track in stream.tracks:
                self._open_copy(source, track)
            self._others = self._copied(source)
        self._ahead = next(self._others, None)

    def _check_milliseconds(self, path: Path) -> None:
        """Note that times are rounded; refuse a clip whose pictures would then fall together."""
        stream = self._part.stream
        if all((int(t) * stream.time_base / MILLISECOND).denominator == 1 for t in stream.times[:_LOOKED_THROUGH]):
            return
        check_times(path, self._part)
        self.notes.append("Matroska keeps times to the millisecond; they are rounded to that")

    def _describe(self, source: InputContainer) -> None:
        """Tags, chapters and timecode."""
        stream = self._part.stream
        self._out.metadata.update(_carried(stream.metadata))
        self._video.metadata.update(_carried(stream.tags))
        if self._part.timecode:
            self._video.metadata["timecode"] = self._part.timecode
        if stream.created:
            self._out.metadata["creation_time"] = stream.created
        if chapters := source.chapters():
            if self._part.whole:
                self._out.set_chapters([_earlier(chapter, self._part.shift * stream.time_base) for chapter in chapters])
            else:
                self.notes.append("chapters are kept for whole clips only")

    def _open_copy(self, source: InputContainer, track: Track) -> None:
        """A track into which another of the source's is copied, or a note that it is not."""
        named = f"track {track.index} ({', '.join(word for word in (track.kind, track.codec, track.name) if word)})"
        if not track.copied:
            if not (self._part.stream.timecode and track.codec == "tmcd"):  # which is written anew
                self.notes.append(f"{named} is not carried over")
            return
        theirs = source.streams[track.index]
        try:
            if track.kind == "data" and self._family == "matroska":
                raise ValueError
            copy = self._out.add_stream_from_template(theirs)
        except (ValueError, av.error.FFmpegError):
            self.notes.append(f"{named} is not carried over; {self._family} does not hold it")
            return
        copy.metadata.update({k: v for k, v in _carried(theirs.metadata).items() if k != "timecode"})
        copy.disposition = theirs.disposition
        self._copies[track.index] = copy

    def _copied(self, source: InputContainer) -> Iterator[av.Packet]:
        """Packets of the tracks that are copied, as they stand; of a part, those that begin within it."""
        for track in source.streams:
            if track.index not in self._copies:
                track.discard = av.stream.Discard.all
        (begin, end), shift = self._part.span, self._part.shift * self._part.stream.time_base
        for packet in source.demux([source.streams[i] for i in self._copies]) if self._copies else ():
            if not packet.size or packet.time_base is None:
                continue
            if not self._part.whole:
                at = (packet.pts if packet.pts is not None else packet.dts or 0) * packet.time_base
                if not begin <= at < end:
                    continue
            if moved := round(shift / packet.time_base):
                packet.pts = None if packet.pts is None else packet.pts - moved
                packet.dts = None if packet.dts is None else packet.dts - moved
            packet.stream = self._copies[packet.stream_index]
            yield packet

    def _mux(self, packets: list[av.Packet]) -> None:
        """The video's packets, each after those of other tracks that are decoded before it."""
        stream = self._part.stream
        for packet in packets:
            now = (packet.dts or 0) * packet.time_base
            while self._ahead is not None and (self._ahead.dts or 0) * self._ahead.time_base <= now:
                self._add(self._ahead)
                self._ahead = next(self._others, None)
            index = int(stream.times.searchsorted((packet.pts or 0) + self._part.shift))
            packet.duration = stream.spacing(min(index, stream.frames - 1))  # encoders guess it from the rate
            self._add(packet)

    def _add(self, packet: av.Packet) -> None:
        """A packet into the file; tracks that are copied as they stand may be damaged, which shows here first."""
        try:
            self._out.mux_one(packet)
        except (av.error.ArgumentError, av.error.InvalidDataError) as error:
            if not self._copies:
                raise
            kinds = " and ".join(sorted({track.kind for track in self._part.stream.tracks if track.copied}))
            raise UnreadableError(f"{self._part.stream.path} holds {kinds} that cannot be carried over; is it damaged?") from error


def _earlier(chapter: "Chapter", seconds: Fraction) -> "Chapter":
    moved = round(seconds / (chapter["time_base"] or 1))
    return {**chapter, "start": chapter["start"] - moved, "end": chapter["end"] - moved}


def _carried(metadata: Mapping[str, str]) -> dict[str, str]:
    return {name: value for name, value in metadata.items() if name not in _NOT_CARRIED}
