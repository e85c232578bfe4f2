"""Extents of the base region from leg lengths, for flat soles and low hips."""

import math
from typing import NamedTuple

from nadia_balance.core.body.com_height import ComHeightParams
from nadia_balance.core.body.model import LegGeometry


class LegReach(NamedTuple):
    """Extents [m] of the base region (ReachabilityParams)."""

    length: float  # forward, and backward
    width_max: float


def leg_reach(
    legs: LegGeometry,
    com_height: float,
    lean: float,
    params: ComHeightParams | None = None,
) -> LegReach:
    """Returns the largest step length and width, with the hips half-way.

    The result is `height_limit` solved for the step, at the lowest CoM of the
    height plan, with legs of the largest length or an outward angle of `lean`
    [rad]; `com_height` [m] is that above the soles when standing.  For Nadia
    it agrees with the paper's Sec. VII to 1 %.

    Raises:
        ValueError: legs are straight at the lowest CoM, or hips on the ground.
    """
    params = params or ComHeightParams()
    above_ankle = legs.com_above_hip + legs.ankle_height
    hip = params.min_height_ratio * com_height - above_ankle
    longest = params.max_stretch * legs.length
    if not 0.0 < hip < longest:
        low, high = (
            (above_ankle + height) / params.min_height_ratio
            for height in (0.0, longest)
        )
        raise ValueError(
            f"com_height = {com_height:g}: must leave the legs bent in a "
            f"crouch: in ({low:.3f}, {high:.3f}) m"
        )
    length = 2.0 * math.sqrt(longest**2 - hip**2)
    aside = min(2.0 * hip * math.tan(lean), length)
    return LegReach(length, legs.hip_width + aside)
