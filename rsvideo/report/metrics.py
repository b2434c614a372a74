"""How near a picture comes to the truth, and what it tells of its own quality where there is no truth.

Pictures are codes in [0, 1]. A measure that finds nothing to measure is nan.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import map_coordinates
from scipy.optimize import minimize

from rsvideo.physics.luminance import BT709_WEIGHTS

BORDER = 40  # px left out on every side: what a moving camera saw there differs
_BORDER_PART = 4  # the border is a quarter of a small picture's side at most
Colours = Float[np.ndarray, "rows cols channels"]
Grey = Float[np.ndarray, "rows cols"]

_TINY = 1e-12  # mean squares below count as this, so that equal pictures are 120 dB apart

# aligning
_MOST_STEPS = 20  # of Gauss and Newton
_LEAST_STEP = 0.005  # px
_ALIGNING_BLUR = 1.5  # px, of the pictures whose phases are correlated
_FARTHEST = 64  # px; a larger shift is a slip of the correlation
_SIMPLEX = 0.15  # px, of Nelder-Mead's first steps; derivatives do not show how interpolation smooths noise; origin: by trial
_SETTLED = {"xatol": 0.04, "fatol": 3e-7, "maxiter": 10}  # px, and linear light squared; origin: by trial
_CUBIC = 3  # px that a cubic interpolation reads beyond its place
_SSIM_SIDE, _SSIM_SIGMA = 11, 1.5  # px, of the Gaussian window (Wang et al. 2004)
_SSIM_C1, _SSIM_C2 = 1e-4, 9e-4  # (0.01 L)^2 and (0.03 L)^2 with white L = 1 (Wang et al. 2004)

# edges
_REACH = 10  # px that a profile goes to either side of its edge
_STEP = 0.5  # px from one sample of a profile to the next
_ALONG = 2  # px to either side that a profile is averaged over along its edge
_EDGES = 400  # strongest edges that are measured
_CELL = 12  # px: of each cell of the picture, only the strongest edge
_FAINTEST = 0.01  # of white a pixel; fainter gradients are no edges
_OVER_MEDIAN = 4  # as strong as the picture's median gradient an edge must be: below, noise may be taken for one
_LOWEST = 0.04  # of white that an edge must rise by
_FROM, _TO = 0.1, 0.9  # of an edge's height, between which its width is measured

# ringing
_SURROUNDINGS = 25  # px that must be flat around a place
_FLAT_PERCENT, _FLATTEST = 20, 0.03  # the quietest part of the recording, as far as its gradients stay below, in white a pixel
_FEWEST_PIXELS = 100  # that say something
_FINE, _COARSE = 1.0, 5.0  # px; what lies between these two Gaussians has wavelengths of about 5 to 30 px

# residuals
_LAGS = 4  # px up to which residuals are correlated
_LEAST_VALID = 0.1  # part of a frame whose residual says something
_NO_RESIDUAL = 1e-14  # mean square; less is rounding, and has no correlation

# lines
_FEWEST_LINES = 3  # that say something
_MOST_LINES = 40
_CURVED = 0.02  # of a line's length, that its points lie off: what bends so much is curved in the world
_SWAY = 5  # px that a line's points may lie off
_GAP = 6  # px of a line that may be hidden
_BEYOND = 10  # px by which a segment may stick out of another and still be the same line
_STRONG_PERCENT = 90  # of the gradients lie below a strong one
_WHOLE = 0.9  # part of a line's points at which there must be an edge
_FEWEST_POINTS = 12
_JUMP, _JUMP_PERCENT = 0.6, 97  # px that an edge's place may change from one pixel to the next, in so many of them
_SHORTEST = 4  # a line is a quarter of the picture's shorter side long at least
_SWELL = 5  # px to which drawn edges are widened, so that a line may sway
_ACROSS = 0.5  # px between the samples across a line
_PEAK = 3  # samples to either side of an edge's peak that its place is averaged over; origin: by trial

# flicker
_DETAIL = 3.0  # px; what a Gaussian of this width takes away is detail
_COUNTED = 0.95  # of the pixels count; the rest differ most because something hides or uncovers them
_NO_DETAIL = 1e-9  # mean square of detail; less is none


@dataclass(frozen=True, kw_only=True, eq=False)
class Aligned:
    """A picture moved and scaled onto the truth, and the truth, both without their borders."""

    image: Colours
    truth: Colours


def luma(image: Colours) -> Grey:
    """BT.709's luma; grey stays itself."""
    return image[..., 0].astype(np.float32) if image.shape[2] == 1 else image.astype(np.float32) @ BT709_WEIGHTS


def aligned(image: Colours, truth: Colours) -> Aligned:
    """After the best translation and the best single scale of intensity, which a single blurred frame cannot tell.

    (Koehler et al., ECCV 2012.) A border of 40 px is left out where there is room for one.
    """
    border = min(BORDER, min(image.shape[:2]) // _BORDER_PART)
    inside = np.s_[border:-border, border:-border]
    grey = [np.ascontiguousarray(x.mean(axis=2, dtype=np.float32)) for x in (image, truth)]
    b = grey[1][inside]

    def parts(shift: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        a = _moved(grey[0], shift, border)
        a = a * np.float32(_scale(a, b))
        d = a - b
        return float(np.vdot(d, d)) / d.size, a, d

    soft = [cv2.GaussianBlur(x, (0, 0), _ALIGNING_BLUR) for x in grey]
    found, _ = cv2.phaseCorrelate(soft[0], soft[1], cv2.createHanningWindow(soft[0].shape[::-1], cv2.CV_32F))
    starts = [np.zeros(2), np.array(found)] if max(map(abs, found)) < _FARTHEST else [np.zeros(2)]
    shift = min(starts, key=lambda start: parts(start)[0])
    error, a, d = parts(shift)
    for _ in range(_MOST_STEPS):  # Gauss and Newton's, halved until the error falls
        G = np.stack([cv2.Sobel(a, cv2.CV_32F, *axis, ksize=1, scale=0.5).ravel() for axis in ((1, 0), (0, 1))])
        step = np.linalg.lstsq((G @ G.T).astype(float), (G @ d.ravel()).astype(float))[0]
        while (tried := parts(shift + step))[0] >= error and np.abs(step).max() > _LEAST_STEP:
            step = step / 2
        if np.abs(step).max() <= _LEAST_STEP:
            break
        shift, (error, a, d) = shift + step, tried
    sure = truth[inside]

    def pair(at: np.ndarray) -> Aligned:
        a = _moved(image, at, border)
        return Aligned(image=a * image.dtype.type(_scale(a, sure)), truth=sure)

    def cost(at: np.ndarray) -> float:
        d = pair(at)
        d = (d.image - d.truth).ravel()
        return float(np.vdot(d, d)) / d.size

    simplex = shift + _SIMPLEX * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    best = minimize(cost, shift, method="Nelder-Mead", options={"initial_simplex": simplex, **_SETTLED})
    return pair(best.x)


def _moved(image: np.ndarray, shift: np.ndarray, border: int) -> np.ndarray:
    """The inside of an image that is moved by `shift`; what lies further off than that is not looked at."""
    reach = min(border, int(np.ceil(np.abs(shift).max())) + _CUBIC)
    cut = border - reach
    rows, cols = image.shape[:2]
    near = image[cut : rows - cut, cut : cols - cut]
    matrix = np.array([[1, 0, shift[0]], [0, 1, shift[1]]], np.float32)
    out = cv2.warpAffine(near, matrix, near.shape[1::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT).reshape(near.shape)
    return out[reach : rows - 2 * cut - reach, reach : cols - 2 * cut - reach]


def _scale(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.vdot(a, b)) / max(float(np.vdot(a, a)), _TINY)


def psnr(image: Colours, truth: Colours) -> float:
    """PSNR in dB, 10 lg 1 / mean (image - truth)^2, of what `aligned` makes of both; more is better."""
    return psnr_of(aligned(image, truth))


def psnr_of(pair: Aligned) -> float:
    """PSNR in dB of a pair that is aligned; more is better."""
    d = (pair.image - pair.truth).ravel()
    return float(-10 * np.log10(max(float(np.dot(d, d)) / d.size, _TINY)))


def ssim_of(pair: Aligned) -> float:
    """SSIM of luma in [-1, 1], 1 for the truth itself; more is better.

    Mean of (2 mu_a mu_b + C1)(2 s_ab + C2) / ((mu_a^2 + mu_b^2 + C1)(s_a^2 + s_b^2 + C2)) under Gaussian windows of 1.5 px,
    C1 = 0.01^2, C2 = 0.03^2 (Wang et al., IEEE TIP 2004).
    """
    a, b = luma(pair.image), luma(pair.truth)

    def mean(x: Grey) -> Grey:
        return cv2.GaussianBlur(x, (_SSIM_SIDE, _SSIM_SIDE), _SSIM_SIGMA, borderType=cv2.BORDER_REFLECT)

    mu_a, mu_b = mean(a), mean(b)
    s_a, s_b, s_ab = mean(a * a) - mu_a**2, mean(b * b) - mu_b**2, mean(a * b) - mu_a * mu_b
    local = (2 * mu_a * mu_b + _SSIM_C1) * (2 * s_ab + _SSIM_C2) / ((mu_a**2 + mu_b**2 + _SSIM_C1) * (s_a + s_b + _SSIM_C2))
    edge = _SSIM_SIDE // 2 if min(local.shape) >= 2 * _SSIM_SIDE - 1 else 0  # windows that hang over
    return float(local[edge : local.shape[0] - edge, edge : local.shape[1] - edge].mean(dtype=np.float64))


def edge_width(image: Grey) -> float:
    """Median distance in px over which an edge rises from 10 to 90 % of its height; less is sharper.

    (Marziliano et al., ICIP 2002, here across the edge.) Of each cell of 12 px the strongest edge, and of these the 400 strongest
    count; each is averaged over 5 px along itself, so that noise counts little.
    """
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.0)
    gx, gy = (cv2.Sobel(smooth, cv2.CV_32F, *d, ksize=3, scale=1 / 8) for d in ((1, 0), (0, 1)))
    strength = np.hypot(gx, gy)
    r, c = _strongest(strength, margin=_REACH + 3)
    if not len(r):
        return np.nan
    normal = np.stack([gy[r, c], gx[r, c]]) / strength[r, c]
    tangent = np.stack([-normal[1], normal[0]])
    s = np.arange(-_REACH, _REACH + _STEP / 2, _STEP)
    along = np.arange(-_ALONG, _ALONG + 1)
    at = (
        np.stack([r, c])[:, :, None, None]
        + normal[:, :, None, None] * s[None, None, None, :]
        + tangent[:, :, None, None] * along[None, None, :, None]
    )
    profiles = map_coordinates(image, at.reshape(2, -1), order=1).reshape(at.shape[1:]).mean(axis=1)
    widths = np.array([_width(p) for p in profiles.astype(float)])
    return float(np.nanmedian(widths)) if np.isfinite(widths).any() else np.nan


def _strongest(strength: Grey, margin: int) -> tuple[np.ndarray, np.ndarray]:
    rows, cols = ((n - 2 * margin) // _CELL for n in strength.shape)
    if rows < 1 or cols < 1:
        return np.zeros(0, int), np.zeros(0, int)
    inner = strength[margin : margin + rows * _CELL, margin : margin + cols * _CELL]
    cells = inner.reshape(rows, _CELL, cols, _CELL).transpose(0, 2, 1, 3).reshape(rows * cols, -1)
    best = cells.argmax(axis=1)
    peak = cells[np.arange(len(cells)), best]
    floor = max(_FAINTEST, _OVER_MEDIAN * float(np.median(strength)))
    chosen = np.argsort(-peak)[:_EDGES]
    chosen = chosen[peak[chosen] > floor]
    return margin + chosen // cols * _CELL + best[chosen] // _CELL, margin + chosen % cols * _CELL + best[chosen] % _CELL


def _width(p: np.ndarray) -> float:
    """Of one rising profile; nan where it hardly rises."""
    middle = len(p) // 2
    falls = np.diff(p) <= 0
    left, right = np.flatnonzero(falls[:middle]), np.flatnonzero(falls[middle:])
    a = int(left[-1]) + 1 if len(left) else 0
    b = middle + int(right[0]) if len(right) else len(p) - 1
    if (height := p[b] - p[a]) < _LOWEST:
        return np.nan
    begin, end = np.interp([p[a] + _FROM * height, p[a] + _TO * height], p[a : b + 1], np.arange(a, b + 1) * _STEP)
    return float(end - begin)


def ringing(image: Grey, recording: Grey) -> float:
    """RMS in % of white of what a picture shows at wavelengths of about 5 to 30 px where the recording is flat; less is better.

    Flat are the places whose surroundings of 25 px are the quietest fifth of the recording. What stands there in a restored
    picture has leaked from edges further off, or is noise (after the ringing measure of Liu et al., SIGGRAPH Asia 2013). Faint
    texture that the blur has wiped out counts too: compare with the value of the truth where there is one.
    """
    smooth = cv2.GaussianBlur(recording.astype(np.float32), (0, 0), 2.0)
    slope = np.hypot(*(cv2.Sobel(smooth, cv2.CV_32F, *d, ksize=3, scale=1 / 8) for d in ((1, 0), (0, 1))))
    busy = cv2.dilate(slope, np.ones((_SURROUNDINGS, _SURROUNDINGS), np.uint8), borderType=cv2.BORDER_REFLECT)
    border = min(BORDER, min(image.shape) // _BORDER_PART)
    inside = np.s_[border:-border, border:-border]
    flat = busy[inside] <= min(float(np.percentile(busy[inside], _FLAT_PERCENT)), _FLATTEST)
    if flat.sum() < _FEWEST_PIXELS:
        return np.nan
    fine, coarse = (cv2.GaussianBlur(image.astype(np.float32), (0, 0), sigma) for sigma in (_FINE, _COARSE))
    return float(100 * np.sqrt(np.mean((fine - coarse)[inside][flat] ** 2, dtype=np.float64)))


def whiteness(residual: Grey, valid: Bool[np.ndarray, "rows cols"]) -> float:
    """RMS of the autocorrelation of a residual b - K l at lags of 1 to 4 px; 0 is white noise, 1 a smooth error; less is better.

    A residual that still shows the scene says that motion and picture do not explain the frame (after Almeida and Figueiredo,
    IEEE TIP 2013). What is not `valid` counts as no data.
    """
    if valid.mean() < _LEAST_VALID:
        return np.nan
    w = valid.astype(np.float32)
    r = (residual - residual[valid].mean()) * w
    rows, cols = r.shape
    shape = cv2.getOptimalDFTSize(rows + _LAGS), cv2.getOptimalDFTSize(cols + _LAGS)
    power = [np.fft.irfft2(np.abs(np.fft.rfft2(x, shape)) ** 2, shape) for x in (r, w)]
    lags = [(i, j) for i in range(_LAGS + 1) for j in range(-_LAGS, _LAGS + 1) if (i, j) > (0, 0)]
    energy = power[0][0, 0] / power[1][0, 0]
    if energy <= _NO_RESIDUAL:
        return 0.0
    rho = np.array([power[0][lag] / max(power[1][lag], 1.0) for lag in lags]) / energy
    return float(np.sqrt(np.mean(rho**2)))


def straightness(image: Grey) -> tuple[float, int]:
    """RMS distance in px of edge points from their straight lines, over all long lines found, and how many; less is better.

    Lines longer than a quarter of the shorter side are found by a probabilistic Hough transform (Matas et al., CVIU 2000) that
    tolerates 3 px; then at each pixel along them the edge is located by the centroid of its gradient, within 5 px.
    A rolling shutter bends what is straight in the world; things that are curved in the world measure the same for all methods.
    """
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.0)
    gx, gy = (cv2.Sobel(smooth, cv2.CV_32F, *d, ksize=3, scale=1 / 8) for d in ((1, 0), (0, 1)))
    strong = max(_FAINTEST, float(np.percentile(np.hypot(gx, gy), _STRONG_PERCENT)))
    codes = np.clip(np.rint(255 * smooth), 0, 255).astype(np.uint8)
    drawn = cv2.Canny(codes, 255 * 4 * strong, 255 * 8 * strong, L2gradient=True)
    least = min(image.shape) / _SHORTEST
    cv2.setRNGSeed(0)
    drawn = cv2.dilate(drawn, np.ones((_SWELL, _SWELL), np.uint8))
    found = cv2.HoughLinesP(drawn, 2, np.pi / 180, int(2 * least), minLineLength=least, maxLineGap=_GAP)
    if found is None:
        return np.nan, 0
    segments = sorted(found.reshape(-1, 4).astype(float), key=lambda s: -np.hypot(s[2] - s[0], s[3] - s[1]))
    total, points, taken = 0.0, 0, []
    for segment in segments:
        if len(taken) == _MOST_LINES or any(_same(segment, other) for other in taken):
            continue
        d = _offsets(gx, gy, segment, strong)
        if d is not None and np.std(d) < _CURVED * np.hypot(*(segment[2:] - segment[:2])):
            taken.append(segment)
            total, points = total + float(np.sum(d**2)), points + len(d)
    return float(np.sqrt(total / points)) if len(taken) >= _FEWEST_LINES else np.nan, len(taken)


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether most of segment `a` lies within the reach of segment `b`."""
    along = b[2:] - b[:2]
    length = float(np.hypot(*along))
    u = along / length
    for point in (a[:2], a[2:], 0.5 * (a[:2] + a[2:])):
        d = point - b[:2]
        if abs(d[0] * u[1] - d[1] * u[0]) > _SWAY + 1 or not -_BEYOND < float(d @ u) < length + _BEYOND:
            return False
    return True


def _offsets(gx: Grey, gy: Grey, segment: np.ndarray, strong: float) -> np.ndarray | None:
    """Distances of a line's edge points from the line through them; None where it is not one edge all along."""
    start, along = segment[:2], segment[2:] - segment[:2]
    length = float(np.hypot(*along))
    u = along / length
    n = np.array([-u[1], u[0]])
    t, s = np.arange(0, length, 1.0), np.arange(-_SWAY, _SWAY + _ACROSS / 2, _ACROSS)
    xy = start[:, None, None] + u[:, None, None] * t[None, :, None] + n[:, None, None] * s[None, None, :]
    across = sum(
        k * map_coordinates(g, xy[::-1].reshape(2, -1), order=1, mode="nearest").reshape(xy.shape[1:])
        for k, g in zip(n, (gx, gy), strict=True)
    )
    across = np.maximum(across if np.sum(across) > 0 else -np.asarray(across), 0.0)
    peak = across.argmax(axis=1)
    near = np.abs(np.arange(len(s))[None] - peak[:, None]) <= _PEAK
    weight = np.where(near, across, 0.0) ** 2
    good = (across.max(axis=1) > 0.5 * strong) & (peak > 0) & (peak < len(s) - 1)
    if good.mean() < _WHOLE or good.sum() < _FEWEST_POINTS:
        return None
    place = (weight[good] * s).sum(axis=1) / weight[good].sum(axis=1)
    if np.percentile(np.abs(np.diff(place)), _JUMP_PERCENT) > _JUMP:  # it jumps from one edge to another
        return None
    line = np.polyfit(t[good], place, 1)
    return place - np.polyval(line, t[good])


def flicker(image: Grey, following: Grey) -> float:
    """RMS difference of two neighbouring frames once motion is undone, relative to their fine detail; less is better.

    Motion is dense optical flow (Kroeger et al., ECCV 2016). Detail is the RMS of what a Gaussian of 3 px takes away: a blurred
    clip has less that could flicker, and would look steady for it. Borders and the 5 % that differ most, which are hidden or
    uncovered, do not count.
    """
    a, b = (np.clip(np.rint(255 * x), 0, 255).astype(np.uint8) for x in (image, following))
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST).calc(a, b, np.zeros((*a.shape, 2), np.float32))
    rows, cols = a.shape
    x, y = np.meshgrid(np.arange(cols, dtype=np.float32), np.arange(rows, dtype=np.float32))
    back = cv2.remap(following.astype(np.float32), x + flow[..., 0], y + flow[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    border = min(BORDER, min(a.shape) // _BORDER_PART)
    inside = np.s_[border:-border, border:-border]
    d = np.sort(((back - image)[inside] ** 2).ravel())[: int(_COUNTED * (rows - 2 * border) * (cols - 2 * border))]
    fine = (image - cv2.GaussianBlur(image.astype(np.float32), (0, 0), _DETAIL))[inside]
    detail = float(np.mean(fine.astype(np.float64) ** 2))
    return float(np.sqrt(d.mean(dtype=np.float64) / detail)) if detail > _NO_DETAIL else np.nan
