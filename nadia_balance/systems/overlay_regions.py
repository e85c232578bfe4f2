"""Where a step would recover, and where it can be put, on the floor."""

import math

import numpy as np
from pydrake.geometry import Meshcat

from nadia_balance.core.foothold_adjustment import CaptureRegions
from nadia_balance.core.walking import Array
from nadia_balance.systems import palette
from nadia_balance.systems.overlay import PolygonOutline
from nadia_balance.systems.overlay_soles import SoleOutline

RADIUS = 1.2  # capture regions are shown so far about the stance foot [m]
REACH_EDGES = 16
REGION_EDGES = (8, 28, 48)  # of C_1, C_2, C_3
_CUT = -0.2  # no edge of a foot has this direction [rad]


class RegionOverlay:
    """C_1 to C_3, the chosen reachability region, the nominal foothold.

    Of the capture regions only what is within RADIUS of the stance foot: far
    from touchdown they go on for many metres.  The nominal foothold is shown
    only when the foot is to land elsewhere.
    """

    def __init__(self, meshcat: Meshcat, path: str, sole: Array):
        """Adds all that there is to draw below `path`, hidden."""
        self._meshcat, self._path = meshcat, path
        self._reach = PolygonOutline(
            meshcat, f"{path}/reach", REACH_EDGES, palette.rgba(palette.REACH)
        )
        self._regions = [
            PolygonOutline(
                meshcat,
                f"{path}/c_{i + 1}",
                edges,
                palette.rgba(palette.CAPTURE_REGIONS[i]),
            )
            for i, edges in enumerate(REGION_EDGES)
        ]
        self._nominal = SoleOutline(
            meshcat, f"{path}/nominal", sole, palette.rgba(palette.NOMINAL)
        )
        meshcat.SetProperty(path, "visible", False)

    def draw(
        self, found: CaptureRegions, centre: Array, z: float, time: float
    ) -> None:
        """Shows `found` about the stance foot at `centre` (2,) [m], z [m]."""
        self._meshcat.SetProperty(self._path, "visible", True, time)
        reach = thinned(found.reach, REACH_EDGES)
        self._reach.draw(reach, z + 0.002, time)
        regions = found.regions[: len(self._regions)]
        for i, (outline, region) in enumerate(
            zip(self._regions, regions, strict=False)
        ):
            region = thinned(region, REGION_EDGES[i])
            starts, ends = edges_near(region, centre, RADIUS)
            outline.draw_edges(starts, ends, z + 0.005 - 0.001 * i, time)
        for outline in self._regions[len(regions) :]:
            outline.draw(np.empty((0, 2)), z, time)
        if found.nominal is None or found.adjusted is found.nominal:
            self._nominal.hide(time)
        else:
            self._nominal.draw(found.nominal, time)

    def hide(self, time: float) -> None:
        """Hides it all from `time` [s] on."""
        self._meshcat.SetProperty(self._path, "visible", False, time)


def thinned(polygon: Array, max_vertices: int) -> Array:
    """Returns the polygon with no more than `max_vertices` of its own.

    They begin with the same edge while the polygon changes, so that a replay
    that draws what is between two frames turns no edge into another.
    """
    n = len(polygon)
    if n == 0:
        return polygon
    edges = np.roll(polygon, -1, axis=0) - polygon
    directions = np.arctan2(edges[:, 1], edges[:, 0]) - _CUT
    first = int(np.argmin(directions % (2.0 * math.pi)))
    count = min(n, max_vertices)
    return polygon[(first + np.arange(count) * n // count) % n]


def edges_near(
    polygon: Array, centre: Array, radius: float
) -> tuple[Array, Array]:
    """Returns the starts and ends (n, 2) of the edges, cut off by a circle.

    An edge that is outside of it becomes a point.
    """
    edge = np.roll(polygon, -1, axis=0) - polygon
    offset = polygon - centre
    # |offset + s edge|^2 = radius^2, in halves of the coefficients.
    a = np.maximum((edge * edge).sum(axis=1), 1e-12)
    b = (edge * offset).sum(axis=1)
    c = (offset * offset).sum(axis=1) - radius**2
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    first, last = (
        np.clip((-b + sign * root) / a, 0.0, 1.0)[:, None] for sign in (-1, 1)
    )
    return polygon + first * edge, polygon + last * edge
