"""Restore what a strongly distorting camera recorded, with the distortion in its profile and without, and print what that gains.

    python tests/benchmarks/distortion.py -o RESULTS [--photos FOLDER] [--only WORD] [--prior tv ...]

Frames are rendered by `rsvideo simulate --camera` from the samples' sharp pictures, and from a few photographs of FOLDER if it is
there, through two wide lenses, with hand-shake and roll. Each is restored with its true motion and blind, by a profile with the
lens's distortion and by the same one without. All other options are those of `rsvideo deblur`.
"""

import argparse
import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from installed import RSVIDEO

from rsvideo.report.metrics import psnr

SAMPLES = Path(__file__).resolve().parents[2] / "samples"
ROWS, COLS = 320, 480  # of the profile's mode; a frame is as large as its photograph and the motion leave room for, in this shape
LENSES = {  # focal length as a part of the columns, model, coefficients
    "wide": (0.62, "brown-conrady", (-0.25, 0.08, 0.0008, -0.0005, -0.008)),  # 102 degrees across the diagonal
    "fisheye": (0.45, "fisheye", (0.02, -0.01, 0.0, 0.0)),  # 150 degrees
}
PHOTOS = {
    "alley": "disco_Capucijnengang_by_Artem_Kavalerov.jpg",
    "town": "saucy_The_City_of_Polen_by_MilanVankovski.jpg",
    "shoes": "karmic_Shoes.jpg",
}
MOTIONS = (  # vigorous turns with roll; blind methods cannot begin from a roll alone
    "x:0,9,-14,4;y:0,-12,9;roll:0,0.03,-0.01",
    "x:0,-16,5;y:0,8,6,-5;roll:0,-0.02,0.015",
    "x:0,6,10,-9;y:0,14,-6;roll:0,0.015,0.01",
)
BLUR_PX, EXPOSURE, READOUT = 12, "1/50", "20ms"
WIDTH = 500  # px, to which photographs are made smaller
RUNS = [(known, bent) for known in (True, False) for bent in (False, True)]


@dataclass(frozen=True, kw_only=True)
class Case:
    """A photograph behind a lens."""

    name: str
    photograph: Path
    lens: str
    motion: str


def main() -> None:
    """Run, and print a Markdown table with the mean gains."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--photos", type=Path, default=SAMPLES.parent.parent / "shared" / "photos")
    parser.add_argument("--only", default="", help="cases whose name holds this")
    args, options = parser.parse_known_args()
    args.output.mkdir(parents=True, exist_ok=True)
    chosen = [case for case in cases(args.photos, args.output) if args.only in case.name]
    print(
        "| case | blurred dB | known motion, ignoring the lens | with it | blind, ignoring the lens | with it |\n|---|---|---|---|---|---|"
    )
    table = []
    for case in chosen:
        table.append(measured(case, args.output / case.name, options))
        print(f"| {case.name} | " + " | ".join(f"{value:.2f}" for value in table[-1]) + " |", flush=True)
    known, blind = (np.array(table)[:, k + 1] - np.array(table)[:, k] for k in (1, 3))
    print(f"\nmean gain of the lens: {known.mean():.2f} dB with known motion, {blind.mean():.2f} dB blind")


def cases(photos: Path, results: Path) -> list[Case]:
    """Every picture behind one lens or the other, in turn."""
    pictures = [SAMPLES / name / "truth.png" for name in ("astronaut", "coffee", "photographer")]
    for name, file in PHOTOS.items():
        image = cv2.imread(str(photos / file)) if (photos / file).is_file() else None
        if image is not None:
            pictures.append(results / f"{name}.png")
            size = (WIDTH, round(WIDTH * image.shape[0] / image.shape[1]))
            cv2.imwrite(str(pictures[-1]), cv2.resize(image, size, interpolation=cv2.INTER_AREA))
    names = [path.parent.name if path.name == "truth.png" else path.stem for path in pictures]
    lenses = list(LENSES)
    return [
        Case(name=f"{name}_{lenses[k % 2]}", photograph=path, lens=lenses[k % 2], motion=MOTIONS[k % 3])
        for k, (name, path) in enumerate(zip(names, pictures, strict=True))
    ]


def measured(case: Case, folder: Path, options: list[str]) -> list[float]:
    """PSNR of the blurred frame, and of what each of RUNS makes of it."""
    folder.mkdir(exist_ok=True)
    for bent in (False, True):
        (folder / f"{bent}.yaml").write_text(profile(case.lens, bent=bent))
    source, truth = folder / "blurred.png", folder / "truth.png"
    run("simulate", case.photograph, "-o", source, "--camera", folder / "True.yaml", "--exposure", EXPOSURE, "--polynomial", case.motion,
        "--blur-px", BLUR_PX, "--overwrite")  # fmt: skip
    found = [psnr(codes(source), codes(truth))]
    for known, bent in RUNS:
        output = folder / f"{'known' if known else 'blind'}_{'with' if bent else 'without'}.png"
        motion = ["--trajectory", folder / "motion.csv"] if known else []
        run("deblur", source, "-o", output, "--camera", folder / f"{bent}.yaml", "--exposure", EXPOSURE, *motion, *options, "--overwrite")
        assert ("distortion" in json.loads(output.with_suffix(".rsvideo.json").read_text())["settings"]["camera"]) == bent
        found.append(psnr(codes(output), codes(truth)))
    return found


def profile(lens: str, *, bent: bool) -> str:
    """The camera's file, with its distortion or without."""
    part, model, coefficients = LENSES[lens]
    distortion = f", distortion: {{model: {model}, coefficients: {list(coefficients)}}}" if bent else ""
    middle = f"cx: {(COLS - 1) / 2}, cy: {(ROWS - 1) / 2}"
    return (
        f"name: {lens}\nmode: {{rows: {ROWS}, cols: {COLS}}}\ntiming: {{readout_s: {float(READOUT[:-2]) / 1000}}}\n"
        f"intrinsics: {{fx: {part * COLS}, fy: {part * COLS}, {middle}{distortion}}}\n"
    )


def run(verb: str, *words: object) -> None:
    """The installed command; what fails stops the benchmark."""
    done = subprocess.run([RSVIDEO, verb, *map(str, words)], capture_output=True, text=True, timeout=1800)
    if done.returncode:
        sys.exit(done.stderr)


def codes(path: Path) -> np.ndarray:
    """A picture's code values in [0, 1]."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return np.atleast_3d(image).astype(np.float32) / (65535 if image.dtype == np.uint16 else 255)


if __name__ == "__main__":
    main()
