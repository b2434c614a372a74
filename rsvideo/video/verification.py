"""A written clip read back: whether it shows what it was given, and what its container and codec did not keep."""

import errno
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np

from rsvideo.config.files import UnreadableError
from rsvideo.video import decode
from rsvideo.video.part import Part
from rsvideo.video.stream import Colour, Stream


def read_back(file: Path, path: Path, rate: Fraction, times: np.ndarray, base: Fraction) -> Stream:
    """The stream of a file that decodes to as many pictures, at the times in steps of `base` seconds, as it was given.

    OSError, with the name `path`, where it does not.
    """
    try:
        written = decode.probe(file, rate)
        found = [picture.pts * written.time_base / base for picture in decode.pictures(written)]
    except UnreadableError as error:
        raise OSError(errno.EIO, f"it does not read back: {error}", str(path)) from error
    if len(found) != len(times) or any(a != b for a, b in zip(found, times, strict=True)):
        at = next((k for k, (a, b) in enumerate(zip(found, times, strict=False)) if a != b), min(len(found), len(times)))
        raise OSError(errno.EIO, f"{len(times)} pictures were written, {len(found)} read back; picture {at} is off", str(path))
    return written


def lost(part: Part, written: Stream, colour: Colour) -> Iterator[str]:
    """What the container or the codec did not keep of what it was given."""
    stream = part.stream
    pairs = {
        "the aspect ratio of its pixels": (stream.sample_aspect_ratio, written.sample_aspect_ratio),
        "its rotation": (stream.display_matrix or (), written.display_matrix or ()),
        "its timecode": (part.timecode, written.timecode),
        "its date": (stream.created, written.created),
        "its colour tags": (colour.h273[:3], written.colour.h273[:3]),
        "its HDR10 metadata": (stream.mastering, written.mastering),
        "its range of codes": (colour.full_range, written.colour.full_range),
    }
    for name, (given, found) in pairs.items():
        if given and given != found:
            words = " ".join(map(str, given)) if isinstance(given, tuple) else str(given)
            yield f"{name} ({words}) is not kept: this container and codec do not hold it"
