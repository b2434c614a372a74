"""Restore every still of a folder of cases with the installed command and print what was gained.

    python tests/benchmarks/quality.py CASES -o RESULTS [--known] [--kind shift,paper800] [--jobs 2] [--json FILE] [--motion shift ...]

CASES holds a folder a case: blurred.png, truth.png, motion.csv, case.json (`rsvideo simulate` writes such). RESULTS gets NAME.png
and its sidecar. With --known the motion of motion.csv is given: the bound of what a blind method can reach with the same prior.
FILE gets the figures, for tests/benchmarks/moved.py. All other options are those of `rsvideo deblur`.
"""

import argparse
import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np
import published
from cases import cases_of, facts_of
from installed import RSVIDEO

from rsvideo.physics.trajectory import path_error
from rsvideo.report.metrics import psnr


def codes(path: Path) -> np.ndarray:
    """A picture's code values in [0, 1]."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        sys.exit(f"cannot read {path}")
    return np.atleast_3d(image).astype(np.float32) / (65535 if image.dtype == np.uint16 else 255)


def restored(case: Path, results: Path, options: list[str], known: bool) -> tuple[str, float, float, float, float, str]:
    """One row of the table: kind, dB blurred, dB restored, px path error, seconds, verdict."""
    facts = facts_of(case)
    output = results / f"{case.name}.png"
    timing = ["--exposure", str(facts["exposure_s"]), "--readout", str(facts["readout_s"]), "--focal-px", str(facts["focal_px"])]
    motion = ["--trajectory", str(case / "motion.csv")] if known else []
    command = [RSVIDEO, "deblur", str(case / "blurred.png"), "-o", str(output), *timing, *motion, *options, "--overwrite", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=1800)
    if done.returncode:
        sys.exit(f"{case.name}: {done.stderr}")
    frame = json.loads(done.stdout)["frames"][0]
    path = frame["trajectory"]
    t, pitch, yaw, _ = np.loadtxt(case / "motion.csv", delimiter=",", skiprows=1).T
    truth = np.stack([np.interp(path["t_s"], t, facts["focal_px"] * yaw), np.interp(path["t_s"], t, -facts["focal_px"] * pitch)], axis=1)
    error = path_error(np.stack([path["x_px"], path["y_px"]], axis=1), truth)
    sharp = codes(case / "truth.png")
    return case.name, psnr(codes(case / "blurred.png"), sharp), psnr(codes(output), sharp), error, frame["seconds"], frame["verdict"]


def written(file: Path, rows: list[tuple[str, float, float, float, float, str]], options: list[str], known: bool) -> None:
    """The figures for moved.py: under the motion that was given, or found."""
    plain = known and options[:2] == ["--prior", "tv"]
    name = "known_tv" if plain else "known" if known else "blind"
    cases = [{"case": case, "blurred_db": before, f"{name}_db": after} for case, before, after, *_ in rows]
    kinds: dict[str, list[tuple[float, float]]] = {}
    for n, (case, before, after, error, seconds, _) in enumerate(rows):
        cases[n] |= {} if known else {"path_error_px": error, "seconds": seconds}
        kinds.setdefault(case.rsplit("_", 1)[0], []).append((after - before, error))
    means = [{"kind": kind, f"{name}_gain_db": float(np.mean([gain for gain, _ in group]))} for kind, group in kinds.items()]
    for mean, group in zip(means, kinds.values(), strict=True):
        mean |= {} if known else {"path_error_px": float(np.median([error for _, error in group]))}
    published.write(file, {"stills": cases, "still_kinds": means}, options[2:] if plain else options)


def main() -> None:
    """Run, and print a Markdown table with the means of each kind."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--known", action="store_true")
    parser.add_argument("--kind", default="")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", type=Path)
    args, options = parser.parse_known_args()
    args.output.mkdir(parents=True, exist_ok=True)
    own = list(options)
    cases = [case for case in cases_of(args.cases) if case.name.startswith(tuple(args.kind.split(",")))]
    options += ["--threads", "1"] if args.jobs > 1 else []
    with ThreadPoolExecutor(args.jobs) as pool:
        rows = list(pool.map(lambda case: restored(case, args.output, options, args.known), cases))
    if args.json:
        written(args.json, rows, own, args.known)
    print("| case | blurred dB | restored dB | gain dB | path error px | seconds | verdict |\n|---|---|---|---|---|---|---|")
    for name, before, after, error, seconds, verdict in rows:
        print(f"| {name} | {before:.2f} | {after:.2f} | {after - before:.2f} | {error:.2f} | {seconds:.0f} | {verdict} |")
    for kind in sorted({row[0].rsplit("_", 1)[0] for row in rows}):
        group = [row for row in rows if row[0].rsplit("_", 1)[0] == kind]
        gain = np.mean([row[2] - row[1] for row in group])
        print(f"\n{kind}: mean gain {gain:.2f} dB, median path error {np.median([row[3] for row in group]):.2f} px", end="")
    print()


if __name__ == "__main__":
    main()
