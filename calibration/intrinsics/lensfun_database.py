"""A lens looked up in lensfun's database instead of measured: nominal focal length, and the distortion of other copies of that lens.

The database gives the crop factor of the whole sensor; a picture wider than 3:2 is taken to show its full width.
"""

from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from jaxtyping import Float

from calibration.provenance import camera_name, today
from rsvideo.config.yaml import shown
from rsvideo.shooting.camera_profile import CameraProfile, Distortion, Found, Lens, Measured, Mode
from rsvideo.stills.exif import FULL_FRAME_DIAGONAL

_STILLS_ASPECT, _ASPECT_TOLERANCE = 1.5, 0.01
_DISTANCE_M = 1000.0  # of the subject: far
_APERTURE = 8.0  # distortion hardly depends on it
_FOCAL_TOLERANCE_MM = 0.5  # beyond a zoom's range, for what EXIF rounds
_FOCAL_MM, _SIDE_PX = (1, 5000), (16, 100_000)  # beyond, a slip
_CENTRE = 0.05  # of the largest radius, within which the ratio of radii is too noisy to fit
_FOCAL_STD, _CENTRE_STD = 0.03, 0.01  # part of the focal length by which nominal ones are off; part of the width
_GRID_PX = 16  # the spacing of points that the distortion is fitted on


@dataclass(frozen=True, kw_only=True)
class LensPrior:
    """What the database says of a lens, and what to mind about it."""

    camera: str
    maker: str
    lens: Lens
    rows: int
    cols: int
    notes: tuple[str, ...]

    def profile(self, *, name: str | None = None, maker: str | None = None) -> CameraProfile:
        """A profile with this lens; camera and maker as the database names them unless given."""
        return CameraProfile(
            name=camera_name(name, self.camera),
            maker=maker or self.maker,
            mode=Mode(rows=self.rows, cols=self.cols),
            intrinsics=self.lens,
        )


def look_up_lens(camera: str, lens: str, *, focal_mm: float, rows: int, cols: int) -> LensPrior:
    """Look a lens up in lensfun's database, where nothing was measured; needs the extra `rsvideo[lensfun]`.

    Args:
        camera: As EXIF names it: `Canon EOS 70D`.
        lens: Its name or a part of it: `EF-S 18-135`.
        focal_mm: The focal length that was set, in mm, not the equivalent.
        rows: Height of the pictures, in px.
        cols: Their width.

    Returns:
        Focal length and principal point in px of the picture, with the deviations that nominal ones have, and the distortion.

    Raises:
        ValueError: the database does not know camera or lens, the lens has no such focal length or is a fisheye, or the extra is missing.
    """
    lensfun = _library()
    if not _FOCAL_MM[0] <= focal_mm <= _FOCAL_MM[1]:
        raise ValueError(f"focal-mm must lie in 1 to 5000 mm, got {focal_mm:g}")
    if not all(_SIDE_PX[0] <= side <= _SIDE_PX[1] for side in (rows, cols)):
        raise ValueError(f"the size must lie in 16 to 100000 px, got {cols} x {rows}")
    database = lensfun.Database()
    body = _first("camera", camera, database.find_cameras(None, camera[:100], loose_search=True))
    found = _first("lens", lens, database.find_lenses(body, None, lens[:100], loose_search=True))
    if found.type != lensfun.LensType.RECTILINEAR:
        raise ValueError(f"{found.model} is a fisheye; its profile must be measured: rsvideo calibrate lens")
    if not found.min_focal - _FOCAL_TOLERANCE_MM <= focal_mm <= (found.max_focal or found.min_focal) + _FOCAL_TOLERANCE_MM:
        raise ValueError(f"{found.model} has {found.min_focal:g} to {found.max_focal:g} mm, got {focal_mm:g} mm; is it the equivalent?")
    crop, aspect = body.crop_factor, max(rows, cols) / min(rows, cols)
    notes = [f"taken for {body.model} with {found.model}; a prior from other copies of it, not a measurement of yours"]
    if aspect > _STILLS_ASPECT + _ASPECT_TOLERANCE:
        crop *= float(np.hypot(1, 1 / _STILLS_ASPECT) / np.hypot(1, 1 / aspect))
        notes.append("the picture is taken to show the sensor's full width; modes that crop have a longer focal length")
    focal = focal_mm * float(np.hypot(rows, cols)) / (FULL_FRAME_DIAGONAL / crop)
    coefficients, rest = _bending(lensfun, found, crop, focal_mm, focal, rows, cols)
    if coefficients is None:
        notes.append("the database holds no distortion of this lens; it is left out")
    else:
        notes.append(f"its distortion is written as Brown-Conrady's to {rest:.2g} px")
    whence = Found(
        how=f"lensfun's database, {found.model} at {focal_mm:g} mm, not measured", when=today(), source="lensfun.github.io (CC BY-SA 3.0)"
    )
    return LensPrior(
        camera=body.model.removeprefix(body.maker).strip() or body.model,
        maker=body.maker,
        lens=Lens(
            fx=Measured(value=focal, std=_FOCAL_STD * focal),
            fy=Measured(value=focal, std=_FOCAL_STD * focal),
            cx=Measured(value=(cols - 1) / 2, std=_CENTRE_STD * cols),
            cy=Measured(value=(rows - 1) / 2, std=_CENTRE_STD * cols),
            distortion=None
            if coefficients is None
            else Distortion(model="brown-conrady", coefficients=[Measured(value=round(float(k), 6)) for k in coefficients]),
            found=whence,
        ),
        rows=rows,
        cols=cols,
        notes=tuple(notes),
    )


def _library() -> ModuleType:
    try:
        import lensfunpy
    except ImportError as error:
        raise ValueError("lensfun's database comes with an extra: pip install 'rsvideo[lensfun]'") from error
    return lensfunpy


def _first(what: str, name: str, found: list[Any]) -> Any:
    """The first that has all the words of `name`: the library's own search takes what is merely near."""
    words = name.lower().split()
    matching = [one for one in found if all(word in f"{one.maker} {one.model}".lower() for word in words)]
    if not matching or not words:
        raise ValueError(f"lensfun knows no {what} named {shown(name)}; its names are those in EXIF")
    return matching[0]


def _bending(
    lensfun: ModuleType, lens: Any, crop: float, focal_mm: float, focal: float, rows: int, cols: int
) -> tuple[Float[np.ndarray, "5"] | None, float]:
    """Brown-Conrady's five coefficients of lensfun's mapping from straight pixels to observed ones, and what they leave of it in px.

    lensfun keeps the scale at some radius, we in the middle: its mapping r -> r (m + ...) is that of a focal length m times as long.
    """
    modifier = lensfun.Modifier(lens, crop, cols, rows)
    modifier.initialize(focal_mm, _APERTURE, _DISTANCE_M, pixel_format=np.uint8, flags=lensfun.ModifyFlags.DISTORTION)
    bent = modifier.apply_geometry_distortion(0, 0, cols, rows)
    if bent is None:
        return None, 0.0
    y, x = np.mgrid[:rows:_GRID_PX, :cols:_GRID_PX]
    centre = np.array([(cols - 1) / 2, (rows - 1) / 2])
    straight = np.stack([x, y], axis=-1).reshape(-1, 2) - centre
    bent = np.asarray(bent, float)[::_GRID_PX, ::_GRID_PX].reshape(-1, 2) - centre
    radius = np.linalg.norm(straight, axis=1)
    away = radius > _CENTRE * radius.max()
    r, ratio = radius[away] / focal, (bent[away] * straight[away]).sum(axis=1) / radius[away] ** 2
    powers = np.stack([r**0, r**2, r**4, r**6], axis=1) * r[:, None]
    (m, *k), *_ = np.linalg.lstsq(powers, ratio * r, rcond=None)
    rest = float(np.abs(powers @ np.array([m, *k]) - ratio * r).max() * focal)
    k1, k2, k3 = (value / m ** (2 * n + 3) for n, value in enumerate(k))
    return np.array([k1, k2, 0.0, 0.0, k3]), rest
