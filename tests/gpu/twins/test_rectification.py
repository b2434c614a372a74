"""A frame straightened on the device is the processor's, whose OpenCV rounds places to 1/32 px."""

import cv2
import numpy as np
import pytest
import skimage.data

from rsvideo.frame import Frame
from rsvideo.gpu import arrays
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, centred
from rsvideo.restoration.rectification import Share, straightened
from rsvideo.restoration.scanlines import to_scanlines

LARGE = not arrays.SIMULATED
ROWS, COLS, CHANNELS = (180, 240, 3) if LARGE else (21, 35, 2)
TURN = np.array([[0.0, 0.0, 0.0], [5.0, -2.0, 0.01], [1.0, 1.5, 0.0]])
TURNED = "along a path"


@pytest.mark.parametrize("path", [TURNED, "with a latent image only", "along a path, with a latent image"])
@pytest.mark.parametrize("readout", [0.02, 0.0], ids=["rolling", "global"])
def test_what_is_shown_is_the_processors(path: str, readout: float) -> None:
    timing = ShutterTiming.from_readout(exposure=0.02, readout=readout, rows=ROWS)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=300.0, rows=ROWS, cols=COLS))
    smooth = cv2.GaussianBlur(skimage.data.astronaut()[60 : 60 + ROWS, 160 : 160 + COLS, :CHANNELS].astype(np.float32), (0, 0), 1.5)
    pixels = (smooth / 255) ** 2.2
    view = to_scanlines(Frame(pixels=pixels, clipped=pixels > 1), camera)
    moving = centred(Polynomial(t0=0.0, t1=timing.interval[1], coefficients=TURN), timing.middle) if TURNED in path else None
    share = np.random.default_rng(0).random((ROWS, COLS, 1)).astype(np.float32)
    latent = Share(1.3 * pixels[::-1] - 0.1, share, reach=3, lamp=0.5) if "latent" in path else None
    here, there = (straightened(view, moving, moved=0.7, device=device, latent=latent) for device in ("cpu", "cuda"))
    np.testing.assert_allclose(there, here, atol=3e-3)
    assert moving is None or readout == 0 or np.abs(straightened(view, moving) - pixels).max() > 0.02
