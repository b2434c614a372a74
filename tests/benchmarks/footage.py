"""Restore real scenes blurred and sheared afresh, with the installed command, and print what each frame gained.

    python tests/benchmarks/footage.py CASES -o RESULTS [--exposure stated|none|FACTOR ...] [--json FILE]

CASES holds a folder a case: clip.mp4, truth.mp4 and case.json with exposure_s and readout_s. `stated` gives both numbers, `none` gives
nothing at all, and a FACTOR gives the readout and so many times the exposure: what a wrong number does. RESULTS gets NAME.WAY.mkv and
its sidecar; FILE the figures, for tests/benchmarks/moved.py. Gains are after the best shift and scale of each whole frame.
"""

import argparse
import json
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import published
from clips import luma

from rsvideo.report.metrics import psnr

HARMED = 0.1  # dB below the input


def restore(case: Path, way: str, output: Path) -> tuple[list[dict], str]:
    """The frames' records, and what the command had to say."""
    facts = json.loads((case / "case.json").read_text())
    words = ["rsvideo", "deblur", case / "clip.mp4", "-o", output, "--codec", "ffv1", "--overwrite", "--json"]
    if way != "none":
        factor = 1.0 if way == "stated" else float(way)
        exposure = min(factor * facts["exposure_s"], 1 / facts["fps"])
        words += ["--exposure", f"{exposure:.6f}", "--readout", facts["readout_s"]]
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=7200)
    if done.returncode:
        sys.exit(f"{case.name}: {done.stderr}")
    return json.loads(done.stdout)["frames"], done.stderr


def main() -> None:
    """Run, and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--exposure", nargs="+", default=["stated", "none"], metavar="WAY")
    parser.add_argument("--only", nargs="+", metavar="NAME")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    rows = []
    print(
        "| clip | exposure given | exposure taken, of the true one | gain dB | least gain dB | frames | harmed | restored | straightened |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for case in sorted(f.parent for f in args.cases.glob("*/case.json")):
        if args.only and case.name not in args.only:
            continue
        truth, before = (luma(case / name) for name in ("truth.mp4", "clip.mp4"))
        for way in args.exposure:
            output = args.output / f"{case.name}.{way}.mkv"
            records, notes = restore(case, way, output)
            after = luma(output)
            gain = np.array([psnr(a, t) - psnr(b, t) for a, b, t in zip(after, before, truth, strict=True)])
            taken = records[0]["timing"]["exposure_s"] / json.loads((case / "case.json").read_text())["exposure_s"]
            verdicts = [record["verdict"].split(",")[0].split(":")[0] for record in records]
            row = {
                "clip": case.name,
                "exposure": way,
                "exposure_taken": taken,
                "gain_db": float(gain.mean()),
                "least_gain_db": float(gain.min()),
                "frames": len(gain),
                "harmed": int((gain < -HARMED).sum()),
                "restored": verdicts.count("restored"),
                "straightened": verdicts.count("straightened"),
            }
            rows.append(row)
            print("| " + " | ".join(f"{v:.2f}" if isinstance(v, float) else str(v) for v in row.values()) + " |", flush=True)
            print("\n".join(f"    {line}" for line in notes.splitlines() if "blur is" in line or "does not show" in line), file=sys.stderr)
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6
    print(f"\nmost memory of any run: {peak:.2f} GB", file=sys.stderr)
    if args.json:
        published.write(args.json, {"footage": rows}, [])


if __name__ == "__main__":
    main()
