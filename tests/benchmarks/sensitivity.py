"""How flat the optimum of each deciding number is: every case of a folder restored with the number halved, as it is, and doubled.

    python tests/benchmarks/sensitivity.py CASES -o FILE.json [--only scene.SEARCH_RIDGE] [--jobs 2] [--every 3] [--crop 352x224]

CASES holds a folder a case. A still has blurred.* and truth.* (PNG or JPEG), case.json and motion.csv; `corpus.py --keep CASES` writes
such. A clip is as `rsvideo simulate --from-clip` makes it, and is restored with its shutter stated. CASES of clips are measured by the
numbers of clips, others by those of stills. --every 3 takes each third of them, --crop the middle of each still. Numbers of the latent
image are measured with the motion given and on the whole frame, so that no search blurs what they do. For each number FILE gets the mean
gain over all frames, and the least change of any frame, with the number halved and doubled, against what it is now. A mean that hardly
changes is a flat optimum; one that rises says that the number was chosen on other cases than these.
"""

import argparse
import contextlib
import io
import json
import os
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Literal

import numpy as np

Motion = Literal["rotation", "shift"]
Crop = tuple[int, int] | None  # rows, cols
NUMBERS = (  # of rsvideo.restoration, that choose a path, judge it, or weigh priors
    "spectrum.SHARPEST",
    "spectrum.LEAK",
    "spectrum.BELIEF",
    "spectrum.FINE_NOISE",
    "spectral_paths.STIFFNESS",
    "spectral_paths.TIE",
    "search.SPECTRA",
    "search.LAST_SPECTRA",
    "search.FINAL_SPECTRA",
    "search.FULL",
    "refinement.SPARSE",
    "search.COARSE_REACH",
    "search.PLAIN",
    "evidence.POWER",
    "evidence.FOCUS_RIDGE",
    "verdict.REST",
    "verdict.MIRROR",
    "verdict.FOCUS",
    "doubtful.PART",
    "doubtful.SHORT",
    "scene.RIDGE",
    "scene.SEARCH_RIDGE",
    "sparsity.WINDOW",
    "sparsity.HALF_WEIGHT",
    "hand_shake.SPREAD",
    "hand_shake.FALL",
    "nonblind.COARSEST_NOISE",
    "nonblind.FINEST_NOISE",
    "nonblind.UNEXPLAINED",
    "nonblind.EXPLAINED",
)
OF_CLIPS = (  # the same, of what clips have besides: paths from points, trust, and neighbours
    "camera_path.STIFFNESS",
    "camera_path.BELIEVED",
    "camera_path.JERK",
    "camera_path.LEAST_REACH",
    "camera_path.END_ERROR",
    "vibration.EVIDENCE",
    "vibration.SPREAD",
    "vibration.STEADY",
    "clip_motion.TRUST",
    "clip_motion.BLURRED",
    "clip_motion.PATH_ERROR",
    "parallax.EXPLAINS",
    "trust.OUT_OF_FOCUS",
    "trust.IN_FOCUS",
    "trust.REGION",
    "trust.FRAME_DOUBT",
    "trust.SURELY",
    "trust.DOUBT",
    "trust.FULL_VOTE",
    "trust.CREDIT_BLUR",
    "trust.CREDIT_REGION",
    "trust.CREDIT_FRAME",
    "predicted_blur.INDEPENDENT",
    "path_from_neighbours.SCATTER",
    "path_from_neighbours.ERROR",
    "path_from_neighbours.SHEAR",
    "fusion.RIDGE",
    "fusion.DOUBT",
    "fusion.FAINTEST",
    "multi_frame.SHARP_ENOUGH",
)
CLIP = "clip.mp4"  # by which a case is one
LATENT = "nonblind."  # the numbers that are measured with the motion given
FACTORS = (0.5, 2.0)


def gains_of(case: Path, motion: Motion, crop: Crop, number: str | None, factor: float, known: bool) -> list[float]:
    """dB by which a still, or each frame of a clip, is nearer to its truth than it was, with `number` times `factor`.

    A still's motion is given if it is `known`.
    """
    if (case / CLIP).exists():
        from footage import rows_of

        with scaled(number, factor), tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
            [(_, gain)] = rows_of(case, ["stated"], Path(folder))
        return gain.tolist()
    return [gain_of_still(case, motion, crop, number, factor, known)]


def gain_of_still(case: Path, motion: Motion, crop: Crop, number: str | None, factor: float, known: bool) -> float:
    """The same of a still."""
    from cases import facts_of

    import rsvideo
    from rsvideo.physics.tone import Transfer, encode
    from rsvideo.report.metrics import psnr

    facts = facts_of(case)
    blurred, truth = (middle(rsvideo.read(next(case.glob(f"{name}.*"))).pixels, None if known else crop) for name in ("blurred", "truth"))
    with scaled(number, factor):
        result = rsvideo.deblur(
            blurred,
            shutter=rsvideo.Shutter(exposure=facts["exposure_s"], readout=facts["row_time_s"] * len(blurred)),
            camera=rsvideo.Camera(focal_px=facts["focal_px"]),
            settings=rsvideo.Settings(motion=motion),
            trajectory=case / "motion.csv" if known else None,
        )
    sharp, before, after = (encode(Transfer.SRGB, light) for light in (truth, blurred, result.light))
    return psnr(after, sharp) - psnr(before, sharp)


def middle(picture: np.ndarray, crop: Crop) -> np.ndarray:
    """The middle rows and columns, about which the lens is centred as it was."""
    rows, cols = picture.shape[:2]
    height, width = (rows, cols) if crop is None else (min(rows, crop[0]), min(cols, crop[1]))
    top, left = (rows - height) // 2, (cols - width) // 2
    return np.ascontiguousarray(picture[top : top + height, left : left + width])


@contextlib.contextmanager
def scaled(number: str | None, factor: float) -> Iterator[None]:
    """Let a number be `factor` times what it is; a width in whole pixels stays odd."""
    if number is None:
        yield
        return
    room, name = number.split(".")
    module = import_module(f"rsvideo.restoration.{room}")
    now = getattr(module, name)
    setattr(module, name, round(now * factor) | 1 if isinstance(now, int) else now * factor)
    try:
        yield
    finally:
        setattr(module, name, now)


def main() -> None:
    """Measure, and write FILE as each number is done."""
    from cases import cases_of

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--only", metavar="ROOM.NAME,...")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--motion", choices=("rotation", "shift"), default="rotation")
    parser.add_argument("--crop", metavar="COLSxROWS")
    parser.add_argument("--every", type=int, default=1)
    request = parser.parse_args()
    cols, rows = map(int, request.crop.split("x")) if request.crop else (0, 0)
    crop = (rows, cols) if request.crop else None
    os.environ |= {"RSVIDEO_THREADS": "1", "OMP_NUM_THREADS": "1"} if request.jobs > 1 else {}
    cases = cases_of(request.cases)[:: request.every]
    numbers = request.only.split(",") if request.only else OF_CLIPS if (cases[0] / CLIP).exists() else NUMBERS
    now: dict[bool, list[float]] = {}
    changes = []
    with ProcessPoolExecutor(request.jobs) as pool:
        measure = partial(gains, pool, cases, request.motion, crop)
        for number in numbers:
            known = number.startswith(LATENT)
            if known not in now:
                now[known] = measure(None, 1.0, known)
            row: dict[str, object] = {"number": number, "gain_db": sum(now[known]) / len(now[known])}
            for factor, word in zip(FACTORS, ("halved", "doubled"), strict=True):
                changed = measure(number, factor, known)
                row |= {
                    f"{word}_db": (sum(changed) - sum(now[known])) / len(changed),
                    f"{word}_least_db": min(a - b for a, b in zip(changed, now[known], strict=True)),
                }
            changes.append(row)
            print(f"{number:28}" + "".join(f"{value:+8.2f}" for value in row.values() if isinstance(value, float)), flush=True)
            request.output.write_text(json.dumps({"cases": len(cases), "rows": changes}, indent=1))


def gains(
    pool: ProcessPoolExecutor, cases: list[Path], motion: Motion, crop: Crop, number: str | None, factor: float, known: bool
) -> list[float]:
    """Of all frames of all cases, in order."""
    of = partial(gains_of, motion=motion, crop=crop, number=number, factor=factor, known=known)
    return [gain for some in pool.map(of, cases) for gain in some]


if __name__ == "__main__":
    main()
