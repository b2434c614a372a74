"""Tone curve, clipping and noise from photographs of one scene at several exposures."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from calibration.provenance import camera_name, provenance
from calibration.radiometry.exposure_series import Photograph, exact_times
from calibration.radiometry.noise_fit import NoiseModel
from calibration.radiometry.response_fit import Response, measure
from calibration.sources import by_name, paths
from rsvideo.physics.tone import Transfer
from rsvideo.shooting import camera_profile
from rsvideo.shooting.camera_profile import CameraProfile, Measured, Mode
from rsvideo.stills import still

_CURVE_DIGITS, _CODE_DIGITS = 6, 5  # of light and of codes, from 0 to 1, that a profile keeps


@dataclass(frozen=True, kw_only=True, eq=False)
class ResponseMeasurement:
    """How a camera's codes stand for light, and how noisy they are."""

    response: Response
    rows: int
    cols: int
    files: tuple[Path, ...]
    camera: str | None  # as the files name it

    @property
    def transfer(self) -> Transfer | None:
        """The standard's curve that fits; None: none does, and `curve` is the camera's own."""
        return self.response.transfer

    @property
    def curve(self) -> Float[np.ndarray, " entries"]:
        """Light from 0 to 1 at codes evenly spaced from 0 to 1."""
        return self.response.curve

    @property
    def std(self) -> float:
        """Standard deviation of the logarithm of light by that curve."""
        return self.response.std

    @property
    def misfits(self) -> dict[str, float]:
        """The same of each curve that was tried, by its name; `free` is the camera's own."""
        return self.response.misfits

    @property
    def clip(self) -> float | None:
        """The code from 0 to 1 from which on highlights are lost; None: no photograph was clipped."""
        return self.response.clip

    @property
    def noise(self) -> NoiseModel | None:
        """Variance = read^2 + shot * light, of light from 0 to 1; None: too few flat patches."""
        return self.response.noise

    @property
    def notes(self) -> tuple[str, ...]:
        """What should be minded."""
        return self.response.notes

    def profile(self, *, name: str | None = None, maker: str | None = None) -> CameraProfile:
        """A profile with this response; `name` is the camera's model, as the files name it unless given."""
        measured, times = self.response, self.response.exposures
        found = provenance(f"{len(times)} exposures of {min(times):.3g} to {max(times):.3g} s", by_name(self.files))
        own = [round(float(light), _CURVE_DIGITS) for light in measured.curve]
        return CameraProfile(
            name=camera_name(name, self.camera),
            maker=maker,
            mode=Mode(rows=self.rows, cols=self.cols),
            tone=camera_profile.Tone(
                transfer=measured.transfer,
                curve=None if measured.transfer else own,
                curve_std=float(f"{measured.std:.3g}"),
                black=Measured(value=round(measured.black, _CODE_DIGITS)),
                clip=None if measured.clip is None else Measured(value=round(measured.clip, _CODE_DIGITS)),
                found=found,
            ),
            noise=_noise_part(measured.noise, found),
        )


def response(files: Path | str | Sequence[Path | str], exposures: Sequence[float] | None = None) -> ResponseMeasurement:
    """Measure how codes stand for light: the tone curve, where highlights clip, and the noise.

    The photographs show one still scene with dark and bright flat parts from a tripod; ISO, aperture and white balance are fixed, and
    exposures are one or two stops apart. A standard's curve is taken where it fits about as well as a free one (Debevec & Malik 1997).

    Args:
        files: The photographs: JPEG, PNG, TIFF or raw, all of one size.
        exposures: How long each was exposed, in seconds, in the files' order; from EXIF unless given.

    Returns:
        The curve, the code at which highlights clip, and read and shot noise, each with its deviation.

    Raises:
        ValueError: exposures are missing, too few or all alike, or the photographs do not show one scene well exposed twice.
        UnreadableError: a file is missing or damaged.

    Examples:
        A wall of grey patches at three exposures, simulated with a camera that encodes in sRGB:

        >>> import tempfile, pathlib, cv2, numpy as np, calibration
        >>> from rsvideo.physics import tone
        >>> folder, rng = pathlib.Path(tempfile.mkdtemp()), np.random.default_rng(0)
        >>> radiance = np.kron(3 * np.exp(rng.uniform(-3, 4.5, (10, 14))), np.ones((16, 16)))
        >>> files, times = [], (1 / 400, 1 / 100, 1 / 25)
        >>> for time in times:
        ...     light = radiance * time
        ...     light += 0.003 * rng.standard_normal(light.shape)
        ...     codes = 255 * tone.encode(tone.Transfer.SRGB, np.clip(light, 0, 1).astype(np.float32))
        ...     files.append(folder / f"{time:g}.png")
        ...     _ = cv2.imwrite(str(files[-1]), np.rint(codes).astype(np.uint8))
        >>> found = calibration.response(files, exposures=times)
        >>> found.transfer.value, round(found.noise.read, 3)
        ('srgb', 0.003)
    """
    sources = paths(files)
    if exposures is not None and len(exposures) != len(sources):
        raise ValueError(f"--exposures must name one time for each of {len(sources)} photographs, it names {len(exposures)}")
    stills = [still.read(path) for path in sources]
    times = list(exposures or [one.shot.exposure or 0.0 for one in stills])
    if missing := [path.name for path, time in zip(sources, times, strict=True) if not time]:
        raise ValueError(f"{missing[0]} must say its exposure in EXIF, it does not; give all with --exposures 1/1000,1/500,...")
    if exposures is None:
        times = exact_times(times)
    series = [
        Photograph(name=path.name, samples=one.codes.samples, exposure=time, linear=one.format is still.Format.RAW)
        for path, one, time in zip(sources, stills, times, strict=True)
    ]
    found = measure(series)
    rows, cols = series[0].samples.shape[:2]
    return ResponseMeasurement(response=found, rows=rows, cols=cols, files=sources, camera=stills[0].shot.camera)


def _noise_part(noise: NoiseModel | None, found: camera_profile.Found) -> camera_profile.Noise | None:
    if noise is None:
        return None
    return camera_profile.Noise(
        read=Measured(value=noise.read, std=noise.read_std or None),
        shot=Measured(value=noise.shot, std=noise.shot_std or None),
        found=found.model_copy(update={"how": noise.how}),
    )
