"""The pictures of an input, of what methods made of it and of its truth, decoded so that they can be measured alike."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float32, UInt8

from rsvideo.config.media import is_clip
from rsvideo.config.request import Request
from rsvideo.physics import tone
from rsvideo.physics.channels import any_channel
from rsvideo.physics.tone import Transfer
from rsvideo.pipeline.clip_facts import frame_range
from rsvideo.report import metrics
from rsvideo.stills import still
from rsvideo.stills.still import Still
from rsvideo.video import colour, decode
from rsvideo.video.stream import Matrix, Stream

_SHOWN_AS_STORED = (Transfer.SRGB, Transfer.BT709, Transfer.GAMMA22, Transfer.GAMMA28)  # curves near enough to a screen's own
Light = tuple[Float32[np.ndarray, "rows cols"], Bool[np.ndarray, "rows cols"]]  # luminance, and where it is valid


@dataclass(frozen=True, kw_only=True, eq=False)
class DecodedPicture:
    """One picture of an entry: codes in [0, 1] to be measured, and what is shown of it."""

    codes: Float32[np.ndarray, "rows cols 3"]
    shown: UInt8[np.ndarray, "r c 3"]  # as people see it: turned upright, in a screen's curve
    light: Callable[[], Light]


@dataclass(frozen=True, kw_only=True, eq=False)
class Source:
    """What photographs and clips have in common as inputs of a comparison."""

    kind: Literal["still", "clip"]
    rows: int  # as shown
    cols: int
    stored: tuple[int, int]  # rows and columns in sensor order, which the display rotation turns
    frames: int  # of the whole source
    rate: Fraction  # pictures a second; 1 of a still
    first: int  # index of the first picture that is compared
    last: int  # and of the one behind the last
    times: Sequence[float]  # seconds of those pictures, since the source's first
    own: Callable[[], Iterator[DecodedPicture]]  # the source's pictures, by what is read of it already
    of_result: Callable[[Path], Iterator[DecodedPicture]]  # all pictures of a file that a method wrote
    of_truth: Callable[[Path], Iterator[DecodedPicture]]  # of a file as long as the source, or as the part of it that is compared


def pictures(path: Path) -> Iterator[DecodedPicture]:
    """All pictures of a still or a clip."""
    if is_clip(path):
        stream = decode.probe(path)
        return _of_clip(stream, 0, stream.frames)
    return iter([_of_still(still.read(path))])


def source(request: Request) -> Source:
    """The source of a request, opened once: a photograph is decoded, a clip is probed; raises UnreadableError."""
    return _clip(request) if request.is_clip else _photograph(request)


def _photograph(request: Request) -> Source:
    transfer = request.camera.transfer
    photograph = still.read(request.source, transfer)
    rows, cols = photograph.pixels.shape[:2]

    def of_file(path: Path) -> Iterator[DecodedPicture]:
        yield _of_still(still.read(path, transfer))

    return Source(
        kind="still",
        rows=rows,
        cols=cols,
        stored=(rows, cols),
        frames=1,
        rate=Fraction(1),
        first=0,
        last=1,
        times=(0.0,),
        own=lambda: iter([_of_still(photograph)]),
        of_result=of_file,
        of_truth=of_file,
    )


def _clip(request: Request) -> Source:
    transfer, rate, on_damage = request.camera.transfer, request.input.frame_rate, request.input.on_damage
    stream = decode.probe(request.source, rate, on_damage=on_damage)
    first, last = frame_range(stream, request.input.range)
    turns = stream.rotation // 90

    def part(other: Stream, begin: int, end: int) -> Iterator[DecodedPicture]:
        return _of_clip(other, begin, end, transfer=transfer, on_damage=on_damage, turns=turns)

    def of_result(path: Path) -> Iterator[DecodedPicture]:
        result = decode.probe(path, rate, on_damage=on_damage)
        return part(result, 0, result.frames)

    def of_truth(path: Path) -> Iterator[DecodedPicture]:
        truth = decode.probe(path, rate, on_damage=on_damage)
        return part(truth, *((first, last) if truth.frames == stream.frames else (0, truth.frames)))

    return Source(
        kind="clip",
        rows=stream.cols if turns % 2 else stream.rows,
        cols=stream.rows if turns % 2 else stream.cols,
        stored=(stream.rows, stream.cols),
        frames=stream.frames,
        rate=stream.rate,
        first=first,
        last=last,
        times=[stream.seconds(k) for k in range(first, last)],
        own=lambda: part(stream, first, last),
        of_result=of_result,
        of_truth=of_truth,
    )


def _of_clip(
    stream: Stream, first: int, last: int, *, transfer: str | None = None, on_damage: decode.OnDamage = "fail", turns: int = 0
) -> Iterator[DecodedPicture]:
    own = stream.colour
    if transfer:
        own = replace(own, transfer=Transfer(transfer))
    rgb = replace(own, matrix=Matrix.RGB, full_range=True, depth=8, subsampling="4:4:4", pixel_format="gbrp", chroma_shift=(0, 0))
    screen = rgb if own.transfer in _SHOWN_AS_STORED or not isinstance(own.transfer, Transfer) else replace(rgb, transfer=Transfer.SRGB)
    if own.floating:
        rgb = screen
    for picture in decode.pictures(stream, first, last, on_damage=on_damage):
        codes = np.stack(colour.relaid(picture, own, rgb).planes, axis=-1)
        shown = codes if screen is rgb else np.stack(colour.relaid(picture, own, screen).planes, axis=-1)

        def light(picture=picture) -> Light:
            pixels, clipped = colour.light(picture, own)
            return metrics.luma(pixels), ~any_channel(clipped)

        yield DecodedPicture(
            codes=codes.astype(np.float32) / np.float32(255), shown=np.ascontiguousarray(np.rot90(shown, turns)), light=light
        )


def _of_still(photograph: Still) -> DecodedPicture:
    codes = tone.encode(photograph.transfer, photograph.pixels)
    shown = codes if photograph.transfer in _SHOWN_AS_STORED else tone.encode(Transfer.SRGB, photograph.pixels)
    if codes.shape[2] == 1:
        codes, shown = (np.repeat(x, 3, axis=2) for x in (codes, shown))
    return DecodedPicture(
        codes=np.ascontiguousarray(codes),
        shown=np.clip(np.rint(255 * shown), 0, 255).astype(np.uint8),
        light=lambda: (metrics.luma(photograph.pixels), ~any_channel(photograph.clipped)),
    )
