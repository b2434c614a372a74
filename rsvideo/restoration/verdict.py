"""Whether restoring a frame along a path will help."""

import math

from rsvideo.frame import Verdict
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.energy import energy
from rsvideo.restoration.evidence import Evidence
from rsvideo.restoration.extent import beyond, longest
from rsvideo.restoration.scene import Scene, windowed
from rsvideo.restoration.sparsity import objective

# What evidence has to exceed was chosen on one half of a corpus of photographs. The limits of energy and f were chosen on the cases
# in the README and 24 others made from the same photographs.
REST = 0.05  # by which the spectra's misfit is lower than at rest: 0.07 to 0.57 along true paths, 0 to 0.45 along others
REST_UNDIRECTED = 0.2  # the same where the mirror image does not speak for the path, which it does for few wrong ones: those show up to
# 0.17, and right ones of unknown direction 0.16 to 0.44
MIRROR = 1.75  # standard errors: about 0 +- 1 along even motions, which leave no trace of their direction, and 1.8 to 24 along true others
LOGISTIC = 0.5, 1.7, 1.3, 1.1  # logarithm of the odds that a path is right: a constant, and what the logarithms of rest, mirror and
# focus add; fitted by tests/benchmarks/judge.py
CONFIDENT = math.log(2)  # of that logarithm: a path is followed that is twice as likely right as wrong, for a wrong one costs more trust
PERHAPS = -0.5  # of that logarithm, from which on a path is followed in part (restoration.doubtful); from -2 to -0.5 little differs
WOBBLE = 0.5  # px; up to which the direction does not matter
FOCUS = 2.5  # standard errors: mostly -2 to 2.5 along wrong paths, up to 7 in scenes of several depths, 2.9 to 21 along most true ones
SHORTEST = 1.0  # px; a frame whose path is shorter is sharp
COSTLIEST = 2.3  # times the frame's own energy, which rises 1.3 to 1.9 times along most true paths
CHEAPER_ACROSS = 3.0  # times the energy along the path, which that across it must reach if the former is beyond COSTLIEST
DENSER = 0.008  # how far f may rise over the frame's own; along true paths it mostly falls, but may rise by 0.04
CONTRAST = 0.4  # of f's rise from along the path to across it, which f may rise further


def judge(scene: Scene, path: Trajectory, evidence: Evidence | None = None) -> Verdict:
    """RESTORED, SHARP where the path is shorter than a pixel, UNDIRECTED where its mirror image may be as true, or UNEXPLAINED.

    Where there is evidence, all of it has to speak for the path. Where there is no evidence, the energy and f decide. Deblurring trades
    blur for contrast, so the energy of Eq. (8) rises over that of the frame taken as sharp. Where it rises more than along true
    paths, the frame holds detail that no blur along the path can have left; a path is believed all the same if the energy across
    it is much higher still. The latent image's edges are hardly ever less sparse than the frame's own, unless restoring across the
    path makes them far less sparse; otherwise the strips' kernels described the picture and not its blur.
    """
    if beyond(scene.camera, path):
        return Verdict.UNEXPLAINED
    part = windowed(scene)
    rest = path.with_coefficients(0 * path.coefficients)
    if longest(part.camera, path) < SHORTEST:
        return Verdict.SHARP
    if evidence:
        return believed(evidence)
    cost, crosswise = energy(part, path), across(path)
    if cost > COSTLIEST * energy(part, rest) and energy(part, crosswise) < CHEAPER_ACROSS * cost:
        return Verdict.UNEXPLAINED
    f, f_rest, f_across = (objective(part, p, part.search_ridge)[0] for p in (path, rest, crosswise))
    return Verdict.UNEXPLAINED if f - f_rest > DENSER + CONTRAST * (f_across - f) else Verdict.RESTORED


def believed(evidence: Evidence) -> Verdict:
    """What becomes of a frame by what speaks for its path: whether it is twice as likely right as wrong, if its direction shows.

    Where its direction shows, but the path is less likely, the frame is restored in part.
    """
    directed = evidence.mirror > MIRROR
    if evidence.rest <= (REST if directed else REST_UNDIRECTED) or evidence.focus <= FOCUS:
        return Verdict.UNEXPLAINED
    if not directed:
        return Verdict.RESTORED if evidence.wobble < WOBBLE else Verdict.UNDIRECTED
    odds = log_odds(evidence)
    if odds > CONFIDENT:
        return Verdict.RESTORED
    return Verdict.DOUBTFUL if odds > PERHAPS else Verdict.UNEXPLAINED


def log_measures(evidence: Evidence) -> tuple[float, ...]:
    """The logarithms of what speaks for a path, all of it positive, in the order of LOGISTIC's weights."""
    return tuple(math.log(measure) for measure in (evidence.rest, evidence.mirror, evidence.focus))


def log_odds(evidence: Evidence) -> float:
    """The logarithm of the odds that a path is right; all of what speaks for it is positive."""
    constant, *weights = LOGISTIC
    return constant + sum(weight * each for weight, each in zip(weights, log_measures(evidence), strict=True))


def across(path: Trajectory) -> Trajectory:
    """The same path turned by a right angle, with the same roll."""
    coefficients = path.coefficients.copy()
    coefficients[:, :2] = path.coefficients[:, 1::-1] * (-1, 1)
    return path.with_coefficients(coefficients)
