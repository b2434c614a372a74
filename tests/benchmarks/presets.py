"""What each `--quality` takes, and what it gains: seconds beside decibels, of photographs and of clips, by the installed command.

    python tests/benchmarks/presets.py CASES -o RESULTS [--every 3] [--json FILE]

CASES holds the folders stills and clips, with a folder a case. Of the stills whose motion is to be found, every third serves. One
command runs at a time, so that its seconds are those of a quiet machine. FILE gets the figures, for tests/benchmarks/moved.py.
"""

import argparse
from pathlib import Path
from typing import get_args

import clips
import numpy as np
import published
import quality
from cases import cases_of

from rsvideo.restoration.settings import Quality

KINDS = ("shift", "paper800", "rotation")


def stills(cases: list[Path], results: Path, preset: str) -> dict[str, float]:
    """Mean gain and seconds of photographs."""
    rows = [quality.restored(case, results, ["--quality", preset], known=False) for case in cases]
    return {
        "stills_gain_db": float(np.mean([after - before for _, before, after, *_ in rows])),
        "stills_s": float(np.mean([seconds for *_, seconds, _ in rows])),
    }


def footage(cases: list[Path], results: Path, preset: str) -> dict[str, float]:
    """Mean gain, the least of a frame, and seconds a frame, of clips."""
    done = [clips.restored(case, results / f"{case.name}.mp4", ["--quality", preset]) for case in cases]
    gains = [values[:, 1] - values[:, 0] for _, values in done]
    return {
        "clips_gain_db": float(np.mean([each.mean() for each in gains])),
        "clips_least_db": float(min(each.min() for each in gains)),
        "clips_s": float(np.mean([frame["seconds"] for frames, _ in done for frame in frames])),
    }


def main() -> None:
    """Run, and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--every", type=int, default=3)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    single = [case for case in cases_of(args.cases / "stills") if case.name.startswith(KINDS)][:: args.every]
    moving = cases_of(args.cases / "clips")
    rows = []
    for preset in get_args(Quality):
        rows.append({"quality": preset} | stills(single, args.output, preset) | footage(moving, args.output, preset))
        published.print_rows(rows[-1:])
    if args.json:
        published.write(args.json, {"presets": rows})


if __name__ == "__main__":
    main()
