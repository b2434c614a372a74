"""How exactly frames of one scene show each other's streaks.

    python tests/benchmarks/streaks.py CASES [-o RESULTS] [--every 1]

CASES holds a folder a case, as for tests/benchmarks/footage.py; every Nth is taken. Each frame's streak is found by
`restoration.relative_blur` from its neighbours, and again from the frame and its truth alone, which is not blurred; streaks of more than
LONG px are compared. Points are followed as ever; the camera's focal length is what is usual. With RESULTS, the clips are restored, too,
with nothing given: along the streaks that the command finds, and along those of frame and truth as if these were exact, which is as much as
straight streaks of even pace can gain.
"""

import argparse
from pathlib import Path
from unittest.mock import patch

import footage
import numpy as np
import published
from cases import cases_of, facts_of, luma

from rsvideo.frame import Frame
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.tone import Transfer, decode
from rsvideo.restoration import stabilised
from rsvideo.restoration.clip_motion import Run, gather
from rsvideo.restoration.relative_blur import Streaks, streaks
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
    true = against(truth, run).pose[:, :2]
    return np.where((found * true).sum(axis=1) < 0, -1, 1)[:, None] * found, true


def against(truth: list[np.ndarray], run: Run) -> Streaks:
    """The streaks that frames of a run show against their truth, as if they were exact."""
    pairs = [[frame.pixels[..., 0], truth[frame.index][..., 0]] for frame in run.small]
    found = [streaks(pair, lambda _k, _j, places: np.zeros(places.shape), [0, 0], run.camera, run.axes) for pair in pairs]
    pose, change = (np.array([getattr(each, name)[0] for each in found]) for name in ("pose", "change"))
    return Streaks(pose=pose, change=change, variance=np.zeros(len(pairs)), probability=np.ones(len(pairs)))


def gained(case: Path, results: Path) -> list[dict]:
    """What frames of a case gain along streaks that are found, and along those of its truth."""
    truth, rows = light(case / "truth.mp4"), []
    for name, way in (("found", stabilised.streaks_of), ("of frame and truth", lambda run: against(truth, run))):
        with patch.object(stabilised, "streaks_of", way):
            rows += [{"streaks": name} | row for row, _ in footage.rows_of(case, ["none"], results)]
    return rows


def main() -> None:
    """Compare, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("-o", "--output", type=Path)
    parser.add_argument("--every", type=int, default=1)
    args = parser.parse_args()
    cases = cases_of(args.cases)[:: args.every]
    both = [streaks_of(case) for case in cases]
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
    if args.output:
        args.output.mkdir(parents=True, exist_ok=True)
        rows = [row for case in cases for row in gained(case, args.output)]
        named = {name: [row for row in rows if row["streaks"] == name] for name in ("found", "of frame and truth")}
        published.print_rows([{"streaks": name} | footage.summary(some, ["none"])[0] for name, some in named.items()])


if __name__ == "__main__":
    main()
