"""Columns that stand for those between them."""

import numpy as np
import pytest

from rsvideo.restoration.nodes import NODES, between, nodes


@pytest.mark.parametrize("cols", [1, 2, NODES, NODES + 1, 3 * NODES + 5])
def test_places_between_nodes_are_interpolated_with_x_and_y_apart(cols: int) -> None:
    columns, rows = nodes(cols), 7
    assert columns[0] == 0
    assert columns[-1] == cols - 1
    at = np.random.default_rng(1).uniform(0, 99, (rows, len(columns), 2)).astype(np.float32)
    expected = [[np.interp(np.arange(cols), columns, row[:, axis]) for row in at] for axis in range(2)]
    np.testing.assert_allclose(between(at, columns), np.array(expected), atol=1e-4)
