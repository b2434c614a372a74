"""What a method leaves unexplained of a frame: b - K l, by the motion or the kernels that it found."""

import cv2
import numpy as np

from rsvideo.comparison.decoded import Light
from rsvideo.config.sidecar import FrameRecord, Sidecar
from rsvideo.physics.blur import BlurOperator
from rsvideo.physics.camera import Camera
from rsvideo.physics.trajectory import Spline, centred, fit

_TERMS = 20  # of the spline that stands for a sampled trajectory
_SAMPLES = 16  # of each scanline's exposure


def of(record: FrameRecord, sidecar: Sidecar, recording: Light, restored: Light) -> Light | None:
    """b - K l in luminance, and where it has a value; None where the method does not say how it explains the frame."""
    (b, valid), (latent, _) = recording, restored
    if b.shape != latent.shape:
        return None
    if record.psfs is not None:
        again, border = _convolved(latent, np.asarray(record.psfs, np.float32))
    elif np.any(record.trajectory.poses()):
        again, border = _moved(latent, record, sidecar)
    else:
        return None
    inside = np.zeros_like(valid)
    if min(b.shape) <= 2 * border:
        return None
    inside[border:-border, border:-border] = True
    return b - again, valid & inside


def _moved(latent: np.ndarray, record: FrameRecord, sidecar: Sidecar) -> tuple[np.ndarray, int]:
    """K l of the trajectory that was found, and how many pixels of the border it does not know."""
    t, poses = np.array(record.trajectory.t_s), record.trajectory.poses()
    if not poses[:, 2].any():
        poses = poses[:, :2]
    camera = Camera(timing=sidecar.timing(record), intrinsics=sidecar.settings.camera.intrinsics)
    blank = Spline(t0=float(t[0]), t1=float(t[-1]), coefficients=np.zeros((min(_TERMS, len(t)), poses.shape[1])))
    path = centred(fit(blank, t, poses), camera.timing.middle)
    operator = BlurOperator.covering(path, camera=camera, samples=_SAMPLES, slack=0)
    down, right = operator.margin
    padded = cv2.copyMakeBorder(latent, down, down, right, right, cv2.BORDER_REPLICATE)
    return operator.forward(padded), max(down, right)


def _convolved(latent: np.ndarray, psfs: np.ndarray) -> tuple[np.ndarray, int]:
    """Kernels over a grid of the frame, mixed linearly between their places, applied to the latent image."""
    down, across, k, _ = psfs.shape
    rows, cols = latent.shape
    weights = [
        np.stack([np.interp(np.arange(n), (np.arange(m) + 0.5) * n / m - 0.5, np.eye(m)[i]) for i in range(m)])
        for n, m in ((rows, down), (cols, across))
    ]
    out = np.zeros_like(latent)
    for i in range(down):
        for j in range(across):
            blurred = cv2.filter2D(latent, -1, psfs[i, j, ::-1, ::-1], borderType=cv2.BORDER_REPLICATE)
            out += (weights[0][i][:, None] * weights[1][j][None]).astype(np.float32) * blurred
    return out, k // 2 + 1
