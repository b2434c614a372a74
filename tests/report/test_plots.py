import io
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from rsvideo.config.sidecar import Camera, FrameRecord, Sampled, Settings, Sidecar, Timing
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.distortion import Distortion
from rsvideo.physics.psf import psfs_from_traces
from rsvideo.physics.shutter import Direction
from rsvideo.physics.tone import Transfer
from rsvideo.report import plots


def sidecar(*, direction: Direction = Direction.TOP_TO_BOTTOM, source: str = "explicit", x: float = 8, roll: float = 0.0) -> Sidecar:
    """A camera that moves `x` pixels and `roll` rad at constant speed over the frame's 40 ms."""
    t = Sampled.times(0, 0.04)
    u = t / 0.04 - 0.5
    camera = Camera.of(Intrinsics.centred(focal=500, rows=300, cols=400), source)
    lines = 300 if direction in (Direction.TOP_TO_BOTTOM, Direction.BOTTOM_TO_TOP) else 400
    settings = Settings(rsvideo="0", camera=camera, direction=direction, transfer=Transfer.SRGB, trajectory_from=None, restoration={})
    frame = FrameRecord(
        index=0,
        time_s=0,
        timing=Timing(exposure_s=0.02, row_time_s=0.02 / lines, source="explicit"),
        trajectory=Sampled.of(t, np.stack([x * u, 0 * u, roll * u], axis=1)),
        verdict="restored",
        seconds=1,
    )
    return Sidecar(input="in.png", settings=settings, frames=[frame])


@pytest.mark.parametrize("kind", plots.FORMATS)
def test_every_format_is_drawn(kind: str) -> None:
    data = plots.motion(sidecar(), kind)
    assert data.startswith({"png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}[kind])


@pytest.mark.parametrize("direction", [Direction.BOTTOM_TO_TOP, Direction.LEFT_TO_RIGHT])
def test_every_direction_is_drawn_on_white_with_something_on_it(direction: Direction) -> None:
    with Image.open(io.BytesIO(plots.motion(sidecar(direction=direction, roll=0.02), "png"))) as image:
        grey = np.asarray(image.convert("L"))
    assert grey[:3].min() == 255
    assert 0.01 < (grey < 128).mean() < 0.3


def test_a_focal_length_that_was_assumed_gives_no_degrees() -> None:
    svg = plots.motion(sidecar(source="explicit"), "svg"), plots.motion(sidecar(source="assumed"), "svg")
    assert b"<!-- angle" in svg[0]
    assert b"<!-- angle" not in svg[1]


def test_a_steady_pan_leaves_a_straight_trace_as_long_as_half_its_way() -> None:
    record = sidecar(x=8)
    trace = plots._trace(np.array([200.0, 150.0]), record, record.frames[0], record.timing(record.frames[0]))
    assert np.ptp(trace[:, 0]) == pytest.approx(4, rel=0.01)  # the exposure is half of the interval
    assert np.ptp(trace[:, 1]) == 0
    assert trace[0, 0] > trace[-1, 0]  # the camera turns right, the image moves left


def test_the_blur_of_a_trace_holds_all_its_light() -> None:
    traces = np.random.default_rng(0).uniform(-5, 5, (4, 300, 2))
    kernels = psfs_from_traces(traces, 7)
    np.testing.assert_allclose(kernels.sum(axis=(1, 2)), 1)
    y, x = np.indices(kernels.shape[1:]) - 7
    centroids = np.stack([(kernels * x).sum(axis=(1, 2)), (kernels * y).sum(axis=(1, 2))], axis=-1)
    np.testing.assert_allclose(centroids, traces.mean(axis=1), atol=1e-12)


def test_a_frame_that_did_not_move_is_drawn_too() -> None:
    assert plots.motion(sidecar(x=0), "png").startswith(b"\x89PNG")


def test_the_trace_of_a_point_is_drawn_through_the_lens() -> None:
    plain = sidecar(roll=0.02)
    camera = replace(plain.settings.camera.intrinsics, distortion=Distortion(model="brown-conrady", coefficients=(-0.25, 0.08, 0.0, 0.0)))
    lensed = plain.model_copy(update={"settings": plain.settings.model_copy(update={"camera": Camera.of(camera, "")})})
    for at, where in ((np.array([30.0, 30.0]), "corner"), (np.array([199.5, 149.5]), "middle")):
        moved = [np.ptp(plots._trace(at, said, said.frames[0], said.timing(said.frames[0])), axis=0) for said in (plain, lensed)]
        assert np.allclose(*moved, atol=0.01) == (where == "middle")
