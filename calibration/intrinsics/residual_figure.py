"""How well a lens explains its views, drawn: the residual of every corner, and where in the picture there were any."""

import io

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration.intrinsics.lens_fit import Fit
from calibration.intrinsics.view_selection import Selection, fields

_BLUE, _VERMILION, _GREY = "#0072B2", "#D55E00", "#8A8A8A"  # Okabe & Ito: apart for every eye
_ARROW = 0.03  # of the picture's width, for the length of a usual residual
_USUAL = 0.9  # quantile of the residuals' sizes that is drawn so long
_LEAST_PX = 1e-9  # of a residual or a radius that divides
_GROUPS, _GROUP = 12, 8  # groups of corners by radius at most, and corners in each at least, whose mean is drawn
_NAME = 14  # letters of a view's name that fit below its bar


def draw(fit: Fit, selection: Selection, kind: str) -> bytes:
    """A figure file."""
    with matplotlib.rc_context({"font.size": 10, "axes.spines.top": False, "axes.spines.right": False, "svg.hashsalt": "rsvideo"}):
        figure = Figure(figsize=(12.5, 5.2), layout="constrained")
        grid = figure.add_gridspec(2, 2, width_ratios=(1.7, 1))
        _vectors(figure.add_subplot(grid[:, 0]), fit, selection)
        _by_radius(figure.add_subplot(grid[0, 1]), fit)
        _by_view(figure.add_subplot(grid[1, 1]), fit)
        figure.suptitle(f"{fit.lens.model}, {len(fit.views)} views: {fit.rms:.3f} px are left", fontsize=11)
        file = io.BytesIO()
        figure.savefig(file, format=kind, dpi=150)
    return file.getvalue()


def _vectors(panel: Axes, fit: Fit, selection: Selection) -> None:
    points = np.concatenate([view.corners.points for view in fit.views])
    rest = np.concatenate(fit.residuals)
    usual = max(float(np.quantile(np.linalg.norm(rest, axis=1), _USUAL)), _LEAST_PX)
    longer = _ARROW * selection.cols / usual
    size = np.linalg.norm(rest, axis=1)
    arrows = panel.quiver(
        *points.T, *rest.T, size, angles="xy", scale_units="xy", scale=1 / longer, cmap="viridis", clim=(0, 2 * usual), width=0.0015
    )
    panel.figure.colorbar(arrows, ax=panel, label="left over (px)", shrink=0.7)
    panel.plot(*fit.lens.numbers[2:4], "+", color=_VERMILION, ms=14, mew=2, label="principal point")
    panel.set(xlim=(0, selection.cols), ylim=(selection.rows, 0), aspect="equal", xlabel="column", ylabel="row")
    empty = ~fields(fit.views, selection.rows, selection.cols)
    panel.imshow(np.where(empty, 1.0, np.nan), extent=(0, selection.cols, selection.rows, 0), cmap="Greys", vmin=0, vmax=8, zorder=0)
    panel.set_title(
        f"corners in {1 - empty.mean():.0%} of the picture, none in the grey parts; arrows {longer:.0f} times as long as they are",
        fontsize=10,
    )
    panel.legend(frameon=False, loc="lower right")


def _by_radius(panel: Axes, fit: Fit) -> None:
    points, rest = np.concatenate([view.corners.points for view in fit.views]), np.concatenate(fit.residuals)
    away = points - fit.lens.numbers[2:4]
    radius = np.maximum(np.linalg.norm(away, axis=1), _LEAST_PX)
    outwards = (rest * away).sum(axis=1) / radius
    panel.plot(radius, outwards, ".", color=_BLUE, ms=3, alpha=0.5)
    order = np.argsort(radius)
    groups = np.array_split(order, min(_GROUPS, max(1, len(order) // _GROUP)))
    panel.plot([radius[g].mean() for g in groups], [outwards[g].mean() for g in groups], color=_VERMILION, lw=2, label="mean")
    panel.axhline(0, color=_GREY, lw=0.8)
    panel.set(xlabel="from the principal point (px)", ylabel="outwards (px)")
    panel.legend(frameon=False)


def _by_view(panel: Axes, fit: Fit) -> None:
    errors = [float(np.sqrt((rest**2).sum(axis=1).mean())) for rest in fit.residuals]
    colours = [_BLUE if view.weight == 1 else _GREY for view in fit.views]
    panel.bar(range(len(errors)), errors, color=colours)
    panel.axhline(fit.rms, color=_VERMILION, lw=1)
    panel.set_xticks(range(len(errors)), [view.name[-_NAME:] for view in fit.views], rotation=90, fontsize=6)
    panel.set_ylabel("left over (px)")
