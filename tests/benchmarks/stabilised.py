"""Stabilise cases as a phone or an editor does, with their truth, as cases for tests/benchmarks/footage.py.

    python tests/benchmarks/stabilised.py CASES -o STABILISED [--strength 1] [--rows bent|straight] [--quality 18]

CASES holds a folder a case, as for footage.py. Each truth's frames are brought to one straight path, by the shift, turn and zoom that the
points of the truth show from frame to frame: all of the way, or by a share of it. The clip's frames get the same, and both are enlarged
by 1.12 and encoded anew by H.264. Their blur stays what the camera's own motion has left, and no longer is that of the path. With rows
that are `straight` the clip is first rectified, with its own exposure and readout, as phones do by their gyroscope; else its scanlines
stay displaced by motion that the path no longer shows, and those of the truth are displaced alike, for nobody can put them straight: it
says what deblurring is worth. case.json is copied as it is: what it says of exposure and readout holds before.
"""

import argparse
import shutil
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
from cases import cases_of, encoded_anew, facts_of
from footage import request_of

from rsvideo.config.method import Method
from rsvideo.pipeline import deblur
from rsvideo.pipeline.prepare import Task, prepare
from rsvideo.progress import ignore
from rsvideo.restoration.rectification import displaced
from rsvideo.restoration.resolution import halved_path
from rsvideo.shooting import given_motion
from rsvideo.video.decode import pictures, probe

ZOOM = 1.12  # by which frames are enlarged, so that their borders are hidden
CORNERS, QUALITY, APART = 400, 0.01, 8  # points at most, the least corner of the best one, and px between them
WINDOW, LEVELS, AGREED = (31, 31), 4, 0.5  # px, of the pyramid, and px by which a point that is followed there and back may miss
INLIER = 1.5  # px

Change = Callable[[int, Sequence[np.ndarray]], Sequence[np.ndarray]]
"""The planes that are made of a picture's number and its planes."""


def poses(frames: Sequence[np.ndarray]) -> np.ndarray:
    """The shift in px, the turn in rad and the logarithm of the zoom of each frame against the first, frames x 4."""
    at, out = np.eye(3), [np.zeros(4)]
    for before, after in pairwise(frames):
        points = cv2.goodFeaturesToTrack(before, CORNERS, QUALITY, APART)
        there, _, _ = cv2.calcOpticalFlowPyrLK(before, after, points, points.copy(), winSize=WINDOW, maxLevel=LEVELS)
        back, _, _ = cv2.calcOpticalFlowPyrLK(after, before, there, there.copy(), winSize=WINDOW, maxLevel=LEVELS)
        good = np.linalg.norm((back - points)[:, 0], axis=1) < AGREED
        step, _ = cv2.estimateAffinePartial2D(points[good], there[good], ransacReprojThreshold=INLIER)
        at = np.vstack([step, [0, 0, 1]]) @ at
        out.append(np.array([at[0, 2], at[1, 2], np.arctan2(at[1, 0], at[0, 0]), np.log(np.hypot(at[0, 0], at[1, 0]))]))
    return np.array(out)


def similarity(pose: np.ndarray) -> np.ndarray:
    """The matrix of a pose."""
    c, s = np.exp(pose[3]) * np.cos(pose[2]), np.exp(pose[3]) * np.sin(pose[2])
    return np.array([[c, -s, pose[0]], [s, c, pose[1]], [0, 0, 1]])


def corrections(truth: Path, strength: float) -> list[np.ndarray]:
    """Where each stabilised frame shows the pixels of the frame: matrices from the former to the latter."""
    frames = [picture.planes[0].copy() for picture in pictures(probe(truth))]
    shown, k = poses(frames), np.arange(len(frames))
    steady = np.stack([np.polyval(np.polyfit(k, each, 1), k) for each in shown.T], axis=1)
    rows, cols = frames[0].shape
    middle = np.array([[1, 0, cols / 2], [0, 1, rows / 2], [0, 0, 1]])
    enlarged = middle @ np.diag([1 / ZOOM, 1 / ZOOM, 1]) @ np.linalg.inv(middle)
    wanted = shown + strength * (steady - shown)
    return [similarity(pose) @ np.linalg.inv(similarity(new)) @ enlarged for pose, new in zip(shown, wanted, strict=True)]


def warped(found: Sequence[np.ndarray], change: Change, k: int, planes: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The planes of stabilised frame k, `change` being what is done to its rows before."""
    out = []
    for plane in change(k, planes):
        size = np.diag([plane.shape[1] / planes[0].shape[1], plane.shape[0] / planes[0].shape[0], 1])
        matrix, how = size @ found[k] @ np.linalg.inv(size), cv2.INTER_LANCZOS4 | cv2.WARP_INVERSE_MAP
        out.append(cv2.warpPerspective(plane, matrix, plane.shape[::-1], flags=how, borderMode=cv2.BORDER_REPLICATE))
    return out


def rectified(case: Path, output: Path) -> Task:
    """How the clip's rows were put straight, in `output`, by its own exposure and readout."""
    request = request_of(case, "stated", facts_of(case), output).replaced(deblur={"method": Method.RECTIFY})
    _ = deblur.carry_out(task := prepare(request), ignore)
    return task


def bent(task: Task) -> Change:
    """What makes of a frame's straight rows those of the clip."""
    begins = [(picture.index, picture.time) for picture in pictures(task.stream)]
    within, _ = given_motion.of_clip(task.request.record, task.treatment.camera, begins)

    def planes_of(k: int, planes: Sequence[np.ndarray]) -> list[np.ndarray]:
        out = []
        for plane in planes:
            camera, path = task.treatment.camera, within[k]
            if plane.shape[0] < camera.timing.rows:
                camera, path = camera.halved(), halved_path(path)
            out.append(np.rint(255 * displaced(path, camera)(plane.astype(np.float32) / 255)).astype(np.uint8))
        return out

    return planes_of


def same(_k: int, planes: Sequence[np.ndarray]) -> Sequence[np.ndarray]:
    """The planes as they are."""
    return planes


def main() -> None:
    """Stabilise all cases."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--strength", type=float, default=1.0)
    parser.add_argument("--rows", choices=("bent", "straight"), default="bent")
    parser.add_argument("--quality", type=int, default=18)
    args = parser.parse_args()
    for case in cases_of(args.cases):
        out = args.output / case.name
        out.mkdir(parents=True, exist_ok=True)
        shutil.copy(case / "case.json", out)
        found = corrections(case / "truth.mp4", args.strength)
        task = rectified(case, out / "straight.mkv")
        if args.rows == "straight":
            sources = {"clip.mp4": (task.request.output, same), "truth.mp4": (case / "truth.mp4", same)}
        else:
            sources = {"clip.mp4": (case / "clip.mp4", same), "truth.mp4": (case / "truth.mp4", bent(task))}
        for name, (source, change) in sources.items():
            encoded_anew(source, out / name, partial(warped, found, change), {"crf": str(args.quality)})


if __name__ == "__main__":
    main()
