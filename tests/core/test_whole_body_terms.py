import numpy as np

from nadia_balance.core.whole_body_terms import (
    BASE,
    LEFT_SOLE,
    PELVIS,
    RIGHT_SOLE,
    TORSO,
)
from tests.whole_body_examples import model, random_state, terms_at


def test_rows_fill_the_stack():
    """Oracle: each row belongs to a sole, base, joints, torso or pelvis."""
    rows = np.arange(47)
    joints = slice(BASE.stop, TORSO.start)
    parts = (LEFT_SOLE, RIGHT_SOLE, BASE, joints, TORSO, PELVIS)
    assert np.array_equal(np.concatenate([rows[p] for p in parts]), rows)
    assert rows[joints].size == model().num_joints


def test_sizes_are_those_of_the_docstring():
    """Oracle: Nadia has 23 joints."""
    terms, nv = terms_at(random_state(0)), 6 + model().num_joints
    assert nv == 29
    assert terms.rows.shape == (47, nv + 1)
    assert terms.forces.shape == (nv, nv + 1)
    assert terms.velocities.shape == (47,)
    assert terms.rotations.shape == (4, 3, 3)
    assert terms.sole_positions.shape == (2, 3)
    assert terms.positions.shape == (nv - 6,)
    assert terms.v.shape == (nv,)
