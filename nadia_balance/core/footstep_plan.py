"""The commanded footsteps, as they can be taken from where the feet are."""

import math
from dataclasses import replace

import numpy as np

from nadia_balance.core.polygon import (
    convex_hull,
    intersection,
    project,
)
from nadia_balance.core.reachability import ReachabilityParams, base_region
from nadia_balance.core.walking import Array, FootPose, FootPoses, Footstep

_DISPLACED = 0.05  # unless pushed, feet land nearer to their footholds [m]


def within_reach(
    commanded: tuple[Footstep, ...],
    feet: FootPoses,
    reach: ReachabilityParams,
    landed: Footstep | None = None,
    num_steps: int = 3,
) -> tuple[Footstep, ...]:
    """Returns the footsteps, the first `num_steps` of them within reach.

    After a step has been adjusted, the next foothold that was commanded may be
    out of reach, or on the wrong side of the stance foot: it is moved to the
    nearest foothold with uncrossed legs.  Each step is seen from the one
    before it, so that the feet go back to the commanded ones in a few steps,
    none of which takes more than `return_share` of the reach.  `landed` is the
    command of the step before, if there was one: where that was kept, the
    next step is as long as it was meant to be.
    A step that needs no change is the very same object.
    """
    share = 1.0
    if landed is not None and not _is_at(feet[landed.side], landed.pose):
        share = reach.return_share
    steps = []
    for step in commanded[:num_steps]:
        stance, mirror = feet[step.side.other], np.array([1.0, step.side.sign])
        p_F = mirror * stance.to_sole(step.pose.p_WF[None, :2])[0]
        if reach.in_base_region(*p_F) and reach.in_base_region(
            *_scaled(p_F, reach, 1.0 / share)
        ):
            share = 1.0
        else:
            region = _share_of_region(reach, share)
            step = _moved(step, stance, mirror * project(p_F, region))
            share = reach.return_share
        feet = feet.with_foot(step.side, step.pose)
        steps.append(step)
    return (*steps, *commanded[num_steps:])


def _is_at(foot: FootPose, commanded: FootPose) -> bool:
    return math.dist(foot.p_WF[:2], commanded.p_WF[:2]) <= _DISPLACED


def _share_of_region(reach: ReachabilityParams, share: float) -> Array:
    """The part (n, 2) [m] of the base region that is left, or else all."""
    region = base_region(reach)
    part = intersection(convex_hull(_scaled(region, reach, share)), region)
    return part if len(part) else region


def _scaled(points: Array, reach: ReachabilityParams, share: float) -> Array:
    """Footholds (..., 2), shorter by `share`, and narrower where they are wide.

    Those nearer to the stance foot than (0, w_nom) do not come nearer.
    """
    x, y = points[..., 0], points[..., 1]
    wider = np.maximum(y - reach.width_nominal, 0.0)
    return np.stack([share * x, y + (share - 1.0) * wider], axis=-1)


def _moved(step: Footstep, stance: FootPose, p_F: Array) -> Footstep:
    xy = stance.to_world(p_F[None])[0]
    p_WF = np.append(xy, step.pose.p_WF[2])
    return replace(step, pose=replace(step.pose, p_WF=p_WF))
