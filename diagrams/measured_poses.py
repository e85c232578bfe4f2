"""Poses of soles, torso and pelvis along the states of a run."""

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from nadia_balance.robot import RobotModel


class MeasuredPoses:
    """Forward kinematics of one robot, from its [q, v]."""

    def __init__(self, robot: RobotModel):
        """Uses a plant of the `robot` alone."""
        self._plant = plant = robot.control_plant()
        self._context = plant.CreateDefaultContext()
        self._soles = [
            (plant.GetBodyByName(name), robot.X_FootSole[side])
            for side, name in robot.foot_bodies.items()
        ]
        self._trunk = [
            plant.GetBodyByName(name)
            for name in (robot.torso_body, robot.pelvis_body)
        ]

    def along(self, states: np.ndarray) -> dict[str, np.ndarray]:
        """Returns the signals `foot_poses` (n, 8) and `trunk_tilt` (n, 2).

        Rows are MeasuredFeet and TrunkTilt (see nadia_balance.results.log) of
        the `states` (n, nq + nv).
        """
        feet, tilts = np.empty((len(states), 2, 4)), np.empty((len(states), 2))
        for row, state in enumerate(states):
            tilts[row] = self.trunk_tilt(state)
            for foot, (body, X_FootSole) in enumerate(self._soles):
                X_WF = self._pose(body) @ X_FootSole
                feet[row, foot, :3] = X_WF.translation()
                feet[row, foot, 3] = RollPitchYaw(X_WF.rotation()).yaw_angle()
        return {"foot_poses": feet.reshape(-1, 8), "trunk_tilt": tilts}

    def trunk_tilt(self, state: np.ndarray) -> np.ndarray:
        """Angles (2,) [rad] of torso and pelvis against the vertical."""
        self._plant.SetPositionsAndVelocities(self._context, state)
        # The z axis of W, in the body's frame.
        z = [self._pose(body).rotation().matrix()[2] for body in self._trunk]
        return np.array([np.arctan2(np.hypot(x, y), up) for x, y, up in z])

    def _pose(self, body) -> RigidTransform:
        return self._plant.EvalBodyPoseInWorld(self._context, body)
