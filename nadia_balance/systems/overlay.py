"""Shapes drawn over the robot in Meshcat, which also move in a recording.

A recording keeps transforms and properties but no new objects.  So every
object is set once, and from then on only moved, scaled, shown and hidden,
always with the time of the frame.
"""

import math

import numpy as np
from pydrake.geometry import Box, Cylinder, Meshcat, MeshcatCone, Rgba, Shape
from pydrake.math import RigidTransform, RotationMatrix

from nadia_balance.core.walking import Array
from nadia_balance.systems import palette


class Marker:
    """A small object that moves without turning, seen through the robot."""

    def __init__(self, meshcat: Meshcat, path: str, shape: Shape, color: str):
        """Adds `shape` of this colour at `path`, hidden until it is drawn."""
        self._meshcat, self._path = meshcat, path
        # What is not quite opaque is painted after all that is.
        meshcat.SetObject(path, shape, palette.rgba(color, 0.99))
        seen_through = f"{path}/<object>"
        meshcat.SetProperty(seen_through, "material.depthTest", False)
        meshcat.SetProperty(seen_through, "renderOrder", 1.0)
        meshcat.SetProperty(path, "visible", False)

    def draw(self, p_W: Array, time: float) -> None:
        """Shows the marker at p_W (3,) [m]."""
        self._meshcat.SetProperty(self._path, "position", list(p_W), time)
        self._meshcat.SetProperty(self._path, "visible", True, time)


class PolygonOutline:
    """The outline of a polygon that may change its shape in every frame.

    Each edge is one unit box, scaled to the length of the edge.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        path: str,
        max_edges: int,
        rgba: Rgba,
        width: float = 0.012,
    ):
        """Adds `max_edges` edges of `width` [m] under `path`, hidden."""
        self._meshcat = meshcat
        self._edges = [f"{path}/{i}" for i in range(max_edges)]
        self._width = width
        for edge in self._edges:
            meshcat.SetObject(edge, Box(1.0, 1.0, 1.0), rgba)
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
            if seen:
                self._draw_edge(edge, starts[i], ends[i], z, time)

    def _draw_edge(
        self,
        edge: str,
        start: Array,
        end: Array,
        z: float,
        time: float | None,
    ) -> None:
        dx, dy = end - start
        # Longer by its width, so that the corners are closed.
        length = math.hypot(dx, dy) + self._width
        self._meshcat.SetTransform(
            edge,
            RigidTransform(
                RotationMatrix.MakeZRotation(math.atan2(dy, dx)),
                [*(0.5 * (start + end)), z],
            ),
            time,
        )
        self._meshcat.SetProperty(
            f"{edge}/<object>", "scale", [length, self._width, 0.004], time
        )


class Arrow:
    """An arrow that points at a place; for what lasts but an instant."""

    LENGTH = 0.55  # [m]
    GAP = 0.2  # between the tip and the place: half a robot [m]
    LINGER = 0.5  # how much longer a recording shows it [s]

    def __init__(self, meshcat: Meshcat, path: str, color: str):
        """Adds the arrow at `path`, hidden; it points along its z axis."""
        self._meshcat, self._path = meshcat, path
        head, radius = 0.14, 0.02
        shaft, tip = self.LENGTH - head, -self.GAP
        rgba = palette.rgba(color)
        meshcat.SetObject(f"{path}/shaft", Cylinder(radius, shaft), rgba)
        meshcat.SetTransform(
            f"{path}/shaft", RigidTransform([0, 0, tip - head - 0.5 * shaft])
        )
        # A cone opens along z from its tip: turn it over.
        cone = MeshcatCone(head, 2.5 * radius, 2.5 * radius)
        meshcat.SetObject(f"{path}/head", cone, rgba)
        meshcat.SetTransform(
            f"{path}/head",
            RigidTransform(RotationMatrix.MakeXRotation(math.pi), [0, 0, tip]),
        )
        meshcat.SetProperty(path, "visible", False)

    def draw(self, p_W: Array, force_W: Array, time: float) -> None:
        """Shows an arrow along `force_W` (3,) that points at p_W (3,) [m]."""
        R = RotationMatrix.MakeFromOneVector(force_W, 2)
        self._meshcat.SetTransform(self._path, RigidTransform(R, p_W), time)
        # A push is over within three frames, too soon for the eye: the
        # recording hides the arrow later, without anybody having to remember.
        self._meshcat.SetProperty(
            self._path, "visible", False, time + self.LINGER
        )
        self._meshcat.SetProperty(self._path, "visible", True, time)

    def hide(self) -> None:
        """Hides the arrow in the live view; a recording lets it linger."""
        self._meshcat.SetProperty(self._path, "visible", False)

    def forget(self, time: float) -> None:
        """Hides the arrow from `time` [s] on, in a recording too."""
        self._meshcat.SetProperty(self._path, "visible", False, time)
