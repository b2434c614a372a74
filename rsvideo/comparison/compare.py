"""What several methods made of one picture or clip, side by side, measured, and gathered for a report."""

import math
import os
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

import av
import cv2
import numpy as np

from rsvideo.comparison import decoded, entry_pictures, key_frames, measuring
from rsvideo.comparison.decoded import DecodedPicture, Source
from rsvideo.comparison.entry_pictures import EntryPictures
from rsvideo.comparison.key_frames import Album
from rsvideo.comparison.measuring import Measuring
from rsvideo.comparison.method_run import MethodRun
from rsvideo.comparison.preflight import Box
from rsvideo.config.request import Request
from rsvideo.progress import Observer, Progress
from rsvideo.report.comparison import Comparison, Crop, Entry, FrameMeasures
from rsvideo.video.mosaic import Grid, Mosaic

_VIDEO_BYTES = 4_500_000  # of a page, before they become text
_VIDEO_FRAMES = 720  # that the video shows: half a minute at 24 a second


class _Video:
    """The pictures of all entries side by side, as far as a page can carry them; nothing of a still."""

    def __init__(self, entries: Sequence[EntryPictures], source: Source) -> None:
        self._names = [entry.name for entry in entries]
        self._count, self._written = source.last - source.first, 0
        self.grid = Grid.fitting(len(entries), source.rows, source.cols)
        moving = source.kind == "clip" and self._count > 1
        frames = min(self._count, _VIDEO_FRAMES)
        self._mosaic = Mosaic(self.grid, source.rate, most_bytes=_VIDEO_BYTES, frames=frames) if moving else None

    @property
    def notes(self) -> tuple[str, ...]:
        """What it does not show."""
        return (f"the video shows the first {_VIDEO_FRAMES} frames",) if self._mosaic and self._count > _VIDEO_FRAMES else ()

    def add(self, pictures: Mapping[str, DecodedPicture]) -> None:
        """The next frame; the place of an entry that has none stays grey."""
        if self._mosaic is not None and self._written < _VIDEO_FRAMES:
            self._mosaic.write([pictures[name].shown if name in pictures else None for name in self._names])
            self._written += 1

    def close(self) -> bytes | None:
        """The file."""
        return None if self._mosaic is None else self._mosaic.close()


def compared(request: Request, runs: Sequence[MethodRun], *, truth: Path | None, crops: Sequence[Box], observe: Observer) -> Comparison:
    """Decode what the methods made of the request's source, all at once, and measure it; each file is read once."""
    source = decoded.source(request)
    entries = entry_pictures.opened(source, runs, truth)
    count, scale = source.last - source.first, key_frames.scale(source.rows, source.cols)
    wanted = key_frames.chosen(count, len(entries), source.rows * source.cols * scale**2)
    video = _Video(entries, source)
    measured, album = Measuring(entries), Album(len(wanted), scale)
    for n, (index, pictures) in enumerate(entry_pictures.lined_up(entries, source)):
        observe(Progress(stage=f"measuring frame {index}", fraction=n / count))
        residuals = measuring.residuals(entries, index, pictures) if n in wanted else {}
        measured.add(index, source.times[n], pictures, residuals)
        video.add(pictures)
        if n in wanted:
            records = {entry.name: entry.records[index] for entry in entries if entry.name in pictures and index in entry.records}
            album.add(index, source.times[n], pictures, records, residuals)
    return _gathered(request.source, truth, source, _entries(entries, runs, measured.of_entry), album, video, crops)


def _gathered(
    path: Path, truth: Path | None, source: Source, entries: tuple[Entry, ...], album: Album, video: _Video, crops: Sequence[Box]
) -> Comparison:
    """All that was found, as a report shows it."""
    chosen = (Crop(x=x, y=y, w=w, h=h, chosen=True) for x, y, w, h in crops)
    return Comparison(
        title=path.name,
        source=_plainly(path),
        kind=source.kind,
        rows=source.rows,
        cols=source.cols,
        rate=float(source.rate) if source.kind == "clip" else 0.0,
        entries=entries,
        key_frames=tuple(album.frames),
        first_shown=album.first_shown,
        crops=(*chosen, *key_frames.crops(album.area, source.rows, source.cols)),
        timing=_timing(entries),
        truth=None if truth is None else _plainly(truth),
        video=video.close(),
        video_cols=video.grid.across,
        provenance=_provenance(entries),
        notes=video.notes,
    )


def _plainly(path: Path) -> str:
    """The path without steps up and down again, unless links make it another place."""
    plain = Path(os.path.normpath(path))
    return str(plain if plain.parent.exists() and plain.parent.samefile(path.parent) else path)


def _entries(
    pictures: Sequence[EntryPictures], runs: Sequence[MethodRun], measured: Mapping[str, Sequence[FrameMeasures]]
) -> tuple[Entry, ...]:
    """The recording, the methods in the order in which they were wanted, and the truth."""
    found = {each.name: _entry(each, measured[each.name]) for each in pictures}
    found |= {
        run.method: Entry(
            name=run.method, role="method", seconds=run.seconds or math.nan, peak_bytes=run.peak_bytes, fault=run.fault, notes=run.notes
        )
        for run in runs
        if run.fault is not None
    }
    return tuple(found[name] for name in dict.fromkeys(["recorded", *(run.method for run in runs), "truth"]) if name in found)


def _entry(pictures: EntryPictures, measured: Sequence[FrameMeasures]) -> Entry:
    run = pictures.run
    return Entry(
        name=pictures.name,
        role=pictures.role,
        frames=tuple(measured),
        seconds=math.nan if run is None else run.seconds,
        peak_bytes=0 if run is None else run.peak_bytes,
        notes=() if run is None else run.notes,
        sidecar=pictures.sidecar,
    )


def _timing(entries: Sequence[Entry]) -> str:
    for entry in entries:
        if entry.sidecar is not None and entry.name != "none":
            timing = entry.sidecar.timing(entry.sidecar.frames[0])
            source = entry.sidecar.frames[0].timing.source
            return f"exposure {1e3 * timing.exposure:.4g} ms, readout {1e3 * timing.readout:.4g} ms {timing.direction.value} ({source})"
    return ""


def _provenance(entries: Sequence[Entry]) -> dict[str, str]:
    source = next((entry.sidecar for entry in entries if entry.sidecar is not None and entry.name != "none"), None)
    found = {"rsvideo": version("rsvideo"), "Python": platform.python_version(), "system": f"{platform.system()} {platform.machine()}"}
    found |= {"NumPy": np.__version__, "OpenCV": cv2.__version__, "PyAV": av.__version__}
    if source is not None:
        camera = source.settings.camera
        found["camera"] = f"focal length {camera.fx:.0f} px ({camera.source}), {camera.cols} x {camera.rows} px"
        found["settings"] = ", ".join(
            f"{name} {value}" for name, value in source.settings.restoration.items() if not isinstance(value, dict | list)
        )
        if source.settings.input_sha256:
            found["SHA-256 of the input"] = source.settings.input_sha256
    return found
