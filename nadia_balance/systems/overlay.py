"""Shapes drawn over the robot in Meshcat, which also move in a recording.

A recording keeps transforms and properties but no new objects.  So every
object is set once, and from then on only moved, scaled, shown and hidden,
always with the time of the frame.
"""

import math

import numpy as np
from pydrake.geometry import Box, Cylinder, Meshcat, MeshcatCone, Shape
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from nadia_balance import palette
from nadia_balance.core.foothold_adjustment import CaptureRegions
from nadia_balance.core.walking import Array, FootPose, Side


class Drawing:
    """What is at and under one path of Meshcat; hidden until it is drawn."""

    def __init__(self, meshcat: Meshcat, path: str):
        self._meshcat, self._path = meshcat, path
        self._show(False, None)

    def _show(self, visible: bool, time: float | None) -> None:
        """From `time` [s] on; without one a recording does not get it."""
        self._meshcat.SetProperty(self._path, "visible", visible, time)

    def hide(self, time: float | None) -> None:
        """Hides it from `time` [s] on; None: only in the live view."""
        self._show(False, time)


class Marker(Drawing):
    """A small object that moves without turning, seen through the robot."""

    def __init__(self, meshcat: Meshcat, path: str, shape: Shape, color: str):
        """Adds `shape` of this colour at `path`."""
        super().__init__(meshcat, path)
        # What is not quite opaque is painted after all that is.
        meshcat.SetObject(path, shape, palette.rgba(color, 0.99))
        seen_through = f"{path}/<object>"
        meshcat.SetProperty(seen_through, "material.depthTest", False)
        meshcat.SetProperty(seen_through, "renderOrder", 1.0)

    def draw(self, p_W: Array, time: float) -> None:
        """Shows the marker at p_W (3,) [m]."""
        self._meshcat.SetProperty(self._path, "position", list(p_W), time)
        self._show(True, time)


class PolygonOutline:
    """The outline of a polygon that may change its shape in every frame.

    Each edge is one unit box, scaled to the length of the edge.
    """

    WIDTH = 0.012  # of the edges [m]

    def __init__(self, meshcat: Meshcat, path: str, max_edges: int, color: str):
        """Adds `max_edges` edges under `path`, hidden."""
        self._meshcat = meshcat
        self._edges = [f"{path}/{i}" for i in range(max_edges)]
        for edge in self._edges:
            meshcat.SetObject(edge, Box(1.0, 1.0, 1.0), palette.rgba(color))
            meshcat.SetProperty(edge, "visible", False)

    def draw(self, vertices: Array, z: float, time: float | None) -> None:
        """Shows the polygon `vertices` (n, 2) [m] of W at height `z` [m].

        An empty polygon hides the outline; without a `time` [s] a recording
        does not get it.

        Raises:
            ValueError: it has more edges than there are boxes.
        """
        self.draw_edges(vertices, np.roll(vertices, -1, axis=0), z, time)

    def draw_edges(
        self, starts: Array, ends: Array, z: float, time: float | None
    ) -> None:
        """Shows the lines from `starts` to `ends` (n, 2) [m]; no points.

        Each has the box of its number; else as `draw`.
        """
        if len(starts) > len(self._edges):
            raise ValueError(
                f"edges = {len(starts)}: must be at most {len(self._edges)}"
            )
        for i, edge in enumerate(self._edges):
            seen = i < len(starts) and not np.array_equal(starts[i], ends[i])
            self._meshcat.SetProperty(edge, "visible", seen, time)
            if not seen:
                continue
            dx, dy = ends[i] - starts[i]
            R = RotationMatrix.MakeZRotation(math.atan2(dy, dx))
            X = RigidTransform(R, [*(0.5 * (starts[i] + ends[i])), z])
            self._meshcat.SetTransform(edge, X, time)
            # Longer by its width, so that the corners are closed.
            scale = [math.hypot(dx, dy) + self.WIDTH, self.WIDTH, 0.004]
            self._meshcat.SetProperty(f"{edge}/<object>", "scale", scale, time)


class Arrow(Drawing):
    """An arrow that points at a place; for what lasts but an instant."""

    LINGER = 0.5  # how much longer a recording shows it [s]

    def __init__(self, meshcat: Meshcat, path: str, color: str):
        """Adds the arrow at `path`; it points along its z axis."""
        super().__init__(meshcat, path)
        shaft, head, gap = 0.41, 0.14, 0.2  # lengths, from the place back [m]
        # A cone opens along z from its tip: turn it over.
        over = RotationMatrix.MakeXRotation(math.pi)
        middle = [0.0, 0.0, -gap - head - 0.5 * shaft]
        for part, shape, X in (
            ("shaft", Cylinder(0.02, shaft), RigidTransform(middle)),
            (
                "head",
                MeshcatCone(head, 0.05, 0.05),
                RigidTransform(over, [0.0, 0.0, -gap]),
            ),
        ):
            meshcat.SetObject(f"{path}/{part}", shape, palette.rgba(color))
            meshcat.SetTransform(f"{path}/{part}", X)

    def draw(self, p_W: Array, force_W: Array, time: float) -> None:
        """Shows an arrow along `force_W` (3,) that points at p_W (3,) [m]."""
        R = RotationMatrix.MakeFromOneVector(force_W, 2)
        self._meshcat.SetTransform(self._path, RigidTransform(R, p_W), time)
        # A push is over within three frames, too soon for the eye: the
        # recording is told now to hide the arrow later.
        self._show(False, time + self.LINGER)
        self._show(True, time)


class SoleOutline(Drawing):
    """The outline of a sole, moved as a rigid body: a planned foothold."""

    def __init__(self, meshcat: Meshcat, path: str, sole: Array, color: str):
        """Adds the outline of `sole` (n, 2) [m] at `path`."""
        super().__init__(meshcat, path)
        outline = PolygonOutline(meshcat, path, len(sole), color)
        outline.draw(np.asarray(sole), 0.004, None)  # above the prints

    def draw(self, pose: FootPose | None, time: float) -> None:
        """Shows the sole at `pose`; None hides it, from `time` [s] on."""
        if pose is not None:
            self._meshcat.SetTransform(self._path, sole_transform(pose), time)
        self._show(pose is not None, time)


class Footprints:
    """Filled soles that stay where they are: one for each step taken."""

    def __init__(self, meshcat: Meshcat, path: str, sole: Array, period: float):
        """Draws `sole` (n, 2) [m] under `path`, a frame each `period` [s]."""
        self._meshcat, self._path, self._period = meshcat, path, period
        self._vertices = np.vstack([np.asarray(sole).T, np.zeros(len(sole))])
        fan = [[0, i, i + 1] for i in range(1, len(sole) - 1)]
        self._faces = np.array(fan, dtype=np.int32).T

    def draw(
        self, side: Side, number: int, pose: FootPose, time: float
    ) -> None:
        """Shows at `pose` the print that step `number` left on `side`."""
        path = f"{self._path}/{side.value}_{number}"
        if not self._meshcat.HasPath(path):
            color = palette.rgba(palette.foot_color(side), 0.6)
            self._meshcat.SetTriangleMesh(
                path, self._vertices, self._faces, color
            )
            # A recording has it from the start: keep it hidden until now.
            if (before := time - self._period) >= 0.0:
                self._meshcat.SetProperty(path, "visible", False, before)
        self._meshcat.SetTransform(path, sole_transform(pose, 0.002), time)
        self._meshcat.SetProperty(path, "visible", True, time)

    def forget(self) -> None:
        """Removes all prints."""
        self._meshcat.Delete(self._path)


def sole_transform(pose: FootPose, height: float = 0.0) -> RigidTransform:
    """X_WF of a level sole, lifted by a `height` [m]."""
    p_W = pose.p_WF + [0.0, 0.0, height]
    return RigidTransform(RollPitchYaw(0.0, 0.0, pose.yaw), p_W)


RADIUS = 1.2  # capture regions are shown so far about the stance foot [m]
EDGES = 16  # of any region: more cost more than they show
BOXES = 24  # for the edges of a capture region
_CUT = -0.2  # a direction that no side of a foot has [rad]


class RegionOverlay(Drawing):
    """C_1 to C_3, the chosen reachability region, the nominal foothold.

    Of the capture regions only what is within RADIUS of the stance foot: far
    from touchdown they go on for many metres.  The nominal foothold is shown
    only when the foot is to land elsewhere.
    """

    def __init__(self, meshcat: Meshcat, path: str, sole: Array):
        """Adds all that there is to draw below `path`, hidden."""
        super().__init__(meshcat, path)
        self._reach = PolygonOutline(
            meshcat, f"{path}/reach", EDGES, palette.REACH
        )
        self._regions = [
            PolygonOutline(meshcat, f"{path}/c_{i}", BOXES, color)
            for i, color in enumerate(palette.CAPTURE_REGIONS, start=1)
        ]
        self._nominal = SoleOutline(
            meshcat, f"{path}/nominal", sole, palette.NOMINAL
        )

    def draw(
        self, found: CaptureRegions, centre: Array, z: float, time: float
    ) -> None:
        """Shows `found` about the stance foot at `centre` (2,) [m], z [m]."""
        self._show(True, time)
        self._reach.draw(thinned(found.reach, EDGES), z + 0.002, time)
        for i, outline in enumerate(self._regions):
            lines = np.zeros((2, BOXES, 2))
            if i < len(found.regions):
                region = thinned(found.regions[i], EDGES)
                boxes = boxes_of_edges(region, BOXES)
                lines[:, boxes] = edges_near(region, centre, RADIUS)
            # C_1 above the others: where they coincide, it is seen.
            outline.draw_edges(*lines, z + 0.005 - 0.001 * i, time)
        nominal, adjusted = found.nominal, found.adjusted
        if nominal is not None and (
            adjusted is None or math.dist(nominal.p_WF, adjusted.p_WF) <= 1e-3
        ):
            nominal = None
        self._nominal.draw(nominal, time)


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
    edge, offset = np.roll(polygon, -1, axis=0) - polygon, polygon - centre
    # |offset + s edge|^2 = radius^2, in halves of the coefficients.
    a = np.maximum((edge * edge).sum(axis=1), 1e-12)
    b = (edge * offset).sum(axis=1)
    c = (offset * offset).sum(axis=1) - radius**2
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    first, last = (
        np.clip((-b + sign * root) / a, 0.0, 1.0)[:, None] for sign in (-1, 1)
    )
    return polygon + first * edge, polygon + last * edge
