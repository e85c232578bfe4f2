"""Where the ICP feedback may put the CoP and the eCMP."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.polygon import halfspaces, project, shrink
from nadia_balance.core.walking import Array


@dataclass(frozen=True, eq=False)
class FeedbackLimits:
    """The constraints of the Nadia paper's Eq. 8, the same while contacts are.

    lower <= C (cop, kappa) <= upper, with the total kappa = ecmp - cop: the
    CoP in the `polygon` (n, 2) [m] of W, and kappa within +-max_kappa [m]
    along the rows of `axes` (2, 2), the last two rows of C.  As kappa leads
    from the CoP to the eCMP, this also bounds how far the eCMP leaves the
    polygon.  C is (max_edges + 2, 4); rows that are not needed are zero, and
    without bounds.
    """

    polygon: Array
    axes: Array
    max_kappa: float
    C: Array
    lower: Array
    upper: Array

    def clipped(self, increments: Array, reference: Array) -> Array:
        """Returns (delta, kappa) (4,) as near as the limits allow.

        `reference` (4,) is (cop_r, kappa_r), the increments start from it.
        """
        total = reference + increments
        cop = project(total[:2], self.polygon)
        on_axes = self.axes @ total[2:]
        kappa = self.axes.T @ on_axes.clip(-self.max_kappa, self.max_kappa)
        return np.asarray(np.concatenate((cop, kappa)) - reference)


def feedback_limits(
    support: Array,
    heading: float,
    safe_distance: float,
    max_kappa: float,
    max_edges: int = 8,
) -> FeedbackLimits:
    """Returns the limits for a support polygon (n, 2) [m] in W.

    The CoP stays `safe_distance` [m] inside; `heading` [rad] is the yaw of
    the foot whose length and width bound kappa; n <= max_edges.

    Raises:
        ValueError: nothing is left of the polygon.
    """
    polygon = shrink(support, safe_distance)
    A, b = halfspaces(polygon)
    c, s = math.cos(heading), math.sin(heading)
    axes = np.array([[c, s], [-s, c]])
    C = np.zeros((max_edges + 2, 4))
    upper = np.full(max_edges + 2, np.inf)
    lower = -upper
    C[: len(A), :2], upper[: len(A)] = A, b
    C[max_edges:, 2:], upper[max_edges:] = axes, max_kappa
    lower[max_edges:] = -max_kappa
    return FeedbackLimits(polygon, axes, max_kappa, C, lower, upper)


def check_safe_distance(distance: float, sole: Array) -> None:
    """Raises ValueError if the CoP has no place in the `sole` (n, 2) [m]."""
    try:
        shrink(sole, distance)
    except ValueError:
        raise ValueError(
            f"cop_safe_distance = {distance}: must leave some of the sole"
        ) from None
