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
EDGES = 16  # of any region: more cost more than they show
BOXES = 24  # for the edges of a capture region
_CUT = -0.2  # a direction that no side of a foot has [rad]


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
            meshcat, f"{path}/reach", EDGES, palette.rgba(palette.REACH)
        )
        self._regions = [
            PolygonOutline(meshcat, f"{path}/c_{i}", BOXES, palette.rgba(color))
            for i, color in enumerate(palette.CAPTURE_REGIONS, start=1)
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
        self._reach.draw(thinned(found.reach, EDGES), z + 0.002, time)
        for i, outline in enumerate(self._regions):
            lines = np.zeros((2, BOXES, 2))
            if i < len(found.regions):
                region = thinned(found.regions[i], EDGES)
                boxes = boxes_of_edges(region, BOXES)
                lines[:, boxes] = edges_near(region, centre, RADIUS)
            # C_1 above the others: where they coincide, it is seen.
            outline.draw_edges(*lines, z + 0.005 - 0.001 * i, time)
        if _moved(found):
            self._nominal.draw(found.nominal, time)
        else:
            self._nominal.hide(time)

    def hide(self, time: float) -> None:
        """Hides it all from `time` [s] on."""
        self._meshcat.SetProperty(self._path, "visible", False, time)


def _moved(found: CaptureRegions) -> bool:
    if found.nominal is None or found.adjusted is None:
        return False
    return math.dist(found.nominal.p_WF, found.adjusted.p_WF) > 1e-3


def thinned(polygon: Array, max_vertices: int) -> Array:
    """Returns the polygon without the vertices that matter least.

    Those whose triangle with their neighbours is smallest (Visvalingam and
    Whyatt).
    """
    while len(polygon) > max_vertices:
        edge = np.roll(polygon, -1, axis=0) - polygon
        last = np.roll(edge, 1, axis=0)
        turn = last[:, 0] * edge[:, 1] - last[:, 1] * edge[:, 0]
        polygon = np.delete(polygon, np.argmin(np.abs(turn)), axis=0)
    return polygon


def boxes_of_edges(polygon: Array, count: int) -> Array:
    """Returns which of `count` boxes is to show which edge, (n,).

    By the direction of the edge.  A replay draws what is between two frames:
    when a polygon gets another edge, the others have to keep their boxes.
    """
    dx, dy = (np.roll(polygon, -1, axis=0) - polygon).T
    turns = (np.arctan2(dy, dx) - _CUT) / (2.0 * math.pi) % 1.0
    order, n = np.argsort(turns), np.arange(len(polygon))
    boxes = np.floor(turns[order] * count).astype(int)
    # One box, one edge: the next box for the second of one direction.
    boxes = np.maximum.accumulate(boxes - n) + n
    boxes = np.minimum(boxes, count - len(n) + n)
    return boxes[np.argsort(order)]


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
