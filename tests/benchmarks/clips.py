"""Restore every clip of a folder of cases with the installed command and print what was gained, and how steady it is.

    python tests/benchmarks/clips.py CASES -o RESULTS [--known] [--alone] [--cold] [--json FILE]

CASES holds a folder a case: clip.mp4, truth.mp4, motion.csv, case.json. With --known the motion of motion.csv is given. With
--alone frames are restored without their neighbours' help: with --known, too, that is the bound of what a frame's own blur has
left. With --cold every frame is restored blindly, as a still. RESULTS gets NAME.mp4, its sidecar and its log; FILE the figures,
for tests/benchmarks/moved.py.
"""

import argparse
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import published
from cases import cases_of, facts_of, luma
from installed import RSVIDEO

from rsvideo.physics.camera import Intrinsics, turned
from rsvideo.physics.trajectory import path_error
from rsvideo.report.metrics import BORDER, psnr

COLUMNS = ("blurred_db", "restored_db", "gain_db", "least_gain_db", "path_error_px", "seconds")  # as docs/results.json has them


def unsteadiness(frames: Sequence[np.ndarray], poses: np.ndarray, camera: Intrinsics) -> float:
    """RMS difference of neighbouring frames after their true motion is undone, in dB below white."""
    x, y = np.meshgrid(np.arange(camera.cols, dtype=float), np.arange(camera.rows, dtype=float))
    squares = []
    for k in range(len(frames) - 1):
        at = turned(camera, x, y, np.broadcast_to(poses[k] - poses[k + 1], (camera.rows, camera.cols, 3)))
        later = cv2.remap(frames[k + 1], (x + at[..., 0]).astype(np.float32), (y + at[..., 1]).astype(np.float32), cv2.INTER_LANCZOS4)
        squares.append(((later - frames[k][..., 0])[BORDER:-BORDER, BORDER:-BORDER] ** 2).mean())
    return float(10 * np.log10(np.mean(squares)))


def restored(case: Path, output: Path, options: Sequence[str | Path] = ()) -> tuple[list[dict[str, Any]], np.ndarray]:
    """The sidecar's frames, and each frame's PSNR before and after, in dB; ends the program where the command fails."""
    facts = facts_of(case)
    words = [RSVIDEO, "deblur", case / "clip.mp4", "-o", output, "--exposure", facts["exposure_s"], "--readout", facts["readout_s"]]
    words += ["--focal-px", facts["focal_px"], "--overwrite", "--json", *options]
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=7200)
    if done.returncode:
        sys.exit(f"{case.name}: {done.stderr}")
    truth, before, after = (luma(path) for path in (case / "truth.mp4", case / "clip.mp4", output))
    if not len(truth) == len(before) == len(after):
        sys.exit(f"{case.name}: {len(truth)} true, {len(before)} blurred and {len(after)} restored frames")
    return json.loads(done.stdout)["frames"], np.array([(psnr(b, s), psnr(a, s)) for b, a, s in zip(before, after, truth, strict=True)])


def main() -> None:
    """Run, and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    for flag in ("--known", "--alone", "--cold"):
        parser.add_argument(flag, action="store_true")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    frames = "alone" if args.alone else "cold" if args.cold else "together"
    rows, steadiness, gains = [], [], []
    columns = ("blurred dB", "restored dB", "gain dB", "least gain of a frame dB", "path error px", "seconds a frame")
    print(f"| clip | {' | '.join(columns)} | unsteadiness dB: truth, blurred, restored |")
    print("|---|---|---|---|---|---|---|---|")
    for case in cases_of(args.cases):
        facts = facts_of(case)
        output = args.output / f"{case.name}.mp4"
        given = ["--trajectory", case / "motion.csv"] if args.known else []
        records, values = restored(case, output, [*given, "--frames", frames])
        t, pitch, yaw, roll = np.loadtxt(case / "motion.csv", delimiter=",", skiprows=1).T
        focal = facts["focal_px"]
        path = np.stack([focal * yaw, -focal * pitch, roll], axis=1)

        def pose(at: np.ndarray, t: np.ndarray = t, path: np.ndarray = path) -> np.ndarray:
            return np.stack([np.interp(at, t, column) for column in path.T], axis=1)

        errors = [
            path_error(
                np.stack([r["trajectory"]["x_px"], r["trajectory"]["y_px"]], axis=1),
                pose(r["time_s"] + np.array(r["trajectory"]["t_s"]))[:, :2],
            )
            for r in records
        ]
        camera = Intrinsics.centred(focal=focal, rows=facts["rows"], cols=facts["cols"])
        middles = pose(np.array([r["time_s"] for r in records]) + 0.5 * (facts["readout_s"] + facts["exposure_s"]))
        steady = [unsteadiness(frames, middles, camera) for frames in map(luma, (case / "truth.mp4", case / "clip.mp4", output))]
        gain = values[:, 1] - values[:, 0]
        seconds = np.mean([r["seconds"] for r in records])
        print(
            f"| {case.name} | {values[:, 0].mean():.2f} | {values[:, 1].mean():.2f} | {gain.mean():.2f} | {gain.min():.2f} |"
            f" {np.median(errors):.2f} | {seconds:.1f} | {', '.join(f'{value:.1f}' for value in steady)} |",
            flush=True,
        )
        figures = [*values.mean(axis=0), gain.mean(), gain.min(), np.median(errors), seconds]
        rows.append({"clip": case.name} | dict(zip(COLUMNS, map(float, figures), strict=True)))
        steadiness.append({"clip": case.name} | dict(zip(("truth_db", "blurred_db", "restored_db"), steady, strict=True)))
        gains.append({"clip": case.name, f"{'known' if args.known else 'found'}_{frames}_gain_db": float(gain.mean())})
    if args.json:
        sections = {"clip_ways": gains} if args.known else {"clips": rows, "steadiness": steadiness, "clip_ways": gains}
        published.write(args.json, sections, [flag for flag in ("--alone", "--cold") if vars(args)[flag[2:]]])


if __name__ == "__main__":
    main()
