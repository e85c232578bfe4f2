"""What each eCMP waypoint of an ICP plan adds to the reference ICP."""

import numpy as np

from nadia_balance.core.walking import Array


def recursive_multipliers(knots: Array, t: float, omega: float) -> Array:
    """Returns the multipliers (N + 1,) of the eCMP waypoints at the `knots`.

    The eCMP goes from one to the next in straight lines, and stays at the last
    one.  The ICP that ends there was, at time t [s], their sum with these
    multipliers, which are not negative and add up to 1: the Atlas paper's
    Eq. 14 and Algorithm 1, for which the CMP jumps between heel and toe.
    With `knots` (N + 1,) [s] increasing, and `omega` [rad/s].

    Waypoints that have been passed have 0.
    """
    begin, end = np.maximum(knots[:-1], t), np.maximum(knots[1:], t)
    passed = np.clip((t - knots[:-1]) / np.diff(knots), 0.0, 1.0)
    # Of a segment from e0 to e1 that lasts T, with d = e^(-w T):
    # icp(0) = d icp(T) + (1 - d - b) e0 + b e1.
    x = omega * (end - begin)  # 0 of what has been passed
    d = np.exp(-x)
    b = np.divide(-np.expm1(-x), x, out=np.ones_like(x), where=x > 0.0) - d
    after = np.exp(-omega * (begin - t))  # of the plan before the segment
    first = after * (1.0 - d - b)
    multipliers = np.zeros(len(knots))
    multipliers[:-1] += (1.0 - passed) * first
    multipliers[1:] += passed * first + after * b
    multipliers[-1] += np.exp(-omega * (end[-1] - t))
    return multipliers
