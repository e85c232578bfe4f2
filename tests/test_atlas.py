"""The figures of models/atlas/atlas.urdf."""

import numpy as np
import pytest

from nadia_balance.robot import load_robot
from tests.model_world import Urdf

ROBOT = load_robot("atlas")
URDF = Urdf(ROBOT)
# Of the public description [N m]; the other side has the same.
EFFORTS = {
    "leg_hpz": 275.0,
    "leg_hpx": 530.0,
    "leg_hpy": 840.0,
    "leg_kny": 890.0,
    "leg_aky": 740.0,
    "leg_akx": 360.0,
    "arm_shz": 87.0,
    "arm_shx": 99.0,
    "arm_ely": 63.0,
    "arm_elx": 112.0,
}
SPINE = {"back_bkz": 106.0, "back_bky": 445.0, "back_bkx": 300.0}


def test_the_mass_is_that_of_the_robot():
    """Oracle: the sum and the largest masses of the public description [kg]."""
    assert ROBOT.mass == pytest.approx(174.0503, abs=1e-9)
    for link, mass in {
        "pelvis": 9.509,
        "utorso": 84.409,
        "l_uleg": 8.204,
        "r_lleg": 4.515,
        "l_foot": 2.41,
        "r_uarm": 4.386,
    }.items():
        assert URDF.inertial(link)[0] == mass


def test_every_joint_has_its_effort_limit():
    """Oracle: the public description; wrists and neck do not move."""
    effort = SPINE | {
        f"{side}_{joint}": limit
        for side in "lr"
        for joint, limit in EFFORTS.items()
    }
    plant = ROBOT.control_plant()
    actuators = [
        plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices()
    ]
    assert {a.joint().name(): a.effort_limit() for a in actuators} == effort


def test_the_legs_are_as_long_and_as_far_apart_as_published():
    """Oracle: joint origins of the public description, knees straight [m]."""
    hip = np.array([0.05, 0.089 + 0.0225, -0.066])
    ankle = np.array([0.0, 0.089 + 0.0225, -0.066 - 0.374 - 0.422])
    legs = ROBOT.legs
    assert legs.length == pytest.approx(np.linalg.norm(hip - ankle), abs=1e-3)
    assert legs.hip_width == pytest.approx(2.0 * hip[1], abs=1e-12)
    plant = ROBOT.control_plant()
    context = plant.CreateDefaultContext()
    for joint, expected in {"l_leg_hpy": hip, "l_leg_aky": ankle}.items():
        frame = plant.GetJointByName(joint).frame_on_child()
        X_PF = frame.CalcPose(context, plant.GetFrameByName("pelvis"))
        assert X_PF.translation() == pytest.approx(expected, abs=1e-12)


def test_left_and_right_stand_alike():
    """Oracle: reflection in the x-z plane, but for the trunk's 2 mm of CoM."""
    plant = ROBOT.control_plant()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, ROBOT.standing_positions())
    for link in URDF.links:
        if link.startswith("l_"):
            p_L, p_R = (
                plant.GetBodyByName(name).EvalPoseInWorld(context).translation()
                for name in (link, f"r_{link[2:]}")
            )
            assert p_L == pytest.approx(p_R * [1.0, -1.0, 1.0], abs=5e-3)
