"""Reachability regions of the swing foot.

Nadia paper, Sec. IV and V.  All are convex polygons (n, 2) [m], of footholds in
the sole frame of the stance foot; x forward, y toward the swing side.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import convex_hull
from nadia_balance.core.walking.state import FootPose, Side
from nadia_balance.parameters.bounds import bounded

BASE, FORWARD, BACKWARD = "base", "forward", "backward"

_ROUNDING = 1e-9  # on the edge of the base region [-], [m]
_COMPLEX = np.array([1.0, 1.0j])


@dataclass(kw_only=True)
class ReachabilityParams:
    """Parameters of the base region and the cross-over regions.

    The base region consists of four quarter ellipses about (0, width_nominal)
    (Nadia paper, Fig. 5), the cross-over regions are elliptic sectors with
    their apex there (Fig. 8).  Defaults as in Sec. VII.
    """

    length_forward: float = bounded(1.0, above=0.0, unit="m")  # l_max
    length_backward: float = bounded(1.0, above=0.0, unit="m")  # l_min
    # w_min
    width_min: float = bounded(0.125, above=0.0, unit="m", of="sole_width")
    width_max: float = bounded(0.8, above=0.0, unit="m")  # w_max
    width_nominal: float = bounded(0.25, above=0.0, unit="m")  # w_nom
    # Largest crossing of the feet beyond the centre line of the stance foot,
    # w_fwd in front of it and w_bwd behind it [m]; negative: before the line.
    width_forward: float = bounded(0.1, unit="m")
    width_backward: float = bounded(-0.05, unit="m")
    # Angles from the y axis, at (0, w_nom), for clearance of the stance leg.
    theta_forward_deg: float = bounded(20.0, least=0.0, most=80.0, unit="deg")
    theta_backward_deg: float = bounded(30.0, least=0.0, most=80.0, unit="deg")
    # Largest step up or down, as in JSK's work.
    rise_max: float = bounded(0.25, above=0.0, unit="m")

    def validate_more(self) -> None:
        """Raises ValueError if the widths define no region."""
        if not self.width_min < self.width_nominal < self.width_max:
            raise ValueError(
                f"width_nominal = {self.width_nominal}: must be between "
                f"width_min = {self.width_min} and "
                f"width_max = {self.width_max} m"
            )
        for name in ("width_forward", "width_backward"):
            if not -self.width_nominal < getattr(self, name) <= self.width_max:
                raise ValueError(
                    f"{name} = {getattr(self, name)}: must be in "
                    f"(-width_nominal, width_max] = "
                    f"(-{self.width_nominal}, {self.width_max}] m"
                )

    def in_base_region(self, x: float, y: float) -> bool:
        """True if the foothold x forward, y to the swing side [m] is reachable.

        The test uses the exact ellipse; `base_region` is an inner polygon.
        """
        length = self.length_forward if x > 0.0 else self.length_backward
        out = y - self.width_nominal
        edge = self.width_max if out > 0.0 else self.width_min
        width = edge - self.width_nominal
        return (x / length) ** 2 + (out / width) ** 2 <= 1.0 + _ROUNDING

    def describe(self) -> str:
        """Describes the base region, for error messages."""
        return (
            f"[{-self.length_backward}, {self.length_forward}] m forward, "
            f"[{self.width_min}, {self.width_max}] m out (ellipse)"
        )


def base_region(params: ReachabilityParams) -> Array:
    """Returns R_b, the region without crossing legs (Nadia paper, Fig. 5)."""
    middle = params.width_nominal
    vertices = []
    for angle in np.linspace(0.0, 2.0 * math.pi, 9):  # last equals first
        c, s = math.cos(angle), math.sin(angle)
        length = params.length_forward if c > 0.0 else params.length_backward
        edge = params.width_min if s >= 0.0 else params.width_max
        width = abs(middle - edge)
        vertices.append((length * c, middle - width * s))
    return convex_hull(np.array(vertices))


def cross_over_region(params: ReachabilityParams, region: str) -> Array:
    """Returns R_fwd or R_bwd, for FORWARD or BACKWARD (Nadia paper, Fig. 8)."""
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
        c, s = math.cos(angle), math.sin(angle)
        width = inward if angle < 0.0 else outward
        vertices.append((length * c, middle + width * s))
    return convex_hull(np.array(vertices))


def step_regions(
    params: ReachabilityParams, cross_over: bool
) -> dict[str, Array]:
    """Returns BASE, with `cross_over` also FORWARD and BACKWARD, by name."""
    regions = {BASE: base_region(params)}
    if cross_over:
        for name in FORWARD, BACKWARD:
            regions[name] = cross_over_region(params, name)
    return regions


def total_region(params: ReachabilityParams, cross_over: bool) -> Array:
    """Returns the hull of all, which covers the stance foot: no footholds."""
    regions = step_regions(params, cross_over)
    return convex_hull(np.concatenate(list(regions.values())))


def circle(radius: float, num_vertices: int = 32) -> Array:
    """Returns R_lmax: a disc about the stance foot, as an inner polygon."""
    angles = np.arange(num_vertices) * (2.0 * math.pi / num_vertices)
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def in_world(region: Array, stance: FootPose, swing: Side) -> Array:
    """Returns `region` (n, 2) [m] in W, for the foot `swing` in the air."""
    if swing is Side.RIGHT:  # mirrored, and again counter-clockwise
        region = region[::-1] * [1.0, -1.0]
    return stance.to_world(region)


def closest_point(polygon: Array, other: Array) -> tuple[Array, float]:
    """Returns the point (2,) of `polygon` closest to `other`, and the gap [m].

    The convex polygons must be disjoint.  One end of the gap is a vertex, so
    the vertices of each are projected onto all edges of the other.
    """
    # As complex numbers, the scalar product with the edge is one product.
    p, q = polygon @ _COMPLEX, other @ _COMPLEX
    i, _, to_other = _closest_vertex(p, q)
    _, foot, to_polygon = _closest_vertex(q, p)
    z = p[i] if to_other <= to_polygon else foot
    return np.array([z.real, z.imag]), min(to_other, to_polygon)


def _closest_vertex(
    vertices: NDArray[np.complex128], polygon: NDArray[np.complex128]
) -> tuple[int, complex, float]:
    """Returns the closest vertex' index, its projection, and the gap."""
    edges = np.concatenate([polygon[1:], polygon[:1]]) - polygon
    apart = vertices[:, None] - polygon
    along = (apart / edges).real
    apart -= np.minimum(np.maximum(along, 0.0), 1.0) * edges
    gaps = np.abs(apart)
    i, k = divmod(int(gaps.argmin()), len(polygon))
    return i, complex(vertices[i] - apart[i, k]), float(gaps[i, k])
