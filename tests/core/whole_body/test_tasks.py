"""Oracles: PD laws written out; Drake's momentum by finite differences."""

import dataclasses
import math

import numpy as np
import pytest
from pydrake.math import RotationMatrix
from pydrake.multibody.tree import JacobianWrtVariable

from nadia_balance.core.walking.state import Side
from nadia_balance.core.whole_body.command import BASE, PELVIS, TORSO
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.core.whole_body.qp import WholeBodyQp
from nadia_balance.core.whole_body.tasks import (
    MomentumTask,
    Motion,
    usual_tasks,
)
from tests.whole_body_examples import (
    CONTACTS,
    PERIOD,
    command,
    context_at,
    kinematics,
    model,
    nadia,
    random_state,
    terms_at,
)

STEP = 1e-6


def swinging(terms, slope):
    """A command: the right sole swings, tilted forward by `slope` [rad]."""
    swing = np.array([0, 0, 0, 0.1, 0.2, 0.3, 1.0, 2.0, 3.0, 0.15, 0.4, 0.5])
    swing[:3] = terms.sole_positions[1] + [0.01, 0.02, 0.03]
    wish = command(terms, (True, False))._replace(swing=swing)
    wish.normals[1] = math.sin(slope), 0.0, math.cos(slope)
    return wish, swing


@pytest.mark.parametrize("slope", [0.0, 0.2])
def test_tasks_of_trunk_and_swing_foot_are_pd_laws(slope):
    """Oracle: PD laws written out, with Drake's angle and axis.

    The swing sole is to be tilted forward, and turned, by `slope` [rad].
    """
    terms, params = terms_at(random_state(0, 2.0)), WholeBodyQpParams()
    wish, swing = swinging(terms, slope)
    wish = wish._replace(heading=(0.2, 0.3, 0.4), turn=(0.05, 0.1, 0.2))
    _, *tasks = usual_tasks(params, model())
    torso, pelvis, foot = (task.motion(terms, wish) for task in tasks)

    def turning(gain, heading, body, rows, slope=0.0):
        yaw, rate, acceleration = heading
        R = RotationMatrix(terms.rotations[body])
        upright = RotationMatrix.MakeYRotation(slope)
        upright @= RotationMatrix.MakeZRotation(yaw)
        to_go = (upright @ R.inverse()).ToAngleAxis()
        error = math.sin(to_go.angle()) * to_go.axis()
        slower = np.array([0.0, 0.0, rate]) - terms.velocities[rows]
        forward = np.array([0.0, 0.0, acceleration])
        return forward + gain * error + 2.0 * math.sqrt(gain) * slower

    gain, sole = params.orientation_gain, slice(6, 9)
    expected = turning(gain, (0.2, 0.3, 0.4), 2, TORSO)
    assert torso.acceleration == pytest.approx(expected)
    expected = turning(gain, (0.25, 0.4, 0.6), 3, PELVIS)
    assert pelvis.acceleration == pytest.approx(expected)
    expected = turning(200.0, swing[9:], 1, sole, slope)
    assert foot.acceleration[:3] == pytest.approx(expected)
    for motion, rows in (torso, TORSO), (pelvis, PELVIS):
        assert np.array_equal(motion.rows, terms.rows[rows])
    assert np.array_equal(foot.rows[:3], terms.rows[sole])


def ankle_rows(state):
    """[J, Jdot v] (3, nv + 1) of the right ankle, by Drake."""
    plant, context = kinematics().plant, context_at(state)
    ankle = plant.GetJointByName("RIGHT_ANKLE_X").frame_on_child()
    world, zero = plant.world_frame(), np.zeros(3)
    J = plant.CalcJacobianTranslationalVelocity(
        context, JacobianWrtVariable.kV, ankle, zero, world, world
    )
    bias = plant.CalcBiasTranslationalAcceleration(
        context, JacobianWrtVariable.kV, ankle, zero, world, world
    )
    return np.column_stack((J, bias))


@pytest.mark.parametrize("slope", [0.0, 0.2])
def test_the_ankle_follows_the_reference_of_the_sole(slope):
    """Oracle: Drake's motion of the ankle; differences of its reference.

    That of an ankle on a sole which keeps its slope [rad], turns and speeds up;
    the measured sole is tilted against it, and its lowest corner is to be on
    the ground where the centre of the reference would be.
    """
    state = random_state(0, 2.0)
    for joint in "RIGHT_ANKLE_X", "RIGHT_ANKLE_Y":
        state[kinematics().plant.GetJointByName(joint).position_start()] += 0.1
    terms, params = terms_at(state), WholeBodyQpParams()
    wish, swing = swinging(terms, slope)
    foot = usual_tasks(params, model())[-1].motion(terms, wish)

    rows = ankle_rows(state)
    assert foot.rows[3:] == pytest.approx(rows, abs=1e-9)

    plant, context = kinematics().plant, context_at(state)
    ankle = plant.GetJointByName("RIGHT_ANKLE_X").frame_on_child()
    X_SoleFoot = nadia().X_FootSole[Side.RIGHT].inverse()
    p_SA = X_SoleFoot @ ankle.GetFixedPoseInBodyFrame().translation()

    def reference(t):
        p, v, a, turn = swing.reshape(4, 3)
        R = RotationMatrix.MakeYRotation(slope)
        R @= RotationMatrix.MakeZRotation(turn @ [1.0, t, 0.5 * t * t])
        return p + t * v + 0.5 * t * t * a + R @ p_SA

    normal = np.array([math.sin(slope), 0.0, math.cos(slope)])
    corners = nadia().sole @ terms.rotations[1][:, :2].T
    lowest = min(corners @ normal)
    assert lowest < -0.005
    before, now, after = (reference(t) for t in (-1e-4, 0.0, 1e-4))
    p_WA = ankle.CalcPoseInWorld(context).translation()
    acceleration = (after - 2.0 * now + before) / 1e-8
    acceleration += 300.0 * (now - lowest * normal - p_WA)
    slower = (after - before) / 2e-4 - rows[:, :-1] @ terms.v
    acceleration += 2.0 * math.sqrt(300.0) * slower
    assert foot.acceleration[3:] == pytest.approx(acceleration, rel=1e-5)


def momentum_at(state):
    """Linear and angular momentum about the CoM, by Drake, per mass."""
    plant, context = kinematics().plant, context_at(state)
    momentum = plant.CalcSpatialMomentumInWorldAboutPoint(
        context, plant.CalcCenterOfMassPositionInWorld(context)
    )
    both = [momentum.translational(), momentum.rotational()]
    return np.concatenate(both) / nadia().mass


@pytest.mark.parametrize("contacts", CONTACTS, ids=str)
def test_momentum_rows_are_its_rate(contacts):
    """Oracle: finite differences of Drake's spatial momentum.

    J vdot + b - a is the rate minus what is wished for: for the horizontal part
    a share of the vertical force, for the angular momentum the damping.
    """
    unweighted = WholeBodyQpParams(
        momentum_weight=1.0, height_weight=1.0, angular_momentum_weight=1.0
    )
    state, plant = random_state(1), kinematics().plant
    terms, wish = terms_at(state), np.array([10.0, -20.0, 30.0])
    rows, acceleration = MomentumTask(unweighted, model()).motion(
        terms, command(terms, contacts, wish)
    )
    vdot = np.random.default_rng(1).normal(size=29)
    qdot = plant.MapVelocityToQDot(context_at(state), terms.v)
    ahead, behind = (
        momentum_at(state + sign * STEP * np.concatenate([qdot, vdot]))
        for sign in (1.0, -1.0)
    )
    missing = (ahead - behind) / (2.0 * STEP)
    missing[:2] -= wish[:2] / (9.81 * nadia().mass) * (missing[2] + 9.81)
    missing[2] -= wish[2] / nadia().mass
    damping = unweighted.angular_momentum_damping
    missing[3:] += damping * momentum_at(state)[3:]
    # Truncation and rounding at this step both leave about 1e-8.
    error = rows @ np.append(vdot, 1.0) - acceleration
    assert error == pytest.approx(missing, abs=1e-6)


class JointTask:
    """A user's task: the angular acceleration of one joint."""

    name = "joint"

    def __init__(self, column, acceleration, weight):
        self.weight = weight
        self._row = np.zeros((1, 30))
        self._row[0, column] = 1.0
        self._acceleration = np.array([acceleration])

    def motion(self, terms, command):
        if command.contacts[0] and not command.contacts[1]:
            return None
        return Motion(self._row, self._acceleration)


# Column of a joint that no other task needs.
ELBOW = kinematics().plant.GetJointByName("RIGHT_ELBOW_Y").velocity_start()


def test_a_task_may_rest():
    """Oracle: bits of the QP without it."""
    terms = terms_at(random_state(0))
    wish = command(terms, (True, False))
    with_task, without = (
        WholeBodyQp(WholeBodyQpParams(), model(), PERIOD, tasks)
        for tasks in ([JointTask(ELBOW, 40.0, 1.0)], [])
    )
    assert np.array_equal(
        with_task.solve(terms, wish).torques, without.solve(terms, wish).torques
    )


def test_refuses_weights_that_are_fewer_than_its_rows():
    """Oracle: by hand: two weights, one row."""
    qp = WholeBodyQp(
        WholeBodyQpParams(), model(), PERIOD, [JointTask(ELBOW, 0.0, [1, 2])]
    )
    terms = terms_at(random_state(0))
    with pytest.raises(ValueError, match="^task 'joint': 2 weights for 1 rows"):
        qp.solve(terms, command(terms, (True, True)))


def test_refuses_a_negative_weight():
    task = JointTask(ELBOW, 0.0, -1.0)
    with pytest.raises(ValueError, match="joint = -1.0"):
        WholeBodyQp(WholeBodyQpParams(), model(), PERIOD, [task])


@pytest.mark.parametrize(
    "name, rows",
    [
        ("momentum_weight", slice(BASE.start + 3, BASE.start + 5)),
        ("height_weight", slice(BASE.start + 5, BASE.start + 6)),
        ("angular_momentum_weight", None),
        ("torso_weight", slice(-6, -3)),
        ("pelvis_weight", slice(-3, None)),
        ("swing_orientation_weight", slice(6, 9)),
        ("swing_position_weight", slice(2)),
        ("swing_height_weight", slice(2, 3)),
    ],
)
def test_weights_are_those_of_the_squares(name, rows):
    """Oracle: twice the weight adds weight J'J to H, J the rows of the terms.

    That of the angular momentum is about the CoM, those of the ankle are
    Drake's; flatness: a share of the swing sole's orientation weight.
    """
    state = random_state(0)
    terms = terms_at(state)
    wish, params = command(terms, (True, False)), WholeBodyQpParams()
    wish, weight = wish._replace(flatness=0.3), getattr(params, name)
    twice = dataclasses.replace(params, **{name: 2.0 * weight})
    once, more = (
        WholeBodyQp(each, model(), PERIOD).problem(terms, wish).H[:29, :29]
        for each in (params, twice)
    )
    if rows is None:
        moment, force = terms.rows[BASE, :-1].reshape(2, 3, 29)
        J = moment - moment[:, 3:6] @ force
    elif name in ("swing_position_weight", "swing_height_weight"):
        J = ankle_rows(state)[rows, :-1]
    else:
        J = terms.rows[rows, :-1]
    weight *= 0.3 if name == "swing_orientation_weight" else 1.0
    assert more - once == pytest.approx(weight * J.T @ J, abs=1e-9 * weight)
