import numpy as np

from nadia_balance.core.whole_body_terms import LEFT_SOLE, RIGHT_SOLE, TORSO
from tests.whole_body_examples import model, random_state, terms_at


def test_rows_fill_the_stack():
    """Oracle: every row of J belongs to one of soles and torso."""
    rows = np.arange(15)
    parts = [rows[part] for part in (LEFT_SOLE, RIGHT_SOLE, TORSO)]
    assert np.array_equal(np.concatenate(parts), rows)


def test_sizes_are_those_of_the_docstring():
    """Oracle: Nadia has 23 joints."""
    terms, nv = terms_at(random_state(0)), 6 + model().num_joints
    assert nv == 29
    assert terms.M.shape == (nv, nv)
    assert terms.bias.shape == terms.v.shape == (nv,)
    assert terms.J.shape == (15, nv)
    assert terms.Jdot_v.shape == terms.Jv.shape == (15,)
    assert terms.rotations.shape == (4, 3, 3)
    assert terms.sole_positions.shape == (2, 3)
    assert terms.positions.shape == (nv - 6,)
