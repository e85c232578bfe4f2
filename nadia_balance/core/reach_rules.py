"""Which reachability region a step is to respect (Nadia paper, Fig. 9)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.polygon import area, clip_all, halfspaces
from nadia_balance.core.reachability import BASE
from nadia_balance.core.walking import Array


@dataclass(kw_only=True)
class ReachRulesParams:
    """How much a region must be better to be preferred."""

    # A cross-over region must share so many times the area that the base
    # region shares with the capture region.
    area_margin: float = 2.0  # [-]
    # To be given up, the region chosen last must share so many times less.
    hysteresis: float = 1.3  # [-]
    # If none shares any area: another must be so much closer.
    distance_hysteresis: float = 0.03  # [m]

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        for name in ("area_margin", "hysteresis"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 1.0):
                raise ValueError(f"{name} = {value}: must be finite and >= 1")
        if not 0.0 <= self.distance_hysteresis < math.inf:
            raise ValueError(
                f"distance_hysteresis = {self.distance_hysteresis}: "
                "must be finite and >= 0 m"
            )


@dataclass(frozen=True)
class Choice:
    """A region by name, and what it shares with the capture region."""

    region: str
    shared: Array  # (n, 2) [m]; (0, 2) if they share no area


def choose_region(
    regions: Mapping[str, Array],
    capture_region: Array,
    previous: str | None,
    params: ReachRulesParams,
) -> Choice:
    """Returns the region that the step has to respect.

    The three rules of the Nadia paper, Sec. V: base if it meets the capture
    region, else the cross-over region that shares most area with it, else the
    closest.  `regions` has convex polygons (n, 2) [m] in the frame of
    `capture_region` (m, 2), BASE among them; `previous` was chosen last.
    Erratum: by its letter, rule 1 prefers any sliver of base to a short step
    across, and the choice flips with the noise; hence margin and hysteresis.
    """
    A, b = halfspaces(capture_region)
    shared = {name: clip_all(r, A, b) for name, r in regions.items()}

    def preference(name: str) -> float:
        margin = params.area_margin if name == BASE else 1.0
        loyalty = params.hysteresis if name == previous else 1.0
        return margin * loyalty * area(shared[name])

    best = max(regions, key=preference)
    if not len(shared[best]):
        best = _closest(regions, capture_region, previous, params)
    return Choice(best, shared[best])


def _closest(
    regions: Mapping[str, Array],
    capture_region: Array,
    previous: str | None,
    params: ReachRulesParams,
) -> str:
    """Rule 3."""

    def distance(name: str) -> float:
        loyalty = params.distance_hysteresis if name == previous else 0.0
        p, q = closest_points(regions[name], capture_region)
        return math.dist(p, q) - loyalty

    return min(regions, key=distance)


def closest_points(first: Array, second: Array) -> tuple[Array, Array]:
    """Returns the points (2,) of two disjoint convex polygons that are closest.

    One of them is always a vertex: all vertices of either are projected on
    all edges of the other.
    """
    p, q, gap = _closest_to_vertices(first, second)
    q2, p2, gap2 = _closest_to_vertices(second, first)
    return (p, q) if gap <= gap2 else (p2, q2)


def _closest_to_vertices(
    vertices: Array, polygon: Array
) -> tuple[Array, Array, float]:
    """Returns a vertex, the point of the polygon closest to it, the gap^2."""
    edge = np.roll(polygon, -1, axis=0) - polygon
    offset = vertices[:, None] - polygon
    squared = np.maximum((edge * edge).sum(axis=1), 1e-30)
    along = np.clip((offset * edge).sum(axis=2) / squared, 0.0, 1.0)
    apart = offset - along[:, :, None] * edge
    gap = (apart * apart).sum(axis=2)
    i, k = divmod(int(gap.argmin()), len(polygon))
    return vertices[i], vertices[i] - apart[i, k], float(gap[i, k])
