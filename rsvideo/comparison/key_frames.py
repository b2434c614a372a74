"""What a page shows of a comparison: which frames, at which size, and the parts in which they differ most."""

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np

from rsvideo.comparison.decoded import Light, Shot
from rsvideo.config.sidecar import FrameRecord
from rsvideo.report import metrics
from rsvideo.report.comparison import Crop, Look

MOST_LOOKS = 48  # frames that are shown
MOST_SIDE = 1920  # px of a picture on the page
PICTURES_BYTES = 15_000_000  # of a page, before they become text
_BYTES_A_PIXEL = 0.15  # of WebP, roughly
_QUALITY, _WORST_QUALITY = 88, 50
_GAIN = 8  # by which residuals are magnified
_THUMB = 160  # px


def chosen(count: int, entries: int, pixels: float) -> frozenset[int]:
    """Which frames are shown: as many as a page can carry, evenly spread."""
    most = max(1, min(count, MOST_LOOKS, int(PICTURES_BYTES / (1.4 * entries * pixels * _BYTES_A_PIXEL))))
    return frozenset(np.linspace(0, count - 1, most).round().astype(int).tolist()) if most > 1 else frozenset({count // 2})


def scale(rows: int, cols: int) -> float:
    """Of the pictures on the page."""
    return min(1.0, MOST_SIDE / max(rows, cols))


def look(
    index: int,
    time_s: float,
    shots: Mapping[str, Shot],
    records: Mapping[str, FrameRecord],
    residuals: Mapping[str, bytes],
    scale: float,
    most: float,
    pool: ThreadPoolExecutor,
) -> Look:
    """Pictures at the best quality at which they take about `most` bytes."""
    used, quality = sum(map(len, residuals.values())), _QUALITY
    while True:
        pictures = list(pool.map(lambda shot, quality=quality: _webp(shot.shown, scale, quality), shots.values()))
        if used + sum(map(len, pictures)) <= 1.2 * most or quality <= _WORST_QUALITY:
            break
        quality -= 10
    first = next(iter(shots.values())).shown
    return Look(
        index=index,
        time_s=time_s,
        pictures=dict(zip(shots, pictures, strict=True)),
        residuals=residuals,
        records=records,
        thumbnail=_webp(first, _THUMB / max(first.shape[:2]), 70),
    )


def drawn(residual: Light, size: float) -> bytes:
    """Grey where the frame is explained; brighter and darker by eight times what is not."""
    r, valid = residual
    grey = np.clip(np.rint(128 + 255 * _GAIN * np.where(valid, r, 0)), 0, 255).astype(np.uint8)
    return _webp(np.repeat(grey[..., None], 3, axis=2), 0.5 * size, 65)


def difference(pictures: Sequence[np.ndarray]) -> np.ndarray:
    """By how much pictures differ, pixel by pixel."""
    alike = [metrics.luma(picture / np.float32(255)) for picture in pictures if picture.shape == pictures[0].shape]
    return cv2.GaussianBlur(np.std(np.stack(alike), axis=0), (0, 0), 2.0)


def crops(area: np.ndarray, rows: int, cols: int, most: int = 4) -> Iterator[Crop]:
    """Parts in which the entries differ most, apart from each other."""
    w = min(cols, max(96, cols // 6))
    h = min(rows, round(0.75 * w))
    if not area.any():
        yield Crop(x=(cols - w) // 2, y=(rows - h) // 2, w=w, h=h, chosen=False)
        return
    edge = min(metrics.BORDER, min(rows, cols) // 8) // 2
    kept = area.copy()
    kept[:edge], kept[-edge:], kept[:, :edge], kept[:, -edge:] = 0, 0, 0, 0
    for _ in range(most):
        sums = cv2.integral(kept)
        box = sums[h:, w:] - sums[:-h, w:] - sums[h:, :-w] + sums[:-h, :-w]
        y, x = (int(n) for n in np.unravel_index(int(box.argmax()), box.shape))
        if box[y, x] <= 0:
            return
        yield Crop(x=x, y=y, w=w, h=h, chosen=False)
        kept[max(0, y - h // 4) : y + h + h // 4, max(0, x - w // 4) : x + w + w // 4] = 0


def _webp(picture: np.ndarray, size: float, quality: int) -> bytes:
    if size < 1:
        cols, rows = (max(1, round(size * n)) for n in picture.shape[1::-1])
        picture = cv2.resize(picture, (cols, rows), interpolation=cv2.INTER_AREA)
    done, data = cv2.imencode(".webp", picture[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, quality])
    if not done:
        raise ArithmeticError("a picture could not be encoded as WebP")
    return data.tobytes()
