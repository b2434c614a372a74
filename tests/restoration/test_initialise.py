"""What of the first trajectories only their kernels tell."""

import numpy as np
import pytest

from rsvideo.restoration.initialise import PLAUSIBLE, mirrored
from rsvideo.restoration.strips import fit
from tests.restoration.test_strips import CAMERA, COARSE, ROLLING, apart, path, strips

EVEN = np.array([[0.0, 0.0], [8.0, 3.0], [0.0, 0.0], [0.0, 0.0]])
BENT = np.array([[0.0, 0.0], [8.0, 3.0], [-4.0, 3.0], [0.0, 0.0]])


@pytest.mark.parametrize(("coefficients", "plausible"), [(EVEN, True), (BENT, False)])
def test_run_backwards_an_even_motion_explains_its_kernels_and_a_bent_one_does_not(coefficients, plausible):
    true = path(coefficients=coefficients)
    forth = fit(strips(true), ROLLING, CAMERA, degree=3, stiffness=COARSE, keep=1)[0]
    back = mirrored(true, strips(true), ROLLING, CAMERA, degree=3, stiffness=COARSE)
    assert (back.energy < PLAUSIBLE * forth.energy) is plausible
    if plausible:
        assert apart(back.trajectory, true.with_coefficients(-coefficients)) < 0.5
