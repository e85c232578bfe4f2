"""Lengths measured in a URDF: of Nadia, and of feet of other shapes."""

import math
import shutil
from dataclasses import replace

import numpy as np
import pytest
from pydrake.geometry import Box, Capsule, Convex, Cylinder
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder
from scipy.optimize import brentq

from nadia_balance.core.body.com_height import ComHeight, ComHeightParams
from nadia_balance.core.walking.state import FootPose, Side
from nadia_balance.robot.model import (
    MODELS,
    load_robot,
    load_robot_params,
    robot_names,
)
from nadia_balance.robot.params import RobotParams
from nadia_balance.robot.plants import is_pitch, joints_above
from nadia_balance.robot.urdf import with_lengths
from tests.boxes import register
from tests.example_walks import FEET, swing
from tests.robot.test_model import change


def test_given_lengths_stay_and_the_rest_is_measured(tmp_path):
    """Oracle: joint origins and the foot's mesh of the public description.

    A lower sole raises the ankle, and the CoM as much.
    """
    nadia = load_robot_params("nadia")[0]
    assert (nadia.legs.hip_width, nadia.legs.ankle_height) == (0.26, 0.098)
    assert nadia.com_height == 0.888  # of the paper's robot
    file = shutil.copytree(MODELS / "nadia", tmp_path / "own") / "robot.yaml"
    given = "name: own\nsole: {z: -0.1}\nlegs: {length: 0.7}"
    change(file, "name: nadia", given)
    params = load_robot_params(str(file))[0]
    assert (params.sole.x_min, params.sole.x_max) == (-0.072, 0.178)
    assert (params.sole.half_width, params.sole.z) == (0.06, -0.1)
    assert (params.legs.length, params.legs.ankle_height) == (0.7, 0.11)
    assert params.com_height == pytest.approx(nadia.com_height + 0.012)


def bone(context, hip, ankle):
    """The hip pitch axis as seen from the ankle's, [forward, up] [m]."""
    p_WH, p_WA = (
        joint.frame_on_child().CalcPoseInWorld(context).translation()
        for joint in (hip, ankle)
    )
    return (p_WH - p_WA)[[0, 2]]


def swung_apart(robot, lean, length):
    """Its plant and context: legs of this `length` that `lean` by +-[rad]."""
    plant = robot.control_plant()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, robot.standing_positions())
    for side, foot in robot.foot_bodies.items():
        above = [j for j in joints_above(plant, foot) if is_pitch(j, context)]
        ankle, knee, hip = above

        def excess(bend, knee=knee, ends=(hip, ankle)):
            knee.set_angle(context, bend)
            return math.hypot(*bone(context, *ends)) - length

        knee.set_angle(context, brentq(excess, 0.15, 1.5))
        turn = side.sign * lean - math.atan2(*bone(context, hip, ankle))
        hip.set_angle(context, hip.get_angle(context) + turn)
        level = -hip.get_angle(context) - knee.get_angle(context)
        ankle.set_angle(context, level)
    return plant, context


@pytest.mark.parametrize("name", robot_names())
@pytest.mark.parametrize("lean", [0.3, -0.3])
def test_a_stretched_leg_lets_the_com_be_as_high_as_it_is(name, lean):
    """Oracle: the kinematics of the plant, its knees bent to that length.

    8 mm, by which the CoM rises in the robot as the legs swing apart.
    """
    robot = load_robot(name)
    model, params = robot.point_mass, ComHeightParams()
    longest = params.max_stretch * model.legs.length
    plant, context = swung_apart(robot, lean, longest)
    X_WF = plant.GetBodyByName(robot.foot_bodies[Side.LEFT]).EvalPoseInWorld(
        context
    )
    p_WS = X_WF @ robot.X_FootSole[Side.LEFT].translation()
    x, _, z = plant.CalcCenterOfMassPositionInWorld(context) - p_WS
    going = replace(swing(), feet=FEET.with_foot(Side.LEFT, FootPose()))
    com = np.array([x, -0.5 * model.legs.hip_width])
    limit = ComHeight(params, model).stance_limit(com, np.zeros(2), going)
    assert limit[0] == pytest.approx(z, abs=8e-3)


CORNERS = np.array([[-0.05, -0.04], [0.15, -0.04], [0.15, 0.04], [-0.05, 0.04]])
TIP = [0.0, 0.0, 0.05]
WEDGE = Convex(np.vstack([np.c_[CORNERS, 4 * [-0.01]], TIP]).T, "wedge")
TURNED = Box(0.1, 0.3, 0.02), (0.04, 0.0, -0.02), (0, 0, math.pi / 2)
# Two, ahead; a third, higher one does not count.
RAILS = [
    (Capsule(0.02, 0.2), (0.05, y, z), (0, math.pi / 2, 0))
    for y, z in ((-0.03, -0.04), (0.03, -0.04), (0.2, -0.03))
]
ASIDE = Cylinder(0.05, 0.04), (0.02, 0.01, 0), (0, 0, 0)


@pytest.mark.parametrize(
    "shapes, ends",
    [
        ([TURNED], (-0.11, 0.19, 0.05, -0.03)),
        (RAILS, (-0.05, 0.15, 0.03, -0.06)),
        ([(WEDGE, (0, 0, -0.02), (0, 0, 0))], (-0.05, 0.15, 0.04, -0.03)),
        ([ASIDE], (-0.03, 0.07, 0.04, -0.02)),  # symmetric about y = 0
    ],
)
def test_soles_are_where_shapes_meet_the_ground(shapes, ends):
    """Oracle: by hand."""
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    mass = SpatialInertia.SolidSphereWithMass(1.0, 0.1)
    for foot in ("left", "right"):
        body = plant.AddRigidBody(foot, mass)
        for shape, p, rpy in shapes:
            X_BG = RigidTransform(RollPitchYaw(*rpy), p)
            register(plant, body, shape, X_BG)
    plant.Finalize()
    params = RobotParams(left_foot_body="left", right_foot_body="right")
    inspector = scene_graph.model_inspector()
    sole = with_lengths(params, {}, plant, inspector).sole
    assert (sole.x_min, sole.x_max, sole.half_width, sole.z) == ends
