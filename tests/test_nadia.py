"""The figures of models/nadia/nadia.urdf."""

import numpy as np
import pytest

from nadia_balance.robot import load_robot
from tests.model_world import Urdf

ROBOT = load_robot("nadia")
URDF = Urdf(ROBOT)
MIRROR = np.diag([1.0, -1.0, 1.0])  # y -> -y


def test_the_mass_is_that_of_the_robot():
    """Oracle: total and largest masses of the public description [kg]."""
    assert ROBOT.mass == pytest.approx(90.8976, abs=1e-3)
    for link, mass in {
        "PELVIS_LINK": 19.0917,
        "TORSO_LINK": 13.5,
        "LEFT_THIGH_LINK": 10.953,
        "RIGHT_SHIN_LINK": 5.42,
        "LEFT_FOOT_LINK": 1.75,
        "RIGHT_SHOULDER_PITCH_LINK": 2.917,
    }.items():
        assert URDF.inertial(link)[0] == mass


@pytest.mark.parametrize(
    "link", ["HIP_YAW", "HIP_ROLL", "THIGH", "ANKLE", "SHOULDER_ROLL"]
)
def test_left_and_right_mirror_each_other_where_published_so(link):
    """Oracle: reflection in the x-z plane."""
    mass, com, inertia = URDF.inertial(f"LEFT_{link}_LINK")
    other_mass, other_com, other_inertia = URDF.inertial(f"RIGHT_{link}_LINK")
    assert other_mass == mass
    assert (other_inertia == MIRROR @ inertia @ MIRROR).all()
    if link == "SHOULDER_ROLL":  # published with the wrong sign of x, too
        com = com * [-1.0, 1.0, 1.0]
    assert (other_com == MIRROR @ com).all()


def test_every_joint_has_its_limits():
    """Oracle: the efforts of the issue [N m]; the published 100 rad/s."""
    effort = dict.fromkeys(URDF.joints, 1000.0)
    effort |= {"LEFT_KNEE_Y": 350.0, "RIGHT_KNEE_Y": 350.0}
    arm = ("SHOULDER_Y", "SHOULDER_X", "SHOULDER_Z", "ELBOW_Y")
    for name, left, right in zip(
        arm, (52.0, 57.0, 24.0, 24.0), (41.0, 41.0, 23.0, 23.0), strict=True
    ):
        effort |= {f"LEFT_{name}": left, f"RIGHT_{name}": right}
    plant = ROBOT.control_plant()
    actuators = [
        plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices()
    ]
    assert len(actuators) == 23
    assert {a.joint().name(): a.effort_limit() for a in actuators} == effort
    for actuator in actuators:
        assert actuator.joint().velocity_upper_limits() == [100.0]


def test_the_mass_matrix_is_well_conditioned():
    """Oracle: 924 in the notes at the zero pose, 22 071 without armature."""
    plant = ROBOT.control_plant()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, ROBOT.standing_positions())
    assert np.linalg.cond(plant.CalcMassMatrix(context)) < 2000.0


def test_the_sole_is_that_of_the_robot():
    """Oracle: the corners of the foot's mesh, x, y, z in the foot frame."""
    corners = [[a, b, -0.088] for a in (-0.072, 0.178) for b in (-0.06, 0.06)]
    for X_FS in ROBOT.X_FootSole.values():
        sole = [X_FS @ [*corner, 0.0] for corner in ROBOT.sole]
        assert sorted(np.round(sole, 12).tolist()) == corners


def test_left_moves_as_the_mirror_of_right():
    """Oracle: reflection; joints about x and z turn the other way."""
    plant = ROBOT.control_plant()
    context = plant.CreateDefaultContext()
    low, high = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    rng = np.random.default_rng(1)
    left = [name for name in URDF.joints if name.startswith("LEFT_")]
    for name in left:
        joint = plant.GetJointByName(name)
        other = plant.GetJointByName(name.replace("LEFT_", "RIGHT_"))
        sign = 1.0 if name.endswith("_Y") else -1.0
        i, j = joint.position_start(), other.position_start()
        assert sorted([sign * low[i], sign * high[i]]) == [low[j], high[j]]
        angle = rng.uniform(low[i], high[i])
        joint.set_angle(context, angle)
        other.set_angle(context, sign * angle)
    for link in URDF.links:
        if link.startswith("LEFT_"):
            X_L, X_R = (
                plant.GetBodyByName(name).EvalPoseInWorld(context)
                for name in (link, link.replace("LEFT_", "RIGHT_"))
            )
            # At most ten rotations in a row: a few units of rounding.
            np.testing.assert_allclose(
                MIRROR @ X_L.GetAsMatrix34() @ np.diag([1, -1, 1, 1]),
                X_R.GetAsMatrix34(),
                rtol=0.0,
                atol=1e-14,
            )
