"""What the search for a clip's motion found of a frame, as its sidecar holds it."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, model_validator

from rsvideo.physics.shutter import LONGEST_MODELLED

Finite = Annotated[float, Field(allow_inf_nan=False, ge=-1e12, le=1e12)]
Middle = Annotated[float, Field(allow_inf_nan=False, ge=-1e6, le=1e6)]  # px


class Record(BaseModel):
    """A part of a sidecar: nothing is left over, and nothing changes."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Drift(Record):
    """How the points of a frame move beside its path, along the scanlines: `rsvideo.restoration.parallax.Flow`."""

    points_px: Annotated[list[tuple[Middle, Middle]], Field(fail_fast=True, min_length=1, max_length=1000)]
    weights_px_s: Annotated[list[tuple[Finite, Finite]], Field(fail_fast=True)]
    length_px: Annotated[float, Field(gt=0, le=1e6, allow_inf_nan=False)]

    @model_validator(mode="after")
    def _check(self) -> "Drift":
        if len(self.points_px) != len(self.weights_px_s):
            raise ValueError("points_px and weights_px_s must be equally long")
        return self


Terms = Annotated[list[Annotated[list[Finite], Field(min_length=2, max_length=3)]], Field(fail_fast=True, min_length=1, max_length=64)]
"""Coefficients of a polynomial, (terms, axes)."""


class Found(Record):
    """What the search for a clip's motion found of a frame, exactly: restored along it, the frame has the pixels that follow the search."""

    path: Terms | None
    """Of a polynomial over the frame's interval, in image axes; None: no point of the frame could be followed."""
    drift: Drift | None  # None: all points move along the path
    error_px: Annotated[Finite, Field(ge=0)]  # by which the blur of one exposure may depart from path and drift
    share: Annotated[float, Field(ge=0, le=1)]  # of a restoration: whether the blur of the run bears its path out
    certainty: Annotated[float, Field(ge=0, le=1)]  # of the scanlines' displacements: how far the frame is straightened
    blur_certainty: Annotated[float, Field(ge=0, le=1)] = 1.0  # of the blur: the less of it, the more of the blur the frame has to show
    exposure_shown: bool = False  # whether the clip's blur has shown its exposure
    seeming_s: Annotated[float | None, Field(gt=0, lt=LONGEST_MODELLED, allow_inf_nan=False)] = None
    """The exposure that the frame's blur shows, softness included, whose interval `focused` is over; None: the frame's own."""
    focused: Terms | None = None  # of the path, along the scanlines, that the frame's focus led to; None: it is `path`
    doubts: Annotated[list[Terms], Field(max_length=64, exclude=True)] = []  # of files by earlier versions; not needed any more

    @model_validator(mode="after")
    def _check(self) -> "Found":
        if self.path and len({len(term) for term in self.path}) > 1:
            raise ValueError("path must have equally many axes in all terms")
        if self.path and self.focused and {len(term) for term in self.focused} != {len(self.path[0])}:
            raise ValueError("focused must have as many axes as path")
        if self.seeming_s and not self.focused:
            raise ValueError("focused must be given beside seeming_s")
        if self.path and any([*map(len, move)] != [*map(len, self.path)] for move in self.doubts):
            raise ValueError("doubts must have as many terms and axes as path")
        return self
