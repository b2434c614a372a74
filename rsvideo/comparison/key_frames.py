"""What a page shows of a comparison: which frames, at which size, and the parts in which they differ most."""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import cv2
import numpy as np

from rsvideo import threads
from rsvideo.comparison.decoded import DecodedPicture, Light
from rsvideo.config.sidecar import FrameRecord
from rsvideo.report import metrics
from rsvideo.report.comparison import Crop, KeyFrame

MOST_KEY_FRAMES = 48  # that are shown
MOST_SIDE = 1920  # px of a picture on the page
PICTURES_BYTES = 15_000_000  # of a page, before they become text
_BYTES_A_PIXEL = 0.15  # of WebP, roughly
_BESIDE = 1.4  # as many bytes as the pictures alone take pictures and residuals together
_OVERSHOOT = 1.2  # of its share, that a frame may take before its quality is lowered: frames after it may take less
_QUALITIES = (88, 78, 68, 58, 48)  # of WebP, of 100, from the best to the worst
_RESIDUAL_QUALITY, _THUMB_QUALITY = 65, 70
_RESIDUAL_SIZE = 0.5  # of the pictures' size
_GAIN = 8  # by which residuals are magnified, as the page says
_THUMB = 160  # px
_BLUR = 2.0  # px, over which differences are gathered: edges that are shifted by less count once
_MOST_CROPS = 4  # that the page chooses
_CROP_PART, _NARROWEST_CROP, _CROP_ASPECT = 6, 96, 0.75  # a crop is a sixth of the picture wide, or 96 px, and 4:3
_EDGE_PART = 8  # a crop's middle keeps off the sides by half of the border, or of an eighth of the picture where that is less
_CROP_GAP = 4  # the next crop lies a quarter of a crop away at least


def chosen(count: int, entries: int, pixels: float) -> frozenset[int]:
    """Which frames are shown: as many as a page can carry, evenly spread."""
    most = max(1, min(count, MOST_KEY_FRAMES, int(PICTURES_BYTES / (_BESIDE * entries * pixels * _BYTES_A_PIXEL))))
    return frozenset(np.linspace(0, count - 1, most).round().astype(int).tolist()) if most > 1 else frozenset({count // 2})


def scale(rows: int, cols: int) -> float:
    """Of the pictures on the page."""
    return min(1.0, MOST_SIDE / max(rows, cols))


class Album:
    """Takes the key frames one after the other, and keeps where the entries differ most."""

    def __init__(self, count: int, scale: float) -> None:
        self._count, self._scale = count, scale
        self._bytes_left = float(PICTURES_BYTES)
        self.frames: list[KeyFrame] = []
        self.first_shown = 0  # of the frames, the one in which the entries differ most
        self.area = np.zeros((0, 0))  # by how much they differ in that one, pixel by pixel

    def add(
        self,
        index: int,
        time_s: float,
        pictures: Mapping[str, DecodedPicture],
        records: Mapping[str, FrameRecord],
        residuals: Mapping[str, Light],
    ) -> None:
        """The next key frame, at the best quality at which it takes its share of the bytes that are left."""
        unexplained = {name: drawn(light, self._scale) for name, light in residuals.items()}
        share = self._bytes_left / (self._count - len(self.frames))
        frame = KeyFrame(
            index=index,
            time_s=time_s,
            pictures=self._compressed(pictures, _OVERSHOOT * share - sum(map(len, unexplained.values()))),
            residuals=unexplained,
            records=records,
            thumbnail=_thumbnail(next(iter(pictures.values())).shown),
        )
        self._bytes_left -= sum(map(len, (*frame.pictures.values(), *unexplained.values())))
        differing = difference([picture.shown for name, picture in pictures.items() if name != "truth"])
        if not self.frames or differing.sum() > self.area.sum():
            self.first_shown, self.area = len(self.frames), differing
        self.frames.append(frame)

    def _compressed(self, pictures: Mapping[str, DecodedPicture], most: float) -> dict[str, bytes]:
        """All pictures at one quality, the best at which they take at most so many bytes, or the worst."""
        found: list[bytes] = []
        for quality in _QUALITIES:
            found = threads.each(partial(_webp, size=self._scale, quality=quality), [each.shown for each in pictures.values()])
            if sum(map(len, found)) <= most:
                break
        return dict(zip(pictures, found, strict=True))


def drawn(residual: Light, size: float) -> bytes:
    """Grey where the frame is explained; brighter and darker by eight times what is not; WebP."""
    r, valid = residual
    grey = np.clip(np.rint(128 + 255 * _GAIN * np.where(valid, r, 0)), 0, 255).astype(np.uint8)
    return _webp(np.repeat(grey[..., None], 3, axis=2), _RESIDUAL_SIZE * size, _RESIDUAL_QUALITY)


def difference(pictures: Sequence[np.ndarray]) -> np.ndarray:
    """By how much pictures differ, pixel by pixel."""
    alike = [metrics.luma(picture / np.float32(255)) for picture in pictures if picture.shape == pictures[0].shape]
    return cv2.GaussianBlur(np.std(np.stack(alike), axis=0), (0, 0), _BLUR)


def crops(area: np.ndarray, rows: int, cols: int, most: int = _MOST_CROPS) -> Iterator[Crop]:
    """The parts in which entries differ most, which do not overlap; `area` says pixel by pixel by how much they differ."""
    w = min(cols, max(_NARROWEST_CROP, cols // _CROP_PART))
    h = min(rows, round(_CROP_ASPECT * w))
    if not area.any():
        yield Crop(x=(cols - w) // 2, y=(rows - h) // 2, w=w, h=h, chosen=False)
        return
    edge = min(metrics.BORDER, min(rows, cols) // _EDGE_PART) // 2
    kept = area.copy()
    kept[:edge], kept[-edge:], kept[:, :edge], kept[:, -edge:] = 0, 0, 0, 0
    for _ in range(most):
        sums = cv2.integral(kept)
        box = sums[h:, w:] - sums[:-h, w:] - sums[h:, :-w] + sums[:-h, :-w]
        y, x = (int(n) for n in np.unravel_index(int(box.argmax()), box.shape))
        if box[y, x] <= 0:
            return
        yield Crop(x=x, y=y, w=w, h=h, chosen=False)
        down, across = h // _CROP_GAP, w // _CROP_GAP
        kept[max(0, y - down) : y + h + down, max(0, x - across) : x + w + across] = 0


def _thumbnail(picture: np.ndarray) -> bytes:
    return _webp(picture, _THUMB / max(picture.shape[:2]), _THUMB_QUALITY)


def _webp(picture: np.ndarray, size: float, quality: int) -> bytes:
    if size < 1:
        cols, rows = (max(1, round(size * n)) for n in picture.shape[1::-1])
        picture = cv2.resize(picture, (cols, rows), interpolation=cv2.INTER_AREA)
    done, data = cv2.imencode(".webp", picture[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, quality])
    if not done:
        raise ArithmeticError("a picture could not be encoded as WebP")
    return data.tobytes()
