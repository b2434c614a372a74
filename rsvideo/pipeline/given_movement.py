"""The motion of a clip that is given in a file: angles, the samples of a sidecar, or exactly what `rsvideo track` found."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rsvideo.config.files import UnreadableError
from rsvideo.config.found_motion import Drift, Found, Terms
from rsvideo.config.sidecar import FrameRecord
from rsvideo.physics.camera import Camera
from rsvideo.physics.trajectory import Polynomial, Trajectory
from rsvideo.pipeline import given_blur
from rsvideo.pipeline.tracked import tracked
from rsvideo.restoration.movement import Evidence, Movement
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.scanlines import path_in_image
from rsvideo.shooting import given_motion

_APART = 1e-3  # s, by which a frame may begin earlier or later than the file states


def of_pictures(path: Path, camera: Camera, frames: Sequence[tuple[int, float]]) -> Movement:
    """The motion of successive frames, given as (index, seconds at which it begins).

    One that `rsvideo track` found is followed as far as it is borne out; any other as it is.
    """
    if settled := tracked(path):
        settled.check_timing(camera.timing)
        return _found(path, camera, frames)
    within, steps = given_motion.of_clip(path, camera, frames)
    for curve in within:
        given_blur.check(path, curve, camera)
    return Movement(within=[*within], steps=np.array([step or [0.0] * 3 for step in steps]), tied=[step is not None for step in steps])


def record(trajectory: Trajectory | None, evidence: Evidence | None) -> Found:
    """What was found of a frame, for its sidecar."""
    flow = evidence.flow if evidence else None
    drift = flow and Drift(
        points_px=[(x, y) for x, y in flow.points.tolist()],
        weights_px_s=[(x, y) for x, y in flow.weights.tolist()],
        length_px=flow.length,
    )
    return Found(
        path=None if trajectory is None else trajectory.coefficients.tolist(),
        drift=drift,
        error_px=evidence.error if evidence else 0.0,
        share=evidence.share if evidence else 0.0,
        certainty=evidence.certainty if evidence else 0.0,
        blur_certainty=evidence.blur_certainty if evidence else 1.0,
        exposure_shown=bool(evidence and evidence.exposure_shown),
        seeming_s=evidence.seeming if evidence else None,
        focused=evidence.focused.coefficients.tolist() if evidence and evidence.focused else None,
    )


def _found(path: Path, camera: Camera, frames: Sequence[tuple[int, float]]) -> Movement:
    """The inverse of `record`, for successive frames."""
    held = given_motion.of_frames(path, [index for index, _ in frames])
    within, evidence, steps, exposures = [], [], [], []
    for k, (index, begins) in enumerate(frames):
        frame, following = held[index], k + 1 < len(frames)
        if frame.found is None:
            raise UnreadableError(f"{path}: frame {index} must hold what was found of it, as the first does; was it put together by hand?")
        if abs(frame.time_s - begins) > _APART:
            raise UnreadableError(f"{path}: frame {index} begins at {frame.time_s:g} s, in the clip at {begins:g} s; is it another clip's?")
        taken = camera.exposed(frame.timing.exposure_s)
        curve, beside = _of_frame(path, frame, taken)
        exposures.append(frame.timing.exposure_s)
        within.append(curve)
        evidence.append(beside)
        steps.append(frame.to_next if following else None)
    axes = next((curve.coefficients.shape[1] for curve in within if curve), 3)
    return Movement(
        within=within,
        steps=np.array([step or [0.0] * 3 for step in steps])[:, :axes],
        tied=[step is not None for step in steps],
        evidence=evidence if any(within) else [],
        exposures=exposures,
    )


def _of_frame(path: Path, frame: FrameRecord, camera: Camera) -> tuple[Trajectory | None, Evidence]:
    """What `record` has taken; UnreadableError where no picture can be restored along it."""
    found = frame.found
    assert found is not None
    judged = camera if found.seeming_s is None else camera.exposed(found.seeming_s)
    drift = found.drift
    flow = drift and Flow(points=np.array(drift.points_px), weights=np.array(drift.weights_px_s), length=drift.length_px)
    curve, focused = _over(camera, found.path), _over(judged, found.focused)
    if curve is not None:
        given_blur.check(path, curve, camera, flow)
        if focused is not None:
            given_blur.check(path, path_in_image(focused, judged.timing.direction), judged, flow)
    return curve, Evidence(
        flow=flow,
        error=found.error_px,
        share=found.share,
        certainty=found.certainty,
        blur_certainty=found.blur_certainty,
        exposure_shown=found.exposure_shown,
        seeming=found.seeming_s,
        focused=focused,
    )


def _over(camera: Camera, terms: Terms | None) -> Polynomial | None:
    """A path over the interval of a frame."""
    t0, t1 = camera.timing.interval
    return None if terms is None else Polynomial(t0=t0, t1=t1, coefficients=np.array(terms))
