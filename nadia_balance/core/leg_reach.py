"""How far apart the legs let both feet be, flat on the ground."""

import math

from nadia_balance.core.com_height import ComHeightParams
from nadia_balance.core.model import LegGeometry


def leg_reach(
    legs: LegGeometry, com_height: float, step_width: float
) -> dict[str, float]:
    """Returns lengths and widths [m] of ReachabilityParams, by name.

    The CoM, `com_height` [m] above the soles when standing, is as low as the
    height plan lets it be, the hips are half-way between the feet: Pythagoras
    on either leg, stretched or rolled as far as it gets.  Of Nadia it is what
    the paper's Sec. VII says, to 1 %.
    """
    params = ComHeightParams()
    lowest = params.min_height_ratio * com_height
    hip = max(lowest - legs.com_above_hip - legs.ankle_height, 0.0)
    stretched = params.max_stretch * legs.length
    reach = 2.0 * math.sqrt(max(stretched**2 - hip**2, 0.0))
    return {
        "length_forward": reach,
        "length_backward": reach,
        "width_nominal": step_width,
        "width_max": legs.hip_width
        + min(reach, 2.0 * hip * math.tan(legs.roll)),
    }
