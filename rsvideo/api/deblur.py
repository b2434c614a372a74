"""One photograph, from array to array."""

from dataclasses import replace
from os import PathLike
from pathlib import Path

import numpy as np

from rsvideo.api import arrays, treatment
from rsvideo.api.arrays import Light
from rsvideo.api.camera import Camera
from rsvideo.api.files import Picture
from rsvideo.api.result import Result, public, within
from rsvideo.api.settings import Settings
from rsvideo.api.shutter import Shutter
from rsvideo.api.trajectory import Trajectory
from rsvideo.api.treatment import Prepared, Stated
from rsvideo.frame import Frame
from rsvideo.physics.camera import Camera as RollingShutterCamera
from rsvideo.physics.tone import Transfer
from rsvideo.physics.trajectory import Trajectory as Curve
from rsvideo.pipeline import methods
from rsvideo.progress import Observer, ignore
from rsvideo.shooting import given_motion


def deblur(
    image: np.ndarray | Picture,
    *,
    shutter: Shutter | None = None,
    camera: Camera | None = None,
    settings: Settings | None = None,
    transfer: str | None = None,
    trajectory: Trajectory | str | PathLike[str] | None = None,
    observe: Observer | None = None,
) -> Result:
    """Remove motion blur and rolling-shutter distortion from one photograph.

    Args:
        image: (rows, cols) or (rows, cols, 3), at least 32 x 32, in the order in which the sensor stores it. uint8 and uint16 are codes;
            floating point is linear light in [0, 1], as a raw converter gives it. Or a `Picture` as `read` gives it, whose file may state
            exposure and focal length.
        shutter: Exposure, readout and direction; what it leaves open is taken from the file and the camera's profile.
        camera: The focal length, or a profile.
        settings: How to restore; the command line's defaults unless given.
        transfer: What codes mean, by name: "srgb", "bt709", "linear", "s-log3", ... [default: the profile's curve, or "srgb"]
        trajectory: Restore along this motion instead of finding one: of another result, of `simulate`, or in a file (a sidecar of
            `rsvideo deblur`, or CSV of t_s,pitch_rad,yaw_rad,roll_rad).
        observe: Called with a `Progress` (stage, fraction of the whole) now and then.

    Returns:
        The picture, in the kind and shape that was given, with the motion that was found, and a verdict: a picture that is sharp, has no
        texture, or whose blur one camera motion does not explain is left as it was.

    Raises:
        ValueError: The array, a time or a length cannot be meant, or something is missing; the line says what, and the likely slip.
        TypeError: The image is no array, or of another kind.
        UnreadableError: A file (a profile, a trajectory) cannot be read.

    Examples:
        >>> import numpy as np, rsvideo
        >>> shutter, camera = rsvideo.Shutter(exposure="1/50", readout="20ms"), rsvideo.Camera(focal_px=400)
        >>> sharp = rsvideo.read("samples/coffee/truth.png").pixels[100:240, 150:330]
        >>> shot = rsvideo.simulate(sharp, shutter=shutter, camera=camera, blur_px=8, seed=4)
        >>> result = rsvideo.deblur(shot.blurred, shutter=shutter, camera=camera)
        >>> result.verdict.value
        'restored'
        >>> before, after = (np.abs(picture - shot.truth).mean() for picture in (shot.blurred, result.latent))
        >>> bool(after < before / 2)
        True
        >>> rsvideo.deblur(shot.blurred * 255, shutter=shutter, camera=camera)
        Traceback (most recent call last):
        ValueError: image must hold linear light in [0, 1], got ... to ...; are they codes? uint8 and uint16 arrays are decoded
    """
    light, prepared = _prepared(image, Stated.of(shutter, camera, settings, transfer=transfer, moved=trajectory is not None))
    path = _curve(trajectory, prepared.treatment.camera)
    result = methods.photograph(prepared.treatment, Frame(pixels=light.pixels, clipped=light.clipped), path, observe or ignore)
    latent = light.like_source(within(result.latent)) if result.verdict.deblurred else light.source.copy()
    return public(result, latent, camera=prepared.treatment.camera.intrinsics, notes=prepared.notes)


def _prepared(image: np.ndarray | Picture, stated: Stated) -> tuple[Light, Prepared]:
    """The picture in linear light, and how it is restored."""
    of_file = isinstance(image, Picture)
    pixels = image.pixels if of_file else image
    rows, cols = arrays.checked("image", pixels).shape[:2]
    named = arrays.curve(pixels, stated.transfer)
    if of_file:
        stored = treatment.Stored(name=str(image.path), rows=rows, cols=cols, exposure=image.exposure, focal_px=image.focal_px)
    else:
        stored = treatment.Stored(name="an array", rows=rows, cols=cols)
    prepared = treatment.prepared(stated, stored)
    curve, saturation = (named, None) if named else prepared.response
    light = arrays.light("image", pixels, curve or Transfer.SRGB, saturation)
    return replace(light, clipped=image.clipped.reshape(light.clipped.shape)) if of_file else light, prepared


def _curve(trajectory: Trajectory | str | PathLike[str] | None, camera: RollingShutterCamera) -> Curve | None:
    if trajectory is None:
        return None
    if isinstance(trajectory, Trajectory):
        trajectory.check_covers(camera.timing.interval)
        return trajectory.curve
    return given_motion.read(Path(trajectory), camera)
