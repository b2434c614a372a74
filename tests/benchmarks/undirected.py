"""What is kept of a frame's gain where its motion is given but for its direction: deblurred, and not straightened.

    python tests/benchmarks/undirected.py CASES -o FILE.json [--jobs 2]

CASES holds a folder a case, as `corpus.py --keep CASES` writes them. Each is restored along its true motion, and along the mirror image
of that, with plain total variation, and once more with its scanlines where the shutter read them. FILE gets, for each: dB gained along
the motion and along its mirror image, dB gained without straightening, and the dB of rsvideo.restoration.undirected, which are measured
without the truth, for the less promising of both directions.
"""

import argparse
import json
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from cases import cases_of
from corpus import opened

from rsvideo.restoration import single_frame, undirected
from rsvideo.restoration.scanlines import path_along_scanlines
from rsvideo.restoration.settings import Settings
from rsvideo.restoration.spectral_paths import mirrored

PLAIN = Settings(prior="tv")


def measured(case: Path) -> dict:
    """The figures of one case."""
    still = opened(case)
    path = path_along_scanlines(still.motion, still.view.direction)
    latents = [single_frame.restored(still.view, PLAIN, path=each).latent for each in (path, mirrored(path))]
    read = [undirected.read(still.view, each, latent) for each, latent in zip((path, mirrored(path)), latents, strict=True)]
    return {
        "case": case.name,
        "gain_db": still.gain(latents[0]),
        "mirror_db": still.gain(latents[1]),
        "not_straightened_db": still.gain(read[0].latent),
        "promised_db": min(each.gain for each in read),
    }


def main() -> None:
    """Measure, and write FILE."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    os.environ |= {"OMP_NUM_THREADS": "1", "RSVIDEO_THREADS": "1"} if args.jobs > 1 else {}
    cases = cases_of(args.cases)
    with ProcessPoolExecutor(args.jobs, mp_context=get_context("spawn")) as pool:
        rows = list(pool.map(measured, cases))
    args.output.write_text(json.dumps(rows, indent=1) + "\n")
    for name, some in (
        ("promised", [r for r in rows if r["promised_db"] >= undirected.WORTH]),
        ("not promised", [r for r in rows if r["promised_db"] < undirected.WORTH]),
    ):
        gains = [r["not_straightened_db"] for r in some]
        if gains:
            print(f"{name}: {len(some)} stills, not straightened {np.min(gains):.2f} to {np.max(gains):.2f} dB, mean {np.mean(gains):.2f}")


if __name__ == "__main__":
    main()
