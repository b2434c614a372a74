"""Each of the paper's steps can take the place of the project's, by itself or together."""

from typing import Literal

import numpy as np
import pytest
import skimage.data

from rsvideo.paper import estimate as paper
from rsvideo.physics import simulate
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial
from rsvideo.restoration.scene import Scene
from rsvideo.restoration.settings import Settings

ROWS, COLS = 120, 160
TIMING = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=ROWS)
CAMERA = Camera(timing=TIMING, intrinsics=Intrinsics.centred(focal=300.0, rows=ROWS, cols=COLS))
TRUE = Polynomial(t0=0.0, t1=TIMING.interval[1], coefficients=np.array([[0.0, 0.0], [5.0, -2.5], [1.2, 1.2]]))


@pytest.fixture(scope="module")
def scene() -> Scene:
    """A photograph as a moving camera records it."""
    sharp = (skimage.data.astronaut()[30:230, 90:330].mean(axis=2) / 255) ** 2.2
    frame = simulate.blur(sharp[..., None], camera=CAMERA, trajectory=TRUE, samples=24)[..., 0]
    frame = (frame + 0.001 * np.random.default_rng(0).standard_normal(frame.shape)).astype(np.float32)
    return Scene(frame=frame, valid=np.ones_like(frame), camera=CAMERA, samples=16, tiles=1, noise=0.001)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("start", "refinement", "stages"),
    [
        ("tracing", "sparsity", ["strip kernels", "candidate paths", "the same path backwards", "path"]),
        ("kernels", "alternation", ["strip kernels", "alternation"]),
        ("tracing", "alternation", ["strip kernels", "alternation"]),
    ],
)
def test_the_stages_are_those_that_were_chosen(
    scene: Scene, start: Literal["kernels", "tracing"], refinement: Literal["sparsity", "alternation"], stages: list[str]
) -> None:
    settings = Settings(start=start, refinement=refinement, motion="shift", degree=2, samples=16, mu=2e-3)
    assert paper.chosen(settings)
    estimates = list(paper.estimate(scene, settings))
    assert list(dict.fromkeys(e.stage for e in estimates)) == stages
    assert [e.fraction for e in estimates] == sorted(e.fraction for e in estimates)
    t = np.linspace(*TIMING.interval, 65)
    apart = estimates[-1].trajectory.at(t) - TRUE.at(t)
    off = np.sqrt(((apart - apart.mean(axis=0)) ** 2).sum(axis=1).mean())
    assert off < 2.5 or (start, refinement) == ("tracing", "alternation")  # of a path of 17 px; the two together find it backwards here


def test_alternation_ends_when_mu_is_at_its_last_value(scene: Scene) -> None:
    settings = Settings(mu=4e-3, mu_factor=0.5, mu_last=1e-3, samples=8)
    assert len(list(paper.alternated(scene, TRUE, settings))) == 3


def test_by_default_no_step_is_the_papers() -> None:
    assert not paper.chosen(Settings())
