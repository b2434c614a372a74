"""When the material does not say how long the readout is."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Likeliest:
    """A readout that is no answer, since it is too uncertain, and better than any other guess."""

    readout: float  # seconds, negative upwards
    std: float


class CannotTellError(ValueError):
    """The material does not say it; the words tell why, and what would help."""

    likeliest: Likeliest | None  # where the material shows one, all the same

    def __init__(self, reason: str, likeliest: Likeliest | None = None) -> None:
        """`likeliest` where no other readout explains the material nearly as well."""
        super().__init__(reason)
        self.likeliest = likeliest


class TooFewPointsError(CannotTellError):
    """No readout was tried, since too few points could be followed."""


class StabilisedError(CannotTellError):
    """The frames were shifted after they were read, so that their motion does not go on within them."""


@dataclass(frozen=True, kw_only=True)
class CannotTell:
    """No readout, because the material does not show it.

    Examples:
        A wall under a light that does not flicker, simulated:

        >>> import tempfile, pathlib, cv2, calibration
        >>> from rsvideo.physics.shutter import ShutterTiming
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "wall.png"
        >>> timing = ShutterTiming.from_readout(exposure=2e-4, readout=0.020, rows=240)
        >>> _ = cv2.imwrite(str(file), calibration.flicker.wall(timing, hertz=1000.0, depth=0.0))
        >>> calibration.readout(file, flicker=1000.0)
        CannotTell(reason='no bands stand out from the scene; film a plain wall, more closely lit, with a short exposure')
    """

    reason: str  # and what would help
