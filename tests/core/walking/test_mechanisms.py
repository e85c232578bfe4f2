"""Oracles: the legends of the papers' figures; the way back."""

import re
from itertools import product

import numpy as np
import pytest

from nadia_balance.core.walking.mechanisms import (
    ATLAS_MECHANISMS,
    MECHANISMS,
    Mechanisms,
)


@pytest.mark.parametrize("on", list(product([False, True], repeat=4)))
def test_the_vector_has_the_order_of_the_columns_and_leads_back(on):
    """Oracle: the way back, for all sixteen."""
    names = "step", "swing", "transfer", "cross_over"
    found = Mechanisms(**dict(zip(names, on, strict=True)))
    assert found.as_vector().tolist() == list(on)
    assert Mechanisms.from_vector(found.as_vector()) == found


@pytest.mark.parametrize("vector", [[1.0, 0.0], [0.3] * 4, [np.nan] * 4])
def test_a_switch_is_on_or_off(vector):
    """Oracle: the message names the numbers."""
    with pytest.raises(ValueError, match=re.escape(f"mechanisms = {vector}")):
        Mechanisms.from_vector(np.array(vector))


def test_each_set_of_mechanisms_has_one_more_than_the_one_before():
    """Oracle: Fig. 10's legend."""
    counts = [on.as_vector().sum() for on in MECHANISMS.values()]
    assert counts == [0, 1, 2, 3, 4]


def test_those_of_the_atlas_paper_combine_step_and_timing():
    """Oracle: Fig. 6's legend; transfers and crossed legs are not in it."""
    found = {
        (on.step, on.swing, on.transfer, on.cross_over)
        for on in ATLAS_MECHANISMS.values()
    }
    assert found == set(product([False, True], [False, True], [False], [False]))
