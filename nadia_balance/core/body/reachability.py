"""Reachability regions of the swing foot.

Nadia paper, Sec. IV and V.  All are convex polygons (n, 2) [m], of footholds in
the sole frame of the stance foot; x forward, y toward the swing side.
"""

import math

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import (
    closest_point,
    convex_hull,
    intersection,
)
from nadia_balance.core.walking.state import FootPose, Side
from nadia_balance.parameters.bounds import bounded, parameters, require

BASE, FORWARD, BACKWARD = "base", "forward", "backward"

_ROUNDING = 1e-9  # on the edge of the base region [-], [m]


@parameters
class ReachabilityParams:
    """Parameters of the base region and the cross-over regions.

    The base region consists of four quarter ellipses about (0, width_nominal)
    (Nadia paper, Fig. 5), the cross-over regions are elliptic sectors with
    their apex there (Fig. 8).  Defaults as in Sec. VII.
    """

    length_forward: float = bounded(
        1.0, above=0.0, unit="m", doc="l_max, forward"
    )
    length_backward: float = bounded(
        1.0, above=0.0, unit="m", doc="l_min, backward"
    )
    width_min: float = bounded(
        0.125,
        above=0.0,
        unit="m",
        of="sole_width",
        doc="w_min, least distance to the side",
    )
    width_max: float = bounded(
        0.8, above=0.0, unit="m", doc="w_max, largest distance to the side"
    )
    width_nominal: float = bounded(
        0.25, above=0.0, unit="m", doc="w_nom, where the ellipses meet"
    )
    width_forward: float = bounded(
        0.1,
        unit="m",
        doc="w_fwd, largest crossing in front of the stance foot, beyond its "
        "centre line; negative: before the line",
    )
    width_backward: float = bounded(
        -0.05,
        unit="m",
        doc="w_bwd, largest crossing behind the stance foot, beyond its "
        "centre line; negative: before the line",
    )
    theta_forward_deg: float = bounded(
        20.0,
        least=0.0,
        most=80.0,
        unit="deg",
        doc="angle from the y axis, at (0, w_nom), for clearance of the "
        "stance leg in front",
    )
    theta_backward_deg: float = bounded(
        30.0, least=0.0, most=80.0, unit="deg", doc="the same, behind"
    )
    rise_max: float = bounded(
        0.25,
        above=0.0,
        unit="m",
        doc="largest step up or down, as in JSK's work",
    )

    def validate_more(self) -> None:
        """Checks the widths.

        Raises:
            ValueError: they define no region.
        """
        require(
            self.width_min < self.width_nominal < self.width_max,
            f"width_nominal = {self.width_nominal}: must be between "
            f"width_min = {self.width_min} and "
            f"width_max = {self.width_max} m",
        )
        for name, width in (
            ("width_forward", self.width_forward),
            ("width_backward", self.width_backward),
        ):
            require(
                -self.width_nominal < width <= self.width_max,
                f"{name} = {width}: must be in "
                f"(-width_nominal, width_max] = "
                f"(-{self.width_nominal}, {self.width_max}] m",
            )

    def in_base_region(self, x: float, y: float) -> bool:
        """Whether (x / length)^2 + ((y - width_nominal) / width)^2 <= 1.

        This is the exact ellipse; `base_region` is an inner polygon.

        Args:
            x: of the foothold, forward [m].
            y: of the foothold, to the swing side [m].

        Returns:
            True if it is reachable.
        """
        length = self.length_forward if x > 0.0 else self.length_backward
        out = y - self.width_nominal
        edge = self.width_max if out > 0.0 else self.width_min
        width = edge - self.width_nominal
        return (x / length) ** 2 + (out / width) ** 2 <= 1.0 + _ROUNDING

    def describe(self) -> str:
        """Describes the base region, for error messages.

        Returns:
            Its extent [m], as text.
        """
        return (
            f"[{-self.length_backward}, {self.length_forward}] m forward, "
            f"[{self.width_min}, {self.width_max}] m out (ellipse)"
        )


def base_region(params: ReachabilityParams) -> Array:
    """R_b, the region without crossing legs (Nadia paper, Fig. 5).

    Args:
        params: its lengths and widths.

    Returns:
        Vertices (n, 2) in the sole frame of the stance foot [m].
    """
    middle = params.width_nominal
    vertices = []
    for angle in np.linspace(0.0, 2.0 * math.pi, 9):  # last equals first
        c, s = math.cos(angle), math.sin(angle)
        length = params.length_forward if c > 0.0 else params.length_backward
        edge = params.width_min if s >= 0.0 else params.width_max
        vertices.append((length * c, middle - abs(middle - edge) * s))
    return convex_hull(np.array(vertices))


def cross_over_region(params: ReachabilityParams, region: str) -> Array:
    """R_fwd or R_bwd, the regions of crossed legs (Nadia paper, Fig. 8).

    Args:
        params: their lengths, widths and angles.
        region: FORWARD or BACKWARD.

    Returns:
        Vertices (n, 2) in the sole frame of the stance foot [m].
    """
    if region == FORWARD:
        length, beyond = params.length_forward, params.width_forward
        theta = math.radians(params.theta_forward_deg)
    else:
        length, beyond = -params.length_backward, params.width_backward
        theta = math.radians(params.theta_backward_deg)
    middle = params.width_nominal
    inward = (middle + beyond) / math.cos(theta)
    vertices = [(0.0, middle)]
    for angle in np.linspace(theta - 0.5 * math.pi, 0.5 * math.pi, 7):
        width = inward if angle < 0.0 else params.width_max - middle
        vertices.append(
            (length * math.cos(angle), middle + width * math.sin(angle))
        )
    return convex_hull(np.array(vertices))


def step_regions(
    params: ReachabilityParams, cross_over: bool
) -> dict[str, Array]:
    """The regions of a step.

    Args:
        params: their lengths, widths and angles.
        cross_over: whether legs may cross.

    Returns:
        Vertices (n, 2) in the sole frame of the stance foot [m] of BASE, and
        with `cross_over` of FORWARD and BACKWARD, by name.
    """
    if not cross_over:
        return {BASE: base_region(params)}
    return {
        BASE: base_region(params),
        FORWARD: cross_over_region(params, FORWARD),
        BACKWARD: cross_over_region(params, BACKWARD),
    }


def total_region(params: ReachabilityParams, cross_over: bool) -> Array:
    """The hull of all regions, which covers the stance foot: no footholds.

    Args:
        params: their lengths, widths and angles.
        cross_over: whether legs may cross.

    Returns:
        Vertices (n, 2) in the sole frame of the stance foot [m].
    """
    return convex_hull(
        np.concatenate(list(step_regions(params, cross_over).values()))
    )


def circle(radius: float, num_vertices: int = 32) -> Array:
    """R_lmax: a disc about the stance foot, as an inner polygon.

    Args:
        radius: l_max [m].
        num_vertices: n, on the circle.

    Returns:
        Vertices (n, 2) in the sole frame of the stance foot [m].
    """
    angles = np.arange(num_vertices) * (2.0 * math.pi / num_vertices)
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def in_world(region: Array, stance: FootPose, swing: Side) -> Array:
    """A region in W.

    Args:
        region: vertices (n, 2) in the sole frame of the stance foot [m].
        stance: pose of the stance foot in W.
        swing: the foot in the air; for the right one y is mirrored.

    Returns:
        Vertices (n, 2) in W [m], counter-clockwise.
    """
    if swing is Side.RIGHT:  # mirrored, and again counter-clockwise
        region = region[::-1] * [1.0, -1.0]
    return stance.to_world(region)


def distance_between(polygon: Array, other: Array) -> float:
    """The distance |p - q| of the closest points of two convex polygons.

    Args:
        polygon: vertices (n, 2) [m].
        other: vertices (k, 2) [m].

    Returns:
        The distance [m]; 0 if they share an area.
    """
    if len(intersection(polygon, other)):
        return 0.0
    return closest_point(polygon, other)[1]
