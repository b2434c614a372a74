"""Draw captions, logos, bars or insets over clips, restore them, and print what became of the scene and of the graphics.

    python tests/benchmarks/graphics.py CASES -o RESULTS [--over nothing|caption|bars|inset ...] [--exposure stated|none ...]
        [--quality 18] [--find] [--only NAME ...] [--set ROOM.NUMBER=VALUE ...] [--json FILE]

CASES holds a folder a case, as for tests/benchmarks/footage.py. Over each picture of clip.mp4 and of truth.mp4 come a time stamp whose
seconds run, and a logo in a box, or black bars of a tenth of the height, or the picture itself, mirrored, a quarter as large and in a white
border. Both are encoded anew, by H.264 at this rate factor. The gains of frames are those of footage.py, graphics included. Of the
graphics' own pixels, the RMS of codes by which they differ from the clip that is given, in the middle one of all clips. With --find
nothing is restored: what the finder takes for graphics, of their pixels and of all others. --set tries other numbers of
rsvideo.restoration than the present ones: with overlay.FEWEST=1000 nothing is found.
"""

import argparse
import shutil
from collections.abc import Sequence
from pathlib import Path

import cv2
import footage
import numpy as np
import published
from cases import cases_of, encoded_anew, luma

from rsvideo.pipeline import clip_frames
from rsvideo.restoration.overlay import Overlay
from rsvideo.video.decode import pictures, probe

OVER = ("nothing", "caption", "bars", "inset")
FONT, WHITE, RED_LUMA = cv2.FONT_HERSHEY_SIMPLEX, 235, 81
BAR = 0.1  # of the height
INSET, BORDER = 4, 2  # times smaller than the picture; px
SECONDS = 8.6  # of the clock when a clip begins: it changes within a clip of twelve frames


def drawn(luma_codes: np.ndarray, over: str, seconds: float) -> np.ndarray:
    """A picture's luma with graphics over it."""
    out = luma_codes.copy()
    rows, cols = out.shape
    size = rows / 500
    if over == "caption":
        clock = f"2026-11-29 12:00:{int(SECONDS + seconds):02} 48 km/h"
        cv2.putText(out, clock, (cols // 40, rows - rows // 20), FONT, size, WHITE, max(1, round(2 * size)), cv2.LINE_AA)
        box = (cols - cols // 5, rows // 25), (cols - cols // 30, rows // 25 + rows // 8)
        cv2.rectangle(out, *box, WHITE, -1)
        cv2.putText(out, "NEWS", (box[0][0] + cols // 60, box[1][1] - rows // 30), FONT, 1.6 * size, RED_LUMA, 2, cv2.LINE_AA)
    elif over == "bars":
        out[: round(BAR * rows)] = out[rows - round(BAR * rows) :] = 16
    elif over == "inset":
        inset = cv2.resize(out[:, ::-1], (cols // INSET, rows // INSET), interpolation=cv2.INTER_AREA)
        bordered = cv2.copyMakeBorder(inset, BORDER, BORDER, BORDER, BORDER, cv2.BORDER_CONSTANT, value=WHITE)
        y, x = rows - rows // 20 - len(bordered), cols - cols // 30 - bordered.shape[1]
        out[y : y + len(bordered), x : x + bordered.shape[1]] = bordered
    return out


def draw(source: Path, output: Path, over: str, quality: int) -> None:
    """The clip with graphics over it."""
    rate = float(probe(source).rate)

    def with_graphics(k: int, planes: Sequence[np.ndarray]) -> list[np.ndarray]:
        shown = [drawn(planes[0], over, k / rate), *planes[1:]]
        for c in (1, 2):
            small = cv2.resize((shown[0] != planes[0]).astype(np.uint8), planes[c].shape[::-1], interpolation=cv2.INTER_AREA)
            shown[c] = np.where(small > 0, 128, planes[c]).astype(np.uint8)
        return shown

    encoded_anew(source, output, with_graphics, {"crf": str(quality)})


def graphics_of(case: Path, over: str) -> np.ndarray:
    """Which pixels of each picture of a case are graphics."""
    stream = probe(case / "clip.mp4")
    shape = stream.rows, stream.cols
    ramps = np.linspace(40, 100, shape[1])[None, :], np.linspace(140, 200, shape[0])[:, None]  # no inset of both is like both
    grounds = [np.broadcast_to(ramp, shape).astype(np.uint8) for ramp in ramps]
    shown = [[drawn(ground, over, k / float(stream.rate)) != ground for ground in grounds] for k in range(stream.frames)]
    return np.array([first | second for first, second in shown])


def found(case: Path, over: str) -> dict:
    """How much of the graphics, and of all else, is taken for graphics."""
    stream, true = probe(case / "clip.mp4"), graphics_of(case, over).any(axis=0)
    overlay = Overlay.of(clip_frames.frame(stream.colour, picture) for picture in pictures(stream))
    covered = np.zeros(true.shape, bool) if overlay is None else overlay.covered
    return {
        "over": over,
        "clip": case.name,
        "found_share": float(covered[true].mean()) if true.any() else None,
        "scene_share": float(covered[~true].mean()),
    }


def differs(case: Path, over: str, way: str, folder: Path) -> float:
    """RMS of the codes of graphics, between the clip and what became of it."""
    mask = graphics_of(case, over)
    before, after = (np.array(luma(path))[..., 0] for path in (case / "clip.mp4", folder / f"{case.name}.{way}.mkv"))
    return 255 * float(np.sqrt(np.mean((after - before)[mask] ** 2)))


def restored(cases: list[Path], over: str, ways: list[str], folder: Path) -> list[dict]:
    """The figures of all cases together, way by way."""
    rows = [row for case in cases for row, _ in footage.rows_of(case, ways, folder)]
    out = []
    for each in footage.summary(rows, ways):
        apart = None if over == "nothing" else float(np.median([differs(case, over, each["exposure"], folder) for case in cases]))
        out.append({"over": over, **{name: each[name] for name in COLUMNS}, "graphics_differ": apart})
    return out


COLUMNS = ("exposure", "clips", "frames", "blurred", "blurred_gain_db", "harmed_share", "harmed_much", "least_gain_db", "sides_gain_db")


def main() -> None:
    """Run, and print Markdown tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--over", nargs="+", choices=OVER, default=list(OVER))
    parser.add_argument("--exposure", nargs="+", default=["stated", "none"], metavar="WAY")
    parser.add_argument("--quality", type=int, default=18)
    parser.add_argument("--find", action="store_true")
    parser.add_argument("--only", nargs="+", metavar="NAME")
    parser.add_argument("--set", nargs="+", default=[], metavar="ROOM.NUMBER=VALUE")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    cases = cases_of(args.cases, args.only)
    footage.try_numbers(args.set)
    rows: list[dict] = []
    for over in args.over:
        made = [args.output / over / case.name for case in cases]
        for case, copy in zip(cases, made, strict=True):
            copy.mkdir(parents=True, exist_ok=True)
            shutil.copy(case / "case.json", copy)
            for name in ("clip.mp4", "truth.mp4"):
                draw(case / name, copy / name, over, args.quality)
        if args.find:
            rows += [found(case, over) for case in made]
        else:
            rows += restored(made, over, args.exposure, args.output / over)
    print()
    published.print_rows(rows)
    if args.find:
        published.print_rows(rows := [found_together(rows, over) for over in args.over])
    if args.json:
        published.write(args.json, {"graphics_found" if args.find else "graphics": rows}, [])


def found_together(rows: list[dict], over: str) -> dict:
    """The mean of all clips, and how many have any of their scene covered."""
    some = [row for row in rows if row["over"] == over]
    shares = [row["found_share"] for row in some if row["found_share"] is not None]
    return {
        "over": over,
        "clips": len(some),
        "found_share": float(np.mean(shares)) if shares else None,
        "least_found_share": float(np.min(shares)) if shares else None,
        "scene_share": float(np.mean([row["scene_share"] for row in some])),
        "most_scene_share": float(np.max([row["scene_share"] for row in some])),
    }


if __name__ == "__main__":
    main()
