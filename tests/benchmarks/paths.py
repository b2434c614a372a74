"""Estimate the camera's path through clips of known motion, and print by how far it displaces scanlines wrongly.

    python tests/benchmarks/paths.py CASES [--set ROOM.NUMBER=VALUE ...] [--json FILE]

CASES holds a folder a clip, as `layers.py --flat` makes it. The error is that of the places of five columns of all scanlines, against the
pose at the middle of the frame's interval, px RMS; of each clip: along the path of its points as Lucas-Kanade finds them first, as they
are found in matched blur, as the path becomes by its blur, and as the frames together correct it. --set tries other numbers of
rsvideo.restoration than the present ones.
"""

import argparse
from pathlib import Path

import footage
import numpy as np
import published
from cases import facts_of
from wobble import decoded

from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Spline
from rsvideo.restoration.camera_path import within
from rsvideo.restoration.clip_motion import Run, gather, in_matched_blur, path_from_tracks, refined_by_blur, refined_by_neighbours
from rsvideo.restoration.rectification import scanline_poses
from rsvideo.restoration.settings import Settings
from rsvideo.shooting import usual

COLUMNS, INSTANTS = 5, 48


def errors(run: Run, path: Spline, motion: np.ndarray) -> np.ndarray:
    """Px RMS over each frame."""
    timing, lens = run.camera.timing, run.camera.intrinsics
    y, x = (np.linspace(0, side - 1, n) - (side - 1) / 2 for side, n in ((lens.rows, lens.rows), (lens.cols, COLUMNS)))
    found = []
    for begins in run.begins:
        times = begins + timing.sample_times(INSTANTS), begins + np.array([timing.middle])
        true, middle = (np.stack([np.interp(t, motion[:, 0], each) for each in motion[:, 1:].T], axis=-1) for t in times)
        apart = scanline_poses(within(path, begins, timing), run.camera) - (true.mean(axis=1) - middle)
        right, down, roll = apart.T[..., None]
        found.append(np.sqrt(((right - roll * y[:, None]) ** 2 + (down + roll * x) ** 2).mean()))
    return np.array(found)


def row_of(case: Path) -> dict:
    """The figures of a clip."""
    facts = facts_of(case)
    motion = np.loadtxt(case / "motion.csv", delimiter=",", skiprows=1)
    lens = Intrinsics.centred(focal=usual.FOCAL * max(facts["rows"], facts["cols"]), rows=facts["rows"], cols=facts["cols"])
    timing = ShutterTiming.from_readout(exposure=facts["exposure_s"], readout=facts["readout_s"], rows=facts["rows"])
    run = gather(decoded(case / "clip.mp4"), Camera(timing=timing, intrinsics=lens), Settings())
    matched = in_matched_blur(run)
    tracked = path_from_tracks(matched)
    by_blur = refined_by_blur(matched, tracked, matched.followed)
    paths = path_from_tracks(run), tracked, by_blur, refined_by_neighbours(matched, by_blur)
    first, again, blur, together = (errors(run, path.spline, motion) for path in paths)
    row = {"clip": case.name, "blur_px": facts["blur_extent_px"], "frames": len(first)}
    for name, each in (("points", first), ("matched_blur", again), ("blur", blur), ("neighbours", together)):
        row[name] = float(np.sqrt((each**2).mean()))
    print("| " + " | ".join(f"{v:.3f}" if isinstance(v, float) else str(v) for v in row.values()) + " |", flush=True)
    return row


def main() -> None:
    """Run, and print Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("--set", nargs="+", default=[], metavar="ROOM.NUMBER=VALUE")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    footage.try_numbers(args.set)
    rows = [row_of(f.parent) for f in sorted(args.cases.glob("*/motion.csv"))]
    summary = {"clips": len(rows), "frames": sum(row["frames"] for row in rows)}
    for name in ("points", "matched_blur", "blur", "neighbours"):
        each = np.array([row[name] for row in rows])
        summary |= {f"{name}_px": float(np.sqrt((each**2).mean())), f"{name}_middle_px": float(np.median(each))}
    print()
    published.print_rows([summary])
    if args.json:
        published.write(args.json, {"paths": rows, "paths_summary": [summary]}, [])


if __name__ == "__main__":
    main()
