"""What FFmpeg says of a picture's colours, layout and place on a screen, in our nouns."""

import re
import struct
from pathlib import Path

from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from rsvideo.config.files import UnreadableError
from rsvideo.physics.tone import Transfer
from rsvideo.video.stream import Colour, Matrix, planar

_MATRIX = {0: Matrix.RGB, 1: Matrix.BT709, 5: Matrix.BT601, 6: Matrix.BT601, 9: Matrix.BT2020}
_TRANSFER = {
    **dict.fromkeys((1, 6, 11, 14, 15), Transfer.BT709),
    4: Transfer.GAMMA22,
    5: Transfer.GAMMA28,
    8: Transfer.LINEAR,
    13: Transfer.SRGB,
    16: Transfer.PQ,
    18: Transfer.HLG,
}
_PRIMARIES = {
    1: "bt709",
    4: "bt470m",
    5: "bt470bg",
    6: "smpte170m",
    7: "smpte240m",
    8: "film",
    9: "bt2020",
    10: "smpte428",
    11: "smpte431",
    12: "smpte432",
    22: "ebu3213",
}
_UNSAID = {2}
_LIMITED, _FULL = 1, 2  # FFmpeg's AVCOL_RANGE_MPEG and AVCOL_RANGE_JPEG
_HD_ROWS = 720  # from which on an untagged clip is taken for BT.709: players do alike
_LAYOUT_OF = (  # layouts that are handed over as planes of the same codes
    (re.compile(r"(rgb24|bgr24|0rgb|rgb0|0bgr|bgr0|argb|rgba|abgr|bgra|pal8)"), "gbrp"),
    (re.compile(r"(rgb48|bgr48|rgba64|bgra64)[lb]e"), "gbrp16le"),
    (re.compile(r"(nv12|nv21)"), "yuv420p"),
    (re.compile(r"nv16"), "yuv422p"),
    (re.compile(r"(yuyv422|uyvy422|yvyu422)"), "yuv422p"),
    (re.compile(r"p010[lb]e"), "yuv420p10le"),
    (re.compile(r"p210[lb]e"), "yuv422p10le"),
    (re.compile(r"(mono[wb]|ya8)"), "gray"),
)


def layout(name: str) -> str | None:
    """The planes in which a format is handed over: its own without alpha, or those that hold the same codes."""
    plain = re.sub(r"^yuva", "yuv", re.sub(r"^gbra", "gbr", name.replace("be", "le")))
    return plain if planar(plain) else next((to for pattern, to in _LAYOUT_OF if pattern.fullmatch(name)), None)


def colour(path: Path, video: VideoStream, frame: VideoFrame) -> tuple[Colour, tuple[str, ...]]:
    """What its codes mean, and what is not carried over; raises UnreadableError."""
    stored, held = frame.format.name, layout(frame.format.name)
    if held is None or (facts := planar(held)) is None:
        raise UnreadableError(f"{path} stores its pixels as {stored}, which is not read; convert it to yuv422p10le first")
    depth, subsampling, shift = facts
    context = video.codec_context
    h273 = (int(context.color_primaries), int(context.color_trc), int(context.colorspace), int(context.color_range))
    rgb, assumed = held.startswith("gbr"), set[str]()
    matrix = Matrix.RGB if rgb else _MATRIX.get(h273[2])
    if h273[2] in _UNSAID and not rgb:
        assumed.add("matrix")
        matrix = Matrix.BT709 if frame.height >= _HD_ROWS else Matrix.BT601
    if matrix is None or ((matrix is Matrix.RGB) != rgb and subsampling != "4:0:0"):  # grey has nothing to mix
        raise UnreadableError(f"{path} mixes its colours by matrix {h273[2]} of H.273, which is not read; convert it to BT.709 first")
    transfer = _TRANSFER.get(h273[1])
    if transfer is None:
        assumed.add("transfer")
    if h273[0] not in _PRIMARIES:
        assumed.add("primaries")
    by_format = rgb or held.startswith("yuvj")
    if not h273[3] and not by_format:
        assumed.add("full_range")
    notes: tuple[str, ...] = ()
    if any(frame.side_data.get(kind) for kind in ("DOVI_METADATA", "DOVI_RPU_BUFFER", "DYNAMIC_HDR_PLUS")):
        notes += ("its metadata for each picture (Dolby Vision or HDR10+) is not carried over",)
    if any(part.is_alpha for part in frame.format.components):
        notes += ("its transparency is not carried over",)
    if frame.interlaced_frame:
        notes += ("it is tagged as interlaced; its two fields are taken as one exposure",)
    return (
        Colour(
            matrix=matrix,
            transfer=transfer or Transfer.BT709,
            primaries=_PRIMARIES.get(h273[0], "bt709"),
            full_range=by_format or h273[3] == _FULL,
            depth=depth,
            subsampling=subsampling,
            pixel_format=held,
            chroma_shift=shift,
            assumed=frozenset(assumed),
            h273=h273,
        ),
        notes,
    )


def display_matrix(frame: VideoFrame) -> tuple[int, ...] | None:
    """Nine numbers, which turn it for the screen."""
    data = frame.side_data.get("DISPLAYMATRIX")
    return None if data is None else struct.unpack("=9i", bytes(data)[:36])


def mastering(frame: VideoFrame) -> tuple[str, ...]:
    """What HDR10 says of the display that the clip was graded on and of its brightest light, as parameters of x265."""
    found = []
    if data := frame.side_data.get("MASTERING_DISPLAY_METADATA"):
        *ratios, has_primaries, has_luminance = struct.unpack("=20i2i", bytes(data)[:88])
        values = [number / divisor if divisor else 0.0 for number, divisor in zip(ratios[::2], ratios[1::2], strict=True)]
        red_x, red_y, green_x, green_y, blue_x, blue_y, white_x, white_y = (round(50_000 * value) for value in values[:8])
        least, most = (round(10_000 * value) for value in values[8:])
        if has_primaries and has_luminance:
            points = f"G({green_x},{green_y})B({blue_x},{blue_y})R({red_x},{red_y})WP({white_x},{white_y})"
            found.append(f"master-display={points}L({most},{least})")
    if data := frame.side_data.get("CONTENT_LIGHT_LEVEL"):
        found.append("max-cll={},{}".format(*struct.unpack("=2I", bytes(data)[:8])))
    return tuple(found)


def matrix(code: int) -> Matrix | None:
    """By its number in H.273; None of one that is not read, or not stated."""
    return _MATRIX.get(code)


def untagged(layout: str, rows: int, *, matrix: Matrix | None, full_range: bool) -> Colour:
    """What codes of a layout mean of which no more is stated than this; ValueError for a layout that is not planar."""
    if (facts := planar(layout)) is None:
        raise ValueError(f"must hold planes such as yuv420p, got {layout}")
    depth, subsampling, shift = facts
    rgb, by_format = layout.startswith("gbr"), layout.startswith(("gbr", "yuvj"))
    code = next(code for code, meant in _MATRIX.items() if meant is matrix) if matrix and not rgb else 2
    return Colour(
        matrix=Matrix.RGB if rgb else matrix or (Matrix.BT709 if rows >= _HD_ROWS else Matrix.BT601),
        transfer=Transfer.BT709,
        primaries="bt709",
        full_range=by_format or full_range,
        depth=depth,
        subsampling=subsampling,
        pixel_format=layout,
        chroma_shift=shift,
        assumed=frozenset({"transfer", "primaries", *(() if rgb or matrix else ("matrix",))}),
        h273=(2, 2, 0 if rgb else code, _FULL if by_format or full_range else _LIMITED),
    )
