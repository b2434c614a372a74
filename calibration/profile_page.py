"""A camera's profile on one page: how its lens bends, when its rows are read, how codes stand for light, how it is noisy."""

import io
import textwrap

import cv2
import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from rsvideo.config.printable import printable
from rsvideo.physics import tone
from rsvideo.physics.tone import Transfer
from rsvideo.shooting.camera_profile import CameraProfile, Clock, Measured, Mode, Noise, Tone
from rsvideo.shooting.camera_profile import Lens as LensPart

_BLUE, _VERMILION, _GREEN, _GREY = "#0072B2", "#D55E00", "#009E73", "#8A8A8A"  # Okabe & Ito: apart for every eye
_GRID_LINES, _LINE_POINTS = 13, 60  # of the distorted grid, and along each of its lines
_WIDTH_IN, _TITLE_IN = 11.7, 1.0
_HEIGHTS_IN = (4.0, 1.5, 3.0)  # of the lens, the timing, and the response
_LINE_IN, _LINES = 0.3, 13  # of text: the height, and how many stand beside the lens at least
_DPI = 130
_HOW_LETTERS = 76  # of the method, that fit a line
_DARKEST = 1e-5  # light that is drawn, of a tone curve that begins at 0
_LIGHT = np.geomspace(1e-4, 1, 200)  # at which noise is drawn
_MEASURES = {"intrinsics": "lens", "timing": "readout", "tone": "response", "noise": "response"}  # parts, and what measures them


def draw(profile: CameraProfile, kind: str) -> bytes:
    """A figure file."""
    with matplotlib.rc_context({"font.size": 10, "axes.spines.top": False, "axes.spines.right": False, "svg.hashsalt": "rsvideo"}):
        lines = _lines(profile)
        top, timing, response = _HEIGHTS_IN
        rows = [top if profile.intrinsics else _LINE_IN * len(lines)]
        rows += [timing] * bool(profile.timing) + [response] * bool(profile.tone or profile.noise)
        figure = Figure(figsize=(_WIDTH_IN, _TITLE_IN + sum(rows)), layout=ConstrainedLayoutEngine(w_pad=0.15, h_pad=0.1))
        grid = figure.add_gridspec(len(rows), 2, height_ratios=rows)
        _numbers(figure.add_subplot(grid[0, 1] if profile.intrinsics else grid[0, :]), lines, _LINES if profile.intrinsics else 1)
        if profile.intrinsics:
            _lens(figure.add_subplot(grid[0, 0]), profile.intrinsics, profile.mode)
        if profile.timing:
            _timing(figure.add_subplot(grid[1, :]), profile.timing, profile.mode)
        if profile.tone or profile.noise:
            _tone(figure.add_subplot(grid[-1, 0]), profile.tone)
            _noise(figure.add_subplot(grid[-1, 1]), profile.noise)
        mode = profile.mode
        title = f"{profile.camera}: {mode.cols} x {mode.rows}" + (f" at {mode.fps:.5g} fps" if mode.fps else "")
        figure.suptitle(printable(title), fontsize=13, parse_math=False)
        file = io.BytesIO()
        figure.savefig(file, format=kind, dpi=_DPI)
    return file.getvalue()


def bent(lens: LensPart, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """Where the lens images the pixels of a pinhole camera without distortion, px."""
    matrix = np.array([[lens.fx.value, 0, lens.cx.value], [0, lens.fy.value, lens.cy.value], [0, 0, 1]])
    if lens.distortion is None:
        return points
    k = np.array([number.value for number in lens.distortion.coefficients])
    rays = (points - matrix[:2, 2]) / np.diag(matrix)[:2]
    if lens.distortion.model == "fisheye":
        return cv2.fisheye.distortPoints(rays[:, None], matrix, k.reshape(4, 1)).reshape(-1, 2)
    at = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    return cv2.projectPoints(at, np.zeros(3), np.zeros(3), matrix, k)[0].reshape(-1, 2)


def _missing(panel: Axes, words: str) -> None:
    panel.axis("off")
    panel.text(0.5, 0.5, words, ha="center", va="center", color=_GREY, transform=panel.transAxes)


def _lens(panel: Axes, lens: LensPart, mode: Mode) -> None:
    across = np.linspace(0, mode.cols, _GRID_LINES)
    down = np.linspace(0, mode.rows, max(3, round(_GRID_LINES * mode.rows / mode.cols)))
    along_x, along_y = np.linspace(0, mode.cols, _LINE_POINTS), np.linspace(0, mode.rows, _LINE_POINTS)
    lines = [np.stack([np.full(_LINE_POINTS, x), along_y], axis=1) for x in across] + [
        np.stack([along_x, np.full(_LINE_POINTS, y)], axis=1) for y in down
    ]
    moved = 0.0
    for line in lines:
        imaged = bent(lens, line)
        panel.plot(*line.T, color=_GREY, lw=0.5)
        panel.plot(*imaged.T, color=_BLUE, lw=1.2)
        moved = max(moved, float(np.linalg.norm(imaged - line, axis=1).max()))
    panel.plot(lens.cx.value, lens.cy.value, "+", color=_VERMILION, ms=14, mew=2)
    panel.set(xlim=(-0.05 * mode.cols, 1.05 * mode.cols), ylim=(1.05 * mode.rows, -0.05 * mode.rows), aspect="equal")
    panel.set_title(f"lens: straight lines (grey) as they are seen (blue), displaced by up to {moved:.3g} px", fontsize=10)


def _with_std(number: Measured, unit: str) -> str:
    return f"{number.value:.6g}" + (f" ± {number.std:.2g}" if number.std is not None else "") + f" {unit}"


def _lines(profile: CameraProfile) -> list[tuple[str, str]]:
    """The profile in numbers, how they were found, and how to find the rest."""
    lens, clock, lines = profile.intrinsics, profile.timing, []
    if lens:
        lines += [(name, _with_std(getattr(lens, name), "px")) for name in ("fx", "fy", "cx", "cy")]
        if lens.distortion:
            lines.append(("distortion", lens.distortion.model))
            names = ("k1", "k2", "k3", "k4") if lens.distortion.model == "fisheye" else ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
            lines += [(name, _with_std(k, "")) for name, k in zip(names, lens.distortion.coefficients, strict=False)]
    if clock:
        lines.append(("readout", _with_std(clock.readout_s.model_copy(update=_in_ms(clock.readout_s)), "ms")))
    for part, what in ((lens, "lens"), (clock, "timing"), (profile.tone, "tone"), (profile.noise, "noise")):
        if part and part.found and part.found.how:
            words = textwrap.shorten(part.found.how, _HOW_LETTERS, placeholder=" ...")
            lines.append((f"{what} by", f"{words}{f' ({part.found.when})' if part.found.when else ''}"))
    for name in dict.fromkeys(_MEASURES.values()):
        if missing := [part for part, by in _MEASURES.items() if by == name and getattr(profile, part) is None]:
            words = " and ".join("lens" if part == "intrinsics" else part for part in missing)
            lines.append(("missing", f"{words}: rsvideo calibrate {name}"))
    return lines


def _numbers(panel: Axes, lines: list[tuple[str, str]], least: int) -> None:
    panel.axis("off")
    for number, (name, value) in enumerate(lines):
        y = 1 - (number + 0.5) / max(len(lines), least)
        panel.text(0.0, y, name, va="center", fontsize=9, color=_GREY, transform=panel.transAxes)
        panel.text(0.17, y, printable(value), va="center", fontsize=9, parse_math=False, transform=panel.transAxes)


def _in_ms(number: Measured) -> dict[str, float | None]:
    return {"value": 1e3 * number.value, "std": None if number.std is None else 1e3 * number.std}


def _timing(panel: Axes, clock: Clock, mode: Mode) -> None:
    readout, period = 1e3 * clock.readout_s.value, 1e3 / mode.fps if mode.fps else None
    panel.barh(0, readout, color=_BLUE, height=0.5, label=f"read {clock.direction.value}: {readout:.4g} ms")
    if clock.readout_s.std:
        panel.errorbar(readout, 0, xerr=2e3 * clock.readout_s.std, color=_VERMILION, capsize=4)
    if period:
        panel.axvline(period, color=_GREY, lw=1, label=f"one frame: {period:.4g} ms")
    by_row = clock.direction.by_row
    lines = mode.rows if by_row else mode.cols
    panel.set(yticks=[], ylim=(-0.5, 0.9), xlim=(0, 1.08 * max(readout, period or 0, 1e-3)), xlabel="ms")
    panel.set_title(f"timing: {1e3 * readout / lines:.4g} µs from one {'row' if by_row else 'column'} to the next", fontsize=10)
    panel.legend(frameon=False, ncols=2, loc="upper left", fontsize=9)


def _tone(panel: Axes, part: Tone | None) -> None:
    if part is None or not (part.transfer or part.curve):
        return _missing(panel, "no tone curve")
    codes = np.linspace(0, 1, 257, dtype=np.float32)
    if part.curve:
        light, name = np.interp(codes, np.linspace(0, 1, len(part.curve)), part.curve), "its own"
    else:
        light, name = tone.decode(Transfer(part.transfer), codes), str(part.transfer)
    panel.plot(codes, np.maximum(light, _DARKEST), color=_BLUE, lw=2, label=name)
    panel.plot(codes, np.maximum(tone.decode(Transfer.SRGB, codes), _DARKEST), color=_GREY, lw=1, ls="--", label="srgb")
    if part.clip:
        panel.axvline(part.clip.value, color=_VERMILION, lw=1, label=f"clipped from {part.clip.value:.4g}")
    panel.set(yscale="log", ylim=(1e-4, 1.2), xlabel="code, as part of the highest", ylabel="light")
    deviation = f" ± {part.curve_std:.1%}" if part.curve_std else ""
    panel.set_title(f"tone{deviation}", fontsize=10)
    panel.legend(frameon=False, fontsize=9)
    return None


def _noise(panel: Axes, noise: Noise | None) -> None:
    if noise is None:
        return _missing(panel, "no noise")
    light = _LIGHT
    read, shot = noise.read.value, noise.shot.value
    panel.loglog(light, np.maximum(np.sqrt(read**2 + shot * light), 1e-9), color=_BLUE, lw=2, label="both")
    panel.loglog(light, np.maximum(np.full_like(light, read), 1e-9), color=_GREEN, lw=1, ls=":", label=f"read {_with_std(noise.read, '')}")
    panel.loglog(light, np.maximum(np.sqrt(shot * light), 1e-9), color=_VERMILION, lw=1, ls="--", label=f"shot {_with_std(noise.shot, '')}")
    panel.set(xlabel="light", ylabel="standard deviation of light")
    panel.set_title("noise: variance = read² + shot · light", fontsize=10)
    panel.legend(frameon=False, fontsize=9)
    return None
