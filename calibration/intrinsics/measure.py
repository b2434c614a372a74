"""Focal length, principal point and distortion from files that show a board."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float

from calibration.boards.target import Board, parse
from calibration.intrinsics import view_selection, views
from calibration.intrinsics.lens_fit import BENT, ENOUGH_VIEWS, Fit, TooFewViewsError, calibrate, reach
from calibration.intrinsics.pose import rms
from calibration.intrinsics.view_selection import Selection, coverage
from calibration.intrinsics.views import Refused, View
from calibration.output import file_format
from calibration.provenance import camera_name, provenance
from calibration.sources import by_name, is_clip, paths, photographs
from rsvideo.config.files import write_whole
from rsvideo.config.quantity import hand_held
from rsvideo.progress import Observer, Progress, ignore
from rsvideo.shooting import camera_profile
from rsvideo.shooting.camera_profile import CameraProfile, Measured, Mode
from rsvideo.stills import still
from rsvideo.video import decode, metadata

Model = Literal["brown-conrady", "fisheye"]

_COVERED = 0.5  # of the picture, in which corners should be
_REACHED = 0.8  # of the distance to the picture's farthest corner, over which corners should tell the distortion
_FOCAL_STD = 0.01  # of the focal length, beyond which a note advises to tilt the board more
_RMS_DIGITS = 4  # of pixels, that a profile keeps
_FPS_DIGITS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class LensMeasurement:
    """A lens that was measured on views of a board."""

    board: str  # its name
    fit: Fit  # the lens with its standard deviations, the views that it was fitted to and their residuals
    selection: Selection  # which views were taken, and why others were not
    files: Mapping[str, Path]  # that the fit rests on, by the views' names; a clip is one
    fps: float | None  # of the clip; None for photographs
    camera: str | None  # as the files name it

    @property
    def model(self) -> str:
        """`brown-conrady` or `fisheye`."""
        return self.fit.lens.model

    @property
    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """The camera matrix: fx, fy, cx, cy in px; the centre of the top-left pixel is (0, 0)."""
        return self.fit.lens.matrix

    @property
    def distortion(self) -> Float[np.ndarray, " k"]:
        """The coefficients of distortion in OpenCV's order: k1, k2, p1, p2, ...; k1 to k4 of a fisheye."""
        return self.fit.lens.numbers[4:]

    @property
    def std(self) -> Float[np.ndarray, " p"]:
        """Standard deviations of fx, fy, cx, cy (px), and of each coefficient of distortion."""
        return self.fit.lens.std

    @property
    def rms_px(self) -> float:
        """The root mean square distance between corners observed and computed, px."""
        return self.fit.rms

    @property
    def view_rms_px(self) -> dict[str, float]:
        """The same for each view that was used, by its name."""
        return {view.name: rms(residual) for view, residual in zip(self.fit.views, self.fit.residuals, strict=True)}

    @property
    def refused(self) -> tuple[Refused, ...]:
        """The pictures that were not used, each with its reason."""
        return (*self.selection.refused, *self.fit.refused)

    @property
    def coverage(self) -> float:
        """The part of the picture in which any view has a corner."""
        return coverage(self.fit.views, self.selection.rows, self.selection.cols)

    @property
    def reach(self) -> float:
        """How far out corners were observed, relative to the distance from the principal point to the picture's farthest corner."""
        return reach(self.fit.views, self.fit.lens.numbers, self.selection.rows, self.selection.cols)

    @property
    def how(self) -> str:
        """The method in words, as the profile notes it."""
        words = f"{len(self.fit.views)} views of {self.board}, {self.fit.rms:.3f} px left"
        displaced = f", the board's corners found up to {self.fit.displacement * 1e3:.2g} mm off their places"
        return words + (displaced if self.fit.displacement else "")

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person should know before they trust the lens."""
        return (*self.selection.notes, *_doubts(self))

    def profile(self, *, name: str | None = None, maker: str | None = None) -> CameraProfile:
        """A profile with this lens; `name` is the camera's model, as the files name it unless given."""
        lens = self.fit.lens
        values = [Measured(value=float(value), std=float(std)) for value, std in zip(lens.numbers, lens.std, strict=True)]
        return CameraProfile(
            name=camera_name(name, self.camera),
            maker=maker,
            mode=Mode(rows=self.selection.rows, cols=self.selection.cols, fps=self.fps),
            intrinsics=camera_profile.Lens(
                fx=values[0],
                fy=values[1],
                cx=values[2],
                cy=values[3],
                distortion=camera_profile.Distortion(
                    model="fisheye" if lens.model == "fisheye" else "brown-conrady", coefficients=values[4:]
                ),
                rms_px=Measured(value=round(self.fit.rms, _RMS_DIGITS)),
                found=provenance(self.how, self.files),
            ),
        )

    def draw_residuals(self, file: Path | str, *, overwrite: bool = False) -> None:
        """Draw the residual of every corner into a .png, .pdf or .svg file."""
        from calibration.intrinsics import residual_figure
        from rsvideo.report.plots import FORMATS

        file = Path(file)
        kind = file_format(file, FORMATS, overwrite=overwrite)
        write_whole({file: residual_figure.draw(self.fit, self.selection, kind)})


def lens(
    views: Path | str | Sequence[Path | str],
    board: str = "chessboard:9x6:25mm",
    *,
    model: Model | None = None,
    find_shape: bool = False,
    readout: float | None = None,
    observer: Observer = ignore,
) -> LensMeasurement:
    """Measure focal length, principal point and distortion from views of a board.

    The views should cover the whole picture, near and far, with the board tilted to all sides and held still. Views that are blurred, in
    motion, alike, of another size, or that no lens explains, are refused, each with its reason. Lens and poses are adjusted together by
    least squares; the model is the simplest that does as well as any on views that were left out.

    Args:
        views: Photographs, their folder, or one clip.
        board: What was photographed: `chessboard:9x6:25mm` (inner corners, side of a square),
            `charuco:5x7:DICT_6X6_250:30mm:22mm` or `aprilgrid:6x6:30mm:9mm`.
        model: `brown-conrady` or `fisheye`; chosen unless given.
        find_shape: Find the board's shape too, for one that is not flat or not printed to scale; takes 8 views or more.
        readout: The rolling shutter's readout time in seconds, by which views of a clip in motion are recognised.
        observer: Is given a `Progress` while the board is searched for.

    Returns:
        The lens with standard deviations, the residuals of each view, and the views refused with their reasons.

    Raises:
        TooFewViewsError: fewer than 3 views can be used; its `refused` says why the others cannot. A ValueError.
        ValueError: the board's name is none, photographs and clips are mixed, or no lens explains the views.
        UnreadableError: a file is missing or damaged, or the board is in none of the pictures.

    Examples:
        Seven photographs of a board, simulated, by a camera of focal length 300 px:

        >>> import tempfile, pathlib, cv2, calibration
        >>> from calibration.boards.render import photographs
        >>> folder = pathlib.Path(tempfile.mkdtemp())
        >>> for n, picture in enumerate(photographs("chessboard:6x5:25mm", 7, focal_px=300.0)):
        ...     _ = cv2.imwrite(str(folder / f"{n}.png"), picture)
        >>> found = calibration.lens(folder, "chessboard:6x5:25mm", model="brown-conrady")
        >>> bool(abs(found.matrix[0, 0] - 300) < 4 * found.std[0] < 6)
        True
        >>> len(found.view_rms_px), found.refused
        (7, ())
    """
    target = parse(board)
    if model not in (None, "brown-conrady", "fisheye"):
        raise ValueError(f"model must be brown-conrady, fisheye or None, got {model!r}")
    rolling = None if readout is None else hand_held("readout", readout, zero=True)
    selection, files, fps, camera = _select(paths(views), target, rolling, observer)
    try:
        fit = calibrate(selection.views, model=model, bent=find_shape)
    except TooFewViewsError as error:
        raise TooFewViewsError(str(error), selection.refused) from error
    used = {view.name for view in fit.views}
    files = {name: path for name, path in files.items() if selection.clip or name in used}
    return LensMeasurement(board=board, fit=fit, selection=selection, files=files, fps=fps, camera=camera)


def _select(
    sources: Sequence[Path], board: Board, readout: float | None, observer: Observer
) -> tuple[Selection, dict[str, Path], float | None, str | None]:
    """The views to calibrate on, the files they may be in, and the clip's frame rate and the camera's name where files say these."""
    clips = [path for path in sources if is_clip(path)]
    if clips and len(sources) > 1:
        raise ValueError(f"views must be photographs or one clip, got {len(sources)} files with {clips[0].name} among them")
    if clips:
        stream = decode.probe(clips[0])
        found = _searched(views.from_clip(stream, board), min(stream.frames, views.MOST_SEARCHED), observer)
        selection = view_selection.select(found, clip=True, readout=readout)
        return selection, by_name(clips), round(float(stream.rate), _FPS_DIGITS), metadata.read(stream).camera
    files = photographs(sources)
    if not files:
        raise ValueError(f"{sources[0] if sources else 'nothing'} holds no photograph; is it the right folder?")
    selection = view_selection.select(_searched(views.from_photographs(files, board), len(files), observer), clip=False, readout=readout)
    names = by_name(files)
    return selection, names, None, still.read(names[selection.views[0].name]).capture.camera


def _searched(found: Iterator[View | Refused], count: int, observer: Observer) -> list[View | Refused]:
    """All pictures that were searched for the board."""
    searched: list[View | Refused] = []
    for one in found:
        searched.append(one)
        observer(Progress(stage="looking for the board", fraction=min(1.0, len(searched) / count)))
    return searched


def _doubts(measured: LensMeasurement) -> list[str]:
    fit, doubts = measured.fit, []
    if len(fit.views) < ENOUGH_VIEWS:
        doubts.append(f"{len(fit.views)} views are few, {ENOUGH_VIEWS} or more tell more; the stated deviations may be too small")
    if measured.coverage < _COVERED:
        doubts.append(f"the board was seen in {measured.coverage:.0%} of the picture only; bring it into the corners too")
    if measured.reach < _REACHED:
        doubts.append(f"no corner lies farther out than {measured.reach:.0%} of the way; beyond, the distortion is a guess")
    if (free := fit.left_out_if_bent) and not fit.displacement and free < BENT * (error := min(fit.left_out.values())):
        doubts.append(
            f"the board is not what --board says: if it may be bent, {free:.3f} instead of {error:.3f} px are left in views left out;"
            " --bent finds its shape, a flat and exact one is better; the stated deviations allow for it"
        )
    if fit.lens.std[0] > _FOCAL_STD * fit.lens.numbers[0]:
        doubts.append(f"the focal length is known to {fit.lens.std[0] / fit.lens.numbers[0]:.1%} only; tilt the board more")
    return doubts
