"""Oracles: numpy's own refusal to write; corners by hand."""

import numpy as np
import pytest

from nadia_balance.core.math.arrays import read_only, rectangle


def test_what_is_read_only_is_a_copy_that_nobody_changes():
    values = np.array([1.0, 2.0])
    copy = read_only(values, 2)
    values[0] = 3.0
    assert copy.tolist() == [1.0, 2.0]
    with pytest.raises(ValueError, match="read-only"):
        copy[0] = 3.0
    with pytest.raises(ValueError, match="reshape"):
        read_only(values, 3)


def test_a_rectangle_begins_in_front_on_the_left():
    corners = [[1.5, 1.0], [-1.5, 1.0], [-1.5, -1.0], [1.5, -1.0]]
    assert rectangle(3.0, 2.0).tolist() == corners
