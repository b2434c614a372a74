"""When the material does not say how long the readout is."""

from dataclasses import dataclass


class CannotTellError(ValueError):
    """The material does not say it; the words tell why, and what would help."""


@dataclass(frozen=True, kw_only=True)
class CannotTell:
    """No readout, because the material does not show it."""

    reason: str  # and what would help
