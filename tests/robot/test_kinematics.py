from xml.etree import ElementTree
from xml.etree.ElementTree import SubElement

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from nadia_balance.core.walking.state import Side
from nadia_balance.core.whole_body.command import PELVIS, SOLES, TORSO
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.robot.kinematics import WholeBodyKinematics, whole_body_model
from nadia_balance.robot.model import MODELS
from tests import whole_body_examples as examples
from tests.whole_body_examples import kinematics, nadia, random_state, terms_at

STEP = 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_velocities_of_a_state_that_is_ahead_are_those_of_now(seed):
    """Oracle: finite difference: at twice the lead, four times the error."""
    state, plant = random_state(seed), kinematics().plant
    context, nq = examples.context_at(state), plant.num_positions()
    rates = plant.MapVelocityToQDot(context, state[nq:])
    now, errors = terms_at(state).velocities, []
    for lead in (1e-3, 2e-3):
        ahead = state.copy()
        ahead[:nq] += lead * rates
        ahead[:4] /= np.linalg.norm(ahead[:4])
        plant.SetPositionsAndVelocities(context, ahead)
        terms = WholeBodyKinematics(nadia(), plant, lead).calc(context)
        missed = (terms.velocities - now)[[*range(18), *range(-6, 0)]]
        first_order = terms.rows[:18, :-1] @ terms.v - now[:18]
        assert abs(missed).max() < 0.05 * abs(first_order).max()
        errors.append(missed)
    assert errors[1] == pytest.approx(4.0 * errors[0], rel=0.05, abs=1e-7)


@pytest.mark.parametrize("seed", range(3))
def test_velocities_are_those_of_soles_and_torso(seed):
    """Oracle: Drake's spatial velocities, shifted to the sole's centre."""
    state, plant = random_state(seed), kinematics().plant
    terms, context = terms_at(state), examples.context_at(state)
    for index, side in enumerate((Side.LEFT, Side.RIGHT)):
        foot = plant.GetBodyByName(nadia().foot_bodies[side])
        X_WB = plant.EvalBodyPoseInWorld(context, foot)
        X_FS = nadia().X_FootSole[side]
        V_WB = plant.EvalBodySpatialVelocityInWorld(context, foot)
        V_WS = V_WB.Shift(X_WB.rotation() @ X_FS.translation()).get_coeffs()
        velocities = terms.velocities[6 * index : 6 * index + 6]
        assert velocities == pytest.approx(V_WS, abs=1e-13)
        X_WS = X_WB @ X_FS
        assert terms.sole_positions[index] == pytest.approx(X_WS.translation())
        assert terms.rotations[index] == pytest.approx(X_WS.rotation().matrix())
    torso = plant.GetBodyByName(nadia().torso_body)
    w_WT = plant.EvalBodySpatialVelocityInWorld(context, torso).rotational()
    assert terms.velocities[TORSO] == pytest.approx(w_WT, abs=1e-13)
    assert terms.velocities[PELVIS] == pytest.approx(terms.v[:3], abs=1e-13)


@pytest.mark.parametrize("seed", range(3))
def test_bias_is_the_rest_of_the_acceleration(seed):
    """Oracle: finite differences of the velocities along the motion."""
    state, plant = random_state(seed), kinematics().plant
    terms = terms_at(state)
    vdot = np.random.default_rng(seed).normal(size=29)
    qdot = plant.MapVelocityToQDot(examples.context_at(state), terms.v)
    change = STEP * np.concatenate([qdot, vdot])
    ahead, behind = terms_at(state + change), terms_at(state - change)
    expected = (ahead.velocities - behind.velocities) / (2.0 * STEP)
    acceleration = terms.rows @ np.append(vdot, 1.0)
    for rows in (*SOLES, TORSO, PELVIS):
        # Truncation and rounding at this step both leave about 1e-8.
        assert acceleration[rows] == pytest.approx(expected[rows], abs=1e-6)


def test_joints_are_damped():
    """Oracle: the bias without damping, and one joint's by hand."""
    plant = MultibodyPlant(0.001)
    nadia().add_to(plant)
    knee = plant.GetJointByName("LEFT_KNEE_Y")
    knee.set_default_damping_vector([0.7])
    plant.Finalize()
    state, context = random_state(0), plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(context, state)
    damped = WholeBodyKinematics(nadia(), plant).calc(context).forces[:, -1]
    extra = nadia().mass * (damped - terms_at(state).forces[:, -1])
    expected = np.zeros(29)
    expected[knee.velocity_start()] = 0.7 * state[30 + knee.velocity_start()]
    assert extra == pytest.approx(expected, abs=1e-12)


def test_constants_are_in_the_order_of_velocities():
    """Oracle: joints by name, whatever the order of the actuators."""
    plant = kinematics().plant
    params = WholeBodyQpParams(joint_lower_limits={"LEFT_KNEE_Y": 0.2})
    params.joint_upper_limits = {"LEFT_KNEE_Y": 2.0, "LEFT_ANKLE_Y": 3.0}
    constants = whole_body_model(nadia(), plant, params)

    def at(values, joint):
        return values[plant.GetJointByName(joint).velocity_start() - 6]

    bent = nadia().posture["LEFT_ELBOW_Y"]
    assert at(constants.posture, "LEFT_ELBOW_Y") == pytest.approx(bent)
    assert at(constants.max_torque, "RIGHT_KNEE_Y") == 350.0
    assert at(constants.max_torque, "LEFT_SHOULDER_X") == 57.0
    assert at(constants.max_torque, "RIGHT_SHOULDER_X") == 41.0
    assert at(constants.position_upper, "RIGHT_KNEE_Y") == 2.62
    assert at(constants.position_lower, "LEFT_KNEE_Y") == 0.2
    assert at(constants.position_lower, "RIGHT_KNEE_Y") == 0.0
    # Upper limits only tighten those of the URDF.
    assert at(constants.position_upper, "LEFT_KNEE_Y") == 2.0
    assert at(constants.position_upper, "LEFT_ANKLE_Y") == 0.698132
    assert constants.is_leg_joint.sum() == 12
    assert at(constants.is_leg_joint, "RIGHT_ANKLE_X")
    assert not at(constants.is_leg_joint, "SPINE_Z")
    assert constants.mass == nadia().mass


def test_refuses_limits_that_no_joint_can_have():
    """Oracle: the message names field, joint and value; the knee's 2.62 rad."""
    must = r"joint_lower_limits.TAIL = 0.1: the robot has no such joint"
    with pytest.raises(ValueError, match=must):
        examples.model(TAIL=0.1)
    must = r"joint_lower_limits.LEFT_KNEE_Y = 3.0: must be below .*, 2.62 rad"
    with pytest.raises(ValueError, match=must):
        examples.model(LEFT_KNEE_Y=3.0)


def test_an_ankle_is_found_above_a_foot_that_is_welded_on():
    """Oracle: Nadia's ankles; a foot 3 cm lower and 1 cm ahead on a cuff."""
    text = (MODELS / "nadia" / "nadia.urdf").read_text(encoding="utf-8")
    top = ElementTree.fromstring(text)
    (roll,) = top.findall("joint[@name='LEFT_ANKLE_X']")
    roll.find("child").set("link", "cuff")
    SubElement(top, "link", name="cuff")
    weld = SubElement(top, "joint", name="weld", type="fixed")
    SubElement(weld, "parent", link="cuff")
    SubElement(weld, "child", link="LEFT_FOOT_LINK")
    SubElement(weld, "origin", xyz="0.01 0 -0.03")
    plant = MultibodyPlant(0.0)
    text = ElementTree.tostring(top, encoding="unicode")
    Parser(plant).AddModelsFromString(text, "urdf")
    plant.Finalize()
    params = WholeBodyQpParams()
    left, right = whole_body_model(nadia(), kinematics().plant, params).ankles
    left_welded, same = whole_body_model(nadia(), plant, params).ankles
    assert left_welded == pytest.approx(left + [-0.01, 0.0, 0.03])
    assert same == pytest.approx(right)
