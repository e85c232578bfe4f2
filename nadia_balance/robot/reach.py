"""Reachable footholds of a robot by whole-body inverse kinematics."""

import math
from dataclasses import replace

import numpy as np
from pydrake.math import RotationMatrix

from nadia_balance.core.body.com_height import ComHeightParams, height_limit
from nadia_balance.core.body.reachability import (
    BASE,
    ReachabilityParams,
    step_regions,
)
from nadia_balance.core.walking.vocabulary import FootPose, Side
from nadia_balance.robot.model import RobotModel, StandingKinematics

_TILT = math.radians(35.0)  # largest tilt of the pelvis in a recovery [rad]
_LEVEL = 0.01  # tolerance of the planned CoM height [m]
_BESIDE = 0.05  # the CoM is in the feet's bounding box, grown by this [m]
_LESS = 0.95  # factor on the lengths in each iteration
_NARROWER = 0.04  # reduction of widths in each iteration [leg length]
_TURNS = 24  # largest number of iterations


def stride(robot: RobotModel, foothold: np.ndarray) -> np.ndarray | None:
    """Positions (nq,), the left foot at `foothold` (2,) [m], the right at 0.

    None if the legs do not get there.  Both soles are flat, the CoM is between
    them at the height of the height plan, the pelvis nearly upright, and all
    joints are within their limits.
    """
    model, params = robot.point_mass, ComHeightParams()
    other = FootPose(np.append(foothold, 0.0))
    limit = height_limit(FootPose(), other, params, model.legs)
    lowest = params.min_height_ratio * model.com_height
    height = min(max(limit, lowest), model.com_height)
    feet = np.array([foothold, [0.0, 0.0]])  # left, right
    ik = StandingKinematics(
        robot,
        dict(zip(Side, feet, strict=True)),
        [*(feet.min(axis=0) - _BESIDE), height - _LEVEL],
        [*(feet.max(axis=0) + _BESIDE), height + _LEVEL],
    )
    pelvis = ik.plant.GetFrameByName(robot.pelvis_body)
    world, upright = ik.plant.world_frame(), RotationMatrix()
    ik.AddOrientationConstraint(world, upright, pelvis, upright, _TILT)
    guess, middle = robot.standing_positions(), 0.5 * foothold
    guess[4:6] = middle
    guess[6] += height - model.com_height
    return ik.nearest(guess, [*middle, height], weight=0.01)


def reaches(robot: RobotModel, foothold: np.ndarray) -> bool:
    """True if a `stride` gets to the `foothold` (2,) [m]."""
    return stride(robot, foothold) is not None


def reach_within(robot: RobotModel) -> tuple[ReachabilityParams, set[str]]:
    """Returns a reach that inverse kinematics confirms, and failed regions.

    The regions are reduced until all their corners and midpoints of edges are
    reached, except points beside the stance leg, which are no steps.  If the
    base region is too large, or no cross-over width can shrink, an iteration
    reduces lengths and the largest width; otherwise it reduces the cross-over
    widths.  The names are those of the regions with points out of reach after
    the last iteration.
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
    """Corners and midpoints (2 n, 2) of the edges: the reach is not convex."""
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
