"""A clip of VapourSynth restored along a motion that was found before, by `rsvideo track` or `rsvideo deblur`.

    import rsvideo.vs
    clip = rsvideo.vs.deblur(clip, sidecar="clip.rsvideo.json")

Frames may be wanted in any order, and motion is found from many in a row: so it has to be found first.
"""

import threading
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path

import numpy as np

from rsvideo.api.settings import Settings
from rsvideo.config import sidecar as record
from rsvideo.config.files import UnreadableError
from rsvideo.config.method import Method
from rsvideo.physics.camera import Camera
from rsvideo.physics.tone import Transfer
from rsvideo.pipeline.chunk import in_view, planned, treated
from rsvideo.pipeline.methods import Treatment
from rsvideo.pipeline.pieces import Chunk
from rsvideo.pipeline.prepare import settings_of
from rsvideo.progress import ignore
from rsvideo.shooting import given_motion
from rsvideo.video import cuts, tags
from rsvideo.video.stream import Colour, Picture, planar

try:
    import vapoursynth as vs  # pyright: ignore[reportMissingImports] # there is none for Python 3.11
except ImportError as error:
    raise ImportError("rsvideo.vs needs VapourSynth; pip install 'rsvideo[vapoursynth]' brings it, on Python 3.12 and later") from error

_CHROMA = {(1, 1): "420", (1, 0): "422", (0, 0): "444", (0, 1): "440", (2, 0): "411", (2, 2): "410"}
_UNSAID = 2  # of H.273


def deblur(clip: "vs.VideoNode", sidecar: str | PathLike[str], *, settings: Settings | None = None) -> "vs.VideoNode":
    """Remove motion blur and rolling-shutter distortion along a motion that was found before, chunk by chunk as frames are wanted.

    The pixels are those of `rsvideo deblur --trajectory SIDECAR`. Shutter, lens and curve are those with which the motion was found;
    matrix and range are those of the first frame's properties. The clip is gone through once for its cuts, when this is called. A
    frame that is wanted has its whole chunk restored, 32 frames at most, which are kept until another chunk's are wanted.

    Args:
        clip: The clip that the motion was found in, from its first frame to its last, at a constant rate: YUV, RGB or grey, of
            8 to 16 bits.
        sidecar: What `rsvideo track` or `rsvideo deblur` wrote.
        settings: How to restore; the command line's defaults unless given.

    Returns:
        A clip of the same format, size and length.

    Raises:
        ValueError, UnreadableError: The clip is of another kind or size, or the sidecar is not of this clip, or damaged.
    """
    path = Path(sidecar)
    held = record.read(path, most_frames=1)
    chunks = _Chunks(clip=clip, colour=_colour(clip, held), path=path, treatment=_treatment(held, settings or Settings()))
    chunks.check(held)
    return clip.std.ModifyFrame(clips=clip, selector=chunks.frame)


@dataclass(kw_only=True, eq=False)
class _Chunks:
    """The chunks of a clip, and the pictures of the one that was restored last."""

    clip: "vs.VideoNode"
    colour: Colour
    path: Path
    treatment: Treatment
    planned: list[Chunk] = field(default_factory=list)
    shown: dict[int, Picture] = field(default_factory=dict)
    busy: threading.Lock = field(default_factory=threading.Lock)

    def check(self, held: record.Sidecar) -> None:
        """Refuse another clip's motion, and cut the clip."""
        camera = held.settings.camera
        if (self.clip.width, self.clip.height) != (camera.cols, camera.rows):
            raise UnreadableError(
                f"{self.path} holds the motion of pictures of {camera.cols} x {camera.rows} px, the clip has {self.clip.width} x"
                f" {self.clip.height}; is it another clip's?"
            )
        given_motion.of_frames(self.path, [0, self.clip.num_frames - 1])
        pictures = self.pictures(0, self.clip.num_frames)
        first = next(self.pictures(0, 1))
        size = sum(plane.nbytes for plane in first.planes)
        self.planned = planned(0, self.clip.num_frames, cuts.cuts(pictures, self.colour), size)

    def pictures(self, first: int, last: int) -> Iterator[Picture]:
        """Frames first to last - 1."""
        for n in range(first, last):
            with self.clip.get_frame(n) as frame:
                planes = tuple(np.array(frame[k]) for k in range(frame.format.num_planes))
            yield Picture(planes=planes, index=n, pts=n, duration=1, time=float(n / self.clip.fps))

    def frame(self, n: int, f: "vs.VideoFrame") -> "vs.VideoFrame":
        """Frame n restored, with the properties of `f`."""
        with self.busy:
            if n not in self.shown:
                chunk = next(chunk for chunk in self.planned if chunk.first <= n <= chunk.last)
                view = self.pictures(*in_view(chunk, self.clip.num_frames))
                done = treated(self.treatment, chunk, view, self.colour, self.path, ignore)
                self.shown = {picture.index: picture for picture, _, _ in done}
            picture = self.shown[n]
        out = f.copy()
        for k, plane in enumerate(picture.planes):
            np.asarray(out[k])[:] = plane
        return out


def _treatment(held: record.Sidecar, settings: Settings) -> Treatment:
    timing, camera = held.timing(held.frames[0]), held.settings.camera
    return Treatment(
        method=Method.RSVIDEO,
        settings=settings_of(*settings.sections()),
        block_rows=None,
        gyro=None,
        camera=Camera(timing=timing, intrinsics=camera.intrinsics, noise=camera.sensor_noise),
        timing_source=held.frames[0].timing.source,
    )


def _colour(clip: "vs.VideoNode", held: record.Sidecar) -> Colour:
    """What the clip's codes mean: by its format, its first frame, and the curve with which the motion was found."""
    stored = clip.format
    if stored is None or not clip.fps or stored.sample_type != vs.INTEGER:
        raise ValueError("clip must have one format of whole numbers and one rate; clip.resize and clip.std.AssumeFPS give it those")
    kind = {vs.YUV: "yuv" + _CHROMA.get((stored.subsampling_w, stored.subsampling_h), "") + "p", vs.RGB: "gbrp", vs.GRAY: "gray"}
    layout = kind.get(stored.color_family, "") + ("" if stored.bits_per_sample == 8 else f"{stored.bits_per_sample}le")
    if planar(layout) is None:
        raise ValueError(f"clip must be YUV, RGB or grey of 8 to 16 bits, it is {stored.name}; clip.resize converts it")
    with clip.get_frame(0) as frame:
        code, full = int(frame.props.get("_Matrix", _UNSAID)), frame.props.get("_Range") == vs.RANGE_FULL
    matrix = tags.matrix(code)
    if code != _UNSAID and matrix is None:
        raise ValueError(f"clip mixes its colours by matrix {code} of H.273, which is not read; clip.resize converts it to BT.709")
    if held.settings.transfer not in set(Transfer):
        raise ValueError(f"the motion was found with a measured curve ({held.settings.transfer}), which clips of VapourSynth do not have")
    found = tags.untagged(layout, clip.height, matrix=matrix, full_range=full)
    return replace(found, transfer=Transfer(held.settings.transfer))
