"""That tests check the shapes and types of the functions they call."""

import numpy as np
import pytest

from rsvideo.solvers.prox import soft_threshold
from tests import checked

WRONG = "a word, not an array"


def call() -> None:
    """A function of the project with an argument that it cannot mean."""
    with pytest.raises(Exception, match="Type-check error"):
        soft_threshold(WRONG, 0.1)  # pyright: ignore[reportArgumentType]


def test_a_call_with_a_wrong_argument_fails() -> None:
    call()


def test_each_test_checks_anew_after_many_calls() -> None:
    for _ in range(checked.MOST + 1):
        soft_threshold(np.zeros((2, 3, 4), np.float32), 0.1)
    checked.begin()
    call()
