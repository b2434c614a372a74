"""How FFmpeg's encoders are set up for a clip, and how they are given its pictures."""

import cv2
from av.container import OutputContainer
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from rsvideo.stills.ffmpeg import fill
from rsvideo.video.output_format import ENCODERS, Encoding
from rsvideo.video.part import Part
from rsvideo.video.stream import Colour, Matrix, Picture, Stream

_CRF = {"h264": 10.0, "hevc": 11.0}  # about the rate of a camera; 14 loses 0.7 dB of a dark forest at 34 dB
_AHEAD = {"h264": 40, "hevc": 20}  # pictures that are held, by the preset `medium`
_LEAST_AHEAD, _BYTES_AHEAD = 6, 2_000_000_000  # pictures: x265 needs more than its B-pictures; bytes: 40 pictures of 16 Mpx, 3 a pixel
_AVX_512F = 13  # of OpenCV's CpuFeatures
_FEWEST_FOR_B_FRAMES = 8  # pictures; of two, libx265 gives the second a dts behind its pts
_FULL_RANGE = 2  # FFmpeg's AVCOL_RANGE_JPEG


def opened(out: OutputContainer, part: Part, codec: str, colour: Colour, encoding: Encoding, *, quicktime: bool) -> VideoStream:
    """The track for the pictures of a part; `quicktime` names HEVC as Apple's players know it."""
    stream = part.stream
    video = out.add_stream(
        ENCODERS[codec], rate=stream.rate, options=_options(encoding, codec, colour, stream, part.count), time_base=stream.time_base
    )
    assert isinstance(video, VideoStream)  # so are all of ENCODERS
    context = video.codec_context
    video.width, video.height = stream.cols, stream.rows
    video.pix_fmt = "bgr0" if (codec, colour.pixel_format) == ("ffv1", "gbrp") else _layout(colour)
    context.thread_count = encoding.threads
    context.sample_aspect_ratio = stream.sample_aspect_ratio
    context.color_primaries, context.color_trc, context.colorspace, context.color_range = colour.h273
    if colour.full_range and colour.matrix is not Matrix.RGB:
        context.color_range = _FULL_RANGE
    if stream.display_matrix:
        video.set_display_matrix(stream.display_matrix)
    if codec == "hevc" and quicktime:
        context.codec_tag = "hvc1"
    return video


def frame(picture: Picture, colour: Colour, video: VideoStream, part: Part) -> VideoFrame:
    """A picture in the layout of `colour` as the track's encoder takes it, at its time within the part."""
    layout = _layout(colour)
    out = VideoFrame(part.stream.cols, part.stream.rows, layout)
    planes = picture.planes
    fill(out, (planes[1], planes[2], planes[0]) if layout.startswith("gbr") else planes)
    if video.pix_fmt != layout:
        out = out.reformat(format=video.pix_fmt)
    out.color_primaries, out.color_trc, out.colorspace = colour.h273[:3]
    out.color_range = video.codec_context.color_range
    out.pts, out.time_base, out.duration = picture.pts - part.shift, part.stream.time_base, picture.duration
    return out


def bytes_held(codec: str, rows: int, cols: int) -> float:
    """By the encoder of a clip at most, roughly: as measured at 8 and 63 Mpx."""
    constant, ahead = {"h264": (55, 3), "hevc": (60, 6.5)}.get(codec, (50, 0))
    return (constant + ahead * lookahead(codec, rows, cols)) * rows * cols


def lookahead(codec: str, rows: int, cols: int) -> int:
    """Pictures that an encoder holds before it writes one: as its preset says, and fewer of those that are larger than cameras film."""
    return max(_LEAST_AHEAD, min(_AHEAD.get(codec, 0), _BYTES_AHEAD // (3 * rows * cols)))


def _layout(colour: Colour) -> str:
    """FFmpeg's name of the planes; whether the range is full is a tag of its own."""
    return colour.pixel_format.replace("yuvj", "yuv")


def _options(encoding: Encoding, codec: str, colour: Colour, stream: Stream, frames: int) -> dict[str, str]:
    crf = f"{_CRF.get(codec, 0.0) if encoding.crf is None else encoding.crf:g}"
    ahead = lookahead(codec, stream.rows, stream.cols)
    match codec:
        case "h264":
            # x264's routines for AVX-512 read memory that they never set, and the bytes differ from run to run
            slower = {"x264-params": "asm=avx2"} if cv2.checkHardwareSupport(_AVX_512F) else {}
            return {"crf": crf, "preset": "medium", "rc-lookahead": f"{ahead}", **slower}
        case "hevc":
            few = ":bframes=0" if frames < _FEWEST_FOR_B_FRAMES else ""
            mastering = "".join(f":{parameter}" for parameter in stream.mastering)
            parameters = f"log-level=error:pools={encoding.threads}:rc-lookahead={ahead}{few}{mastering}"
            return {"crf": crf, "preset": "medium", "x265-params": parameters}
        case "prores":
            return {"profile": "hq" if colour.subsampling == "4:2:2" else "4444", "vendor": "apl0"}
        case "dnxhr":
            profiles = {("4:2:2", 8): "dnxhr_hq", ("4:2:2", 10): "dnxhr_hqx"}
            return {"profile": profiles.get((colour.subsampling, colour.depth), "dnxhr_444")}
        case _:
            return {"level": "3", "slicecrc": "1", "g": "1", "strict": "experimental"}
