"""The log of a run: its signals, once per control tick, and their robot."""

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.framework import Context, DiagramBuilder, OutputPort
from pydrake.systems.primitives import LogVectorOutput, Multiplexer

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.body.reachability import (
    ReachabilityParams,
    step_regions,
)
from nadia_balance.robot.model import RobotModel


class SignalLog:
    """Logs vector ports once per control period.

    Drake publishes at t before the updates of t, so row t contains the state,
    the references and the torques of t, all from the same x-.  The updates
    reuse the outputs that the log has evaluated from the cache.
    """

    def __init__(
        self,
        builder: DiagramBuilder,
        period: float,
        ports: dict[str, OutputPort],
        robot: RobotModel,
        ground: Ground | None,
    ):
        """Adds systems that log `ports`, by name, every `period` [s]."""
        self._fixed = {"sole": robot.sole}
        self._fixed |= region_logs(robot.point_mass.reach)
        if ground is not None:
            self._fixed["ground"] = np.concatenate(
                [
                    np.column_stack([np.full(len(r.polygon), i), r.polygon])
                    for i, r in enumerate(ground.regions)
                    if not r.obstacle
                ]
            )
        self._sizes = {name: port.size() for name, port in ports.items()}
        multiplexer = builder.AddNamedSystem(
            "log_multiplexer", Multiplexer(list(self._sizes.values()))
        )
        for i, port in enumerate(ports.values()):
            builder.Connect(port, multiplexer.get_input_port(i))
        self._sink = LogVectorOutput(
            multiplexer.get_output_port(), builder, publish_period=period
        )
        self._sink.set_name("log")

    def forget(self, context: Context) -> None:
        """Clears the log."""
        self._sink.FindMutableLog(context).Clear()

    def read(self, context: Context) -> dict[str, np.ndarray]:
        """Returns name -> (n, size), and the times `t` (n,) [s].

        Row i contains the values at t[i], before its updates.  The sole, the
        ground and the regions of footholds have no row per tick.
        """
        log = self._sink.FindLog(context)
        t, data = log.sample_times().copy(), log.data().T
        # A simulation from a cloned Context logs its first row a second time.
        last = np.diff(t, append=np.inf) > 0.0
        if not np.all(last):
            t, data = t[last], data[last]
        ends = np.cumsum(list(self._sizes.values()))[:-1]
        columns = np.split(data, ends, axis=1)
        signals = dict(zip(self._sizes, columns, strict=True))
        return {"t": t, **signals, **self._fixed}


def region_logs(reach: ReachabilityParams) -> dict[str, np.ndarray]:
    """Returns all regions (n, 2) [m] of possible footholds.

    They include those for crossed legs, which may be switched on in a run.
    """
    regions = step_regions(reach, cross_over=True)
    return {f"region_{name}": region for name, region in regions.items()}


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
        trunk = robot.torso_body, robot.pelvis_body
        self._trunk = [plant.GetBodyByName(name) for name in trunk]

    def along(self, states: np.ndarray) -> dict[str, np.ndarray]:
        """Returns the signals `foot_poses` (n, 8) and `trunk_tilt` (n, 2).

        Rows are MeasuredFeet and TrunkTilt (see systems.signals) of
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
