"""Distances of the robot's links, and the QP that keeps them apart."""

import copy
from dataclasses import replace

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


def distances(q, within=0.08, v=None):
    """Of links within so many metres, at q and v, and their rows."""
    robot = copy.copy(nadia())
    robot.whole_body = replace(PARAMS, link_attention=within)
    root = DIAGRAM.CreateDefaultContext()
    context = PLANT.GetMyMutableContextFromRoot(root)
    PLANT.SetPositions(context, q)
    if v is not None:
        PLANT.SetVelocities(context, v)
    return LinkDistances(robot, PLANT, SCENE).calc(context)


def moving(joint, speed):
    """All velocities, zero but for one [rad/s]."""
    v = np.zeros(PLANT.num_velocities())
    v[PLANT.GetJointByName(joint).velocity_start()] = speed
    return v


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
    found, rows = distances(q, 0.09)
    assert 4 <= len(found) <= MAX_PAIRS
    assert np.all(np.diff(found) > 1e-5)  # so that they keep their order
    context = PLANT.CreateDefaultContext()
    PLANT.SetPositions(context, q)
    step = 1e-4
    for i, v in enumerate(np.eye(PLANT.num_velocities())):
        along = step * PLANT.MapVelocityToQDot(context, v)
        after, before = distances(q + along, 0.09), distances(q - along, 0.09)
        rates = (after[0] - before[0]) / (2.0 * step)
        assert rows[:, i] == pytest.approx(rates, abs=1e-3)


def test_there_is_nothing_near_a_robot_that_stands():
    """Oracle: the gap of 2 cm that the shapes leave."""
    found, rows = distances(standing_positions(), 0.02)
    assert found.shape == (0,)
    assert rows.shape == (0, PLANT.num_velocities())


@pytest.mark.parametrize(
    ("joint", "speed", "seen"),
    [
        ("LEFT_SHOULDER_X", -10.0, 2),
        ("LEFT_SHOULDER_X", -6.0, 0),
        ("LEFT_SHOULDER_X", 10.0, 0),
        ("LEFT_HIP_X", -6.0, 0),
    ],
)
def test_an_arm_is_seen_from_afar_if_it_has_to_brake(joint, speed, seen):
    """Oracle: all of Drake's distances, now and a moment later.

    Legs may pass each other as closely, and as fast.
    """
    q, v, step = standing_positions(), moving(joint, speed), 1e-4
    found, rows = distances(q, v=v)
    assert len(found) == seen
    root = DIAGRAM.CreateDefaultContext()
    context = PLANT.GetMyMutableContextFromRoot(root)
    port, within = PLANT.get_geometry_query_input_port(), []
    for at in q, q + step * PLANT.MapVelocityToQDot(context, v):
        PLANT.SetPositions(context, at)
        pairs = port.Eval(context).ComputeSignedDistancePairwiseClosestPoints(
            0.4
        )
        within.append(np.array([pair.distance for pair in pairs]))
    for d, rate in zip(found, rows @ v, strict=True):
        assert min(abs(within[0] - d)) < 1e-9
        assert min(abs(within[1] - d - step * rate)) < 1e-5
        assert d > 0.08 and 2.0 * rate + 25.0 * (d - 0.02) < 0.0


@pytest.mark.parametrize("speed", [0.0, -0.3])
def test_links_are_kept_apart(speed):
    """Oracle: by hand, distance 3 cm: (d/dt + 25)^2 (distance - 2 cm) >= 0."""
    terms = terms_at(random_state(0, 0.0))
    towards = moving("LEFT_SHOULDER_X", 1.0)
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


def test_an_arm_brakes_early_as_much_as_that_weighs():
    """Oracle: by hand: (d/dt + 25)^2 (distance - 2 cm) = 0, the nearer the
    more it weighs.
    """
    terms = terms_at(random_state(0, 0.0))
    towards = moving("LEFT_SHOULDER_X", 1.0)
    far = terms._replace(
        v=-8.0 * towards,
        distances=np.array([0.25]),
        distance_rows=towards[None],
    )
    demanded = 25.0 * (2.0 * 8.0 - 25.0 * 0.23)
    found = []
    for weight in 0.0, 3.0, 1e4:
        params = replace(PARAMS, arm_weight=weight)
        solution = WholeBodyQp(params, model(), PERIOD).solve(
            far, command(terms)
        )
        assert solution.qp.solved
        found.append(towards @ solution.vdot)
    assert found[0] < found[1] < found[2]
    assert found[2] == pytest.approx(demanded, rel=1e-2)
