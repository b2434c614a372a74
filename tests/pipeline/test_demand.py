"""What a task is said to need, beside what was measured."""

import pytest

from rsvideo.pipeline import demand


@pytest.mark.parametrize(("pixels", "gigabytes"), [(1920 * 1080, 1.26), (3840 * 2160, 2.44), (4000 * 3000, 3.43), (6000 * 4000, 6.2)])
def test_a_photograph_is_said_to_need_what_it_took_and_at_most_half_as_much_again(pixels: int, gigabytes: float) -> None:
    needed = demand._of_pixels("photograph", pixels) / 1e9
    assert 0.95 * gigabytes < needed < 1.5 * gigabytes
