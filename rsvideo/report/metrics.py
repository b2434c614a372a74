"""How near a restored picture comes to the truth, and a found path to the recorded one."""

import cv2
import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

BORDER = 40  # px left out on every side: what a moving camera saw there differs


def psnr(image: Float[np.ndarray, "rows cols channels"], truth: Float[np.ndarray, "rows cols channels"]) -> float:
    """PSNR in dB of code values in [0, 1] after the best translation and the best single scale of intensity.

    A single blurred frame can tell neither (Koehler et al., ECCV 2012). A border is left out where there is room for one.
    """
    border = min(BORDER, min(image.shape[:2]) // 4)
    inside = np.s_[border:-border, border:-border]

    def error(shift: np.ndarray) -> float:
        matrix = np.array([[1, 0, shift[0]], [0, 1, shift[1]]], np.float32)
        moved = cv2.warpAffine(image, matrix, image.shape[1::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        a, b = moved.reshape(image.shape)[inside], truth[inside]
        scale = float((a * b).sum()) / max(float((a * a).sum()), 1e-12)
        return float(np.mean((scale * a - b) ** 2))

    grey = [cv2.GaussianBlur(x.mean(axis=2, dtype=np.float32), (0, 0), 1.5) for x in (image, truth)]
    found, _ = cv2.phaseCorrelate(grey[0], grey[1], cv2.createHanningWindow(grey[0].shape[::-1], cv2.CV_32F))
    starts = [np.zeros(2), np.array(found)] if max(map(abs, found)) < 64 else [np.zeros(2)]
    start = min(starts, key=error)
    simplex = start + np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5]])
    best = minimize(error, start, method="Nelder-Mead", options={"initial_simplex": simplex, "xatol": 0.01, "fatol": 1e-9, "maxiter": 80})
    return float(-10 * np.log10(max(best.fun, 1e-12)))


def path_error(found: Float[np.ndarray, "n axes"], truth: Float[np.ndarray, "n axes"]) -> float:
    """RMS distance in px of two sampled paths in x and y, after removing the mean difference."""
    d = (found - truth)[:, :2]
    return float(np.sqrt(((d - d.mean(axis=0)) ** 2).sum(axis=1).mean()))
