"""Contact wrenches that a rectangular sole can transmit."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NUM_CONE_ROWS = 16


def contact_wrench_cone(length: float, width: float, friction: float) -> Array:
    """Returns U (16, 6) of the cone U [tau, f] <= 0, at the sole's centre.

    tau (3,) [N m] and f (3,) [N] act on the sole, in the sole frame: z up, x
    along `length` [m].  The cone is exact for four corners with a friction
    pyramid |f_x|, |f_y| <= friction * f_z each.  Rows: 4 friction, 4 centre
    of pressure, 8 yaw moment (Caron, Pham, Nakamura, Stability of surface
    contacts for humanoid robots, ICRA 2015, Eqs. 15-19).

    Raises:
        ValueError: an argument is not positive.
    """
    for name, value in (
        ("length", length),
        ("width", width),
        ("friction", friction),
    ):
        if not value > 0.0:
            raise ValueError(f"{name} = {value}: must be > 0")
    x, y, mu = 0.5 * length, 0.5 * width, friction
    signs = list(itertools.product((1.0, -1.0), repeat=2))
    force = [[0, 0, 0, s, 0, -mu] for s in (1.0, -1.0)]
    force += [[0, 0, 0, 0, s, -mu] for s in (1.0, -1.0)]
    pressure = [[s, 0, 0, 0, 0, -y] for s in (1.0, -1.0)]
    pressure += [[0, s, 0, 0, 0, -x] for s in (1.0, -1.0)]
    # tau_z <= mu (x + y) f_z - |y f_x + mu tau_x| - |x f_y + mu tau_y|, and
    # -tau_z <= mu (x + y) f_z - |y f_x - mu tau_x| - |x f_y - mu tau_y|.
    yaw = [
        [s * a * mu, s * b * mu, s, a * y, b * x, -mu * (x + y)]
        for s in (1.0, -1.0)
        for a, b in signs
    ]
    return np.array(force + pressure + yaw)
