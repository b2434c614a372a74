"""Fit the odds that a photograph's path is right to what speaks for it, and print how well they foretell it.

    python tests/benchmarks/judge.py FILE...

Each FILE is what tests/benchmarks/corpus.py writes. The odds are fitted to the stills of the half that is chosen on, by logistic
regression on the logarithms of the evidence; a path is right that is off by 0.15 of the blur or less. The table has, for either
half and each range of the present odds, how many stills there are, the mean probability, and the share of right paths.
"""

import argparse
import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import published
from corpus import NEAR
from jaxtyping import Float
from scipy.optimize import minimize

from rsvideo.restoration.evidence import Evidence
from rsvideo.restoration.verdict import log_measures, log_odds

LEAST_ERROR = 0.3  # px by which a right path may be off, however short the blur
LEAST = {"rest": 0.02, "mirror": 0.3, "focus": 0.5}  # of a measure: its logarithm is taken
RIDGE = 0.05  # of the weights, which few stills would else exaggerate
BANDS = (-np.inf, -2.0, -1.0, 0.0, 1.0, 2.0, np.inf)  # of the odds' logarithm


def floored(row: dict) -> Evidence:
    """The evidence of a still, of which logarithms can be taken."""
    return Evidence(**{name: max(value, LEAST.get(name, -np.inf)) for name, value in row["evidence"].items()})


def fitted(measured: Float[np.ndarray, "stills measures"], right: Float[np.ndarray, " stills"]) -> Float[np.ndarray, " weights"]:
    """The constant and the weights of the likeliest odds."""
    features = np.column_stack([np.ones(len(measured)), measured])

    def unlikely(weights: np.ndarray) -> float:
        told = features @ weights
        return float(np.logaddexp(0, told).sum() - right @ told + RIDGE * (weights[1:] ** 2).sum())

    return minimize(unlikely, np.zeros(features.shape[1])).x


def calibration(half: str, told: Float[np.ndarray, " stills"], right: Float[np.ndarray, " stills"]) -> list[dict]:
    """How often paths are right, by what their odds say."""
    rows = []
    for low, high in pairwise(BANDS):
        some = (told > low) & (told <= high)
        if some.any():
            foretold = float((1 / (1 + np.exp(-told[some]))).mean())
            rows.append({"half": half, "from": low, "to": high, "stills": int(some.sum()), "told": foretold, "right": right[some].mean()})
    return rows


def main() -> None:
    """Fit, and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE")
    stills = [row for file in parser.parse_args().files for row in json.loads(file.read_text())["stills"] if row["evidence"]]
    rows: list[dict] = []
    for half in ("choose", "report"):
        if some := [row for row in stills if row["half"] == half]:
            seen = [floored(row) for row in some]
            right = np.array([row["path_error_px"] <= max(NEAR[0] * row["blur_px"], LEAST_ERROR) for row in some], float)
            if half == "choose":
                weights = fitted(np.array([log_measures(each) for each in seen]), right)
                print("constant, " + ", ".join(LEAST) + ": " + ", ".join(f"{weight:.2f}" for weight in weights) + "\n")
            rows += calibration(half, np.array([log_odds(each) for each in seen]), right)
    published.print_rows(rows)


if __name__ == "__main__":
    main()
