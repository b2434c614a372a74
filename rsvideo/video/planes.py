"""Pictures kept losslessly between two steps of the work: one file, each plane a NumPy array in a ZIP archive."""

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

_LEVEL = 1  # of deflate: noise hardly shrinks more
_DATE = (1980, 1, 1, 0, 0, 0)  # the same pictures make the same bytes


def write(path: Path, pictures: Iterable[Picture]) -> str:
    """Write the pictures so that the file appears whole or not at all; answers its SHA-256."""
    with naming(path), aside(path.parent) as folder:
        part = folder / path.name
        with part.open("xb") as file:
            with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=_LEVEL) as archive:
                for picture in pictures:
                    for k, plane in enumerate(picture.planes):
                        data = io.BytesIO()
                        np.save(data, plane, allow_pickle=False)
                        archive.writestr(zipfile.ZipInfo(f"{picture.index}.{k}", _DATE), data.getvalue(), zipfile.ZIP_DEFLATED)
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
                while f"{index}.{len(planes)}" in archive.NameToInfo:
                    planes.append(np.load(io.BytesIO(archive.read(f"{index}.{len(planes)}")), allow_pickle=False))
                if not planes:
                    raise ValueError(f"it lacks picture {index}")
                yield replace(blank(stream, index), planes=tuple(planes))
    except (zipfile.BadZipFile, zlib.error, ValueError, EOFError, RuntimeError, OSError) as error:
        raise UnreadableError(f"{path} is damaged: {error}") from error


def blank(stream: Stream, index: int) -> Picture:
    """A picture of a stream without planes."""
    return Picture(planes=(), index=index, pts=int(stream.times[index]), duration=stream.spacing(index), time=stream.seconds(index))
