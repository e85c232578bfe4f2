"""What balances a robot by its bus: estimators and controller, tick by tick."""

from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder, System

from nadia_balance.balance_controller import (
    BalanceController,
    ControllerParams,
    controller_params,
)
from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.plan.footstep_plan import velocity_limits
from nadia_balance.parameters.bounds import require
from nadia_balance.robot.fall import fall_of, upright
from nadia_balance.robot.model import RobotModel, load_robot
from nadia_balance.robot.params import load_sensors
from nadia_balance.robot.plants import actuated_velocities, joints_above
from nadia_balance.systems.estimation import StateEstimator, imu_place
from nadia_balance.systems.foot_forces import FootForceEstimator
from nadia_balance.systems.wiring import connect
from nadia_balance.wire.messages import JointCommand, RobotState
from nadia_balance.wire.process import ProcessParams, RobotProcess


class Ticking:
    """Runs a system tick by tick; its time is the number of ticks before."""

    def __init__(self, system: System, period: float) -> None:
        """Makes the simulator.

        Args:
            system: with all inputs declared as vectors.
            period: of a tick [s].
        """
        self._system, self._period = system, period
        self.begin()

    def begin(self) -> None:
        """Starts anew, at tick 0."""
        self._simulator = Simulator(self._system)
        self._ticks = 0

    def tick(self, **inputs: Array) -> None:
        """Sets the inputs of the next tick.

        Args:
            **inputs: by the names of the ports.

        Raises:
            RuntimeError: as finish.
        """
        if self._ticks:
            self.finish()
            self._simulator.AdvanceTo(self._ticks * self._period)
        self._ticks += 1
        context = self._simulator.get_mutable_context()
        for name, value in inputs.items():
            self._system.GetInputPort(name).FixValue(context, value)

    def finish(self) -> None:
        """Updates the states by the last tick's inputs: its outputs are read.

        Drake updates at a time when it is asked to advance from there, or to
        there once more.  A second call does nothing.

        Raises:
            RuntimeError: a block has no value.
        """
        if self._ticks:
            context = self._simulator.get_context()
            self._simulator.AdvanceTo(context.get_time())

    def output(self, name: str) -> Any:
        """An output by the last tick's inputs.

        Args:
            name: of the port.

        Returns:
            Its value, which the next tick may overwrite.
        """
        context = self._simulator.get_context()
        return self._system.GetOutputPort(name).Eval(context)


class RobotBalance:
    """Estimators and BalanceController between a state and a command.

    Its time is the number of ticks since `begin`.

    Args:
        robot: that is balanced.
        params: of the controller.
        sensors: place and errors of its IMU and encoders.

    Raises:
        ValueError: as the blocks; or a joint has no actuator.
    """

    def __init__(
        self, robot: RobotModel, params: ControllerParams, sensors: SensorParams
    ) -> None:
        self.period = params.control_period
        plant = robot.control_plant()
        # Where the joint of each actuator is among all joints.
        self._joints = actuated_velocities(plant) - 6
        self._nj = plant.num_velocities() - 6
        require(
            sorted(self._joints) == [*range(self._nj)],
            f"robot = {robot.name}: must have an actuator at each joint",
        )
        self._weight = robot.mass * GRAVITY
        _, X_BI = imu_place(plant, robot, sensors)
        self._up_I = X_BI.rotation().matrix()[2]  # the pelvis' z axis
        self._standing = robot.standing_positions()
        self._load = Ticking(
            FootForceEstimator(robot, sensors, self.period), self.period
        )
        self._estimate = Ticking(
            _estimators(robot, sensors, self.period), self.period
        )
        self._control = Ticking(
            BalanceController(params, robot, sensors=sensors), self.period
        )

    def begin(self) -> None:
        """Forgets all: the robot is at rest; at its first tick it stands."""
        for ticking in self._load, self._estimate, self._control:
            ticking.begin()

    def loads(self, imu: Array, state: RobotState) -> Array:
        """The loads on the feet of a robot that does not balance yet.

        Args:
            imu: as of systems.estimation.Imu, over the last period (9,).
            state: the latest.

        Returns:
            Shares of its weight on the left and the right foot (2,).
        """
        self._load.tick(imu=imu, joints=self._angles(state), torques=state.tau)
        return np.asarray(self._load.output("foot_forces") / self._weight)

    def lies(self, state: RobotState) -> bool:
        """Whether a robot that does not balance yet has fallen.

        Args:
            state: the latest.

        Returns:
            True if its pelvis is tilted too far.
        """
        w, x, y, z = state.quaternion.tolist()
        up = x * z - w * y, y * z + w * x, 0.5 - x**2 - y**2  # of W, in I / 2
        height = self._standing[6]  # unknown yet
        return bool(fall_of(2.0 * self._up_I @ up, height, height))

    def tick(
        self, imu: Array, state: RobotState, velocity: Array
    ) -> JointCommand:
        """The command of a tick.

        Args:
            imu: as of systems.estimation.Imu, over the last period (9,).
            state: the latest.
            velocity: commanded, forward, left [m/s], turn [rad/s] (3,).

        Returns:
            The command.

        Raises:
            RuntimeError: there is none.
        """
        self.estimate(imu, state)
        names = "estimated_state", "foot_forces"
        estimates = {name: self._estimate.output(name) for name in names}
        self._control.tick(velocity_command=velocity, **estimates)
        command = self._control.output("joint_command").copy()
        q, dq, tau, kp, kd = command.reshape(5, -1)
        return JointCommand(q=q, dq=dq, tau=tau, kp=kp, kd=kd)

    def estimate(self, imu: Array, state: RobotState) -> None:
        """Estimates the state in a tick that is passed over.

        Args:
            imu: as of systems.estimation.Imu, over the last period (9,).
            state: the latest.

        Raises:
            RuntimeError: a block has no value.
        """
        self._estimate.tick(
            imu=imu, joints=self._angles(state), torques=state.tau
        )

    def finish(self) -> None:
        """Computes of the last tick what its command did not need.

        Raises:
            RuntimeError: a block has no value.
        """
        self._estimate.finish()
        self._control.finish()

    def fall_reason(self) -> str:
        """Why the robot has fallen by the last tick.

        Returns:
            A few words; empty if it has not.
        """
        state = self._estimate.output("estimated_state")
        return fall_of(upright(state[:4]), state[6], self._standing[6])

    def _angles(self, state: RobotState) -> Array:
        """Angles and speeds (2 nj,) in the order of the joints."""
        joints = np.empty((2, self._nj))
        joints[:, self._joints] = state.q, state.dq
        return joints.ravel()


def process_of(
    robot: str,
    sensors: str,
    tell: Callable[[str], None] = lambda line: None,
    process_params: ProcessParams | None = None,
) -> tuple[RobotModel, RobotProcess]:
    """All that balances a robot.

    Args:
        robot: a model's name, or the path of a robot.yaml.
        sensors: of models/sensors, how wrong its IMU and encoders are.
        tell: takes a line for each event.
        process_params: how it gets up, and its samples.

    Returns:
        The robot, and its process.

    Raises:
        ValueError: there is no such robot, or no such sensors.
    """
    model, params = load_robot(robot), controller_params(robot)
    plant = model.control_plant()
    bearing = {
        joint.velocity_start()
        for body in (*model.foot_bodies.values(), model.torso_body)
        for joint in joints_above(plant, body)
    }
    process = RobotProcess(
        RobotBalance(model, params, load_sensors(sensors)),
        standing=model.standing_positions()[actuated_velocities(plant) + 1],
        limits=np.array(plant.GetEffortUpperLimits()),
        bears=np.isin(actuated_velocities(plant), [*bearing]),
        velocity_limits=velocity_limits(
            params.footstep_planner, model.point_mass
        ),
        params=process_params,
        tell=tell,
    )
    return model, process


def _estimators(
    robot: RobotModel, sensors: SensorParams, period: float
) -> Diagram:
    """From imu, joints and torques to foot_forces and estimated_state."""
    forces = FootForceEstimator(robot, sensors, period)
    estimator = StateEstimator(
        robot=robot, sensors=sensors, period=period, q=None, height=0.0
    )
    builder = DiagramBuilder()
    builder.AddNamedSystem("foot_force_estimator", forces)
    builder.AddNamedSystem("state_estimator", estimator)
    for name in "imu", "joints":
        builder.ExportInput(forces.GetInputPort(name), name)
        builder.ConnectInput(name, estimator.GetInputPort(name))
    builder.ExportInput(forces.GetInputPort("torques"), "torques")
    connect(builder, forces, estimator, "foot_forces")
    for system, name in (
        (forces, "foot_forces"),
        (estimator, "estimated_state"),
    ):
        builder.ExportOutput(system.GetOutputPort(name), name)
    return builder.Build()
