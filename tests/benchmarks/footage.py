"""Restore real scenes blurred and sheared afresh, and print what each frame gained, and how many frames were harmed.

    python tests/benchmarks/footage.py CASES -o RESULTS [--exposure stated|none|profile|steady|period|FACTOR ...] [--only NAME ...]
        [--set ROOM.NUMBER=VALUE ...] [--json FILE]

CASES holds a folder a case, as `rsvideo simulate --from-clip` makes it: clip.mp4, truth.mp4 and case.json with exposure_s and readout_s.
`stated` gives both numbers, `none` gives nothing at all, `profile` a camera's profile with the readout, `steady` takes what `none` measures
in the clip's middle for all of it, `period` gives the readout and a frame's period as the exposure, and a FACTOR the readout and so many
times the exposure: what a wrong number does.
One that is longer than the period is refused, and counts as told. RESULTS gets NAME.WAY.mkv and its sidecar; FILE the figures, for
tests/benchmarks/moved.py. Gains are after the best shift and scale of each frame, without its border; those of its sides, 40 px along the
border, are without. Frames count as blurred where the middle one of all pixels moves by more than 2 px while the middle scanline is open.
A wrong exposure counts as told where the command says what the blur shows instead, or what is assumed; not where it says that the clip
does not show its own.

A restoration depends on the shutter that is settled for it: ways that settle the same one share it. --set tries other numbers of
rsvideo.restoration than the present ones: trust.OUT_OF_FOCUS=-0.004.
"""

import argparse
import json
import resource
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import published
import yaml
from cases import cases_of, facts_of, luma

from rsvideo.config.request import Request, Sections
from rsvideo.pipeline import deblur
from rsvideo.pipeline.prepare import prepare
from rsvideo.progress import ignore
from rsvideo.report.metrics import psnr
from rsvideo.video.decode import probe

HARMED, MUCH = 0.1, 0.5  # dB below the input
BLURRED = 2.0  # px
SIDES = 40  # px
LONGER = "at most one frame's period"  # of the refusal
WARNINGS, UNCHECKED = ("blur is", "does not show", "better focus"), "is taken as given"  # a note that has one of these words, not the last


def request_of(case: Path, way: str, facts: dict, output: Path) -> Request:
    """What the command would be asked."""
    stated: dict = {"encoding": {"codec": "ffv1"}}
    if way == "profile":
        stated["camera"] = {"profile": str(profile_of(case, facts, output.with_suffix(".yaml")))}
    elif way not in ("none", "steady"):
        true, period = facts["exposure_s"], 1 / facts["fps"]
        exposure = {"stated": true, "period": period}.get(way) or float(way) * true
        stated["camera"] = {"exposure": exposure, "readout": facts["readout_s"]}
    return Request.of(case / "clip.mp4", output, Sections.model_validate(stated), overwrite=True)


def profile_of(case: Path, facts: dict, path: Path) -> Path:
    """A profile that states the readout of a case's camera and nothing else."""
    clip = probe(case / "clip.mp4")
    mode = {"rows": clip.rows, "cols": clip.cols, "fps": facts["fps"]}
    path.write_text(yaml.safe_dump({"name": case.name, "mode": mode, "timing": {"readout_s": facts["readout_s"]}}))
    return path


def along_sides(image: np.ndarray, truth: np.ndarray) -> float:
    """PSNR in dB of the SIDES px along the border, where neighbours often do not show what a frame shows."""
    inner = np.zeros(truth.shape[:2], bool)
    inner[SIDES:-SIDES, SIDES:-SIDES] = True
    return float(-10 * np.log10(np.mean((image - truth)[~inner] ** 2)))


def rows_of(case: Path, ways: list[str], folder: Path) -> list[tuple[dict, np.ndarray]]:
    """The figures of a case, way by way, with the gain of each frame."""
    facts = facts_of(case)
    truth, before = (luma(case / name) for name in ("truth.mp4", "clip.mp4"))
    blur = np.array(facts.get("blur_px", [facts["blur_extent_px"]] * len(truth)))
    settled: dict[tuple[float, float, bool], tuple[np.ndarray, float, list[str], tuple[str, ...]]] = {}
    rows = []
    for way in ways:
        output = folder / f"{case.name}.{way}.mkv"
        try:
            task = prepare(request_of(case, way, facts, output))
        except ValueError as refusal:
            rows.append((refused(case, way, refusal), np.zeros(0)))
            continue
        if way == "steady":  # as if somebody had stated what the clip's middle shows
            stated = replace(task.shutter.exposure, source=way, assumed=False)
            task = replace(task, shutter=replace(task.shutter, exposure=stated))
        shutter = task.timing.exposure, task.timing.readout, task.shutter.exposure_open
        if shutter not in settled:
            outcome = deblur.carry_out(task, ignore)
            records = json.loads(task.request.record.read_text())["frames"]
            verdicts = [record["verdict"].split(",")[0].split(":")[0] for record in records]
            pictures = list(zip(luma(output), before, truth, strict=True))
            gain = np.array([psnr(a, t) - psnr(b, t) for a, b, t in pictures])
            sides = float(np.mean([along_sides(a, t) - along_sides(b, t) for a, b, t in pictures]))
            settled[shutter] = gain, sides, verdicts, outcome.notes
        gain, sides, verdicts, notes = settled[shutter]
        row = {
            "clip": case.name,
            "exposure": way,
            "exposure_taken": shutter[0] / facts["exposure_s"],
            "blurred": int((blur > BLURRED).sum()),
            "blurred_gain_db": float(gain[blur > BLURRED].sum()),
            "gain_db": float(gain.mean()),
            "least_gain_db": float(gain.min()),
            "frames": len(gain),
            "harmed": int((gain < -HARMED).sum()),
            "harmed_much": int((gain < -MUCH).sum()),
            "restored": verdicts.count("restored"),
            "straightened": verdicts.count("straightened"),
            "warned": any(words in note and UNCHECKED not in note for note in (*task.notes, *notes) for words in WARNINGS),
            "sides_gain_db": sides,
            "refused": 0,
        }
        rows.append((row, gain))
        print("| " + " | ".join(f"{v:.2f}" if isinstance(v, float) else str(v) for v in row.values()) + " |", flush=True)
    return rows


def refused(case: Path, way: str, refusal: ValueError) -> dict:
    """The row of a clip whose exposure the command does not take."""
    if LONGER not in str(refusal):
        raise refusal
    gains = dict.fromkeys(("blurred_gain_db", "gain_db", "least_gain_db", "sides_gain_db"), 0.0)
    counts = dict.fromkeys(("blurred", "frames", "harmed", "harmed_much", "restored", "straightened"), 0)
    return {"clip": case.name, "exposure": way, "exposure_taken": 0.0, **gains, **counts, "warned": True, "refused": 1}


def summary(rows: list[dict], ways: list[str]) -> list[dict]:
    """All clips together, way by way."""
    out = []
    for way in ways:
        some = [row for row in rows if row["exposure"] == way]
        frames, blurred = (sum(row[name] for row in some) for name in ("frames", "blurred"))
        out.append(
            {
                "exposure": way,
                "clips": len(some),
                "frames": frames,
                "blurred": blurred,
                "blurred_gain_db": sum(row["blurred_gain_db"] for row in some) / max(blurred, 1),
                "harmed_share": sum(row["harmed"] for row in some) / max(frames, 1),
                "harmed_much": sum(row["harmed_much"] for row in some),
                "least_gain_db": min((row["least_gain_db"] for row in some if row["frames"]), default=0.0),
                "warned": sum(row["warned"] for row in some),
                "sides_gain_db": sum(row["sides_gain_db"] * row["frames"] for row in some) / max(frames, 1),
                "refused": sum(row["refused"] for row in some),
            }
        )
    return out


def try_numbers(changes: list[str]) -> None:
    """ROOM.NUMBER=VALUE each."""
    for name, value in (change.split("=") for change in changes):
        room, number = name.split(".")
        module = import_module(f"rsvideo.restoration.{room}")
        setattr(module, number, type(getattr(module, number))(value))


def main() -> None:
    """Run, and print Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--exposure", nargs="+", default=["stated", "none"], metavar="WAY")
    parser.add_argument("--only", nargs="+", metavar="NAME")
    parser.add_argument("--set", nargs="+", default=[], metavar="ROOM.NUMBER=VALUE")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    try_numbers(args.set)
    rows: list[dict] = []
    for case in cases_of(args.cases, args.only):
        for row, gain in rows_of(case, args.exposure, args.output):
            rows.append(row)
            if worst := [f"{k}: {gain[k]:.2f}" for k in np.argsort(gain) if gain[k] < -HARMED]:
                print(f"{row['clip']} {row['exposure']}, dB of harmed frames: {', '.join(worst)}", file=sys.stderr, flush=True)
    print()
    published.print_rows(rows)
    published.print_rows(summaries := summary(rows, args.exposure))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(f"most memory of any run: {peak:.2f} GB", file=sys.stderr)
    if args.json:
        published.write(args.json, {"footage": rows, "footage_summary": summaries}, [])


if __name__ == "__main__":
    main()
