"""The published figures: docs/results.json, and the tables of docs/results.md that are made from it.

    python tests/benchmarks/published.py [--check]

writes each table into the page, between the lines `<!-- table NAME -->` and `<!-- end -->`; with --check it only says which tables
differ, and exits with 1. Benchmarks write what they measured with `--json FILE` in the same form, one section or more, by
`write`; `python tests/benchmarks/moved.py FILE` compares that with what is published.
"""

import argparse
import json
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parents[2] / "docs"
PUBLISHED = DOCS / "results.json"
PAGE = DOCS / "results.md"
_TABLE = re.compile(r"(<!-- table (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def sections() -> dict[str, Any]:
    """The sections of docs/results.json by name: `command`, `columns` (name, title, unit, digits) and `rows`."""
    return json.loads(PUBLISHED.read_text(encoding="utf-8"))["sections"]


def key(section: Mapping[str, Any], row: Mapping[str, Any]) -> str:
    """What names a row of a section: its first column, or the columns that the section lists as its `key`."""
    return " ".join(str(row[name]) for name in section.get("key", [section["columns"][0]["name"]]))


def write(file: Path, measured: Mapping[str, Sequence[Mapping[str, Any]]], options: Sequence[str] = ()) -> None:
    """Write what a benchmark measured: the rows of each section, and the options that the command had besides the default ones."""
    record = {"options": list(options), "sections": {name: {"rows": list(rows)} for name, rows in measured.items()}}
    file.write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def table(section: Mapping[str, Any]) -> str:
    """A section as a Markdown table; numbers with the digits of their column, the largest of a row in bold where the section says so."""
    columns = section["columns"]
    titles = [column["title"] + (f", {column['unit']}" if column["unit"] else "") for column in columns]
    numeric = [any(isinstance(row[column["name"]], int | float) for row in section["rows"]) for column in columns]
    lines = [f"| {' | '.join(titles)} |", f"|{'|'.join('---:' if right else '---' for right in numeric)}|"]
    for row in section["rows"]:
        cells = [_cell(row[column["name"]], column["digits"]) for column in columns]
        if section.get("best"):
            top = max(float(cell) for cell in cells[1:] if cell != "-")
            cells = [f"**{cell}**" if cell != "-" and n and float(cell) == top else cell for n, cell in enumerate(cells)]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def print_rows(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print rows of equal columns as Markdown, for a person who waits."""
    print("| " + " | ".join(column.replace("_", " ") for column in rows[0]) + " |")
    print("|" + "---|" * len(rows[0]))
    for row in rows:
        cells = ("-" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value) for value in row.values())
        print("| " + " | ".join(cells) + " |", flush=True)
    print()


def _cell(value: object, digits: int) -> str:
    if value is None:
        return "-"
    return f"{value:.{0 if isinstance(value, int) else digits}f}" if isinstance(value, int | float) else str(value)


def page(text: str, figures: Mapping[str, Any]) -> str:
    """The page with every table made anew."""
    return _TABLE.sub(lambda found: found[1] + "\n" + table(figures[found[2]]) + "\n" + found[3], text)


def main() -> None:
    """Write the tables, or check them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; exit with 1 where the page is not up to date")
    args = parser.parse_args()
    before = PAGE.read_text(encoding="utf-8")
    after = page(before, sections())
    if args.check:
        stale = [old[2] for old, new in zip(_TABLE.finditer(before), _TABLE.finditer(after), strict=True) if old[0] != new[0]]
        for name in stale:
            print(f"{PAGE.name}: the table {name} differs from {PUBLISHED.name}; python tests/benchmarks/published.py makes it anew")
        sys.exit(1 if stale else 0)
    PAGE.write_text(after, encoding="utf-8")


if __name__ == "__main__":
    main()
