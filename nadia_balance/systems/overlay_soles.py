"""Soles drawn over the robot in Meshcat: where they were and will be."""

import numpy as np
from pydrake.geometry import Meshcat, Rgba
from pydrake.math import RigidTransform, RollPitchYaw

from nadia_balance.core.walking import Array, FootPose, Side
from nadia_balance.systems import palette
from nadia_balance.systems.overlay import PolygonOutline


class SoleOutline:
    """The outline of a sole, moved as a rigid body: a planned foothold."""

    def __init__(self, meshcat: Meshcat, path: str, sole: Array, rgba: Rgba):
        """Adds the outline of `sole` (n, 2) [m] at `path`, hidden."""
        self._meshcat, self._path = meshcat, path
        outline = PolygonOutline(meshcat, path, len(sole), rgba)
        outline.draw(np.asarray(sole), 0.004, None)  # above the prints
        meshcat.SetProperty(path, "visible", False)

    def draw(self, pose: FootPose, time: float) -> None:
        """Shows the sole at `pose`."""
        self._meshcat.SetTransform(self._path, sole_transform(pose), time)
        self._meshcat.SetProperty(self._path, "visible", True, time)

    def hide(self, time: float) -> None:
        """Hides the sole from `time` [s] on."""
        self._meshcat.SetProperty(self._path, "visible", False, time)


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
            self._meshcat.SetTriangleMesh(
                path,
                self._vertices,
                self._faces,
                palette.rgba(palette.foot_color(side), 0.6),
            )
            # A recording has it from the start: keep it hidden until now.
            if time >= self._period:
                self._meshcat.SetProperty(
                    path, "visible", False, time - self._period
                )
        p_W = pose.p_WF + [0.0, 0.0, 0.002]
        self._meshcat.SetTransform(
            path, sole_transform(FootPose(p_W, pose.yaw)), time
        )
        self._meshcat.SetProperty(path, "visible", True, time)

    def forget(self) -> None:
        """Removes all prints."""
        self._meshcat.Delete(self._path)


def sole_transform(pose: FootPose) -> RigidTransform:
    """X_WF of a level sole."""
    return RigidTransform(RollPitchYaw(0.0, 0.0, pose.yaw), pose.p_WF)
