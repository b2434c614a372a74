"""A clip, whether a file or arrays, as pictures that can be gone through more than once."""

import itertools
import tempfile
import weakref
from collections.abc import Callable, Iterable, Iterator, Sized
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rsvideo.api import arrays, treatment
from rsvideo.api.files import Clip
from rsvideo.api.treatment import Response, Stated
from rsvideo.frame import Frame
from rsvideo.pipeline import clip_frames
from rsvideo.pipeline.chunk import in_view, planned
from rsvideo.pipeline.methods import Treatment
from rsvideo.pipeline.pieces import Chunk
from rsvideo.video import colour, cuts, sequence
from rsvideo.video.stream import Colour, Picture

Frames = Iterable[np.ndarray]


@dataclass(frozen=True, kw_only=True, eq=False)
class Footage:
    """Pictures of one shutter, one lens and one size."""

    pictures: Callable[[], Iterator[Picture]]  # from the first to the last, each time it is called
    colour: Colour
    treatment: Treatment
    notes: tuple[str, ...]
    kind: tuple[np.dtype, int] | None  # of the arrays that it was made of, and their number of axes; None of a file
    motion: Path | None = None  # a file that gives it

    def shown(self, picture: Picture, latent: np.ndarray) -> np.ndarray:
        """A latent image in the kind of the arrays that the footage was made of; `picture` is what it is the latent image of."""
        dtype, axes = self.kind or (np.dtype(np.float32), 3 if latent.shape[2] == 3 else 2)
        if dtype.kind == "f":
            out = latent.astype(np.float32, copy=False)
        else:
            out = np.stack(colour.codes(latent, picture, self.colour).planes, axis=-1)
        return out if axes == 3 else out[..., 0]

    def chunks(self) -> Iterator[tuple[Chunk, list[Picture]]]:
        """The footage in the command's chunks, and the pictures in view of each; at most those are held."""
        count = 0

        def counted() -> Iterator[Picture]:
            nonlocal count
            for count, picture in enumerate(self.pictures(), 1):  # noqa: B007 - read after the last
                yield picture

        scenes = list(cuts.cuts(counted(), self.colour))
        first = next(self.pictures())
        coming, held = self.pictures(), []
        for chunk in planned(0, count, scenes, sum(plane.nbytes for plane in first.planes)):
            begin, end = in_view(chunk, count)
            held = [picture for picture in held if picture.index >= begin]
            held += itertools.islice(coming, end - (held[-1].index + 1 if held else begin))
            yield chunk, held


def of_path(path: Path | Clip, stated: Stated) -> Footage:
    """The clip in a file or a folder; raises UnreadableError or ValueError before any work."""
    if isinstance(path, Clip):
        stated = replace(stated, rate=path.rate if stated.rate is None else stated.rate, transfer=stated.transfer or path.chosen)
        path = path.path
    task = treatment.of_path(path, stated)
    return Footage(
        pictures=lambda: clip_frames.pictures(task),
        colour=task.stream.colour,
        treatment=task.treatment,
        notes=task.notes,
        kind=None,
        motion=stated.motion,
    )


def of_arrays(frames: Frames, stated: Stated) -> Footage:
    """The clip in arrays of one shape and kind; raises TypeError or ValueError for what the first of them shows, before any work."""
    rate, transfer = stated.rate, stated.transfer
    if rate is None:
        raise ValueError("rate must be given, arrays do not say how many frames there are a second; rate=24 or rate='24000/1001'")
    if iter(frames) is frames:
        first = next(frames, None)  # pyright: ignore[reportCallIssue, reportArgumentType] - it is an iterator
        passes = _kept(itertools.chain([] if first is None else [first], frames))
    else:
        first = next(iter(frames), None)
        passes = lambda: iter(frames)  # noqa: E731
    if first is None:
        raise ValueError("frames must hold at least one picture, they hold none")
    stored = arrays.checked("frame 0", first)
    codes = arrays.is_codes(first)
    arrays.curve(first, transfer)  # which light has not
    size = treatment.Stored(name="an array", rows=stored.shape[0], cols=stored.shape[1], rate=rate)
    plain = sequence.colour_of("png" if codes else "exr", _planes("frame 0", first, first))

    def meaning(response: Response) -> Colour:
        curve, saturation = (transfer, None) if transfer else response
        return replace(plain, transfer=curve, saturation=saturation) if codes and curve else plain

    def pictures(begin: int = 0, end: int | None = None) -> Iterator[Picture]:
        for k, image in enumerate(itertools.islice(passes(), begin, end), begin):
            planes = _planes(f"frame {k}", image, first)
            yield Picture(planes=planes, index=k, pts=k, duration=1, time=float(k / rate))

    def middle(response: Response) -> Iterator[Frame]:
        from rsvideo.pipeline import measuring  # which loads what is needed for measuring alone

        count = len(frames) if isinstance(frames, Sized) else sum(1 for _ in passes())
        return (clip_frames.frame(meaning(response), picture) for picture in pictures(*measuring.middle(0, count)))

    found = treatment.prepared(stated, size, middle)
    return Footage(
        pictures=pictures,
        colour=meaning(found.response),
        treatment=found.treatment,
        notes=found.notes,
        kind=(first.dtype, first.ndim),
        motion=stated.motion,
    )


def _planes(name: str, image: np.ndarray, first: np.ndarray) -> tuple[np.ndarray, ...]:
    stored = arrays.checked(name, image)
    if (image.shape, image.dtype) != (first.shape, first.dtype):
        raise ValueError(f"{name} must be as the first, {first.shape} of {first.dtype}, it is {image.shape} of {image.dtype}")
    kind = stored.dtype if arrays.is_codes(image) else np.dtype("<f4")
    return tuple(np.ascontiguousarray(stored[..., k], kind) for k in range(stored.shape[2]))


def _kept(frames: Iterator[np.ndarray]) -> Callable[[], Iterator[np.ndarray]]:
    """Passes over what can be gone through only once: the first one writes to a temporary file that vanishes with it."""
    file = tempfile.TemporaryFile(prefix="rsvideo-")  # noqa: SIM115 - it lives as long as the passes do
    count = 0

    def passes() -> Iterator[np.ndarray]:
        nonlocal count
        if count == 0:
            for image in frames:
                np.save(file, image, allow_pickle=False)
                count += 1
        file.seek(0)
        for _ in range(count):
            yield np.load(file, allow_pickle=False)

    weakref.finalize(passes, file.close)
    return passes
