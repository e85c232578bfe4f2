"""Where the swing foot can be put (Nadia paper, Sec. IV and V).

All regions are convex polygons, counter-clockwise, of footholds in the sole
frame of the stance foot; x forward, y toward the swing side.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from nadia_balance.core.polygon import contains, convex_hull
from nadia_balance.core.walking import Array, FootPose, Side

BASE, FORWARD, BACKWARD = "base", "forward", "backward"

LENGTHS = ("length_forward", "length_backward")
WIDTHS = ("width_min", "width_nominal", "width_max")


@dataclass(kw_only=True)
class ReachabilityParams:
    """The base region and what crossing the legs adds to it.

    The base region is a quarter ellipse on each side of (0, width_nominal)
    (Nadia paper, Fig. 5), the cross-over regions are slices of a pie with
    their tip there (Fig. 8).  Defaults as in Sec. VII.
    """

    length_forward: float = 1.0  # l_max [m]
    length_backward: float = 1.0  # l_min [m]
    width_min: float = 0.125  # w_min [m]
    width_max: float = 0.8  # w_max [m]
    width_nominal: float = 0.25  # w_nom [m]
    # Steps back to the commanded footholds are no longer, and no wider beyond
    # w_nom, than so much of the base region: at the gait's pace, the ankle of
    # the other foot would meet its limit [-].
    return_share: float = 0.7
    cross_over: bool = False  # whether the legs may be crossed
    # How far beyond the stance foot's centre line; negative: not up to it.
    width_forward: float = 0.1  # w_fwd, in front of the stance foot [m]
    width_backward: float = -0.05  # w_bwd, behind the stance foot [m]
    # Angles from the y axis, at (0, w_nom), that keep clear of the stance leg.
    theta_forward_deg: float = 20.0  # theta_fwd [deg]
    theta_backward_deg: float = 30.0  # theta_bwd [deg]
    # Vertices [x, y] [m] of a convex base region in place of the ellipse.
    base_polygon: list[list[float]] = field(default_factory=list)

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        for name in (*LENGTHS, *WIDTHS):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} = {value}: must be > 0 m")
        if not self.width_min < self.width_nominal < self.width_max:
            raise ValueError(
                f"width_nominal = {self.width_nominal}: must be between "
                f"width_min = {self.width_min} and "
                f"width_max = {self.width_max} m"
            )
        if not 0.0 < self.return_share <= 1.0:
            raise ValueError(
                f"return_share = {self.return_share}: must be in (0, 1]"
            )
        self._validate_cross_over()
        if self.base_polygon:
            _validate_polygon(self.base_polygon)

    def _validate_cross_over(self) -> None:
        for name in ("width_forward", "width_backward"):
            value = getattr(self, name)
            if not -self.width_nominal < value <= self.width_max:
                raise ValueError(
                    f"{name} = {value}: must be in (-width_nominal, "
                    f"width_max] = (-{self.width_nominal}, {self.width_max}] m"
                )
        for name in ("theta_forward_deg", "theta_backward_deg"):
            value = getattr(self, name)
            if not 0.0 <= value <= 80.0:
                raise ValueError(f"{name} = {value}: must be in [0, 80] deg")

    def in_base_region(self, x: float, y: float) -> bool:
        """True if the foot can be put at x forward, y to the swing side [m].

        Of the true ellipse, of which `base_region` is the inner polygon.
        """
        if self.base_polygon:
            return contains(np.array([x, y]), base_region(self), 1e-9)
        length = self.length_forward if x > 0.0 else self.length_backward
        out = y - self.width_nominal
        width = (
            self.width_max - self.width_nominal
            if out > 0.0
            else self.width_nominal - self.width_min
        )
        return (x / length) ** 2 + (out / width) ** 2 <= 1.0 + 1e-9

    def describe(self) -> str:
        """The region in words, for error messages."""
        if self.base_polygon:
            return f"the polygon {self.base_polygon}"
        return (
            f"[{-self.length_backward}, {self.length_forward}] m forward, "
            f"[{self.width_min}, {self.width_max}] m out (ellipse)"
        )


def base_region(params: ReachabilityParams) -> Array:
    """Returns R_b (n, 2) [m]: feet side by side (Nadia paper, Fig. 5)."""
    if params.base_polygon:
        return convex_hull(np.array(params.base_polygon))
    middle = params.width_nominal
    vertices = []
    for angle in np.linspace(0.0, 2.0 * math.pi, 9):  # the last is the first
        c, s = math.cos(angle), math.sin(angle)
        length = params.length_forward if c > 0.0 else params.length_backward
        width = (
            middle - params.width_min if s >= 0.0 else params.width_max - middle
        )
        vertices.append((length * c, middle - width * s))
    return convex_hull(np.array(vertices))


def cross_over_region(params: ReachabilityParams, region: str) -> Array:
    """Returns R_fwd or R_bwd (n, 2) [m] (Nadia paper, Fig. 8).

    `region` is FORWARD or BACKWARD.
    """
    if region == FORWARD:
        length, beyond = params.length_forward, params.width_forward
        theta = math.radians(params.theta_forward_deg)
    else:
        length, beyond = -params.length_backward, params.width_backward
        theta = math.radians(params.theta_backward_deg)
    middle = params.width_nominal
    inward = (middle + beyond) / math.cos(theta)
    outward = params.width_max - middle
    vertices = [(0.0, middle)]
    for angle in np.linspace(theta - 0.5 * math.pi, 0.5 * math.pi, 7):
        width = inward if angle < 0.0 else outward
        vertices.append(
            (length * math.cos(angle), middle + width * math.sin(angle))
        )
    return convex_hull(np.array(vertices))


def step_regions(params: ReachabilityParams) -> dict[str, Array]:
    """Returns the regions that a step may be put into, by name."""
    regions = {BASE: base_region(params)}
    if params.cross_over:
        for name in FORWARD, BACKWARD:
            regions[name] = cross_over_region(params, name)
    return regions


def total_region(params: ReachabilityParams) -> Array:
    """Returns the hull (n, 2) [m] of all regions.

    It covers the stance foot: only for capture regions, never for a step.
    """
    return convex_hull(np.concatenate(list(step_regions(params).values())))


def circle(radius: float, num_vertices: int = 32) -> Array:
    """Returns R_lmax (n, 2) [m]: a disc about the stance foot, from inside."""
    angles = np.arange(num_vertices) * (2.0 * math.pi / num_vertices)
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def in_world(region: Array, stance: FootPose, swing: Side) -> Array:
    """Returns `region` (n, 2) [m] in W, for the foot `swing` in the air."""
    if swing is Side.RIGHT:  # mirrored, and again counter-clockwise
        region = region[::-1] * [1.0, -1.0]
    return stance.to_world(region)


def _validate_polygon(vertices: list[list[float]]) -> None:
    if any(len(vertex) != 2 for vertex in vertices) or not np.all(
        np.isfinite(vertices)
    ):
        raise ValueError(
            f"base_polygon = {vertices}: must be a list of finite [x, y]"
        )
    if not 3 <= len(convex_hull(np.array(vertices))) == len(vertices):
        raise ValueError(
            f"base_polygon = {vertices}: must be convex, with 3 or more corners"
        )
