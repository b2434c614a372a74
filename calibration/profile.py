"""What was measured, as parts of a camera's profile."""

from collections.abc import Mapping
from pathlib import Path

from calibration.lens import Fit
from calibration.response import Response
from rsvideo.config.files import sha256
from rsvideo.config.quantity import same_rate
from rsvideo.config.yaml import ConfigError
from rsvideo.shooting import camera_profile
from rsvideo.shooting.camera_profile import CameraProfile, Found, Measured

_NAMED = 3  # files that are named in words; the others are counted


def found(how: str, files: Mapping[str, Path], when: str) -> Found:
    """The provenance of a part: the method, the day, and the files, by what they are called, with their hashes."""
    names = list(files)
    words = ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")
    return Found(how=how[:500], when=when, source=words[:500], files={name[-300:]: sha256(path) for name, path in files.items()})


def lens(fit: Fit, whence: Found) -> camera_profile.Lens:
    """The lens's part."""
    values = [Measured(value=float(value), std=float(std)) for value, std in zip(fit.lens.numbers, fit.lens.std, strict=True)]
    model = "fisheye" if fit.lens.model == "fisheye" else "brown-conrady"
    return camera_profile.Lens(
        fx=values[0],
        fy=values[1],
        cx=values[2],
        cy=values[3],
        distortion=camera_profile.Distortion(model=model, coefficients=values[4:]),
        rms_px=Measured(value=round(fit.rms, 4)),
        found=whence,
    )


def tone(response: Response, whence: Found) -> camera_profile.Tone:
    """The tone curve's part."""
    own = [round(float(light), 6) for light in response.curve]
    return camera_profile.Tone(
        transfer=response.transfer,
        curve=None if response.transfer else own,
        curve_std=float(f"{response.std:.3g}"),
        black=Measured(value=round(response.black, 5)),
        clip=None if response.clip is None else Measured(value=round(response.clip, 5)),
        found=whence,
    )


def noise(response: Response, whence: Found) -> camera_profile.Noise | None:
    """The noise's part."""
    if (model := response.noise) is None:
        return None
    return camera_profile.Noise(
        read=Measured(value=model.read, std=model.read_std or None),
        shot=Measured(value=model.shot, std=model.shot_std or None),
        found=whence.model_copy(update={"how": model.how}),
    )


def merged(before: CameraProfile, measured: CameraProfile) -> CameraProfile:
    """`before` with the parts that were measured in place of its own; both must be of one mode."""
    one, other = before.mode, measured.mode
    rates = {rate for rate in (one.fps, other.fps) if rate}
    if (one.rows, one.cols) != (other.rows, other.cols) or (len(rates) == 2 and not same_rate(max(rates), min(rates))):
        sizes = [f"{m.cols} x {m.rows}" + (f" at {m.fps:.5g} fps" if m.fps else "") for m in (one, other)]
        raise ConfigError(f"the profile is of {sizes[0]}, what was measured of {sizes[1]}; another mode needs another profile")
    parts = {part: new for part in ("intrinsics", "timing", "tone", "noise") if (new := getattr(measured, part)) is not None}
    return before.model_copy(update=parts | {"mode": one.model_copy(update={"fps": one.fps or other.fps})})
