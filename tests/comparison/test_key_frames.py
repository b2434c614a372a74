import numpy as np

from rsvideo.comparison import key_frames
from rsvideo.report.comparison import Crop


def test_crops_are_where_entries_differ_and_lie_apart() -> None:
    area = np.zeros((300, 400))
    area[40:60, 300:340] = 1.0
    area[200:230, 100:140] = 0.5
    first, second, *_ = key_frames.crops(area, 300, 400)
    assert first.x <= 300
    assert first.x + first.w >= 340
    assert first.y <= 40
    assert first.y + first.h >= 60
    assert second.x <= 100
    assert second.y + second.h >= 230
    assert abs(first.x - second.x) >= first.w or abs(first.y - second.y) >= first.h


def test_where_nothing_differs_the_middle_is_shown() -> None:
    assert list(key_frames.crops(np.zeros((300, 400)), 300, 400)) == [Crop(x=152, y=114, w=96, h=72, chosen=False)]
    small = list(key_frames.crops(np.ones((64, 80)), 64, 80))
    assert all(c.x >= 0 and c.y >= 0 and c.x + c.w <= 80 and c.y + c.h <= 64 for c in small)
    assert small


def test_as_many_frames_are_shown_as_a_page_can_carry() -> None:
    assert key_frames.chosen(24, 8, 640 * 360) == frozenset(range(24))
    many = key_frames.chosen(1000, 8, 3840 * 2160 / 4)
    assert 1 <= len(many) <= 12
    assert key_frames.chosen(1, 8, 1e9) == frozenset({0})
