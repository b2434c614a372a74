"""PSNR of several methods over a folder of cases as a table: rows cases, columns methods, the best in bold."""

import csv
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

Format = Literal["markdown", "latex", "csv"]
_NONE = "-"
_LISTED = 6  # cases of one reason that are named


@dataclass(frozen=True, kw_only=True)
class Row:
    """A case, and the PSNR in dB of each method that gave a result."""

    kind: str
    case: str
    psnr: Mapping[str, float]
    why_not: Mapping[str, str]  # of the others


@dataclass(frozen=True, kw_only=True)
class Table:
    """The cases in their order."""

    methods: tuple[str, ...]
    rows: tuple[Row, ...]

    @property
    def failed(self) -> bool:
        """Whether a method that applies gave no result."""
        return any(why != DOES_NOT_APPLY for row in self.rows for why in row.why_not.values())

    @property
    def notes(self) -> tuple[str, ...]:
        """Why there are gaps, in words."""
        reasons: dict[tuple[str, str], list[str]] = {}
        for row in self.rows:
            for method, why in row.why_not.items():
                reasons.setdefault((method, why), []).append(row.case)
        return tuple(
            f"{method}: {why} ({', '.join(cases[:_LISTED])}{', ...' if len(cases) > _LISTED else ''})"
            for (method, why), cases in reasons.items()
        )


DOES_NOT_APPLY = "sees the motion between frames, and stills have one"


def written(table: Table, kind: Format) -> str:
    """The table in the format `kind`."""
    match kind:
        case "csv":
            return _csv(table)
        case "latex":
            return _latex(table)
        case _:
            return _markdown(table)


def means(table: Table) -> list[Row]:
    """A row for each kind of case: each method's mean over the cases, where it has all of them; else there is nothing to compare."""
    kinds = list(dict.fromkeys(row.kind for row in table.rows))
    out = []
    for kind in kinds:
        rows = [row for row in table.rows if row.kind == kind]
        mean = {m: float(np.mean([row.psnr[m] for row in rows])) for m in table.methods if all(m in row.psnr for row in rows)}
        out.append(Row(kind=kind, case=f"mean of {kind}", psnr=mean, why_not={}))
    return out


def _best(row: Row) -> frozenset[str]:
    """The methods whose number, as it is written, is the highest."""
    top = max((f"{value:.2f}" for value in row.psnr.values()), key=float, default="")
    return frozenset(m for m, value in row.psnr.items() if f"{value:.2f}" == top) if len(row.psnr) > 1 else frozenset()


def _cells(row: Row, methods: Sequence[str], bold: Callable[[str], str]) -> list[str]:
    best = _best(row)
    texts = {m: f"{value:.2f}" if math.isfinite(value) else _NONE for m, value in row.psnr.items()}
    return [bold(texts[m]) if m in best else texts.get(m, _NONE) for m in methods]


def _markdown(table: Table) -> str:
    def line(cells: Sequence[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

    lines = [line(["PSNR, dB", *table.methods]), "|---|" + "---:|" * len(table.methods)]
    lines += [line([row.case, *_cells(row, table.methods, "**{}**".format)]) for row in table.rows]
    lines += [line([f"*{row.case}*", *_cells(row, table.methods, "**{}**".format)]) for row in means(table)]
    return "\n".join([*lines, *([""] if table.notes else []), *(f"{_NONE} {note}" for note in table.notes)]) + "\n"


def _latex(table: Table) -> str:
    def line(cells: Sequence[str]) -> str:
        return "  " + " & ".join(cells) + r" \\"

    def row(each: Row) -> str:
        return line([_escaped(each.case), *_cells(each, table.methods, r"\textbf{{{}}}".format)])

    lines = [r"\begin{tabular}{l" + "r" * len(table.methods) + "}", r"  \hline"]
    lines += [line(["PSNR, dB", *map(_escaped, table.methods)]), r"  \hline", *map(row, table.rows), r"  \hline", *map(row, means(table))]
    return "\n".join([*lines, r"  \hline", r"\end{tabular}", *(f"% {_NONE} {note}" for note in table.notes)]) + "\n"


def _escaped(text: str) -> str:
    special = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    return "".join(special.get(letter, f"\\{letter}" if letter in "&%$#_{}" else letter) for letter in text)


def _csv(table: Table) -> str:
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["kind", "case", *table.methods])
    for row in (*table.rows, *means(table)):
        rows.writerow([row.kind, row.case, *(f"{row.psnr[m]:.4f}" if m in row.psnr else "" for m in table.methods)])
    return text.getvalue()
