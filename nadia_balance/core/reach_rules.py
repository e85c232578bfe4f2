"""Which reachability region a step is to respect (Nadia paper, Fig. 9)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nadia_balance.core.polygon import area, clip_all, halfspaces
from nadia_balance.core.reachability import BASE
from nadia_balance.core.walking import Array

_HALVINGS = 4  # of the margin, where the capture region is not so deep
_COMPLEX = np.array([1.0, 1.0j])


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


@dataclass(frozen=True, eq=False)
class Choice:
    """The region that a step has to respect, and where in it to step.

    `goal` (n, 2) [m]: what the region shares with the capture region, or if
    they share nothing, the point (1, 2) of the region that is closest to it.
    """

    region: str
    goal: Array


def choose_region(
    regions: Mapping[str, Array],
    capture_region: Array,
    previous: str | None,
    params: ReachRulesParams,
    margin: float = 0.0,
) -> Choice:
    """Returns the region to step into.

    The three rules of the Nadia paper, Sec. V: base if it meets the capture
    region, else the cross-over region that shares most area with it, else the
    closest.  `regions` has convex polygons (n, 2) [m] in the frame of
    `capture_region` (m, 2), BASE among them; `previous` was chosen last.
    `margin` [m] is how deep inside the capture region the goal should be; if
    there is no such place, it is about as deep as can be.
    Erratum: by its letter, rule 1 prefers any sliver of base to a short step
    across, and the choice flips with the noise; hence margin and hysteresis.
    """
    A, b = halfspaces(capture_region)
    choice = _largest(regions, A, b - margin, previous, params)
    if choice is None and margin > 0.0:
        choice = _largest(regions, A, b, previous, params)
        if choice is not None:
            return Choice(choice.region, _deepest(choice.goal, A, b, margin))
    return choice or _closest(regions, capture_region, previous, params)


def _largest(
    regions: Mapping[str, Array],
    A: Array,
    b: Array,
    previous: str | None,
    params: ReachRulesParams,
) -> Choice | None:
    """Rules 1 and 2, or None; the capture region is A p <= b."""
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
    """Returns the part of `shared` that is deepest, but for margin / 2^4."""
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
) -> Choice:
    """Rule 3."""

    def candidate(name: str) -> tuple[float, Choice]:
        nearest, gap = closest_point(regions[name], capture_region)
        if name == previous:
            gap -= params.distance_hysteresis
        return gap, Choice(name, nearest[None])

    return min(map(candidate, regions), key=lambda found: found[0])[1]


def closest_point(polygon: Array, other: Array) -> tuple[Array, float]:
    """Returns the point (2,) of `polygon` closest to `other`, and the gap [m].

    Of two disjoint convex polygons.  One end of the gap is a vertex: those of
    either are projected on all edges of the other.
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
