"""The pictures of an input, of what methods made of it and of its truth, decoded to one measure."""

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
from rsvideo.physics.tone import Transfer
from rsvideo.pipeline.clip_facts import frame_range
from rsvideo.report import metrics
from rsvideo.stills import still
from rsvideo.video import colour, decode
from rsvideo.video.stream import Matrix, Stream

_PLAIN = (Transfer.SRGB, Transfer.BT709, Transfer.GAMMA22, Transfer.GAMMA28)  # may be shown as they are
Light = tuple[Float32[np.ndarray, "rows cols"], Bool[np.ndarray, "rows cols"]]  # luminance, and where it is valid


@dataclass(frozen=True, kw_only=True, eq=False)
class Shot:
    """One picture of an entry: codes in [0, 1] to be measured, and what is shown of it."""

    codes: Float32[np.ndarray, "rows cols 3"]
    shown: UInt8[np.ndarray, "r c 3"]  # as people see it: turned upright, in a screen's curve
    light: Callable[[], Light]


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """What photographs and clips have in common as inputs."""

    kind: Literal["still", "clip"]
    rows: int  # as shown
    cols: int
    rate: Fraction
    first: int
    last: int
    times: Sequence[float]
    reel: Callable[[Path, bool], Iterator[Shot]]  # of a file; whether it is a whole clip, not only the part


def shots(path: Path) -> Iterator[Shot]:
    """All pictures of a still or a clip."""
    if is_clip(path):
        stream = decode.probe(path)
        return _clip_shots(stream, 0, stream.frames)
    return iter([_still_shot(path, None)])


def plan(request: Request) -> Plan:
    """What is to be seen of a request's source."""
    transfer, rate, on_damage = request.camera.transfer, request.input.frame_rate, request.input.on_damage
    if not request.is_clip:
        rows, cols = still.read(request.source, transfer).pixels.shape[:2]

        def one(path: Path, _: bool) -> Iterator[Shot]:
            yield _still_shot(path, transfer)

        return Plan(kind="still", rows=rows, cols=cols, rate=Fraction(1), first=0, last=1, times=(0.0,), reel=one)
    stream = decode.probe(request.source, rate, on_damage=on_damage)
    first, last = frame_range(stream, request.input.range)
    turned = stream.rotation // 90 % 2

    def many(path: Path, whole: bool) -> Iterator[Shot]:
        its = decode.probe(path, rate, on_damage=on_damage)
        begin, end = (first, last) if whole and its.frames == stream.frames else (0, its.frames)
        return _clip_shots(its, begin, end, transfer=transfer, on_damage=on_damage, turns=stream.rotation // 90)

    return Plan(
        kind="clip",
        rows=stream.cols if turned else stream.rows,
        cols=stream.rows if turned else stream.cols,
        rate=stream.rate,
        first=first,
        last=last,
        times=[stream.seconds(k) for k in range(first, last)],
        reel=many,
    )


def _clip_shots(
    stream: Stream, first: int, last: int, *, transfer: str | None = None, on_damage: decode.OnDamage = "fail", turns: int = 0
) -> Iterator[Shot]:
    own = stream.colour
    if transfer:
        own = replace(own, transfer=Transfer(transfer))
    rgb = replace(own, matrix=Matrix.RGB, full_range=True, depth=8, subsampling="4:4:4", pixel_format="gbrp", chroma_shift=(0, 0))
    screen = rgb if own.transfer in _PLAIN or not isinstance(own.transfer, Transfer) else replace(rgb, transfer=Transfer.SRGB)
    if own.floating:
        rgb = screen
    for picture in decode.pictures(stream, first, last, on_damage=on_damage):
        codes = np.stack(colour.relaid(picture, own, rgb).planes, axis=-1)
        shown = codes if screen is rgb else np.stack(colour.relaid(picture, own, screen).planes, axis=-1)

        def light(picture=picture) -> Light:
            pixels, clipped = colour.light(picture, own)
            return metrics.luma(pixels), np.asarray(~clipped.any(axis=2))

        yield Shot(codes=codes.astype(np.float32) / np.float32(255), shown=np.ascontiguousarray(np.rot90(shown, turns)), light=light)


def _still_shot(path: Path, transfer: Transfer | None) -> Shot:
    photograph = still.read(path, transfer)
    codes = tone.encode(photograph.transfer, photograph.pixels)
    shown = codes if photograph.transfer in _PLAIN else tone.encode(Transfer.SRGB, photograph.pixels)
    if codes.shape[2] == 1:
        codes, shown = (np.repeat(x, 3, axis=2) for x in (codes, shown))
    return Shot(
        codes=np.ascontiguousarray(codes),
        shown=np.clip(np.rint(255 * shown), 0, 255).astype(np.uint8),
        light=lambda: (metrics.luma(photograph.pixels), np.asarray(~photograph.clipped.any(axis=2))),
    )
