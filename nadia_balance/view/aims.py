"""Arrows of what the user is about to do: the push, and the commanded way."""

import math
from typing import Any, cast

import numpy as np
from pydrake.geometry import Cylinder, Meshcat, MeshcatCone
from pydrake.math import RotationMatrix

from nadia_balance import palette
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.plan.gait import middle
from nadia_balance.core.walking.state import FootPoses, Side
from nadia_balance.view.scene import add_marker, transform

ROOT = "/aims"  # not part of the drawings of a run
PUSH = f"{ROOT}/push"
COMMAND = f"{ROOT}/command"
METRES = 0.6  # length of the push's shaft, per [m/s] of the push [s]
_GAP, _TIP = 0.2, 0.14  # from the CoM to the tip, length of the tip [m]
AHEAD = 0.45  # from the CoM to where the commanded way begins [m]
HORIZON = 1.5  # of the commanded way [s]
_POINTS = 12  # of the commanded way
_WIDTH, _HEAD = 0.03, 0.07  # half widths of its band and of its tip [m]
_ABOVE = 0.009  # above the ground and all that is drawn there [m]


class Aims:
    """Draws the push before it is pushed, and the velocity command.

    Neither is in a recording.
    """

    def __init__(self, meshcat: Meshcat):
        """Adds the arrow of the push, hidden.

        Args:
            meshcat: where it is drawn.
        """
        self._meshcat = meshcat
        self._delta_v = 0.0  # of the push that is drawn [m/s]
        self._command: Array | None = None  # that is drawn
        for part, shape in (
            ("shaft", Cylinder(0.012, 1.0)),
            ("tip", MeshcatCone(_TIP, 0.04, 0.04)),
        ):
            add_marker(
                meshcat, f"{PUSH}/{part}", shape, palette.PUSH, opacity=0.4
            ).show(True, None)
        # A cone opens along z from its tip; the arrow's tip points along z.
        meshcat.SetTransform(
            f"{PUSH}/tip",
            transform([0.0, 0.0, -_GAP], RotationMatrix.MakeXRotation(math.pi)),
        )
        meshcat.SetProperty(PUSH, "visible", False)

    def draw_push(
        self, com: np.ndarray[Any, Any], yaw: float, delta_v: float
    ) -> None:
        """Draws the arrow of a push; none if it is of 0 m/s.

        Args:
            com: where it points, (3,) in W [m].
            yaw: its direction in W [rad].
            delta_v: its size [m/s], by which the shaft is long.
        """
        if delta_v != self._delta_v:
            self._delta_v = delta_v
            self._meshcat.SetProperty(PUSH, "visible", delta_v > 0.0)
            length = max(METRES * delta_v, 1e-3)
            shaft: Any = np.asfortranarray(np.diag([1.0, 1.0, length, 1.0]))
            shaft[2, 3] = -_GAP - _TIP - 0.5 * length
            self._meshcat.SetTransform(f"{PUSH}/shaft", shaft)
        direction = np.array([math.cos(yaw), math.sin(yaw), 0.0])
        R_WP = RotationMatrix.MakeFromOneVector(cast(Any, direction), 2)
        self._meshcat.SetTransform(PUSH, transform(com, R_WP))

    def draw_command(self, command: Array, com: Array, feet: FootPoses) -> None:
        """Draws the commanded way on the ground; none if it is to stand.

        Args:
            command: forward, left [m/s] and turn [rad/s], (3,).
            com: the robot's centre of mass, (3,) in W [m].
            feet: its soles, which give the heading and the height.
        """
        if self._command is None or not np.array_equal(command, self._command):
            self._command = np.array(command)
            self._meshcat.Delete(COMMAND)
            if np.any(command):
                self._add_band(commanded_way(command))
        if np.any(command):
            height = max(float(feet[side].p_WF[2]) for side in Side)
            self._meshcat.SetTransform(
                COMMAND,
                transform(
                    [com[0], com[1], height + _ABOVE],
                    RotationMatrix.MakeZRotation(middle(feet).yaw),
                ),
            )

    def _add_band(self, points: Array) -> None:
        """Adds a band along the points (n, 2) [m], with a tip at its end."""
        edges = np.gradient(points, axis=0)
        edges /= np.linalg.norm(edges, axis=1, keepdims=True)
        normal = edges[:, ::-1] * [-1.0, 1.0]  # to the left
        end, along, left = points[-1], edges[-1], normal[-1]
        corners = np.concatenate(
            [
                points + _WIDTH * normal,
                points - _WIDTH * normal,
                [end + _HEAD * left, end - _HEAD * left],
                [end + 2.0 * _HEAD * along],
            ]
        )
        n = len(points)
        i = np.arange(n - 1)
        triangles: Any = np.hstack(
            [
                [i, i + n, i + n + 1],
                [i, i + n + 1, i + 1],
                [[2 * n], [2 * n + 1], [2 * n + 2]],  # the tip
            ]
        ).astype(np.int32)
        self._meshcat.SetTriangleMesh(
            path=COMMAND,
            vertices=cast(Any, np.vstack([corners.T, np.zeros(len(corners))])),
            faces=triangles,
            rgba=palette.rgba(palette.COMMAND, 0.8),
        )


def commanded_way(command: Array) -> Array:
    """Returns the way of a point ahead of the robot in the time HORIZON.

    In the robot's frame now, whose origin moves by the command v, w.  The point
    is at p = (AHEAD, 0) of the frame:

        x(t) = R(w t) p + integral of R(w s) v from 0 to t

    Args:
        command: forward, left [m/s] and turn [rad/s], (3,).

    Returns:
        Points (n, 2) [m].
    """
    forward, left, turn = np.asarray(command, dtype=float).tolist()
    times = np.linspace(0.0, HORIZON, _POINTS)
    angles = turn * times
    # sin(w t) / w and (1 - cos(w t)) / w, also at w = 0.
    along = times * np.sinc(angles / np.pi)
    across = times * np.sin(0.5 * angles) * np.sinc(0.5 * angles / np.pi)
    return np.column_stack(
        [
            AHEAD * np.cos(angles) + forward * along - left * across,
            AHEAD * np.sin(angles) + forward * across + left * along,
        ]
    )
