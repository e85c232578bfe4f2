"""Planned footsteps on the regions of the ground."""

import math
from collections.abc import Iterable
from dataclasses import replace

from nadia_balance.core.body import reachability
from nadia_balance.core.body.ground import Ground
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking import vocabulary as walking


def standing_on(ground: Ground, feet: walking.FootPoses) -> walking.FootPoses:
    """Returns the feet with the heights and normals of their regions.

    Raises ValueError: a foot is not on a single region.
    """
    for side in walking.Side:
        what = f"{side.value} foot at the start"
        feet = feet.with_foot(side, _on_region(ground, feet[side], what))
    return feet


def given_on(
    ground: Ground, steps: Iterable[walking.Footstep]
) -> tuple[walking.Footstep, ...]:
    """Returns the steps with the heights and normals of their regions.

    Raises ValueError: a step is not on a single region.
    """
    return tuple(
        replace(step, pose=_on_region(ground, step.pose, _name(number, step)))
        for number, step in enumerate(steps, start=1)
    )


def snapped_to(
    ground: Ground,
    steps: Iterable[walking.Footstep],
    feet: walking.FootPoses,
    reach: reachability.ReachabilityParams,
) -> tuple[walking.Footstep, ...]:
    """Returns the steps, each moved to the nearest foothold on the ground.

    Each foothold is within `reach` of its stance foot, the first at `feet`.

    Raises ValueError: there is no such foothold.
    """
    found = []
    for number, step in enumerate(steps, start=1):
        stance = feet[step.side.other]
        region = reachability.in_world(
            reachability.base_region(reach), stance, step.side
        )
        snapped = moved_to(ground, step, [region])
        if snapped is None:
            raise ValueError(
                f"{_name(number, step)}: must fit on a region within reach of "
                f"the other foot; {_beside(ground, step.pose)}"
            )
        feet = feet.with_foot(step.side, snapped.pose)
        found.append(snapped)
    return tuple(found)


def moved_to(
    ground: Ground, step: walking.Footstep, within: Iterable[Array]
) -> walking.Footstep | None:
    """Returns the step at the nearest foothold in the first feasible polygon.

    Polygons (n, 2) [m] in W, in order; None if none contains a foothold.
    """
    p, yaw = step.pose.p_WF, step.pose.yaw
    for polygon in within:
        point = ground.nearest(p[:2], yaw, polygon)
        if point is not None:
            return replace(step, pose=ground.pose(point, yaw, float(p[2])))
    return None


def _name(number: int, step: walking.Footstep) -> str:
    return f"step {number} ({step.side.value})"


def _on_region(
    ground: Ground, foot: walking.FootPose, what: str
) -> walking.FootPose:
    """Returns the foot on its region; raises ValueError about `what`."""
    if ground.region_under(foot) is None:
        raise ValueError(f"{what}: {_beside(ground, foot)}")
    return ground.pose(foot.p_WF[:2], foot.yaw, 0.0)


def _beside(ground: Ground, foot: walking.FootPose) -> str:
    """Returns the foot's position and the nearest foothold, as a message."""
    x, y, _ = foot.p_WF.tolist()
    point = ground.nearest(foot.p_WF[:2], foot.yaw)
    where = f"the sole at x = {x:.3f}, y = {y:.3f} m must be on one region"
    if point is None:
        return f"{where}, and fits on none"
    region = ground.region_under(ground.pose(point, foot.yaw, 0.0))
    name = "" if region is None else f", on {region.name!r}"
    away = math.dist(point, (x, y))
    return (
        f"{where}; the nearest foothold is x = {point[0]:.3f}, "
        f"y = {point[1]:.3f} m{name}, {away:.3f} m away"
    )
