"""How feet meet the ground, from a record of every step of the plant."""

import math
from typing import Any, cast

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.state import Side, number_of_ticks
from nadia_balance.robot.model import RobotModel
from nadia_balance.systems.contact_clock import BOUNCE
from nadia_balance.systems.signals import Touchdown, size

CONTACT = 0.01  # least force of a foot in contact, per weight [-]
IMPACT = 0.06  # time from the touchdown in which its forces are looked at [s]
MEAN = 0.01  # time over which a force is a machine's to bear [s]
SLIDE = 0.1  # time from the touchdown in which the foot may slide [s]


class TouchdownRecord:
    """Finds the touchdowns of a run, and measures each.

    Args:
        robot: robot that was simulated.
        step: of the plant [s].
    """

    def __init__(self, robot: RobotModel, step: float) -> None:
        self._step, self._weight = step, robot.mass * GRAVITY
        self._plant: Any = robot.control_plant()
        self._context = self._plant.CreateDefaultContext()
        corners = np.column_stack((robot.sole, np.zeros(len(robot.sole))))
        self._feet = [
            (
                self._plant.GetBodyByName(robot.foot_bodies[side]),
                np.asarray(
                    robot.X_FootSole[side].multiply(cast(Any, corners.T))
                ).T,
            )
            for side in Side
        ]

    def touchdowns(self, times: Array, states: Array, forces: Array) -> Array:
        """All touchdowns, in order of time.

        Args:
            times: of the plant's steps (m,) [s].
            states: [q, v] at these times (m, nq + nv).
            forces: upward forces on the (left, right) foot in the steps that
                begin then (m, 2) [N].

        Returns:
            The entries of a Touchdown in each row (k, 8).
        """
        shares = forces / self._weight
        rows = [
            (times[k], *self._measure(side, k, states, shares[:, i]))
            for i, side in enumerate(Side)
            for k in self._begins(shares[:, i])
        ]
        return np.array(sorted(rows)).reshape(-1, size(Touchdown))

    def _begins(self, force: Array) -> list[int]:
        """The steps in which a foot meets the ground."""
        touches, least = force > CONTACT, round(BOUNCE / self._step)
        begins, in_air = [], 0
        for k, contact in enumerate(touches.tolist()):
            if contact and in_air >= least:
                begins.append(k)
            in_air = 0 if contact else in_air + 1
        return begins

    def _measure(
        self, side: Side, k: int, states: Array, force: Array
    ) -> tuple[float, ...]:
        """The entries of a Touchdown in step `k` behind its time.

        The motion is that of the state before it.
        """
        p_WC, v_WC, z_WF = self._corners(side, states[max(k - 1, 0)])
        lowest = int(np.argmin(p_WC[:, 2]))
        vx, vy, vz = v_WC[lowest].tolist()
        impact = force[k : k + round(IMPACT / self._step)]
        mean = min(number_of_ticks(MEAN, self._step), len(impact))
        means = np.convolve(impact, np.full(mean, 1.0 / mean), "valid")
        last = min(k + round(SLIDE / self._step), len(states) - 1)
        places = [
            self._corners(side, states[i])[0].mean(axis=0) for i in (k, last)
        ]
        return (
            side.sign,
            math.hypot(vx, vy),
            -vz,
            math.acos(min(z_WF, 1.0)),
            float(impact.max()),
            float(means.max()),
            math.dist(places[0][:2], places[1][:2]),
        )

    def _corners(self, side: Side, state: Array) -> tuple[Array, Array, float]:
        """Positions and velocities (4, 3) of a sole's corners in W.

        Behind them comes the upward part of the sole's normal.
        """
        body, p_FC = self._feet[list(Side).index(side)]
        self._plant.SetPositionsAndVelocities(self._context, state)
        X_WF = body.EvalPoseInWorld(self._context)
        V_WF = body.EvalSpatialVelocityInWorld(self._context)
        arms = p_FC @ X_WF.rotation().matrix().T
        velocities = V_WF.translational() + np.cross(V_WF.rotational(), arms)
        up = float(X_WF.rotation().matrix()[2, 2])
        return X_WF.translation() + arms, velocities, up
