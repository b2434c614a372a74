"""Pictures kept losslessly between two steps of the work: one file, each plane a NumPy array in a ZIP archive.

Of a plane the steps along its rows are kept, from one column to the next, as whole numbers that wrap around: they shrink to five
sixths of what the plane itself shrinks to.
"""

import io
import os
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from rsvideo.config.files import UnreadableError, naming, opened, sha256
from rsvideo.config.placing import Made, aside, place
from rsvideo.video.stream import Picture, Stream

_LEVEL = 1  # of deflate: level 6 shrinks noise by a tenth more, and takes five times as long
_DATE = (1980, 1, 1, 0, 0, 0)  # the same pictures make the same bytes


def write(path: Path, pictures: Iterable[Picture]) -> str:
    """Write the pictures so that the file appears whole or not at all; answers its SHA-256."""
    with naming(path), aside(path.parent) as folder:
        part = folder / path.name
        with part.open("xb") as file:
            with zipfile.ZipFile(file, "w") as archive:
                for picture in pictures:
                    for k, plane in enumerate(picture.planes):
                        data = io.BytesIO()
                        np.save(data, _steps(plane), allow_pickle=False)
                        entry = zipfile.ZipInfo(_name(picture.index, k), _DATE)
                        archive.writestr(entry, data.getvalue(), zipfile.ZIP_DEFLATED, _LEVEL)
            file.flush()
            os.fsync(file.fileno())
        made = Made(at=part, path=path, sha256=sha256(part))
        place([made])
        return made.sha256


def read(path: Path, stream: Stream, indices: Iterable[int]) -> Iterator[Picture]:
    """The pictures of these indices."""
    try:
        with opened(path) as file, zipfile.ZipFile(file) as archive:
            for index in indices:
                planes: list[np.ndarray] = []
                while (name := _name(index, len(planes))) in archive.NameToInfo:
                    planes.append(_summed(np.load(io.BytesIO(archive.read(name)), allow_pickle=False)))
                if not planes:
                    raise ValueError(f"it lacks picture {index}")
                yield replace(blank(stream, index), planes=tuple(planes))
    except (zipfile.BadZipFile, zlib.error, ValueError, EOFError, RuntimeError, OSError) as error:
        raise UnreadableError(f"{path} is damaged: {error}") from error


def _name(index: int, plane: int) -> str:
    return f"{index}.{plane}.steps"


def _steps(plane: np.ndarray) -> np.ndarray:
    """Of a plane (rows, cols) the first column, and from then on the steps from one to the next, in as many bytes."""
    whole = np.ascontiguousarray(plane).view(f"u{plane.itemsize}")
    return np.diff(whole, axis=1, prepend=np.zeros_like(whole[:, :1])).view(plane.dtype)


def _summed(steps: np.ndarray) -> np.ndarray:
    """The plane that has these steps."""
    whole = steps.view(f"u{steps.itemsize}")
    return np.cumsum(whole, axis=1, dtype=whole.dtype).view(steps.dtype)


def blank(stream: Stream, index: int) -> Picture:
    """A picture of a stream without planes."""
    return Picture(planes=(), index=index, pts=int(stream.times[index]), duration=stream.spacing(index), time=stream.seconds(index))
