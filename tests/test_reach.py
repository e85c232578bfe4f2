"""What is called reachable is: the oracle is inverse kinematics, of Drake."""

import math

import numpy as np
import pytest
from pydrake.math import RotationMatrix
from pydrake.multibody.inverse_kinematics import (
    ComPositionConstraint,
    InverseKinematics,
)
from pydrake.solvers import SnoptSolver

from nadia_balance.core.com_height import ComHeightParams, height_limit
from nadia_balance.core.reachability import step_regions
from nadia_balance.core.walking import FootPose, Side
from nadia_balance.robot import RobotModel, load_robot

TILT = math.radians(35.0)  # of the pelvis, in a recovery
BESIDE = 0.05  # the CoM may be beside the line between the feet [m]


def reaches(robot: RobotModel, foothold: np.ndarray) -> bool:
    """True if the left foot can be at `foothold` (2,), the right one at 0.

    Both flat, the CoM as high as the height plan has it then.
    """
    model, params = robot.point_mass, ComHeightParams()
    limit = height_limit(
        FootPose(), FootPose([*foothold, 0]), params, model.legs
    )
    lowest = params.min_height_ratio * model.com_height
    height = min(max(limit, lowest), model.com_height)
    plant = robot.control_plant()
    ik = InverseKinematics(plant)
    prog, q, world = ik.prog(), ik.q(), plant.world_frame()
    free = np.inf
    for side, (x, y) in ((Side.RIGHT, (0.0, 0.0)), (Side.LEFT, foothold)):
        foot = plant.GetFrameByName(robot.foot_bodies[side])
        # Three points with 3 + 2 + 1 fixed coordinates fix the sole.
        for p_S, low, high in (
            ([0.0, 0.0, 0.0], [x, y, 0.0], [x, y, 0.0]),
            ([0.1, 0.0, 0.0], [-free, y, 0.0], [free, y, 0.0]),
            ([0.0, 0.1, 0.0], [-free, -free, 0.0], [free, free, 0.0]),
        ):
            p_F = robot.X_FootSole[side] @ p_S
            ik.AddPositionConstraint(foot, p_F, world, low, high)
    pelvis, upright = plant.GetFrameByName(robot.pelvis_body), RotationMatrix()
    ik.AddOrientationConstraint(world, upright, pelvis, upright, TILT)
    com = prog.NewContinuousVariables(3)
    feet = np.array([[0.0, 0.0], foothold])
    prog.AddBoundingBoxConstraint(
        [*(feet.min(axis=0) - BESIDE), height - 0.01],
        [*(feet.max(axis=0) + BESIDE), height + 0.01],
        com,
    )
    prog.AddConstraint(
        ComPositionConstraint(plant, None, world, ik.get_mutable_context()),
        [*q, *com],
    )
    guess = robot.standing_positions()
    guess[4:6] = 0.5 * foothold
    guess[6] += height - model.com_height
    prog.AddQuadraticErrorCost(0.01 * np.eye(len(q)), guess, q)
    prog.SetInitialGuess(q, guess)
    prog.SetInitialGuess(com, [*(0.5 * foothold), height])
    return SnoptSolver().Solve(prog).is_success()


@pytest.mark.parametrize("name", ["nadia", "atlas"])
def test_a_leg_gets_to_every_corner_of_its_regions(name):
    """Oracle: whole-body inverse kinematics; the corners are the farthest."""
    robot = load_robot(name)
    for region, polygon in step_regions(robot.point_mass.reach, True).items():
        for corner in polygon:
            # The tip of the regions across is beneath the hip: it is no step.
            if corner[1] > 0.0 or abs(corner[0]) > 0.28:
                assert reaches(robot, corner), (region, corner)


def test_a_leg_does_not_get_anywhere():
    """Oracle: legs of 0.88 m do not span 1.9 m, lowered or not."""
    assert not reaches(load_robot("nadia"), np.array([1.9, 0.25]))
