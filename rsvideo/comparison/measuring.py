"""What is measured of each frame of each entry."""

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from rsvideo import threads
from rsvideo.comparison import residual
from rsvideo.comparison.decoded import DecodedPicture, Light
from rsvideo.comparison.entry_pictures import EntryPictures
from rsvideo.frame import Verdict
from rsvideo.report import metrics
from rsvideo.report.comparison import FrameMeasures


class Measuring:
    """Measures the entries frame by frame, in order; `of_entry` holds what was measured by then."""

    def __init__(self, entries: Sequence[EntryPictures]) -> None:
        self._entries = entries
        self._before: dict[str, tuple[int, np.ndarray]] = {}  # each entry's last luma, and the index of its frame
        self.of_entry: dict[str, list[FrameMeasures]] = {entry.name: [] for entry in entries}

    def add(self, index: int, time_s: float, pictures: Mapping[str, DecodedPicture], residuals: Mapping[str, Light]) -> None:
        """The next frame; residuals of the methods that explain it, where they are wanted."""
        present = [entry for entry in self._entries if entry.name in pictures]
        lumas = {name: metrics.luma(picture.codes) for name, picture in pictures.items()}
        earlier = {name: luma for name, (at, luma) in self._before.items() if at == index - 1}
        self._before = {name: (index, luma) for name, luma in lumas.items()}
        values = threads.each(partial(_values, pictures=pictures, lumas=lumas, earlier=earlier), present)
        for entry, found in zip(present, values, strict=True):
            if entry.name in residuals:
                found["whiteness"] = metrics.whiteness(*residuals[entry.name])
            self.of_entry[entry.name].append(_frame(entry, index, time_s, found))


def _frame(entry: EntryPictures, index: int, time_s: float, values: Mapping[str, float]) -> FrameMeasures:
    record = entry.records.get(index)
    verdict = "" if entry.role != "method" else record.verdict if record else Verdict.UNTOUCHED.value
    return FrameMeasures(index=index, time_s=time_s, verdict=verdict, seconds=record.seconds if record else 0.0, values=values)


def _values(
    entry: EntryPictures, *, pictures: Mapping[str, DecodedPicture], lumas: Mapping[str, np.ndarray], earlier: Mapping[str, np.ndarray]
) -> dict[str, float]:
    """All measures but the residual's; of the entries' lumas the first is the recording's."""
    mine, recording = lumas[entry.name], next(iter(lumas.values()))
    values = {"edge_width": metrics.edge_width(mine), "straightness": metrics.straightness(mine)[0]}
    if recording.shape == mine.shape:
        values["ringing"] = metrics.ringing(mine, recording)
    if entry.role != "truth" and "truth" in pictures and pictures["truth"].codes.shape == pictures[entry.name].codes.shape:
        pair = metrics.aligned(pictures[entry.name].codes, pictures["truth"].codes)
        values |= {"psnr": metrics.psnr_of(pair), "ssim": metrics.ssim_of(pair)}
    if entry.name in earlier:
        values["flicker"] = metrics.flicker(earlier[entry.name], mine)
    return values


def residuals(entries: Sequence[EntryPictures], index: int, pictures: Mapping[str, DecodedPicture]) -> dict[str, Light]:
    """What each method leaves unexplained of a frame; one after the other, since compiled loops do not run in several threads."""
    recording = entries[0].name
    found = {entry.name: _residual(entry, index, pictures, recording) for entry in entries if entry.name in pictures}
    return {name: light for name, light in found.items() if light is not None}


def _residual(entry: EntryPictures, index: int, pictures: Mapping[str, DecodedPicture], recording: str) -> Light | None:
    """Of a frame that a method restored where it was."""
    record = entry.records.get(index)
    if entry.sidecar is None or record is None or entry.name == recording or recording not in pictures:
        return None
    if record.verdict != Verdict.RESTORED or entry.name.startswith(("rectify", "vidstab")):  # what was moved is not what the camera saw
        return None
    return residual.of(record, entry.sidecar, pictures[recording].light(), pictures[entry.name].light())
