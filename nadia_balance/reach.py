"""How far a robot can step: found by whole-body inverse kinematics."""

import math
from dataclasses import replace

import numpy as np
from pydrake.math import RotationMatrix
from pydrake.multibody.inverse_kinematics import (
    ComPositionConstraint,
    InverseKinematics,
)
from pydrake.solvers import SnoptSolver

from nadia_balance.core.com_height import ComHeightParams, height_limit
from nadia_balance.core.reachability import (
    BASE,
    ReachabilityParams,
    step_regions,
)
from nadia_balance.core.walking import FootPose, Side
from nadia_balance.robot import RobotModel

_TILT = math.radians(35.0)  # of the pelvis, in a recovery
_LEVEL = 0.01  # the CoM is as high as planned, to within this [m]
_BESIDE = 0.05  # the CoM may be beside the line between the feet [m]
_LESS = 0.95  # of the lengths, in each turn of the search
_NARROWER = 0.04  # a step across, in each turn, of the leg's length
_TURNS = 24


def reaches(robot: RobotModel, foothold: np.ndarray) -> bool:
    """True if the left foot can be at `foothold` (2,) [m], the right one at 0.

    With both soles flat, the CoM between them and as high as the height plan
    has it there, the pelvis nearly upright, and all joints within their limits.
    """
    model, params = robot.point_mass, ComHeightParams()
    other = FootPose(np.append(foothold, 0.0))
    limit = height_limit(FootPose(), other, params, model.legs)
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
    ik.AddOrientationConstraint(world, upright, pelvis, upright, _TILT)
    com = prog.NewContinuousVariables(3)
    feet = np.array([[0.0, 0.0], foothold])
    prog.AddBoundingBoxConstraint(
        [*(feet.min(axis=0) - _BESIDE), height - _LEVEL],
        [*(feet.max(axis=0) + _BESIDE), height + _LEVEL],
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
    return bool(SnoptSolver().Solve(prog).is_success())


def reach_within(robot: RobotModel) -> tuple[ReachabilityParams, set[str]]:
    """Returns the robot's reach, cut down to what its legs reach.

    And the names of the regions of which that was not enough, none if all went
    well.  Until all corners of its regions, and the middles between them, are
    reached: shorter and less wide, or, if that is not what they need, less far
    across.  Next to the stance leg nothing counts: it is no step.
    """
    reach, leg = robot.point_mass.reach, robot.params.legs.length
    missed: list[tuple[str, np.ndarray]] = []
    for _ in range(_TURNS):
        missed = [
            (name, point)
            for name, polygon in step_regions(reach, True).items()
            for point in _around(polygon)
            if not (_beside_stance(robot, point) or reaches(robot, point))
        ]
        if not missed:
            break
        less = {
            f"width_{name}": max(
                getattr(reach, f"width_{name}") - _NARROWER * leg,
                -0.9 * reach.width_nominal,
            )
            for name, point in missed
            if name != BASE and point[1] < reach.width_nominal
        }
        narrower = replace(reach, **less)
        too_long = narrower == reach or any(name == BASE for name, _ in missed)
        reach = _shorter(reach) if too_long else narrower
    return reach, {name for name, _ in missed}


def _around(polygon: np.ndarray) -> np.ndarray:
    """Corners and middles (2 n, 2) of the edges: not all between is reached."""
    return np.vstack([polygon, 0.5 * (polygon + np.roll(polygon, 1, axis=0))])


def _shorter(reach: ReachabilityParams) -> ReachabilityParams:
    return replace(
        reach,
        length_forward=_LESS * reach.length_forward,
        length_backward=_LESS * reach.length_backward,
        width_max=max(_LESS * reach.width_max, 1.01 * reach.width_nominal),
    )


def _beside_stance(robot: RobotModel, corner: np.ndarray) -> bool:
    detour = robot.point_mass.detour
    return abs(corner[0]) < detour.ahead and corner[1] < detour.beside
