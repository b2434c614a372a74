"""The attack: thousands of hostile files and hundreds of hostile requests, and a table of what became of them.

    python tests/robustness/attack.py [--json FILE] [--files 3000] [--requests 500] [--jobs 2] [--only ROOM/NUMBER] [--keep DIR]

Each is made anew from its room and number, so that one that went wrong can be repeated: `--only media/17 --keep /tmp/17`.
"""

import argparse
import collections
import concurrent.futures
import importlib
import multiprocessing
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[2])  # `tests` and the project, instead of this folder

from tests.robustness import harness
from tests.robustness.case import Case
from tests.robustness.harness import RIGHT, WRONG, Answer

SHARES = {"media": 0.55, "pictures": 0.25, "texts": 0.2}  # of the files, by room


def names(files: int, requests: int) -> list[str]:
    """The cases of an attack of so many files and requests, those of all rooms in turn."""
    counts = {room: round(share * files) for room, share in SHARES.items()} | {"commands": requests}
    return [f"{room}/{number}" for number in range(max(counts.values())) for room, count in counts.items() if number < count]


def sample(files: int, requests: int, of: Sequence[str]) -> list[str]:
    """So many of the cases, spread evenly."""
    counts = {room: round(share * files) for room, share in SHARES.items()} | {"commands": requests}
    chosen: list[str] = []
    for room, count in counts.items():
        own = [name for name in of if name.startswith(f"{room}/")]
        chosen += [own[(2 * k + 1) * len(own) // (2 * count)] for k in range(count)]
    return chosen


def answers(cases: Iterable[str], jobs: int, keep: Path | None = None) -> Iterator[Answer]:
    """What became of each, from so many workers."""
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(jobs, mp_context=context, initializer=harness.prepared) as workers:
        for done in concurrent.futures.as_completed([workers.submit(one, name, keep) for name in cases]):
            yield done.result()


def one(name: str, keep: Path | None = None) -> Answer:
    """Make a case from its name, run it and judge it."""
    return harness.answer(case(name), keep)


def case(name: str) -> Case:
    """The case of a room and a number."""
    room, number = name.split("/")
    return importlib.import_module(f"tests.robustness.{room}").case(int(number))


def rows(found: Iterable[Answer]) -> list[dict[str, Any]]:
    """Counts by family, and of all: the rows of the published table."""
    by_family: dict[str, list[Answer]] = collections.defaultdict(list)
    for each in found:
        by_family[each.family].append(each)
    everything = [each for group in by_family.values() for each in group]
    return [_row(family, group) for family, group in sorted(by_family.items())] + [_row("all", everything)]


def _row(family: str, group: Sequence[Answer]) -> dict[str, Any]:
    counts = collections.Counter(each.verdict for each in group)
    return {
        "attack": family,
        "tried": len(group),
        **{verdict.replace(" ", "_"): counts[verdict] for verdict in (*RIGHT, *WRONG)},
        "slowest_s": round(max(each.seconds for each in group), 1),
        "memory_gb": round(max(each.bytes for each in group) / 1e9, 2),
    }


def printed(table: Sequence[dict[str, Any]]) -> str:
    """The table as Markdown."""
    lines = [f"| {' | '.join(table[0])} |", "|---" + "|---:" * (len(table[0]) - 1) + "|"]
    return "\n".join([*lines, *(f"| {' | '.join(map(str, row.values()))} |" for row in table)])


def main() -> int:
    """Attack, print what went wrong and the table; 1 where anything went wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the table's rows, as docs/results.json holds them")
    parser.add_argument("--files", type=int, default=3000)
    parser.add_argument("--requests", type=int, default=500)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", nargs="+", metavar="ROOM/NUMBER", help="these alone; their answers are printed")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="leave the cases' folders here")
    args = parser.parse_args()
    found: list[Answer] = []
    cases = args.only or names(args.files, args.requests)
    for each in answers(cases, args.jobs, args.keep):
        found.append(each)
        if len(found) % 100 == 0:
            print(f"{len(found)} of {len(cases)}", file=sys.stderr, flush=True)
        if args.only or each.verdict not in RIGHT:
            print(f"{each.verdict}: {each.name} ({each.family}), code {each.code}, {each.seconds:.1f} s: {each.words}", flush=True)
    table = rows(found)
    print(printed(table))
    if args.json:
        from tests.benchmarks import published

        published.write(args.json, {"attack": table})
    return 0 if all(each.verdict in RIGHT for each in found) else 1


if __name__ == "__main__":
    sys.exit(main())
