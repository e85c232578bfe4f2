"""Distances of the robot's links, and the QP that keeps them apart."""

import numpy as np
import pytest

from nadia_balance.core.whole_body_command import MAX_PAIRS, WholeBodyQpParams
from nadia_balance.core.whole_body_qp import WholeBodyQp
from nadia_balance.link_distances import LinkDistances
from tests.whole_body_examples import (
    PERIOD,
    command,
    model,
    nadia,
    random_state,
    standing_positions,
    terms_at,
)

DIAGRAM, PLANT, SCENE = nadia().control_diagram()
PARAMS = WholeBodyQpParams()


def distances(q, within=0.08, most=MAX_PAIRS):
    root = DIAGRAM.CreateDefaultContext()
    context = PLANT.GetMyMutableContextFromRoot(root)
    PLANT.SetPositions(context, q)
    return LinkDistances(PLANT, SCENE, most).calc(context, within)


def thighs(angle):
    """Stands, with both hips adducted by so much [rad]."""
    q = standing_positions().copy()
    for name, sign in (("LEFT_HIP_X", -1.0), ("RIGHT_HIP_X", 1.0)):
        q[PLANT.GetJointByName(name).position_start()] = sign * angle
    return q


def test_rows_are_the_rates_of_the_distances():
    """Oracle: finite differences along each velocity, by Drake's map to q.

    Drake finds the closest points of capsules by iteration, its normals are
    good to 4e-4.
    """
    q = thighs(0.05)
    q[PLANT.GetJointByName("LEFT_HIP_Y").position_start()] -= 0.1
    found, rows = distances(q, 0.15)
    assert len(found) == MAX_PAIRS
    assert np.all(np.diff(found) > 1e-5)  # so that they keep their order
    context = PLANT.CreateDefaultContext()
    PLANT.SetPositions(context, q)
    step = 1e-4
    for i, v in enumerate(np.eye(PLANT.num_velocities())):
        along = step * PLANT.MapVelocityToQDot(context, v)
        after, before = distances(q + along, 0.15), distances(q - along, 0.15)
        rates = (after[0] - before[0]) / (2.0 * step)
        assert rows[:, i] == pytest.approx(rates, abs=1e-3)


def test_there_is_nothing_near_a_robot_that_stands():
    """Oracle: the gap of 2 cm that the shapes leave."""
    found, rows = distances(standing_positions(), 0.02)
    assert found.shape == (0,)
    assert rows.shape == (0, PLANT.num_velocities())


@pytest.mark.parametrize("speed", [0.0, -0.3])
def test_links_are_kept_apart(speed):
    """Oracle: by hand, distance 3 cm: (d/dt + 25)^2 (distance - 2 cm) >= 0."""
    terms = terms_at(random_state(0, 0.0))
    towards = np.zeros(terms.v.size)
    towards[PLANT.GetJointByName("LEFT_SHOULDER_X").velocity_start()] = 1.0
    v = speed * towards
    near = terms._replace(
        v=v, distances=np.array([0.03]), distance_rows=towards[None]
    )
    qp = WholeBodyQp(PARAMS, model(), PERIOD)
    free = qp.solve(terms._replace(v=v), command(terms))
    found = qp.solve(near, command(terms))
    least = -25.0 * (2.0 * speed + 25.0 * 0.01)
    assert found.qp.solved
    expected = max(towards @ free.vdot, least)
    assert towards @ found.vdot == pytest.approx(expected, rel=1e-3)
    if speed:
        assert towards @ free.vdot < least
