"""The focal length from points that were followed as a camera turns."""

import numpy as np
import pytest

from calibration.intrinsics.from_motion import VAGUE, Focal, focal_length
from calibration.timing.pair_motion import Pair
from rsvideo.physics.camera import Intrinsics, turned
from rsvideo.shooting.usual import FOCAL, FOCAL_SPREAD

ROWS, COLS, FRAMES, POINTS = 360, 640, 20, 200


def followed(focal: float, *, reach: float, bent: float = 0.0, seed: int = 1) -> Focal:
    """What points show of a camera that turns by about `reach` px a frame, if depth moves those at the sides by `bent` px more."""
    rng = np.random.default_rng(seed)
    lens = Intrinsics.centred(focal=focal, rows=ROWS, cols=COLS)
    pairs = []
    for k in range(FRAMES):
        before = rng.uniform((20, 20), (COLS - 20, ROWS - 20), (POINTS, 2))
        x, y = before[:, :1], before[:, 1:]
        pose = rng.standard_normal(3) * (reach, reach, reach / focal)
        moved = turned(lens, x, y, np.broadcast_to(pose, (*x.shape, 3)))[:, 0]
        beside = bent * rng.standard_normal(2) * (2 * before[:, :1] / COLS - 1) ** 2
        after = before + moved + beside + 0.1 * rng.standard_normal((POINTS, 2))
        pairs.append(Pair(before=before, after=after, begins=(k / 30, (k + 1) / 30)))
    return focal_length(pairs, ROWS, COLS)


@pytest.mark.parametrize("share", [0.7, 1.0, 1.5])
def test_turns_show_the_focal_length(share: float) -> None:
    found = followed(share * COLS, reach=8.0)
    assert found.pixels == pytest.approx(share * COLS, rel=2.5 * found.deviation)
    assert found.deviation < VAGUE


def test_a_camera_that_stands_shows_nothing_but_what_is_usual() -> None:
    found = followed(1.5 * COLS, reach=0.0)
    assert found.pixels == pytest.approx(FOCAL * COLS, rel=0.01)
    assert found.deviation == pytest.approx(FOCAL_SPREAD, rel=0.01)


def test_what_depth_adds_by_chance_makes_it_uncertain() -> None:
    plain, deep = (followed(COLS, reach=8.0, bent=bent) for bent in (0.0, 4.0))
    assert deep.deviation > 2 * plain.deviation
    assert abs(np.log(deep.pixels / COLS)) < 3 * deep.deviation
