"""The lens, and what is measured of a camera, as a user states it."""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

from rsvideo.config.quantity import pixels
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.distortion import Distortion


@dataclass(frozen=True, kw_only=True, init=False)
class Camera:
    """The camera that took a picture: its focal length, or its profile.

    Args:
        focal_px: Focal length in pixels of the picture, as a number or a text such as "1400" or "1400px". About 0.7 to 0.9
            times the longer side for most phones; millimetres * width of the picture in pixels / width of the sensor in millimetres.
            None leaves it to the profile, to the file's 35 mm equivalent, or to what the motion of a clip shows.
        distortion: How the lens bends rays: OpenCV's Brown-Conrady coefficients k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4]]]. A
            fisheye lens needs a profile. None leaves it to the profile, and is a pinhole camera where that does not state one.
        profile: A camera's profile by name or file (see `rsvideo calibrate`): lens, readout, tone curve and clipping of one mode of
            one camera, fitted to the picture's size, and its noise. What `focal_px`, `distortion`,
            `Shutter` or `transfer` state goes before it.

    Raises:
        ValueError: The focal length is not a positive number of pixels, or the coefficients are none.

    Examples:
        >>> import rsvideo
        >>> rsvideo.Camera(focal_px=1400)
        Camera(focal_px=1400.0, distortion=None, profile=None)
        >>> rsvideo.Camera(focal_px="35mm")
        Traceback (most recent call last):
        ValueError: focal-px must be a positive number of pixels such as 1400, got '35mm'; pixels = millimetres * width of ...
    """

    focal_px: float | None
    distortion: tuple[float, ...] | None
    profile: str | None

    def __init__(
        self,
        *,
        focal_px: float | str | None = None,
        distortion: Sequence[float] | None = None,
        profile: str | os.PathLike[str] | None = None,
    ) -> None:
        if isinstance(focal_px, str):
            focal_px = pixels("focal-px", focal_px)
        if focal_px is not None and not 0 < focal_px < math.inf:
            raise ValueError(f"focal-px must be a positive number of pixels such as 1400, got {focal_px:g}")
        object.__setattr__(self, "focal_px", None if focal_px is None else float(focal_px))
        object.__setattr__(self, "distortion", None if distortion is None else tuple(map(float, distortion)))
        object.__setattr__(self, "profile", None if profile is None else os.fspath(profile))
        if self.distortion is not None:
            Distortion(model="brown-conrady", coefficients=self.distortion)

    def bent(self, lens: Intrinsics) -> Intrinsics:
        """A lens with the distortion that is stated here, if one is."""
        if self.distortion is None:
            return lens
        return replace(lens, distortion=Distortion(model="brown-conrady", coefficients=self.distortion))
