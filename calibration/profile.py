"""A camera's profile: read, written, merged, drawn and converted. What is measured becomes a part of it."""

from pathlib import Path
from typing import Protocol, runtime_checkable

from calibration.output import file_format
from rsvideo.config.files import write_whole
from rsvideo.config.quantity import same_rate
from rsvideo.config.yaml import ConfigError, meant
from rsvideo.shooting import profiles
from rsvideo.shooting.camera_profile import CameraProfile

FILE_FORMATS = ("yaml", "yml")
_PARTS = ("intrinsics", "timing", "tone", "noise")


@runtime_checkable
class Measurement(Protocol):
    """What measures a camera: a lens, a readout or a response."""

    def profile(self, *, name: str | None = None, maker: str | None = None) -> CameraProfile:
        """A profile that holds what was measured, and nothing else."""
        ...


def read(camera: Path | str) -> CameraProfile:
    """The profile in a file, ours or one of Gyroflow, OpenCV, kalibr or ROS; or one that ships with rsvideo, by its name.

    Raises:
        ConfigError: there is no such profile, or it says what cannot be; the message names the line.
        UnreadableError: the file is missing, empty or damaged.

    Examples:
        >>> from calibration import profile
        >>> camera = profile.read("iphone_17_pro_wide_2160p24")
        >>> camera.mode.cols, camera.mode.rows, camera.intrinsics.fx.value
        (3840, 2160, 2839.4)
    """
    return profiles.find(str(camera))


def write(measured: "CameraProfile | Measurement", file: Path | str, *, add: bool = False, overwrite: bool = False) -> CameraProfile:
    """Write a profile, or what was measured, into a YAML file, which `--camera FILE` takes in every command.

    Args:
        measured: A profile, or what `lens`, `readout` or `response` returned.
        file: Where to write; it ends in .yaml or .yml.
        add: Keep the other parts of a profile that exists there.
        overwrite: Replace a profile that exists there.

    Returns:
        The profile as written.

    Raises:
        FileExistsError: the file exists, and neither `add` nor `overwrite` is given.
        ConfigError: with `add`, the file holds another mode of the camera.
        ValueError: the suffix is wrong, or the folder does not exist.

    Examples:
        >>> import tempfile, pathlib, calibration
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "mine.yaml"
        >>> found = calibration.readout(table=("GoPro HERO8 Black", "1080p"))
        >>> _ = calibration.profile.write(found, file)
        >>> calibration.profile.read(file).timing.readout_s.value == round(found.value, 9)
        True
    """
    file = Path(file)
    before = earlier(file, add=add, overwrite=overwrite)
    profile = measured if isinstance(measured, CameraProfile) else measured.profile()
    if before:
        profile = merge(before, profile)
    data, _ = profiles.encode(profile)
    write_whole({file: data})
    return profile


def earlier(file: Path, *, add: bool, overwrite: bool) -> CameraProfile | None:
    """The profile that is added to, if there is one; refused where `file` may not be written."""
    exists = file.exists() and add
    file_format(file, FILE_FORMATS, overwrite=overwrite or exists)
    return profiles.read(file) if exists else None


def merge(before: CameraProfile, measured: CameraProfile) -> CameraProfile:
    """`before` with the parts that were measured in place of its own.

    Raises:
        ConfigError: the two are not of one mode: other sizes, or frame rates that differ by more than 0.2 %.

    Examples:
        >>> from calibration import profile
        >>> camera = profile.read("nikon_1_j1_1080p30")
        >>> profile.merge(camera.model_copy(update={"timing": None}), camera).timing == camera.timing
        True
    """
    one, other = before.mode, measured.mode
    rates = {rate for rate in (one.fps, other.fps) if rate}
    if (one.rows, one.cols) != (other.rows, other.cols) or (len(rates) == 2 and not same_rate(max(rates), min(rates))):
        sizes = [f"{m.cols} x {m.rows}" + (f" at {m.fps:.5g} fps" if m.fps else "") for m in (one, other)]
        raise ConfigError(f"the profile is of {sizes[0]}, what was measured of {sizes[1]}; another mode needs another profile")
    parts = {part: new for part in _PARTS if (new := getattr(measured, part)) is not None}
    return before.model_copy(update=parts | {"mode": one.model_copy(update={"fps": one.fps or other.fps})})


def show(camera: CameraProfile | Path | str, file: Path | str, *, overwrite: bool = False) -> None:
    """Draw a profile on one page: lens, timing, tone curve and noise.

    Args:
        camera: A profile, or what `read` takes.
        file: Where to draw; it ends in .png, .pdf or .svg.
        overwrite: Replace what exists there.

    Raises:
        FileExistsError: the file exists, and `overwrite` is false.
        ValueError: the suffix names no format, or the folder does not exist.

    Examples:
        >>> import tempfile, pathlib
        >>> from calibration import profile
        >>> page = pathlib.Path(tempfile.mkdtemp()) / "page.svg"
        >>> profile.show("nikon_1_j1_1080p30", page)
        >>> page.read_text()[:5]
        '<?xml'
    """
    from calibration import profile_page
    from rsvideo.report.plots import FORMATS

    file = Path(file)
    kind = file_format(file, FORMATS, overwrite=overwrite, read=[] if isinstance(camera, CameraProfile) else [Path(camera)])
    write_whole({file: profile_page.draw(camera if isinstance(camera, CameraProfile) else read(camera), kind)})


def convert(camera: CameraProfile | Path | str, to: str) -> tuple[str, tuple[str, ...]]:
    """A profile as another program reads it, and notes of what that program's form cannot hold.

    Args:
        camera: A profile, or what `read` takes.
        to: `rsvideo`, `gyroflow`, `kalibr`, `opencv` or `ros`.

    Examples:
        >>> from calibration import profile
        >>> text, notes = profile.convert("iphone_17_pro_wide_2160p24", "opencv")
        >>> text.splitlines()[0]
        '%YAML:1.0'
    """
    if to not in profiles.FORMS:
        raise ValueError(f"a profile is converted to one of {', '.join(profiles.FORMS)}, got {to[:40]!r}{meant(to, profiles.FORMS)}")
    data, notes = profiles.encode(camera if isinstance(camera, CameraProfile) else read(camera), to)
    return data.decode(), notes
