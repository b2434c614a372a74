"""The numbers of a comparison as files: report.csv and report.json."""

import csv
import io
import json
import math
from collections.abc import Callable, Sequence

from rsvideo.report.comparison import Comparison, Entry, best, measures_of
from rsvideo.report.measures import MEASURES
from rsvideo.report.summary import summary


def as_csv(comparison: Comparison) -> bytes:
    """A line for each entry and frame."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["entry", "role", "frame", "time_s", *(m.key for m in MEASURES), "seconds", "verdict"])
    for entry in comparison.entries:
        for frame in entry.frames:
            values = [f"{v:.6g}" if math.isfinite(v := frame.value(m.key)) else "" for m in MEASURES]
            rows.writerow([entry.name, entry.role, frame.index, f"{frame.time_s:.6f}", *values, f"{frame.seconds:.4g}", frame.verdict])
    return text.getvalue().encode()


def all_csv(comparisons: Sequence[Comparison]) -> bytes:
    """The lines of several comparisons, each beginning with its title."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    for n, comparison in enumerate(comparisons):
        header, *lines = csv.reader(io.StringIO(as_csv(comparison).decode()))
        rows.writerows(([["input", *header]] if n == 0 else []) + [[comparison.title, *line] for line in lines])
    return text.getvalue().encode()


def all_json(comparisons: Sequence[Comparison]) -> bytes:
    """Several comparisons in one file."""
    return (json.dumps({"version": 1, "inputs": [_plain(each) for each in comparisons]}, indent=1, ensure_ascii=False) + "\n").encode()


def as_json(comparison: Comparison) -> bytes:
    """The same numbers, their means, and where they come from."""
    return (json.dumps(_plain(comparison), indent=1, ensure_ascii=False) + "\n").encode()


def _plain(comparison: Comparison) -> dict[str, object]:
    """The comparison as JSON holds it."""

    def entry(each: Entry) -> dict[str, object]:
        return {
            "name": each.name,
            "role": each.role,
            "fault": each.fault,
            "seconds": _number(each.seconds),
            "peak_bytes": each.peak_bytes or None,
            "notes": each.notes,
            "verdicts": each.verdicts,
            "mean": _numbers(each.mean),
            "worst": _numbers(each.worst),
            "frames": [
                {"frame": f.index, "time_s": f.time_s, "verdict": f.verdict, "seconds": f.seconds, **_numbers(f.values.get)}
                for f in each.frames
            ],
        }

    return {
        "version": 1,
        "source": comparison.source,
        "truth": comparison.truth,
        "kind": comparison.kind,
        "rows": comparison.rows,
        "cols": comparison.cols,
        "rate": comparison.rate or None,
        "timing": comparison.timing,
        "summary": summary(comparison),
        "measures": {m.key: {"unit": m.unit, "more_is_better": m.more_is_better, "words": m.words} for m in MEASURES},
        "best": {m.key: sorted(best(comparison, m.key)) for m in measures_of(comparison)},
        "entries": [entry(each) for each in comparison.entries],
        "crops": [[crop.x, crop.y, crop.w, crop.h] for crop in comparison.crops],
        "provenance": dict(comparison.provenance),
        "notes": comparison.notes,
    }


def _number(value: float | None) -> float | None:
    """JSON knows neither nan nor infinity."""
    return None if value is None or not math.isfinite(value) else value


def _numbers(value: Callable[[str], float | None]) -> dict[str, float | None]:
    """A value for each measure."""
    return {m.key: _number(value(m.key)) for m in MEASURES}
