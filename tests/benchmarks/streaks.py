"""How exactly frames of one scene show each other's streaks.

    python tests/benchmarks/streaks.py CASES

CASES holds a folder a case, as for tests/benchmarks/footage.py. Each frame's streak is found by `restoration.relative_blur` from its
neighbours, and again from the frame and its truth alone, which is not blurred; streaks of more than LONG px are compared. Points are
followed as ever; the camera's focal length is what is usual.
"""

import argparse
from pathlib import Path

import numpy as np
import published
from cases import cases_of, facts_of, luma

from rsvideo.frame import Frame
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.tone import Transfer, decode
from rsvideo.restoration import stabilised
from rsvideo.restoration.clip_motion import gather
from rsvideo.restoration.relative_blur import streaks
from rsvideo.restoration.settings import Settings
from rsvideo.shooting import usual

LONG = 3.0  # px


def light(path: Path) -> list[np.ndarray]:
    """A clip's frames in grey, by the luma of video levels."""
    return [decode(Transfer.BT709, np.clip((frame * 255 - 16) / 219, 0, 1).astype(np.float32)) for frame in luma(path)]


def streaks_of(case: Path) -> tuple[np.ndarray, np.ndarray]:
    """The streak of each frame in its middle, px, from its neighbours and from its truth; of the same sense."""
    frames, truth = light(case / "clip.mp4"), light(case / "truth.mp4")
    (rows, cols), fps = frames[0].shape[:2], facts_of(case)["fps"]
    timing = ShutterTiming.from_readout(exposure=usual.MILD / fps, readout=0.0, rows=rows)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=usual.FOCAL * cols, rows=rows, cols=cols))
    clipped = np.zeros(frames[0].shape, bool)
    run = gather([Frame(pixels=f, clipped=clipped, index=k, time=k / fps) for k, f in enumerate(frames)], camera, Settings())
    found = stabilised.streaks_of(run).pose[:, :2]
    true = np.array(
        [streaks([a[..., 0], b[..., 0]], _at_rest, [0, 0], run.camera, 3).pose[0, :2] for a, b in zip(frames, truth, strict=True)]
    )
    return np.where((found * true).sum(axis=1) < 0, -1, 1)[:, None] * found, true


def _at_rest(_k: int, _j: int, places: np.ndarray) -> np.ndarray:
    return np.zeros(places.shape)


def main() -> None:
    """Compare, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    args = parser.parse_args()
    both = [streaks_of(case) for case in cases_of(args.cases)]
    found, true = (np.concatenate(each) for each in zip(*both, strict=True))
    length = np.linalg.norm(true, axis=1)
    error, long = np.linalg.norm(found - true, axis=1), length > LONG
    published.print_rows(
        [
            {
                "clips": len(both),
                "frames": len(length),
                f"with more than {LONG:g} px": int(long.sum()),
                "median error, px": float(np.median(error[long])),
                "median length, of the true one": float(np.median(np.linalg.norm(found, axis=1)[long] / length[long])),
            }
        ]
    )


if __name__ == "__main__":
    main()
