"""Compare a benchmark's run with the published figures of docs/results.json, and say what moved.

    python tests/benchmarks/quality.py CASES -o RESULTS --json run.json && python tests/benchmarks/moved.py run.json
    rsvideo compare --table CASES -o table.csv && python tests/benchmarks/moved.py table.csv --fail

RESULTS is a file that a benchmark wrote with --json, or the CSV of `rsvideo compare --table`. Each figure is printed that differs
from the published one by more than its tolerance: 0.01 dB, 5 % of a time or a memory, 0.01 of anything else (--decibels, --share,
--other). With --fail the exit code is 1 if anything moved, or if the run holds nothing that is published.
"""

import argparse
import csv
import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import published

RELATIVE = ("s", "GB", "MB")  # units that are compared by their ratio
SLACK = 1e-9  # two decimals that differ by exactly the tolerance have not moved


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """By how much a figure may differ before it has moved."""

    decibels: float = 0.01  # dB
    share: float = 0.05  # of a time or a memory
    other: float = 0.01  # px and the like


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A figure that is published and was measured again."""

    case: str
    what: str
    unit: str
    before: float
    now: float

    def moved(self, tolerance: Tolerance) -> bool:
        """Whether it differs by more than the tolerance of its unit."""
        if self.unit in RELATIVE:
            return abs(self.now - self.before) > tolerance.share * abs(self.before) + SLACK
        return abs(self.now - self.before) > (tolerance.decibels if self.unit == "dB" else tolerance.other) + SLACK


def read(file: Path) -> dict[str, list[dict[str, Any]]]:
    """The rows of each section of a run."""
    if file.suffix == ".csv":
        with file.open(encoding="utf-8", newline="") as lines:
            rows = [{name: float(text) if name != "case" else text for name, text in row.items() if text} for row in _cases(lines)]
        return {"comparison": rows}
    record = json.loads(file.read_text(encoding="utf-8"))
    if record["options"]:
        print(f"{file}: the run had options of its own: {' '.join(record['options'])}", file=sys.stderr)
    return {name: section["rows"] for name, section in record["sections"].items()}


def _cases(lines: Iterator[str]) -> Iterator[dict[str, str]]:
    for row in csv.DictReader(lines):
        row.pop("kind")
        yield row


def figures(run: Mapping[str, list[dict[str, Any]]], sections: Mapping[str, Any]) -> Iterator[Figure]:
    """Every number of the run that is published too, rounded as it is published unless it is compared by its ratio."""
    for name, rows in run.items():
        section = sections[name]
        known = {published.key(section, row): row for row in section["rows"]}
        for row in rows:
            before = known.get(published.key(section, row), {})
            for column in section["columns"]:
                old, new = before.get(column["name"]), row.get(column["name"])
                if isinstance(old, int | float) and isinstance(new, int | float):
                    unit = column["unit"] or section.get("unit", "")
                    now = new if unit in RELATIVE else round(new, column["digits"])
                    yield Figure(case=published.key(section, row), what=column["title"], unit=unit, before=old, now=now)


def main() -> None:
    """Print what moved."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="+", metavar="RESULTS")
    parser.add_argument("--fail", action="store_true", help="exit with 1 if anything moved")
    parser.add_argument("--decibels", type=float, default=Tolerance.decibels)
    parser.add_argument("--share", type=float, default=Tolerance.share)
    parser.add_argument("--other", type=float, default=Tolerance.other)
    args = parser.parse_args()
    tolerance = Tolerance(decibels=args.decibels, share=args.share, other=args.other)
    compared = [figure for file in args.results for figure in figures(read(file), published.sections())]
    moved = [figure for figure in compared if figure.moved(tolerance)]
    if moved:
        print("| case | figure | before | now | difference |\n|---|---|---:|---:|---:|")
    for each in moved:
        share = f" ({(each.now / each.before - 1):+.0%})" if each.unit in RELATIVE and each.before else ""
        unit = f", {each.unit}" if each.unit else ""
        print(f"| {each.case} | {each.what}{unit} | {each.before:g} | {each.now:g} | {each.now - each.before:+.2f}{share} |")
    print(f"{len(compared)} figures compared, {len(moved)} moved", file=sys.stderr)
    sys.exit(1 if args.fail and (moved or not compared) else 0)


if __name__ == "__main__":
    main()
