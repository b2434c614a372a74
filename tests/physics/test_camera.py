"""One pose moves all pixels by one homography."""

import numpy as np
import pytest

from rsvideo.physics.camera import Intrinsics, homography, projected, turned

CAMERA = Intrinsics(fx=500.0, fy=520.0, cx=70.0, cy=40.0, rows=90, cols=160)


@pytest.mark.parametrize("pose", [[12.0, -7.0], [12.0, -7.0, 0.05], [0.0, 0.0, 0.0]])
def test_the_homography_of_a_pose_is_where_it_turns_each_pixel(pose):
    x, y = np.meshgrid(np.linspace(0, 159, 7), np.linspace(0, 89, 5))
    poses = np.broadcast_to(np.array(pose), (*x.shape, len(pose)))
    expected = np.stack([x, y], axis=-1) + turned(CAMERA, x, y, poses)
    np.testing.assert_allclose(projected(homography(CAMERA, np.array(pose)), x, y), expected, atol=1e-9)
