"""Neighbours brought to a frame's pose on the device are the processor's, whose OpenCV rounds places to 1/32 px."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import skimage.data

from rsvideo.frame import Frame
from rsvideo.gpu import arrays
from rsvideo.physics.camera import Camera, Intrinsics, resampled_at
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, Trajectory, centred
from rsvideo.restoration import alignment, device_frame, fusion, multi_frame, nonblind, settings
from rsvideo.restoration.fusion import PosedImage
from rsvideo.restoration.movement import Evidence, Movement
from rsvideo.restoration.nodes import NODES, nodes
from rsvideo.restoration.predicted_blur import confirmed
from rsvideo.restoration.settings import Device, Settings

LARGE = not arrays.SIMULATED
ROWS, COLS, CHANNELS = (180, 240, 3) if LARGE else (19, 23, 1)
LENS = Intrinsics.centred(focal=300.0, rows=ROWS, cols=COLS)
CAMERA = Camera(timing=ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=ROWS), intrinsics=LENS)
AWAY = np.array([1.3, -0.6, 0.004])  # px, px, rad
AMISS = np.array([0.4, 0.3, 0.001])  # by which that is misjudged


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    """The simulator's picture is nearly all borders; every second row and column is compared."""
    if not LARGE:
        monkeypatch.setattr(alignment, "EDGE", 3)
        monkeypatch.setattr(fusion, "PATCH", 5)
    monkeypatch.setattr(alignment, "PLENTY", ROWS * COLS / 4)


def polynomial(coefficients: np.ndarray) -> Trajectory:
    return centred(Polynomial(t0=0.0, t1=CAMERA.timing.interval[1], coefficients=coefficients), CAMERA.timing.middle)


def path() -> Trajectory:
    return polynomial(np.array([[0.0, 0.0], [2.0, -1.0], [0.7, 0.5]]))


def at_pose(pose: np.ndarray) -> np.ndarray:
    """What a camera turned so sees of a photograph, smooth enough that 1/64 px changes it by a few thousandths."""
    whole = ((skimage.data.astronaut()[..., :CHANNELS] / 255) ** 2.2).astype(np.float32)
    x, y = np.meshgrid(np.arange(COLS, dtype=float), np.arange(ROWS, dtype=float))
    at = resampled_at(LENS, pose, x, y).astype(np.float32) + np.array([160, 60], np.float32)
    return cv2.remap(cv2.GaussianBlur(whole, (0, 0), 1.5), at[..., 0], at[..., 1], cv2.INTER_CUBIC).reshape(ROWS, COLS, CHANNELS)


@pytest.fixture
def pair() -> tuple[PosedImage, PosedImage]:
    """A frame's own image, and a neighbour's, whose pose is not quite what it is held to be."""
    own = PosedImage(latent=at_pose(np.zeros(3)), pose=np.zeros(3), length=6.0)
    return own, PosedImage(latent=at_pose(AWAY), pose=AWAY + AMISS, length=3.0)


def test_the_displacement_found_is_the_processors_and_the_true_one(pair: tuple[PosedImage, PosedImage]) -> None:
    first, other = pair
    columns, step, basis = nodes(COLS), alignment.thinned(ROWS, COLS), alignment.bends(ROWS)
    x, y = np.meshgrid(columns.astype(float), np.arange(ROWS, dtype=float))
    at = resampled_at(LENS, -other.pose, x, y)
    soft = alignment.softened(first.latent), alignment.softened(other.latent)
    expected = alignment.misaligned(*soft, at, columns)
    assert step == 2
    how = {"edge": alignment.EDGE, "step": step, "outlier": alignment.OUTLIER, "least_difference": alignment.LEAST_DIFFERENCE}
    rows = nodes(ROWS)
    drift = at[rows] - np.stack([x, y], axis=-1)[rows]
    neighbour = device_frame.neighbour(first.there, other.there, drift, NODES, **how)
    found = alignment.least_squares(ROWS, step, lambda found: neighbour.sums(found @ basis.T))
    moved = np.swapaxes(found @ basis.T, 1, 2)
    side = np.linspace(-0.5, 0.5, COLS)[columns]
    displacement = moved[0][:, None] + moved[1][:, None] * side[:, None]
    np.testing.assert_allclose(displacement, expected, atol=0.02)
    assert np.abs(displacement).max() > 0.2
    if LARGE:
        np.testing.assert_allclose(displacement, resampled_at(LENS, -AWAY, x, y) - at, atol=0.15)


def test_what_neighbours_make_of_a_frame_is_the_processors(pair: tuple[PosedImage, PosedImage]) -> None:
    first, other = pair
    stranger = PosedImage(latent=np.ascontiguousarray(other.latent[::-1]), pose=np.zeros(3), length=3.0)
    clipped = first.latent > np.quantile(first.latent, 0.97)
    how = {"samples": 5, "tolerance": 0.25}
    frames = [tiled(first.latent, clipped, path(), CAMERA, **how) for tiled in (nonblind.tiled, device_frame.tiled)]
    own = np.linspace(0, 1, ROWS * COLS, dtype=np.float32).reshape(ROWS, COLS)
    still = {"own": own, "displaced": lambda image: image}
    here, there = (fusion.fused(frame, first, [other, stranger], LENS, 2e-3, 0.05, **still) for frame in frames)
    np.testing.assert_array_equal(there.shown, here.shown)
    np.testing.assert_array_equal(there.astray, here.astray)
    assert 0 < here.astray.mean() < 1
    assert 0.1 < here.shown.mean() < 1
    np.testing.assert_allclose(there.explained, here.explained, atol=0.03)
    np.testing.assert_allclose(there.support, here.support, atol=0.03)
    assert here.predicted is not None
    assert there.predicted is not None
    found, expected = (confirmed(predicted) for predicted in (there.predicted, here.predicted))
    assert found.whole == pytest.approx(expected.whole, abs=0.03)
    np.testing.assert_allclose(np.median(found.about), np.median(expected.about), atol=0.05)
    latent = here.solved()
    np.testing.assert_allclose(frames[1].to_host(there.solved()), latent, atol=3e-3)
    assert np.abs(latent - first.latent).max() > 0.02


def test_a_clip_is_the_processors(pair: tuple[PosedImage, PosedImage], monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames restored by themselves, with one another, straightened and mixed, from one device's memory to the other's and back."""
    if not LARGE:
        monkeypatch.setattr(settings, "TV_FIRST_STEPS", 1)
        draft = replace(settings.EFFORTS["draft"], tv_steps=1)
        monkeypatch.setattr(settings, "EFFORTS", settings.EFFORTS | {"draft": draft})
        monkeypatch.setattr(nonblind, "finished", lambda _, latent, __: latent)  # tests of a frame have it
    monkeypatch.setattr(multi_frame, "trust", lambda scene, *_: np.linspace(0.5, 1, scene.frame.size, dtype=np.float32).reshape(ROWS, COLS))
    frames = [Frame(pixels=image.latent, clipped=image.latent > 0.9, index=k) for k, image in enumerate(pair)]
    evidence = Evidence(flow=None, error=0.1, share=0.9, certainty=0.8)
    two = polynomial(np.array([[0.0, 0.0, 0.0], [2.0, -1.0, 0.002], [0.7, 0.5, 0.0]]))
    moved = Movement(within=[two, two], steps=np.stack([pair[1].pose, 0 * AWAY]), tied=[True, False], evidence=[evidence, evidence])

    def restored(device: Device) -> list[np.ndarray]:
        return [result.latent for result in multi_frame.restored(frames, moved, CAMERA, Settings(device=device, samples=5))]

    for there, here, frame in zip(restored("cuda"), restored("cpu"), frames, strict=True):
        inner = np.s_[16:-16, 16:-16] if LARGE else np.s_[:, :]  # at the sides of several tiles both assume different things
        np.testing.assert_allclose(there[inner], here[inner], atol=0.01)
        assert np.sqrt(np.mean((there - here) ** 2)) < 2e-3
        assert np.abs(there - frame.pixels).max() > 0.05
