"""The commanded footsteps, as they can be taken from where the feet are."""

from dataclasses import replace

import numpy as np

from nadia_balance.core.polygon import project
from nadia_balance.core.reachability import ReachabilityParams, base_region
from nadia_balance.core.walking import Array, FootPose, FootPoses, Footstep


def within_reach(
    commanded: tuple[Footstep, ...],
    feet: FootPoses,
    reach: ReachabilityParams,
    num_steps: int = 3,
) -> tuple[Footstep, ...]:
    """Returns the footsteps, the first `num_steps` of them within reach.

    After a step has been adjusted, the next foothold that was commanded may be
    out of reach, or on the wrong side of the stance foot: it is moved to the
    nearest foothold with uncrossed legs.  Each step is seen from the one
    before it, so that the feet go back to the commanded ones in a few steps.
    A step that needs no change is the very same object.
    """
    region = base_region(reach)
    steps = []
    for step in commanded[:num_steps]:
        stance = feet[step.side.other]
        x, y = p_F = stance.to_sole(step.pose.p_WF[None, :2])[0]
        if not reach.in_base_region(x, step.side.sign * y):
            mirror = np.array([1.0, step.side.sign])
            step = _moved(step, stance, mirror * project(mirror * p_F, region))
        feet = feet.with_foot(step.side, step.pose)
        steps.append(step)
    return (*steps, *commanded[num_steps:])


def _moved(step: Footstep, stance: FootPose, p_F: Array) -> Footstep:
    xy = stance.to_world(p_F[None])[0]
    p_WF = np.append(xy, step.pose.p_WF[2])
    return replace(step, pose=replace(step.pose, p_WF=p_WF))
