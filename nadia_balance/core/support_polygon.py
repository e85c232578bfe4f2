"""The support polygon: the hull of the soles that are meant to carry."""

from __future__ import annotations

import numpy as np

from nadia_balance.core.polygon import convex_hull
from nadia_balance.core.walking import Array, ContactSchedule, Side


def support_polygon(schedule: ContactSchedule, sole: Array) -> Array:
    """Returns the hull (n, 2) [m] in W of the soles in contact.

    `sole` (k, 2) [m] are the corners of either sole in its own frame.
    """
    soles = [
        schedule.feet[side].to_world(sole)
        for side in Side
        if schedule.in_contact(side)
    ]
    return convex_hull(np.concatenate(soles))
