"""Reachability regions of the swing foot, and the rules to choose one.

Nadia paper, Sec. IV and V.  All regions are convex polygons (n, 2) [m],
counter-clockwise, of footholds in the sole frame of the stance foot; x
forward, y toward the swing side.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nadia_balance.core.bounds import bounded
from nadia_balance.core.polygon import (
    area,
    clip_all,
    contains,
    convex_hull,
    halfspaces,
)
from nadia_balance.core.walking import Array, FootPose, Side

BASE, FORWARD, BACKWARD = "base", "forward", "backward"

_ROUNDING = 1e-9  # on the edge of the base region [-], [m]
_HALVINGS = 4  # bisection steps for a feasible margin [-]
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
    width_min: float = bounded(
        0.125, above=0.0, unit="m", of="sole_width"
    )  # w_min
    width_max: float = bounded(0.8, above=0.0, unit="m")  # w_max
    width_nominal: float = bounded(0.25, above=0.0, unit="m")  # w_nom
    # Share of the base region's length, and of its width beyond w_nom, for
    # steps that return to the commanded footholds: at the gait's pace, the
    # ankle of the other foot would otherwise meet its limit.
    return_share: float = bounded(0.7, above=0.0, most=1.0)
    # Largest crossing of the feet beyond the centre line of the stance foot,
    # w_fwd in front of it and w_bwd behind it [m]; negative: before the line.
    width_forward: float = bounded(0.1, unit="m")
    width_backward: float = bounded(-0.05, unit="m")
    # Angles from the y axis, at (0, w_nom), for clearance of the stance leg.
    theta_forward_deg: float = bounded(20.0, least=0.0, most=80.0, unit="deg")
    theta_backward_deg: float = bounded(30.0, least=0.0, most=80.0, unit="deg")
    # Largest step up or down, as in JSK's work.
    rise_max: float = bounded(0.25, above=0.0, unit="m")
    # Vertices [x, y] [m] of a convex base region in place of the ellipse.
    base_polygon: list[list[float]] = field(default_factory=list)

    def validate_more(self) -> None:
        """Raises ValueError if widths or polygon define no region."""
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
        polygon = self.base_polygon
        if any(len(vertex) != 2 for vertex in polygon):
            raise ValueError(
                f"base_polygon = {polygon}: must be a list of [x, y]"
            )
        if polygon and not (
            3 <= len(convex_hull(np.array(polygon))) == len(polygon)
        ):
            raise ValueError(
                f"base_polygon = {polygon}: must be convex, with 3 or more "
                "corners"
            )

    def in_base_region(self, x: float, y: float) -> bool:
        """True if the foothold x forward, y to the swing side [m] is reachable.

        The test uses the exact ellipse; `base_region` is an inner polygon.
        """
        if self.base_polygon:
            return contains(np.array([x, y]), base_region(self), _ROUNDING)
        length = self.length_forward if x > 0.0 else self.length_backward
        out = y - self.width_nominal
        width = (
            self.width_max - self.width_nominal
            if out > 0.0
            else self.width_nominal - self.width_min
        )
        return (x / length) ** 2 + (out / width) ** 2 <= 1.0 + _ROUNDING

    def describe(self) -> str:
        """Describes the base region, for error messages."""
        if self.base_polygon:
            return f"the polygon {self.base_polygon}"
        return (
            f"[{-self.length_backward}, {self.length_forward}] m forward, "
            f"[{self.width_min}, {self.width_max}] m out (ellipse)"
        )


def base_region(params: ReachabilityParams) -> Array:
    """Returns R_b, the region without crossing legs (Nadia paper, Fig. 5)."""
    if params.base_polygon:
        return convex_hull(np.array(params.base_polygon))
    middle = params.width_nominal
    vertices = []
    for angle in np.linspace(0.0, 2.0 * math.pi, 9):  # last equals first
        c, s = math.cos(angle), math.sin(angle)
        length = params.length_forward if c > 0.0 else params.length_backward
        width = (
            middle - params.width_min if s >= 0.0 else params.width_max - middle
        )
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
        width = inward if angle < 0.0 else outward
        vertices.append(
            (length * math.cos(angle), middle + width * math.sin(angle))
        )
    return convex_hull(np.array(vertices))


def step_regions(
    params: ReachabilityParams, cross_over: bool
) -> dict[str, Array]:
    """Returns the regions of footholds by name.

    They are BASE, and with `cross_over` also FORWARD and BACKWARD.
    """
    regions = {BASE: base_region(params)}
    if cross_over:
        for name in FORWARD, BACKWARD:
            regions[name] = cross_over_region(params, name)
    return regions


def total_region(params: ReachabilityParams, cross_over: bool) -> Array:
    """Returns the hull of all regions.

    It covers the stance foot: use it for capture regions, not for footholds.
    """
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


@dataclass(kw_only=True)
class ReachRulesParams:
    """Preference of the base region, and hysteresis of the choice."""

    # Least ratio of the area that a cross-over region shares with the capture
    # region to that of the base region.
    area_margin: float = bounded(5.0, least=1.0)
    # The previous region is kept until another region shares this many times
    # its area or, if none shares any, is this much closer.
    hysteresis: float = bounded(1.3, least=1.0)
    distance_hysteresis: float = bounded(0.03, least=0.0, unit="m")


@dataclass(frozen=True, eq=False)
class Choice:
    """The region chosen for a step, and the goal within it.

    `goal` (n, 2) [m] is the intersection of the region and the capture region
    or, if it is empty, the point (1, 2) of the region closest to the latter.
    """

    region: str
    goal: Array


def choose_region(
    regions: Mapping[str, Array],
    capture_region: Array,
    previous: str | None,
    params: ReachRulesParams,
    margin: float = 0.0,
    on_arrival: Callable[[Array], Array] | None = None,
) -> Choice:
    """Returns the region to step into, by the Nadia paper's rules (Sec. V).

    Rule 1: base if it intersects the capture region; rule 2: else the
    cross-over region that shares most area with it; rule 3: else the closest.
    `regions` has convex polygons (n, 2) [m] in the frame of `capture_region`
    (m, 2), BASE among them; `previous` was chosen last.  `margin` [m] is the
    desired depth of the goal inside the capture region; if it is infeasible,
    the goal is about as deep as possible.  `on_arrival` returns, for a region,
    the capture region at the earliest time the foot can be there: rule 3
    compares the gaps at these times.
    Erratum: as printed, rule 1 prefers any sliver of base to a short step
    across, and the choice flips with noise; hence margin and hysteresis.
    Its rule 3 compares all regions at the same time, but a cross-over step
    takes longer, while the ICP diverges.
    """
    A, b = halfspaces(capture_region)
    choice = _largest(regions, A, b - margin, previous, params)
    if choice is None and margin > 0.0:
        choice = _largest(regions, A, b, previous, params)
        if choice is not None:
            return Choice(choice.region, _deepest(choice.goal, A, b, margin))
    if choice is not None:
        return choice
    return _closest(
        regions,
        capture_region,
        previous,
        params,
        on_arrival or (lambda _: capture_region),
    )


def _largest(
    regions: Mapping[str, Array],
    A: Array,
    b: Array,
    previous: str | None,
    params: ReachRulesParams,
) -> Choice | None:
    """Returns the choice of rules 1 and 2, or None; A p <= b is captured."""
    found, most = None, 0.0
    for name, region in regions.items():
        shared = clip_all(region, A, b)
        preference = area(shared)
        if name == BASE:
            preference *= params.area_margin
        if name == previous:
            preference *= params.hysteresis
        if preference > most:
            found, most = Choice(name, shared), preference
    return found


def _deepest(shared: Array, A: Array, b: Array, margin: float) -> Array:
    """Returns the deepest part of `shared`, to within margin / 2^4."""
    best, low, high = shared, 0.0, margin
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        part = clip_all(shared, A, b - middle)
        if len(part):
            best, low = part, middle
        else:
            high = middle
    return best


def _closest(
    regions: Mapping[str, Array],
    capture_region: Array,
    previous: str | None,
    params: ReachRulesParams,
    on_arrival: Callable[[Array], Array],
) -> Choice:
    """Returns the choice of rule 3."""

    def gap(name: str) -> float:
        _, gap = closest_point(regions[name], on_arrival(regions[name]))
        return gap - (name == previous) * params.distance_hysteresis

    name = min(regions, key=gap)
    nearest, _ = closest_point(regions[name], capture_region)
    return Choice(name, nearest[None])


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
