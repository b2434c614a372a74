"""What explains a frame: the camera's path, the blur that this makes across the frame, the residual and the steps to it."""

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float
from markupsafe import Markup

from rsvideo.config.sidecar import FrameRecord, Sidecar
from rsvideo.report import charts, embedded, plots
from rsvideo.report.comparison import Comparison, KeyFrame

_TILE = 56  # px that a kernel is enlarged to at most
_FAINTEST = 8  # of 255, the opacity of a kernel's empty pixels: it shows where tiles end
_GAP_PART = 12  # kernels stand a twelfth of their width apart
_LEAST_PEAK = 1e-12  # an empty kernel divides by this


@dataclass(frozen=True, kw_only=True)
class Motion:
    """What explains one frame of one method."""

    name: str
    path: Markup
    psfs: str
    psf_words: str
    residual: str
    convergence: Markup


def motions(comparison: Comparison, frame: KeyFrame) -> list[Motion]:
    """The figures of each method that explains the frame."""
    out = []
    for entry in comparison.methods:
        record = frame.records.get(entry.name)
        if record is not None and entry.sidecar is not None and (found := _motion(entry.name, entry.sidecar, record, frame.residuals)):
            out.append(found)
    return out


def _motion(name: str, sidecar: Sidecar, record: FrameRecord, residuals: Mapping[str, bytes]) -> Motion | None:
    moved = bool(np.any(record.trajectory.poses()))
    if not moved and record.psfs is None:
        return None
    tiles, across = _tiles(sidecar, record)
    steps = record.convergence
    return Motion(
        name=name,
        path=charts.trajectory(sidecar, record) if moved else Markup(""),
        psfs=embedded.data_uri(_drawn(tiles, across), "image/png"),
        psf_words=f"what a point of light becomes across the frame; each tile is {tiles.shape[-1]} px wide",
        residual=embedded.data_uri(residuals[name], "image/webp") if name in residuals else "",
        convergence=charts.falling(steps) if len(steps) > 1 else Markup(""),
    )


def _tiles(sidecar: Sidecar, record: FrameRecord) -> tuple[Float[np.ndarray, "tiles k k"], int]:
    """The frame's kernels row by row, and how many stand in a row."""
    if record.psfs is not None:
        psfs = np.asarray(record.psfs, float)
        return psfs.reshape(-1, *psfs.shape[2:]), psfs.shape[1]
    return plots.psfs(sidecar, record)[1], plots.grid(sidecar)[1]


def _drawn(tiles: Float[np.ndarray, "tiles k k"], across: int) -> bytes:
    """Kernels in a grid, as opaque as they are strong, so that they can stand on any paper."""
    k, scale = tiles.shape[-1], max(1, _TILE // tiles.shape[-1])
    gap = max(1, k * scale // _GAP_PART)
    cell = k * scale + gap
    down = -(-len(tiles) // across)
    alpha = np.zeros((down * cell + gap, across * cell + gap), np.uint8)
    for n, tile in enumerate(tiles):
        y, x = gap + n // across * cell, gap + n % across * cell
        strong = np.clip(255 * np.sqrt(np.maximum(tile, 0) / max(float(tile.max()), _LEAST_PEAK)), _FAINTEST, 255).astype(np.uint8)
        alpha[y : y + k * scale, x : x + k * scale] = np.kron(strong, np.ones((scale, scale), np.uint8))
    picture = np.zeros((*alpha.shape, 4), np.uint8)
    picture[..., 3] = alpha
    return cv2.imencode(".png", picture)[1].tobytes()
