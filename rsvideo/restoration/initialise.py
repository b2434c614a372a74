"""The first trajectories of a frame, from blind uniform deconvolution of its strips (Sec. 4.2.2)."""

from collections.abc import Iterator
from functools import partial
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from rsvideo import threads
from rsvideo.physics.camera import Camera
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import still
from rsvideo.restoration import blind_kernel as uniform
from rsvideo.restoration.blind_kernel import SIZES, KernelSettings
from rsvideo.restoration.psf_fit import Candidate, Strip, fit

STRIPS = 5  # kernels of a third of the frame correlate 0.88-0.95 with the true PSF of its middle, of a sixth 0.47-0.87
SHARE = 0.36  # of the frame's scanlines that a strip spans; neighbours overlap
LOWEST = 48  # scanlines of a strip at least
STIFFNESSES = (8e-3, 2e-3, 5e-4)  # of the prior on the path: stiff ones find the sense of time, soft ones strong curves
KEPT = 3  # candidates of each stiffness
LEFT_OUT_FROM = 2  # best candidates that are fitted again without each of the strips
NEW = 0.8  # px by which the coefficients of another candidate differ, with two axes; origin: by trial
NEW_WITH_ROLL = 0.5  # px, with three
WORST = 3.0  # times the best candidate's energy, beyond which a path explains the kernels too badly; origin: by trial


def strip_kernels(frame: Float[np.ndarray, "rows cols"], timing: ShutterTiming, settings: KernelSettings, *, parts: int) -> list[Strip]:
    """Overlapping strips over the frame's scanlines, each cut into `parts` side by side, with their kernels."""
    rows, cols = frame.shape
    height = max(round(SHARE * rows), min(rows, LOWEST))
    count = 1 if timing.readout == 0 else STRIPS
    firsts = np.linspace(0, rows - height, count).round().astype(int) if count > 1 else [0]
    height = height if count > 1 else rows
    edges = np.linspace(0, cols, parts + 1).round().astype(int)
    cells = [(int(f), int(a), int(b)) for f in firsts for a, b in pairwise(edges)]

    def strip(cell: tuple[int, int, int], size: int) -> Strip:
        first, left, right = cell
        image = np.ascontiguousarray(frame[first : first + height, left:right])
        *_, kernel = uniform.estimate(image, min(size, (min(image.shape) // 2 - 1) | 1), settings)
        return Strip(first=first, last=first + height, middle=(left + right - 1) / 2, kernel=kernel)

    strips: list[Strip] = []
    for size in SIZES:
        strips = threads.each(lambda cell, size=size: strip(cell, size), cells)
        if np.median([uniform.border_share(s.kernel) for s in strips]) < uniform.FULL:
            break
    return strips


def candidates(strips: list[Strip], camera: Camera, *, degree: int, most: int) -> Iterator[Candidate]:
    """At most `most` distinct trajectories worth refining, from several stiffnesses of the prior.

    And up to as many from all strips but one: a single kernel that has failed, often by being too short, bends them all.
    """
    found: list[Candidate] = []
    fitted = partial(fit, strips, camera, degree=degree)

    def fresh(fits: list[Candidate], most: int) -> Iterator[Candidate]:
        for c in fits:
            apart = all(np.linalg.norm(c.trajectory.coefficients - f.trajectory.coefficients) > NEW for f in found)
            if apart and len(found) < most and (not found or c.energy < WORST * found[0].energy):
                found.append(c)
                yield c

    for stiffness in STIFFNESSES:
        yield from fresh(fitted(stiffness=stiffness, keep=KEPT), most)
    first = found[:LEFT_OUT_FROM]
    for i in range(len(strips) if len(strips) > 2 else 0):
        for c in first:
            yield from fresh(fitted(stiffness=STIFFNESSES[1], keep=1, start=c.trajectory, without=i), 2 * most)


def with_roll(found: list[Candidate], strips: list[Strip], halves: list[Strip], camera: Camera, *, degree: int) -> list[Candidate]:
    """The candidates with a third axis, fitted anew; equal ones once.

    Kernels of the frame's left and right halves show roll; those of whole strips fail more rarely, but strong roll misleads
    them. So each candidate is fitted to the halves, trusting all of them or those that agree with it, and to both.
    """
    out: list[Candidate] = []
    for candidate in found:
        flat = np.hstack([candidate.trajectory.coefficients, np.zeros((degree + 1, 1))])
        start = still(camera.timing.interval, degree=degree, axes=3).with_coefficients(flat)
        for observed, doubting in ((halves, False), (halves, True), (strips + halves, True)):
            fitted = fit(observed, camera, degree=degree, stiffness=candidate.stiffness, keep=1, start=start, doubting=doubting)[0]
            new = fitted.trajectory.coefficients[:, :2]
            if all(np.linalg.norm(new - other.trajectory.coefficients[:, :2]) > NEW_WITH_ROLL for other in out):
                out.append(fitted)
    return out
