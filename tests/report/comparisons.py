"""A small comparison with everything that a report shows: `from tests.report.comparisons import comparison`."""

from collections.abc import Mapping
from dataclasses import replace

import cv2
import numpy as np

from rsvideo.config.sidecar import Sidecar
from rsvideo.report.comparison import Comparison, Crop, Entry, FrameMeasures, KeyFrame
from tests.report.test_plots import sidecar

ROWS, COLS, FRAMES = 300, 400, 3
HOSTILE = "</script><img src=x onerror=alert(1)>\u202egpj.mp4"


def webp(value: int) -> bytes:
    picture = np.full((ROWS, COLS, 3), value, np.uint8)
    picture[:, :: 1 + value // 40] = 255 - value
    return cv2.imencode(".webp", picture)[1].tobytes()


def entry(name: str, values: Mapping[str, list[float]], **said) -> Entry:
    """An entry whose measures are given by frame."""
    frames = tuple(
        FrameMeasures(index=k, time_s=k / 24, verdict="restored", seconds=1.0, values={key: v[k] for key, v in values.items()})
        for k in range(FRAMES)
    )
    return Entry(**{"name": name, "role": "method", "frames": frames, "seconds": 3.0, "peak_bytes": 10**9, **said})


def told() -> Sidecar:
    record = sidecar(roll=0.01)
    return record.model_copy(update={"frames": [record.frames[0].model_copy(update={"index": k}) for k in range(FRAMES)]})


def comparison(**changed) -> Comparison:
    """Three frames: the recording, two methods, one that failed, and the truth."""
    said = told()
    wide = {"ssim": [0.9] * 3, "straightness": [1.0] * 3, "flicker": [0.1] * 3}  # a table with all its columns
    entries = (
        entry("none", {"psnr": [20, 21, 22], "edge_width": [5, 5, 5], "ringing": [0.1] * 3}),
        entry(
            "rsvideo", {"psnr": [30, 31, 32], "edge_width": [2.1] * 3, "ringing": [0.5] * 3, "whiteness": [0.1] * 3, **wide}, sidecar=said
        ),
        entry("uniform", {"psnr": [25, 26, 33], "edge_width": [1.5] * 3, "ringing": [0.4] * 3, **wide}),
        Entry(name="stitch", role="method", fault="<b>no</b> texture", seconds=1.0),
        entry("truth", {"edge_width": [2.0, 2.0, 2.0]}, role="truth"),
    )
    key_frames = tuple(
        KeyFrame(
            index=k,
            time_s=k / 24,
            pictures={name: webp(40 * n + 10 * k) for n, name in enumerate(("none", "rsvideo", "uniform", "truth"))},
            residuals={"rsvideo": webp(128)},
            records={"rsvideo": said.frames[k]},
            thumbnail=webp(200),
        )
        for k in range(FRAMES)
    )
    base = Comparison(
        title="clip.mp4",
        source="/clips/clip.mp4",
        kind="clip",
        rows=ROWS,
        cols=COLS,
        rate=24.0,
        entries=entries,
        key_frames=key_frames,
        first_shown=1,
        crops=(Crop(x=20, y=30, w=96, h=72, chosen=True), Crop(x=200, y=130, w=96, h=72, chosen=False)),
        timing="exposure 20 ms, readout 20 ms top-to-bottom (explicit)",
        truth="/clips/truth.mp4",
        provenance={"rsvideo": "0"},
    )
    return replace(base, **changed)
