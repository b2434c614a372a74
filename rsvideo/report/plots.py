"""The motion in a sidecar as a figure: the trajectory over time, and the blur it makes across the frame."""

import io
from pathlib import Path

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rsvideo.config.sidecar import FrameRecord, Sidecar
from rsvideo.config.yaml import shown
from rsvideo.physics.camera import turned
from rsvideo.physics.psf import INSTANTS, psfs_from_traces
from rsvideo.physics.shutter import Direction, ShutterTiming

FORMATS = ("png", "pdf", "svg")
_BLUE, _VERMILION, _GREEN, _GREY = "#0072B2", "#D55E00", "#009E73", "#8A8A8A"  # Okabe & Ito: apart for every eye
_GRID = (5, 7)  # points across the shorter and the longer side
_ROOM = 1.1  # times a trace's reach, that its tile shows
_LONGEST = 200  # px from the middle of a trace to its end; longer ones are drawn smaller
_MOST_TITLE = 120  # characters


def motion(sidecar: Sidecar, kind: str, index: int = 0) -> bytes:
    """A figure file of one frame's motion."""
    record = sidecar.frames[index]
    timing = sidecar.timing(record)
    turns = bool(np.any(record.trajectory.roll_rad))
    with matplotlib.rc_context({"font.size": 10, "axes.spines.top": False, "svg.hashsalt": "rsvideo"}):
        figure = Figure(figsize=(12.5, 5.2), layout="constrained")
        grid = figure.add_gridspec(1, 2, width_ratios=(1.0, 1.15))
        paths, blurs = figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])
        ratios = (3, 1.3, 1) if turns else (3, 1)
        axes = paths.subplots(len(ratios), 1, sharex=True, height_ratios=ratios)
        _draw_shift(axes[0], sidecar, record)
        if turns:
            _draw_roll(axes[1], record)
        _draw_exposures(axes[-1], timing)
        for panel in axes[:-1]:
            panel.axhline(0, color=_GREY, lw=0.8)
        for panel in axes:
            panel.axvline(1e3 * timing.middle, color=_GREY, lw=0.8)
        axes[-1].set(xlabel="time (ms); the restored image shows the middle", xlim=(0, 1e3 * timing.interval[1]))
        paths.align_ylabels(axes)
        _draw_blurs(blurs.subplots(), sidecar, record)
        figure.suptitle(shown(f"{Path(sidecar.input).name}: {record.verdict}", most=_MOST_TITLE), fontsize=11, parse_math=False)
        file = io.BytesIO()
        figure.savefig(file, format=kind, dpi=150)
    return file.getvalue()


def _draw_shift(panel: Axes, sidecar: Sidecar, record: FrameRecord) -> None:
    ms = 1e3 * np.array(record.trajectory.t_s)
    panel.plot(ms, record.trajectory.x_px, color=_BLUE, lw=2, label="x")
    panel.plot(ms, record.trajectory.y_px, color=_VERMILION, lw=2, ls=(0, (5, 2)), label="y")
    panel.set_ylabel("position (px)")
    panel.legend(frameon=False, handlelength=3)
    camera = sidecar.settings.camera
    if camera.source != "assumed":
        focal = camera.fx
        degrees = panel.secondary_yaxis(
            "right", functions=(lambda px: np.degrees(np.arctan(np.divide(px, focal))), lambda angle: focal * np.tan(np.radians(angle)))
        )
        degrees.set_ylabel("angle (°)")


def _draw_roll(panel: Axes, record: FrameRecord) -> None:
    panel.plot(1e3 * np.array(record.trajectory.t_s), np.degrees(record.trajectory.roll_rad), color=_GREEN, lw=2, ls=(0, (1, 1)))
    panel.set_ylabel("roll (°)")


def _draw_exposures(panel: Axes, timing: ShutterTiming) -> None:
    """Which scanlines are open when."""
    scanlines = np.array([0, timing.rows])
    opens = 1e3 * scanlines * timing.row_time
    panel.fill_betweenx(scanlines, opens, opens + 1e3 * timing.exposure, color=_GREY, alpha=0.4, lw=0)
    panel.set(ylim=(timing.rows, 0), ylabel=f"{'row' if timing.direction.by_row else 'column'} open")
    if timing.direction in (Direction.BOTTOM_TO_TOP, Direction.RIGHT_TO_LEFT):
        panel.set_ylabel(f"{panel.get_ylabel()}\n(from the end)")


def _draw_blurs(panel: Axes, sidecar: Sidecar, record: FrameRecord) -> None:
    """The trace that a point of light leaves at each point of a grid, all at one magnification."""
    camera = sidecar.settings.camera
    centres, tiles, shrunk = psfs(sidecar, record)
    cell = _cell(sidecar)
    half = shrunk * (tiles.shape[-1] // 2)
    for (x, y), tile in zip(centres, tiles, strict=True):
        extent = (x - 0.44 * cell, x + 0.44 * cell, y + 0.44 * cell, y - 0.44 * cell)
        panel.imshow(tile, cmap="gray_r", extent=extent, interpolation="nearest", vmin=0, vmax=tile.max())
        panel.add_artist(_frame(extent))
    panel.set(xlim=(0, camera.cols), ylim=(camera.rows, 0), aspect="equal", xlabel="column", ylabel="row")
    panel.spines["top"].set_visible(True)
    panel.set_title(f"blur across the frame; each tile is {2 * half + 1:.0f} px wide", fontsize=10)


def psfs(sidecar: Sidecar, record: FrameRecord) -> tuple[list[tuple[float, float]], Float[np.ndarray, "tiles k k"], float]:
    """Where the points of a grid stand in the frame, the trace that a point of light leaves there, and by how much all are shrunk."""
    camera, timing = sidecar.settings.camera, sidecar.timing(record)
    down, across = grid(sidecar)
    centres = [((i + 0.5) * camera.cols / across, (j + 0.5) * camera.rows / down) for j in range(down) for i in range(across)]
    traces = np.stack([_trace(np.array(centre), sidecar, record, timing) for centre in centres])
    traces -= traces.mean(axis=1, keepdims=True)
    reach = float(np.abs(traces).max())
    shrunk = max(1.0, reach / _LONGEST)
    half = max(2, int(np.ceil(_ROOM * reach / shrunk)) + 1)  # px from a trace's middle to the edge of its tile
    return centres, psfs_from_traces(traces / shrunk, half), shrunk


def grid(sidecar: Sidecar) -> tuple[int, int]:
    """Points down and across at which blurs are drawn."""
    camera = sidecar.settings.camera
    return _GRID if camera.rows <= camera.cols else (_GRID[1], _GRID[0])


def _cell(sidecar: Sidecar) -> float:
    camera, (down, across) = sidecar.settings.camera, grid(sidecar)
    return min(camera.rows / down, camera.cols / across)


def _frame(extent: tuple[float, float, float, float]):
    from matplotlib.patches import Rectangle

    left, right, bottom, top = extent
    return Rectangle((left, top), right - left, bottom - top, fill=False, edgecolor=_GREY, lw=0.5)


def _trace(point: Float[np.ndarray, "2"], sidecar: Sidecar, record: FrameRecord, timing: ShutterTiming) -> Float[np.ndarray, "instants 2"]:
    """Where the image of a still point of light stands at each instant of the exposure of the scanline at `point`."""
    camera = sidecar.settings.camera
    scanline = {
        Direction.TOP_TO_BOTTOM: point[1],
        Direction.BOTTOM_TO_TOP: camera.rows - 1 - point[1],
        Direction.LEFT_TO_RIGHT: point[0],
        Direction.RIGHT_TO_LEFT: camera.cols - 1 - point[0],
    }[timing.direction]
    t = scanline * timing.row_time + (np.arange(INSTANTS) + 0.5) / INSTANTS * timing.exposure
    x, y, roll = (np.interp(t, record.trajectory.t_s, column) for column in record.trajectory.poses().T)
    if camera.distortion:
        return -turned(camera.intrinsics, point[:1], point[1:], np.stack([x, y, roll], axis=1))
    cx, cy = camera.cx, camera.cy
    return -np.stack([x - roll * (point[1] - cy), y + roll * (point[0] - cx)], axis=1)  # the image moves against the sampling
