"""Which method wins, and by how much, in sentences."""

import math
from collections.abc import Sequence

from rsvideo.report.comparison import Comparison, Entry, best, measures_of

OURS = "rsvideo"
_LEAD = 0.01  # dB; a smaller lead does not show in numbers of two digits
_MOST_NUMBERS = 12  # frames that a sentence names


def summary(comparison: Comparison, ours: str = OURS) -> list[str]:
    """Which method wins, in sentences; also where it is not `ours`."""
    done = [entry for entry in comparison.methods if entry.fault is None]
    sentences: list[str] = []
    if any(math.isfinite(entry.mean("psnr")) for entry in done):
        sentences = _against_truth(comparison, done, ours)
    elif len(done) > 1:
        sentences = ["There is no truth to compare with: the numbers below tell what the pictures tell of themselves, and eyes decide."]
    sentences += _better_elsewhere(comparison, done, ours)
    if failed := [entry for entry in comparison.methods if entry.fault is not None]:
        sentences.append(f"{_and([entry.name for entry in failed])} gave no result; why stands below.")
    return sentences


def _against_truth(comparison: Comparison, done: Sequence[Entry], ours: str) -> list[str]:
    """Which method comes closest to the truth, how far behind `ours` is, and on which frames another is closer."""
    ranked = sorted((entry for entry in done if math.isfinite(entry.mean("psnr"))), key=lambda entry: -entry.mean("psnr"))
    first, *others = ranked
    sentences = [_closest(comparison, first, others)]
    mine = next((entry for entry in ranked if entry.name == ours), None)
    if mine and mine is not first:
        sentences.append(f"{ours} is {first.mean('psnr') - mine.mean('psnr'):.2f} dB behind {first.name} here.")
    if mine and mine is first and (lost := _frames_lost(mine, [entry for entry in done if entry is not mine])):
        sentences.append(f"Another method is closer on {_some(len(lost), 'frame')}: {_list(lost)}.")
    return sentences


def _closest(comparison: Comparison, first: Entry, others: Sequence[Entry]) -> str:
    """The lead of the method that comes closest, over the recording and over the next best."""
    recording = next((entry for entry in comparison.entries if entry.role == "recorded" or entry.name == "none"), None)
    words = f"{first.name} comes closest to the truth, {first.mean('psnr'):.2f} dB"
    if len(first.frames) > 1:
        words += f" on average over {len(first.frames)} frames"
    leads = []
    if recording and recording is not first:
        leads.append(f"{first.mean('psnr') - recording.mean('psnr'):.2f} dB more than the recording")
    if rivals := [entry for entry in others if entry is not recording]:
        leads.append(f"{first.mean('psnr') - rivals[0].mean('psnr'):.2f} dB more than {rivals[0].name}, the next best")
    return words + (f": {_and(leads)}." if leads else ".")


def _frames_lost(mine: Entry, others: Sequence[Entry]) -> list[int]:
    """The frames of a clip on which another entry is closer to the truth."""
    if len(mine.frames) < 2:
        return []
    by_index = [{frame.index: frame.value("psnr") for frame in entry.frames} for entry in others]
    return [frame.index for frame in mine.frames if any(psnr.get(frame.index, math.nan) > frame.value("psnr") + _LEAD for psnr in by_index)]


def _better_elsewhere(comparison: Comparison, done: Sequence[Entry], ours: str) -> list[str]:
    """Measures but PSNR in which a method other than ours is best, a sentence for each such method."""
    mine = next((entry for entry in done if entry.name == ours), None)
    truth = next((entry for entry in comparison.entries if entry.role == "truth"), None)
    wins: dict[str, list[str]] = {}
    for measure in measures_of(comparison):
        names = best(comparison, measure.key)
        if mine is None or measure.key == "psnr" or not names or ours in names or not math.isfinite(mine.mean(measure.key)):
            continue
        winners = [entry for entry in done if entry.name in names]
        own = math.nan if truth is None else truth.mean(measure.key)
        unit = f" {measure.unit}" if measure.unit else ""
        words = f"{measure.written(winners[0].mean(measure.key))}{unit} against {measure.written(mine.mean(measure.key))}"
        words += f", the truth {measure.written(own)}" if math.isfinite(own) else ""
        wins.setdefault(_and([entry.name for entry in winners]), []).append(f"{measure.praise} ({words})")
    return [f"{who} {'have' if ' and ' in who else 'has'} {_and(which)}." for who, which in wins.items()]


def _and(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _some(number: int, thing: str) -> str:
    return f"{number} {thing}{'' if number == 1 else 's'}"


def _list(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers[:_MOST_NUMBERS])) + (", …" if len(numbers) > _MOST_NUMBERS else "")
