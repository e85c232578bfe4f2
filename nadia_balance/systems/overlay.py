"""Shapes drawn over the robot in Meshcat, which also move in a recording.

A recording stores transforms and properties, and contains every object from
its start on.  An object is therefore set once, and after that only moved,
scaled, shown and hidden, always with the time of the frame.
"""

import math
from itertools import zip_longest

import numpy as np
from pydrake.geometry import Box, Cylinder, Meshcat, MeshcatCone, Rgba, Shape
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from nadia_balance import palette
from nadia_balance.core.foothold_adjustment import CaptureRegions
from nadia_balance.core.polygon import intersection
from nadia_balance.core.reachability import circle
from nadia_balance.core.walking import Array, FootPose, Side


class Drawing:
    """The objects at and under one Meshcat path; hidden until drawn."""

    def __init__(self, meshcat: Meshcat, path: str):
        self._meshcat, self._path = meshcat, path
        self._show(False, None)

    def _show(self, visible: bool, time: float | None) -> None:
        """Sets visibility from `time` [s] on; None: not in a recording."""
        self._meshcat.SetProperty(self._path, "visible", visible, time)

    def hide(self, time: float | None) -> None:
        """Hides the objects from `time` [s] on; None: only in the live view."""
        self._show(False, time)


class Marker(Drawing):
    """A small object that moves without turning, seen through the robot."""

    def __init__(self, meshcat: Meshcat, path: str, shape: Shape, color: str):
        """Adds `shape` of this colour at `path`."""
        super().__init__(meshcat, path)
        # Transparent objects are painted after all opaque ones.
        meshcat.SetObject(path, shape, palette.rgba(color, 0.99))
        seen_through = f"{path}/<object>"
        meshcat.SetProperty(seen_through, "material.depthTest", False)
        meshcat.SetProperty(seen_through, "renderOrder", 1.0)

    def draw(self, p_W: Array, time: float) -> None:
        """Shows the marker at p_W (3,) [m]."""
        self._meshcat.SetProperty(self._path, "position", list(p_W), time)
        self._show(True, time)


class PolygonOutline:
    """The outline of a polygon whose shape may change in every frame.

    Each edge is one unit box, scaled to the length of the edge.
    """

    WIDTH = 0.012  # width of the edges [m]

    def __init__(self, meshcat: Meshcat, path: str, max_edges: int, color: str):
        """Adds `max_edges` edges under `path`, hidden."""
        self._meshcat = meshcat
        self._edges = [f"{path}/{i}" for i in range(max_edges)]
        for edge in self._edges:
            meshcat.SetObject(edge, Box(1.0, 1.0, 1.0), palette.rgba(color))
            meshcat.SetProperty(edge, "visible", False)

    def draw(self, vertices: Array, z: float, time: float | None) -> None:
        """Shows the polygon `vertices` (n, 2) [m] of W at height `z` [m].

        An empty polygon hides the outline.  Without a `time` [s] the change is
        not recorded.

        Raises:
            ValueError: the polygon has more edges than the outline has boxes.
        """
        if len(vertices) > len(self._edges):
            raise ValueError(
                f"edges = {len(vertices)}: must be at most {len(self._edges)}"
            )
        starts, ends = vertices, np.roll(vertices, -1, axis=0)
        for i, edge in enumerate(self._edges):
            seen = i < len(starts)
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
    """An arrow that points at a place, for events shorter than a few frames."""

    LINGER = 0.5  # extra time for which a recording shows it [s]

    def __init__(self, meshcat: Meshcat, path: str, color: str):
        """Adds the arrow at `path`; it points along its z axis."""
        super().__init__(meshcat, path)
        shaft, head, gap = 0.41, 0.14, 0.2  # lengths [m]
        # A cone opens along z from its tip; the arrow's tip points along z.
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
        # A push lasts about three frames, too short to be seen: the arrow is
        # hidden later in the recording.
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
    """Filled soles at the stance poses: one for each step taken."""

    def __init__(self, meshcat: Meshcat, path: str, sole: Array, period: float):
        """Draws `sole` (n, 2) [m] under `path`, a frame each `period` [s]."""
        self._meshcat, self._path, self._period = meshcat, path, period
        self._sole = np.asarray(sole)

    def draw(
        self, side: Side, number: int, pose: FootPose, time: float
    ) -> None:
        """Shows at `pose` the print that step `number` left on `side`."""
        path = f"{self._path}/{side.value}_{number}"
        if not self._meshcat.HasPath(path):
            color = palette.rgba(palette.foot_color(side), 0.6)
            faces = fan(len(self._sole))
            self._meshcat.SetTriangleMesh(
                path, at_height(self._sole, 0.0), faces, color
            )
            hide_before(self._meshcat, path, time, self._period)
        self._meshcat.SetTransform(path, sole_transform(pose, 0.002), time)
        self._meshcat.SetProperty(path, "visible", True, time)

    def forget(self) -> None:
        """Removes all prints."""
        self._meshcat.Delete(self._path)


def sole_transform(pose: FootPose, height: float = 0.0) -> RigidTransform:
    """X_WF of a level sole, lifted by a `height` [m]."""
    p_W = pose.p_WF + [0.0, 0.0, height]
    return RigidTransform(RollPitchYaw(0.0, 0.0, pose.yaw), p_W)


class ConvexShape:
    """A convex polygon that may change, with its border; filled or not.

    A recording cannot reshape an object, so each shape is a new object that is
    visible only in its own frames.  Only the last KEPT objects are kept, which
    bounds the memory of a long walk.
    """

    KEPT = 1000
    BORDER = 0.016  # width of the border at corners [m]
    STILL = 0.005  # smaller motions of the corners are not redrawn [m]

    def __init__(
        self,
        meshcat: Meshcat,
        path: str,
        color: Rgba,
        period: float,
        filled: bool = True,
    ):
        """Draws under `path`, a frame each `period` [s]."""
        self._meshcat, self._path, self._color = meshcat, path, color
        self._period, self._filled = period, filled
        self.forget()

    def draw(self, polygon: Array, z: float, time: float) -> None:
        """Shows `polygon` (n, 2) [m] of W at z [m]; an empty one hides it."""
        corners = at_height(polygon, z)
        if corners.shape == self._shown.shape and np.all(
            np.abs(corners - self._shown) < self.STILL
        ):
            return
        self._shown = corners
        if self._count:
            last = f"{self._path}/{self._count}"
            self._meshcat.SetProperty(last, "visible", False, time)
        if len(polygon):
            self._add(polygon, z, time)

    def _add(self, polygon: Array, z: float, time: float) -> None:
        self._count += 1
        path = f"{self._path}/{self._count}"
        vertices, faces = border(polygon, self.BORDER)
        if self._filled:  # the border twice, which makes it darker
            faces = np.hstack([fan(len(polygon)), faces])
        self._meshcat.SetTriangleMesh(
            path, at_height(vertices, z), faces, self._color
        )
        # Objects that are painted later, but lie lower, must stay visible.
        self._meshcat.SetProperty(
            f"{path}/<object>", "material.depthWrite", False
        )
        hide_before(self._meshcat, path, time, self._period)
        self._meshcat.SetProperty(path, "visible", True, time)
        self._meshcat.Delete(f"{self._path}/{self._count - self.KEPT}")

    def forget(self) -> None:
        """Removes all shapes."""
        self._meshcat.Delete(self._path)
        self._count, self._shown = 0, np.empty((3, 0))


def hide_before(
    meshcat: Meshcat, path: str, time: float, period: float
) -> None:
    """Hides a new object in all frames of a recording before this one.

    `time` [s] is that of this frame, `period` [s] the time between frames.
    """
    if (before := time - period) >= 0.0:
        meshcat.SetProperty(path, "visible", False, before)


def at_height(points: Array, z: float) -> Array:
    """Returns the points (n, 2) as columns (3, n) [m] with this z."""
    return np.vstack([points.T, np.full(len(points), z)])


def fan(count: int) -> Array:
    """Returns the triangles (3, count - 2) of a convex polygon."""
    i = np.arange(1, count - 1, dtype=np.int32)
    return np.stack([0 * i, i, i + 1])


def border(polygon: Array, width: float) -> tuple[Array, Array]:
    """Returns vertices (2 n, 2) [m] and triangles (3, 2 n) of a border.

    The first n vertices are those of the polygon (n, 2), the others are
    `width` [m] nearer to its centroid.
    """
    n = len(polygon)
    inwards = polygon.mean(axis=0) - polygon
    lengths = np.linalg.norm(inwards, axis=1, keepdims=True)
    inner = polygon + inwards * np.minimum(width / lengths, 0.5)
    i = np.arange(n, dtype=np.int32)
    j = np.roll(i, -1)
    faces = np.hstack([np.stack([i, j, j + n]), np.stack([i, j + n, i + n])])
    return np.vstack([polygon, inner]), faces


RADIUS = 1.2  # capture regions are clipped to it, about the stance foot [m]
EDGES = 16  # largest number of edges drawn per region
_CIRCLE = circle(RADIUS, 2 * EDGES)


class RegionOverlay(Drawing):
    """C_1 to C_3, the chosen reachability region, the nominal foothold.

    The capture regions are clipped to RADIUS about the stance foot: long
    before touchdown they extend for many metres.  The nominal foothold is
    drawn only if the adjusted one differs from it.
    """

    def __init__(self, meshcat: Meshcat, path: str, sole: Array, period: float):
        """Adds all objects below `path`, hidden."""
        super().__init__(meshcat, path)
        brown = palette.rgba(palette.REACH, 0.99)  # painted after the floor
        self._reach = ConvexShape(
            meshcat, f"{path}/reach", brown, period, filled=False
        )
        looks = zip(palette.CAPTURE_REGIONS, palette.OPACITIES, strict=True)
        self._regions = [
            ConvexShape(
                meshcat,
                f"{path}/c_{i}",
                palette.rgba(*look),
                period,
            )
            for i, look in enumerate(looks, start=1)
        ]
        self._nominal = SoleOutline(
            meshcat, f"{path}/nominal", sole, palette.NOMINAL
        )

    def draw(
        self, found: CaptureRegions, centre: Array, z: float, time: float
    ) -> None:
        """Draws `found` about the stance foot at `centre` (2,) [m], z [m]."""
        self._show(True, time)
        self._reach.draw(thinned(found.reach, EDGES), z + 0.005, time)
        for drawing, region in zip_longest(
            self._regions, found.regions[: len(self._regions)]
        ):
            seen = np.empty((0, 2))
            if region is not None:
                near = intersection(region, centre + _CIRCLE)
                seen = thinned(near, EDGES)
            drawing.draw(seen, z + 0.004, time)  # above the prints
        nominal, adjusted = found.nominal, found.adjusted
        if nominal is not None and (
            adjusted is None or math.dist(nominal.p_WF, adjusted.p_WF) <= 1e-3
        ):
            nominal = None
        self._nominal.draw(nominal, time)

    def forget(self) -> None:
        """Removes the regions that were drawn."""
        for drawing in (self._reach, *self._regions):
            drawing.forget()


def thinned(polygon: Array, max_vertices: int) -> Array:
    """Returns the polygon with at most `max_vertices` vertices.

    Repeatedly removes the vertex whose triangle with its neighbours is the
    smallest (Visvalingam and Whyatt).
    """
    while len(polygon) > max_vertices:
        edge = np.roll(polygon, -1, axis=0) - polygon
        last = np.roll(edge, 1, axis=0)
        turn = last[:, 0] * edge[:, 1] - last[:, 1] * edge[:, 0]
        polygon = np.delete(polygon, np.argmin(np.abs(turn)), axis=0)
    return polygon
