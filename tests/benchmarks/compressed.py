"""Compress cases once more at random rates, as cases for footage.py, and print how far the exposures that they show are from the truth.

    python tests/benchmarks/compressed.py CASES -o COMPRESSED [--bits 0.1 1] [--seed 1] [--json FILE]

CASES holds a folder a case, as `rsvideo simulate --from-clip` makes it, which is hardly compressed. Each clip gets --bits bits a pixel
(log-uniform), by one of ENCODERS. COMPRESSED gets the same folders, their truth as it was; a later run takes the cases from there.
"""

import argparse
import json
import shutil
import sys
from pathlib import Path

import numpy as np
import published
from cases import cases_of, encoded_anew, facts_of
from measured import measured, summary

ENCODERS = (("libx264", "veryfast"), ("libx264", "medium"), ("libx265", "fast"))  # and their presets
QUIET = {"libx265": {"x265-params": "log-level=none"}}


def compressed(case: Path, out: Path, bits: float, encoder: str, preset: str) -> Path:
    """The case with its clip at so many bits a pixel, made unless it is there."""
    if (out / "case.json").is_file():
        return out
    out.mkdir(parents=True, exist_ok=True)
    facts = facts_of(case)
    rate = round(bits * facts["rows"] * facts["cols"] * facts["fps"])
    options = {"preset": preset, "b": str(rate), "maxrate": str(rate), "bufsize": str(rate)} | QUIET.get(encoder, {})
    shutil.copy(case / "truth.mp4", out)
    encoded_anew(case / "clip.mp4", out / "clip.mp4", lambda _, planes: planes, options, encoder)
    (out / "case.json").write_text(json.dumps(facts | {"bits_a_pixel": bits, "encoder": f"{encoder} {preset}"}, indent=1))
    return out


def main() -> None:
    """Compress, measure, and print two Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--bits", type=float, nargs=2, default=(0.1, 1.0), metavar=("FROM", "TO"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, metavar="FILE")
    args = parser.parse_args()
    rng, rows = np.random.default_rng(args.seed), list[dict]()
    for case in cases_of(args.cases):
        bits, (encoder, preset) = float(np.exp(rng.uniform(*np.log(args.bits)))), ENCODERS[rng.integers(len(ENCODERS))]
        made = compressed(case, args.output / case.name, bits, encoder, preset)
        rows.append({"clip": case.name, "bits_a_pixel": bits, "encoder": f"{encoder} {preset}"} | measured(made))
        print(f"{len(rows)}: {case.name}", file=sys.stderr, flush=True)
    published.print_rows(rows)
    published.print_rows(summaries := summary(rows))
    if args.json:
        published.write(args.json, {"compressed": rows, "compressed_summary": summaries})


if __name__ == "__main__":
    main()
