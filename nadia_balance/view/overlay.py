"""Shapes drawn over the robot in Meshcat, which also move in a recording.

A recording stores transforms and properties, and contains every object from
its start on.  An object is therefore set once, and after that only moved, shown
and hidden, always with the time of the frame.
"""

import math

import numpy as np
from pydrake.geometry import Cylinder, Meshcat, MeshcatCone, Rgba, Shape
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from nadia_balance import palette
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.vocabulary import FootPose

LINE = 0.012  # width of outlines [m]


class Drawing:
    """The objects at and under one Meshcat path; hidden until shown."""

    def __init__(self, meshcat: Meshcat, path: str):
        """Hides the `path`; a time of None is not in a recording."""
        self._meshcat, self._path = meshcat, path
        self.show(False, None)

    def show(self, visible: bool, time: float | None) -> None:
        """Shows or hides the objects from `time` [s] on."""
        self._meshcat.SetProperty(self._path, "visible", visible, time)

    def place(self, X_W: RigidTransform, time: float) -> None:
        """Shows the objects at the pose X_W."""
        self._meshcat.SetTransform(self._path, X_W, time)
        self.show(True, time)


def add_marker(
    meshcat: Meshcat, path: str, shape: Shape, color: str
) -> Drawing:
    """Adds a small object that is seen through the robot."""
    # Transparent objects are painted after all opaque ones.
    meshcat.SetObject(path, shape, palette.rgba(color, 0.99))
    seen_through = f"{path}/<object>"
    meshcat.SetProperty(seen_through, "material.depthTest", False)
    meshcat.SetProperty(seen_through, "renderOrder", 1.0)
    return Drawing(meshcat, path)


def add_arrow(meshcat: Meshcat, path: str, color: str) -> Drawing:
    """Adds an arrow along its z axis that points at its origin."""
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
    return Drawing(meshcat, path)


def add_polygon(
    meshcat: Meshcat,
    path: str,
    corners: Array,
    color: Rgba,
    filled: bool = True,
    outlined: bool = False,
) -> Drawing:
    """Adds a convex polygon with `corners` (n, 3) [m], counterclockwise.

    The outline is LINE wide, within the polygon.  A filled polygon is painted
    twice there, which makes a transparent outline darker.
    """
    count = len(corners)
    i = np.arange(count, dtype=np.int32)
    fan = np.stack([0 * i[2:], i[1:-1], i[2:]])
    j = np.roll(i, -1)
    edges = np.hstack([[i, j, j + count], [i, j + count, i + count]])
    meshcat.SetTriangleMesh(
        path,
        np.vstack([corners, _inset(corners)]).T,
        np.hstack([fan] * filled + [edges] * outlined),
        color,
    )
    # Objects that are painted later, but lie lower, must stay visible.
    if color.a() < 1.0:
        meshcat.SetProperty(f"{path}/<object>", "material.depthWrite", False)
    return Drawing(meshcat, path)


def _inset(corners: Array) -> Array:
    """The corners (n, 3), moved by LINE from both of their edges."""
    edges = np.roll(corners[:, :2], -1, axis=0) - corners[:, :2]
    lengths = np.linalg.norm(edges, axis=1, keepdims=True)
    after = edges[:, ::-1] * [-1.0, 1.0] / np.maximum(lengths, 1e-9)
    before = np.roll(after, 1, axis=0)  # both point inwards
    # Sharp corners, and those of nearly no polygon, move by 2 LINE at most.
    cosine = np.sum(before * after, axis=1, keepdims=True)
    inset = corners.copy()
    inset[:, :2] += LINE * (before + after) / np.maximum(1.0 + cosine, 0.5)
    return inset


def at_height(polygon: Array, z: float) -> Array:
    """The points (n, 2) with this z, (n, 3) [m]."""
    return np.column_stack([polygon, np.full(len(polygon), z)])


def sole_transform(pose: FootPose, height: float = 0.0) -> RigidTransform:
    """X_WF of a level sole, lifted by a `height` [m]."""
    p_W = pose.p_WF + [0.0, 0.0, height]
    return RigidTransform(RollPitchYaw(0.0, 0.0, pose.yaw), p_W)


class ChangingPolygon:
    """A convex polygon of another shape in every frame, with its outline.

    A recording cannot reshape an object, so each shape is a new object that is
    visible only in its own frames.  Only the last KEPT objects are kept, which
    bounds the memory of a long walk.
    """

    KEPT = 1000
    STILL = 0.005  # smaller motions of the corners are not redrawn [m]

    def __init__(
        self,
        meshcat: Meshcat,
        path: str,
        color: Rgba,
        period: float,
        filled: bool = True,
    ):
        self._meshcat, self._path, self._color = meshcat, path, color
        self._period, self._filled = period, filled
        self.forget()

    def draw(self, polygon: Array, z: float, time: float) -> None:
        """Shows `polygon` (n, 2) [m] of W at z [m]; an empty one hides it."""
        corners = at_height(polygon, z)
        if corners.shape == self._corners.shape and np.all(
            np.abs(corners - self._corners) < self.STILL
        ):
            return
        self._corners = corners
        if self._shown is not None:
            self._shown.show(False, time)
            self._shown = None
        if len(polygon):
            self._count += 1
            path = f"{self._path}/{self._count}"
            self._shown = add_polygon(
                self._meshcat, path, corners, self._color, self._filled, True
            )
            hide_before(self._shown, time, self._period)
            self._shown.show(True, time)
            self._meshcat.Delete(f"{self._path}/{self._count - self.KEPT}")

    def forget(self) -> None:
        """Removes all shapes."""
        self._meshcat.Delete(self._path)
        self._count, self._corners = 0, np.empty((0, 3))
        self._shown: Drawing | None = None


def hide_before(drawing: Drawing, time: float, period: float) -> None:
    """Hides a new object in frames before `time` [s], `period` [s] apart."""
    if (before := time - period) >= 0.0:
        drawing.show(False, before)
