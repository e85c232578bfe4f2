"""How far apart the feet can be, from the legs: flat soles, the hips low."""

import math
from typing import NamedTuple

from nadia_balance.core.com_height import ComHeightParams
from nadia_balance.core.model import LegGeometry


class LegReach(NamedTuple):
    """Of the base region (ReachabilityParams) [m]."""

    length: float  # forward, and backward
    width_max: float


def leg_reach(
    legs: LegGeometry,
    com_height: float,
    lean: float,
    params: ComHeightParams | None = None,
) -> LegReach:
    """Returns how far apart the feet can be, the hips half-way between them.

    The CoM, `com_height` [m] above the soles when standing, is as low as the
    height plan lets it be; a leg is as long as there, or leans outward by
    `lean` [rad].  It is `height_limit` solved for the step, and of Nadia what
    the paper's Sec. VII says, to 1 %.

    Raises:
        ValueError: the hips are not that low, or they are on the ground.
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
