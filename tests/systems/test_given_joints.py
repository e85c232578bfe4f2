"""Oracles: the law of a servo, by hand; messages."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from nadia_balance.systems.given_joints import GivenJoints, GivenMotion
from tests.blocks import answer, fix
from tests.whole_body_examples import nadia

PLANT = nadia().control_plant()
ELBOW = "LEFT_ELBOW_Y"
MOTION = GivenMotion(
    np.array([0.5, 1.0]), np.array([-0.3, -0.7]), stiffness=20.0, damping=3.0
)


def test_its_joints_are_commanded_and_no_others():
    """Oracle: by hand: the position that counts, at rest, without torque."""
    system = GivenJoints({ELBOW: MOTION}, PLANT)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    rng = np.random.default_rng(1)
    command = rng.normal(size=(5, PLANT.num_actuators()))
    fix(system, context, joint_command=command.ravel())
    elbow = PLANT.GetJointActuatorByName(ELBOW).input_start()
    others = np.arange(PLANT.num_actuators()) != elbow
    for time, position in (0.0, -0.3), (0.996, -0.3), (1.0, -0.7), (9.0, -0.7):
        simulator.AdvanceTo(time)
        given = answer(system, context, "joint_command").reshape(5, -1)
        assert given[:, elbow].tolist() == [position, 0.0, 0.0, 20.0, 3.0]
        assert (given[:, others] == command[:, others]).all()


@pytest.mark.parametrize(
    ("name", "motion", "message"),
    [
        ("TAIL", MOTION, "TAIL: must be a joint with a drive"),
        (ELBOW, MOTION._replace(times=np.array([1.0])), f"{ELBOW}: must have"),
        (ELBOW, MOTION._replace(times=np.zeros(2)), f"{ELBOW}: must have"),
        (ELBOW, GivenMotion(*np.empty((2, 0)), 1.0, 1.0), f"{ELBOW}: must"),
        (ELBOW, GivenMotion(*np.full((2, 1), np.nan), 1.0, 1.0), f"{ELBOW}: m"),
        (ELBOW, MOTION._replace(damping=-1.0), f"{ELBOW}: damping = -1.0: mu"),
    ],
)
def test_refuses_what_it_cannot_command(name, motion, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        GivenJoints({name: motion}, PLANT)
