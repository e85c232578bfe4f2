"""A robot to put at the other end of a wire: an engine with drives and bus."""

from pathlib import Path
from typing import Any, cast

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RotationMatrix
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import ExternallyAppliedSpatialForce
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder

from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.math.arrays import Array
from nadia_balance.engines.plants import add_mujoco_plant
from nadia_balance.parameters.bounds import require
from nadia_balance.robot.fall import fall_of, upright
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import actuated_velocities
from nadia_balance.systems.estimation import Imu, JointEncoders, imu_place
from nadia_balance.systems.hardware import JointDrives
from nadia_balance.systems.wiring import connect
from nadia_balance.wire.band import Band
from nadia_balance.wire.messages import JointCommand, Mode, RobotState

ENGINES = "drake", "mujoco"
STEP = 0.001  # of the engine and of the drives [s]
SAMPLE = 0.002  # period of the bus [s]
ATTACK = 0.4  # of the band above the origin of the pelvis, over the CoM [m]
PUSH_TIME = 0.1  # [s]


class SimulatedRobot:
    """Does what it is commanded to, and tells what its sensors measure.

    Its drives compute the law of a JointCommand in every STEP, and then have
    the lag and the limits of `robot`.  It hangs in a Band at first.

    Args:
        robot: whose URDF, drives and sensors' places it has.
        sensors: errors of its IMU and encoders.
        engine: one of ENGINES.
        model: MJCF of the same robot that moves in its place, with other
            masses and contacts; for MuJoCo.
        catches: see Band.
        seed: of the noise.

    Raises:
        ValueError: there is no such engine, or it cannot take the model.
    """

    def __init__(
        self,
        robot: RobotModel,
        sensors: SensorParams,
        engine: str = ENGINES[0],
        model: Path | None = None,
        catches: bool = True,
        seed: int = 0,
    ) -> None:
        require(
            engine in ENGINES,
            f"engine = {engine!r}: must be one of {', '.join(ENGINES)}",
        )
        require(
            model is None or engine == "mujoco",
            f"model = {model}: must come with engine = mujoco",
        )
        builder = DiagramBuilder()
        self._engine: Any
        if engine == "mujoco":
            self._engine, self._plant, _ = add_mujoco_plant(
                builder, robot, STEP, mjcf=model
            )
        else:
            self._plant, _ = robot.add_plant_to(builder, STEP)
            self._engine = self._plant
        self._nq = self._plant.num_positions()
        self._joints = actuated_velocities(self._plant)
        self._diagram = self._finish(builder, robot, sensors, seed)
        self._simulator = Simulator(self._diagram)
        _, X_BI = imu_place(self._plant, robot, sensors)
        self._R_BI = X_BI.rotation()
        self._pelvis = self._plant.GetBodyByName(robot.pelvis_body).index()
        self._standing = robot.standing_positions()
        self._mass = robot.mass
        context: Any = self._plant.CreateDefaultContext()
        self._plant.SetPositions(context, cast(Any, self._standing))
        p_WC = self._plant.CalcCenterOfMassPositionInWorld(context)
        # Where the band attacks, in the upright pelvis.
        self._p_BA = np.append(p_WC[:2] - self._standing[4:6], ATTACK)
        self.band = Band(robot.mass, self._standing[6] + ATTACK, catches)
        self._hang()
        self._push = np.zeros(3)
        self._push_ends = 0.0
        self.samples = 0

    def _finish(
        self,
        builder: DiagramBuilder,
        robot: RobotModel,
        sensors: SensorParams,
        seed: int,
    ) -> Diagram:
        """Adds drives and sensors to the engine."""
        drives: Any = JointDrives(self._plant, robot)
        imu = Imu(robot, sensors, SAMPLE, seed)
        encoders = JointEncoders(robot, sensors, SAMPLE, seed)
        for name, block in (
            ("joint_drives", drives),
            ("imu", imu),
            ("joint_encoders", encoders),
        ):
            builder.AddNamedSystem(name, block)
            connect(builder, self._engine, block, "state")
        connect(builder, drives, self._engine, torques="actuation")
        for system, port, name in (
            (drives, "joint_command", "joint_command"),
            (self._engine, "applied_spatial_force", "forces"),
        ):
            builder.ExportInput(system.GetInputPort(port), name)
        for system, name in (
            (self._engine, "state"),
            (drives, "torques"),
            (imu, "imu"),
            (encoders, "joints"),
        ):
            builder.ExportOutput(system.GetOutputPort(name), name)
        return builder.Build()

    def _hang(self) -> None:
        """Puts it where the band holds it, its joints at rest and at 0."""
        context = self._simulator.get_mutable_context()
        q = np.zeros(self._nq)
        q[0], q[6] = 1.0, self._standing[6] + 0.15
        self._engine.SetPositions(
            self._engine.GetMyMutableContextFromRoot(context), q
        )

    @property
    def time(self) -> float:
        """Of the robot's clock [s]."""
        return self.samples * SAMPLE

    @property
    def pose(self) -> Array:
        """The true pose of the pelvis: w x y z, and p_WB (7,)."""
        return np.array(self._output("state")[:7])

    @property
    def is_down(self) -> bool:
        """Whether it has fallen."""
        pose = self.pose
        return bool(fall_of(upright(pose[:4]), pose[6], self._standing[6]))

    def push(self, delta_v: float, direction_deg: float) -> None:
        """Pushes the pelvis for PUSH_TIME.

        Args:
            delta_v: momentum over the robot's mass [m/s].
            direction_deg: 0 forward, 90 left, as the pelvis looks [deg].
        """
        R: Any = _rotation(self.pose).matrix()
        angle = np.arctan2(R[1, 0], R[0, 0]) + np.radians(direction_deg)
        size = self._mass * delta_v / PUSH_TIME
        self._push = size * np.array([np.cos(angle), np.sin(angle), 0.0])
        self._push_ends = self.time + PUSH_TIME

    def state(self) -> RobotState:
        """What its sensors tell now.

        Returns:
            A sample.
        """
        imu, joints = self._output("imu"), self._output("joints")
        q, dq = joints.reshape(2, -1)[:, self._joints - 6]
        R = _rotation(self.pose) @ self._R_BI
        return RobotState(
            time=self.time,
            q=q,
            dq=dq,
            tau=self._output("torques").copy(),
            quaternion=R.ToQuaternion().wxyz(),
            gyro=imu[6:].copy(),
            force=imu[3:6].copy(),
        )

    def step(self, command: JointCommand) -> None:
        """Moves for a SAMPLE.

        Args:
            command: that the drives have.
        """
        is_stiff = command.mode is Mode.ON and bool(
            command.kp.any() or command.tau.any()
        )
        self.band.advance(is_stiff, SAMPLE)
        parts = command.q, command.dq, command.tau, command.kp, command.kd
        values = np.concatenate(parts)
        if command.mode is Mode.OFF:
            values[:] = 0.0
        inputs = {
            "joint_command": values,
            "forces": self._forces(self._output("state")),
        }
        context = self._simulator.get_mutable_context()
        for name, value in inputs.items():
            self._diagram.GetInputPort(name).FixValue(context, value)
        self.samples += 1
        self._simulator.AdvanceTo(self.time)

    def _forces(self, state: Array) -> list[ExternallyAppliedSpatialForce]:
        """Band and push, on the pelvis."""
        forces = []
        if self.time < self._push_ends - 1e-9:
            forces.append(self._force(np.zeros(3), self._push))
        if not self.band.is_slack:
            arm = _rotation(state) @ self._p_BA
            w, v = state[self._nq : self._nq + 6].reshape(2, 3)
            held = self.band.force(state[4:7] + arm, v + np.cross(w, arm))
            forces.append(self._force(self._p_BA, held))
        return forces

    def _force(
        self, p_BA: Array, force: Array
    ) -> ExternallyAppliedSpatialForce:
        """A force on the pelvis."""
        applied = ExternallyAppliedSpatialForce()
        applied.body_index = self._pelvis
        applied.p_BoBq_B = cast(Any, p_BA)
        applied.F_Bq_W = SpatialForce(cast(Any, np.zeros(3)), cast(Any, force))
        return applied

    def _output(self, name: str) -> Any:
        context = self._simulator.get_context()
        return self._diagram.GetOutputPort(name).Eval(context)


def _rotation(state: Array) -> RotationMatrix:
    """R_WB of the pelvis; a plant's quaternion drifts off the unit."""
    unit: Any = state[:4] / np.linalg.norm(state[:4])
    return RotationMatrix(Quaternion(unit))
