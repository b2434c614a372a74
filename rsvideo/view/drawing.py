"""Pictures for a page: frames as a screen shows them, the motion drawn over them, and what it leaves unexplained as a heat map."""

import cv2
import numpy as np
from jaxtyping import Float

from rsvideo.comparison.decoded import Light
from rsvideo.config.sidecar import FrameRecord, Sidecar
from rsvideo.physics.tone import Tone
from rsvideo.pipeline.preview import on_screen
from rsvideo.report import plots

File = tuple[str, bytes]  # media type and content

_QUALITY = 85  # of WebP, of 100
MOST_SIDE = 2560  # px of a picture on a page
_HEAT = 0.06  # of white, that is drawn as the hottest
_WIDE = 1.5  # px, over which what is left is gathered
_PATH_PART = 0.3  # of the shorter side, over which a path is drawn at most
_MOST_MAGNIFIED = 32
_LEAST_REACH = 1e-3  # px
_DARK, _LIT, _TILE = (16, 16, 16), (255, 214, 51), (86, 204, 255)  # RGB: a dark rim, the path, the PSFs; bright on any picture
_STYLE = (
    "<style>text{font:12px sans-serif;fill:#63605a}.rule{stroke:#ddd;fill:none}.axis{stroke:#8d8981;fill:none}"
    ".line{fill:none;stroke-width:2}.c0{stroke:#0072b2}.c1{stroke:#d55e00}.c2{stroke:#009e73}.end{text-anchor:end}"
    ".mid{text-anchor:middle}@media(prefers-color-scheme:dark){text{fill:#aeaaa0}.rule{stroke:#34322e}.axis{stroke:#827e76}"
    ".c0{stroke:#56b4e9}.c1{stroke:#f08a4b}.c2{stroke:#2fc79b}}</style>"
)


def shown(light: Float[np.ndarray, "rows cols channels"], transfer: Tone | None, turns: int) -> File:
    """Linear light as WebP, turned upright by quarters."""
    return webp(on_screen(light, transfer), turns)


def webp(picture: np.ndarray, turns: int = 0, *, most: int = MOST_SIDE) -> File:
    """8-bit codes as WebP, at most so large."""
    if picture.shape[2] == 1:
        picture = np.repeat(picture, 3, axis=2)
    longer = max(picture.shape[:2])
    if longer > most:
        cols, rows = (max(1, round(n * most / longer)) for n in picture.shape[1::-1])
        picture = cv2.resize(picture, (cols, rows), interpolation=cv2.INTER_AREA)
    turned = np.ascontiguousarray(np.rot90(picture, turns)[..., ::-1])
    done, data = cv2.imencode(".webp", turned, [cv2.IMWRITE_WEBP_QUALITY, _QUALITY])
    if not done:
        raise ArithmeticError("a picture could not be encoded as WebP")
    return "image/webp", data.tobytes()


def heat(left: Light, turns: int) -> tuple[File, float]:
    """What is left of a frame, black where nothing is; and its root mean square, of white."""
    rest, valid = left
    held = np.where(valid, rest, 0).astype(np.float32)
    size = cv2.GaussianBlur(np.abs(held), (0, 0), _WIDE)
    codes = np.clip(np.rint(255 / _HEAT * size), 0, 255).astype(np.uint8)
    coloured = cv2.applyColorMap(codes, cv2.COLORMAP_INFERNO)[..., ::-1]
    rms = float(np.sqrt(np.mean(rest[valid] ** 2))) if valid.any() else 0.0
    return webp(np.ascontiguousarray(coloured), turns), rms


def blur_length(sidecar: Sidecar, record: FrameRecord) -> float:
    """How long the trace of a point in the frame's middle is, px."""
    timing, t = sidecar.timing(record), np.array(record.trajectory.t_s)
    opened = 0.5 * (timing.interval[1] - timing.exposure)
    within = np.linspace(opened, opened + timing.exposure, 33)
    x, y = (np.interp(within, t, column) for column in (record.trajectory.x_px, record.trajectory.y_px))
    return float(np.hypot(np.diff(x), np.diff(y)).sum())


def motion(sidecar: Sidecar, record: FrameRecord, turns: int) -> tuple[File, float]:
    """The PSFs in their places and the path about the middle, to be laid over the frame; and by how much the path is magnified."""
    camera = sidecar.settings.camera
    rows, cols = camera.rows, camera.cols
    picture = np.zeros((rows, cols, 4), np.uint8)
    if record.psfs is None:
        centres, tiles, _ = plots.psfs(sidecar, record)
    else:
        grid = np.asarray(record.psfs, float)
        down, across, k = grid.shape[0], grid.shape[1], grid.shape[2]
        centres = [((i + 0.5) * cols / across, (j + 0.5) * rows / down) for j in range(down) for i in range(across)]
        tiles = grid.reshape(-1, k, k)
    down, across = plots.grid(sidecar)
    room = 0.8 * min(rows / down, cols / across)
    times = max(1.0, min(4.0, room // max(1, tiles.shape[-1])))
    for (x, y), tile in zip(centres, tiles, strict=True):
        _stamp(picture, x, y, tile, times)
    path = np.stack([record.trajectory.x_px, record.trajectory.y_px], axis=1)
    reach = max(float(np.ptp(path, axis=0).max()), _LEAST_REACH)
    magnified = float(2 ** int(np.clip(np.log2(_PATH_PART * min(rows, cols) / reach), 0, np.log2(_MOST_MAGNIFIED))))
    points = (path - path.mean(axis=0)) * -magnified + [cols / 2, rows / 2]  # the image moves against the sampling
    line = np.rint(8 * points).astype(np.int32).reshape(-1, 1, 2)
    thick = max(2, round(min(rows, cols) / 270))
    for colour, width in ((_DARK, thick + 2), (_LIT, thick)):
        cv2.polylines(picture, [line], False, (*colour, 255), width, cv2.LINE_AA, 3)
    first = tuple(int(n) for n in np.rint(points[0]))
    cv2.circle(picture, first, 2 * thick, (*_LIT, 255), -1, cv2.LINE_AA)
    turned = np.ascontiguousarray(np.rot90(picture, turns)[..., [2, 1, 0, 3]])
    return ("image/png", cv2.imencode(".png", turned)[1].tobytes()), magnified


def _stamp(picture: np.ndarray, x: float, y: float, tile: np.ndarray, times: float) -> None:
    """Draw a PSF about a point, as opaque as it is strong, with a dark rim."""
    strong = np.sqrt(np.maximum(tile, 0) / max(float(tile.max()), 1e-12)).astype(np.float32)
    strong = cv2.resize(strong, None, fx=times, fy=times, interpolation=cv2.INTER_LINEAR)
    k = strong.shape[0]
    top, left = round(y - k / 2), round(x - k / 2)
    a, b, c, d = max(top, 0), min(top + k, picture.shape[0]), max(left, 0), min(left + k, picture.shape[1])
    if a >= b or c >= d:
        return
    rim = cv2.dilate(strong, np.ones((3, 3), np.uint8))
    for alpha, colour in ((0.75 * rim, _DARK), (strong, _TILE)):
        part, cut = picture[a:b, c:d], alpha[a - top : b - top, c - left : d - left, None]
        over = 255 * np.clip(cut, 0, 1)
        wins = over[..., 0] > (part[..., 3] if colour is _DARK else 96)
        part[wins] = np.concatenate([np.broadcast_to(np.array(colour), (*cut.shape[:2], 3)), over], axis=2).astype(np.uint8)[wins]


def styled(svg: str) -> File:
    """A chart as a file of its own, in a page's colours."""
    opened, rest = str(svg).split(">", 1)
    return "image/svg+xml", f'{opened} xmlns="http://www.w3.org/2000/svg">{_STYLE}{rest}'.encode()
