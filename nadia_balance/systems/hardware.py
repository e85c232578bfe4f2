"""Between plant and controller: drives, foot forces, errors of the state."""

from typing import Any, cast

import numpy as np
from pydrake.multibody.plant import ContactModel, MultibodyPlant
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiscreteValues,
    System,
)

from nadia_balance.core.body.model import lag_share, torque_limits
from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.state import Side, whole_ticks
from nadia_balance.parameters.bounds import bounded, parameters, require
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import actuated_velocities
from nadia_balance.systems.ports import Block, Input, check_period, input_port


class JointDrives(Block):
    """Filters the commanded torques: first-order lag, torque-speed limits.

        u = tau + kp (q_d - q) + kd (v_d - v)

    is commanded in every step of the plant by a `joint_command` (5 nu,), [q_d,
    v_d, tau, kp, kd] in [rad, s, N m], or tau alone by an `actuation` (nu,) [N
    m], one of which is connected; `torques` (nu,) [N m] are those that act.
    All are in the order of the plant's actuators; `state` is [q, v] of the
    plant: a drive knows its joint without noise.  The discrete state is
    `torques`, 0 at the start, and the last command with the number of steps
    that it still holds; it is updated in every step of the plant, so that a
    command acts one step late.

    Args:
        plant: plant that has no robot but this one.
        robot: robot with the drives.
        period: time for which a controller holds its torques [s]: the command
            is read once in it, at its begin; 0: in every step of the plant.

    Raises:
        ValueError: the robot's fidelity is ideal: it has no drives; or the
            period is not a multiple of the plant's time step.

    .. pydrake_system::

        name: JointDrives
        input_ports: [actuation, joint_command, state]
        output_ports: [torques]
    """

    def __init__(
        self, plant: MultibodyPlant, robot: RobotModel, period: float = 0.0
    ) -> None:
        super().__init__()
        if robot.drives is None:
            raise ValueError("fidelity = 'ideal': must be realistic")
        step = plant.time_step()
        self._later = whole_ticks("period", period or step, step) - 1.0
        velocities = actuated_velocities(plant)
        self._speeds = plant.num_positions() + velocities
        # The base has a quaternion, one number more than it has velocities.
        self._joints = np.concatenate((velocities + 1, self._speeds))
        self._max_torques: Any = plant.GetEffortUpperLimits()
        self._max_speeds = robot.max_joint_speeds[velocities - 6]
        self._corner_speed = robot.corner_speeds[velocities - 6]
        # Up to the corner speed the limits are constant.  The margin is large
        # against rounding.
        self._per_corner_speed = np.zeros(plant.num_multibody_states())
        self._per_corner_speed[self._speeds] = (1.0 + 1e-6) / (
            self._corner_speed * self._max_speeds
        )
        self._full: Any = np.negative(self._max_torques), self._max_torques
        self._share = lag_share(robot.drives.bandwidth, step)
        self._actuation = input_port(self, "actuation", velocities.size)
        self._command = input_port(self, "joint_command", 5 * velocities.size)
        self._command_port = self.GetInputPort("joint_command")
        self._state = input_port(self, "state", plant.num_multibody_states())
        self.DeclareStateOutputPort(
            "torques", self.DeclareDiscreteState(velocities.size)
        )
        # Of the last command the torques at [q, v] = 0, the gains and whether
        # there are any, and for how many more steps it holds.
        self.DeclareDiscreteState(3 * velocities.size + 2)
        self.DeclarePeriodicDiscreteUpdateEvent(step, 0.0, self._follow)

    def _follow(self, context: Context, new: DiscreteValues) -> None:
        # As few calls as can be: a step of the plant leaves nothing in the
        # processor's caches, and each function is a wait for memory.
        torques: Any = new.get_mutable_value(0)  # still those of the last step
        held: Any = new.get_mutable_value(1)
        if held[-1] > 0.0:
            held[-1] -= 1.0
        else:
            q, v, tau, kp, kd = self.command(context)
            held[: tau.size] = tau + kp * q + kd * v
            held[tau.size : -2] = gains = np.concatenate((kp, kd))
            held[-2:] = gains.any(), self._later
        state, n = self._state(context), torques.size
        lower, upper = self._limits(state)
        commanded = held[:n]
        if held[-2]:
            back = held[n:-2] * state[self._joints]
            commanded = commanded - back[:n] - back[n:]
        following = torques + self._share * (commanded - torques)
        np.maximum(np.minimum(following, upper), lower, out=torques)

    def command(self, context: Context) -> Array:
        """The joint command now, that of `actuation` with gains of 0.

        Args:
            context: that of this block.

        Returns:
            [q_d, v_d, tau, kp, kd] (5, nu).
        """
        if self._command_port.HasValue(context):
            return np.reshape(self._command(context), (5, -1))
        command = np.zeros((5, self._max_torques.size))
        command[2] = self._actuation(context)
        return command

    def _limits(self, state: Array) -> Any:
        """The least and the largest torques (nu) [N m] in the state."""
        shares = state * self._per_corner_speed
        if shares.dot(shares) < 1.0:  # then no share is above 1, either
            return self._full
        return torque_limits(
            state[self._speeds],
            max_torque=self._max_torques,
            max_speed=self._max_speeds,
            corner_speed=self._corner_speed,
        )


class FootForceSensor(Block):
    """Computes the mean vertical contact force on each foot over a period.

    `foot_forces` are the components along z of W, clipped at 0 in every step,
    without contacts among the robot's own bodies.  After a hard touchdown a
    foot bounces within one step of the plant, so every step is measured.
    `step_forces` are those on (left, right) in the steps of the last period,
    the latest first, without noise.  The outputs, which count at ticks, are
    discrete state, behind which is the number of steps left in the period.

    Args:
        plant: plant with the robot.
        robot: robot whose feet are measured.
        period: control period [s].
        engine: system that computes the contacts, by default the plant.
        sensors: noise of the sensors, by default none.
        seed: of the noise, which depends on it and the time only.

    Raises:
        ValueError: the period is not a multiple of the plant's time step,
            or not all contacts are points.

    .. pydrake_system::

        name: FootForceSensor
        input_ports: [contact_results]
        output_ports: [foot_forces, step_forces]
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        robot: RobotModel,
        period: float,
        engine: System | None = None,
        sensors: SensorParams | None = None,
        seed: int = 0,
    ) -> None:
        super().__init__()
        self._step = step = plant.time_step()
        require(step > 0.0, f"time_step = {step}: must be > 0 s")
        check_period(period)
        self._steps = whole_ticks("period", period, step)
        engine = engine or plant
        require(
            engine is not plant
            or plant.get_contact_model() == ContactModel.kPoint,
            "contact_model of the plant: must be point",
        )
        self._foot_of = _feet_by_contact(plant, robot)
        self._contacts = self.DeclareAbstractInputPort(
            "contact_results",
            engine.GetOutputPort("contact_results").Allocate(),
        )
        mean = self.DeclareDiscreteState(2)
        samples = self.DeclareDiscreteState(2 * self._steps)
        self.DeclareDiscreteState(cast(Any, [self._steps - 1.0]))
        self._seed = seed
        self._noise = None
        if sensors and max(sensors.load_noise, sensors.load_bias) > 0.0:
            random = np.random.default_rng((seed, 0, 3)).standard_normal(2)
            self._noise = sensors.load_noise
            self._bias = sensors.load_bias * robot.mass * GRAVITY * random
        # Matrix that averages the samples.
        self._average = np.tile(np.eye(2), self._steps) / self._steps
        self.DeclareStateOutputPort("foot_forces", mean)
        self.DeclareStateOutputPort("step_forces", samples)
        self.DeclarePeriodicDiscreteUpdateEvent(step, 0.0, self._measure)

    def _measure(self, context: Context, new: DiscreteValues) -> None:
        samples: Any = new.get_mutable_value(1)
        left: Any = new.get_mutable_value(2)
        later = int(left[0])
        samples[2 * later : 2 * later + 2] = self._forces(
            self._contacts.Eval(context)
        )
        left[0] = (later or self._steps) - 1
        if later > 0:
            return
        forces: Any = new.get_mutable_value(0)
        forces[:] = self._average.dot(samples)
        if self._noise is not None:
            seed = self._seed, 1 + round(context.get_time() / self._step), 3
            noise = self._noise * np.random.default_rng(seed).standard_normal(2)
            forces[:] = np.maximum(forces * (1.0 + noise) + self._bias, 0.0)

    def _forces(self, results: Any) -> list[float]:
        """The forces [N] up on left and right foot in this step."""
        forces = [0.0, 0.0]
        for i in range(results.num_point_pair_contacts()):
            pair = results.point_pair_contact_info(i)
            bodies = int(pair.bodyA_index()), int(pair.bodyB_index())
            if bodies in self._foot_of:
                foot, sign = self._foot_of[bodies]
                forces[foot] += sign * pair.contact_force().item(2)
        return [max(force, 0.0) for force in forces]


def _feet_by_contact(
    plant: MultibodyPlant, robot: RobotModel
) -> dict[tuple[int, int], tuple[int, float]]:
    """The foot among bodies (A, B) in contact, and the sign of its force.

    Contact results list the force on B.  Bodies of the robot alone are missing.
    """
    feet = [plant.GetBodyByName(robot.foot_bodies[side]) for side in Side]
    links = set(map(int, plant.GetBodyIndices(feet[0].model_instance())))
    foot_of = {}
    for i, foot in enumerate(feet):
        for other in set(range(plant.num_bodies())) - links:
            foot_of[other, int(foot.index())] = i, 1.0
            foot_of[int(foot.index()), other] = i, -1.0
    return foot_of


@parameters
class Imperfections:
    """Deviations of measurements, ground and model; none by default.

    Noise is white, Gaussian, of these standard deviations, new in each tick.
    """

    joint_noise: float = bounded(
        0.0, least=0.0, most=0.1, unit="rad", doc="noise of the joint angles"
    )
    joint_speed_noise: float = bounded(
        0.0, least=0.0, most=10.0, unit="rad/s", doc="noise of the joint speeds"
    )
    pelvis_noise: float = bounded(
        0.0,
        least=0.0,
        most=0.1,
        unit="m",
        doc="noise of the position of the pelvis",
    )
    pelvis_speed_noise: float = bounded(
        0.0,
        least=0.0,
        most=1.0,
        unit="m/s",
        doc="noise of its linear velocity and, in rad/s, of its angular one",
    )
    delay: float = bounded(
        0.0,
        least=0.0,
        most=0.1,
        unit="s",
        doc="from measurement to controller, which knows it, as from time "
        "stamps; a multiple of its period",
    )
    friction_ratio: float = bounded(
        1.0,
        above=0.0,
        most=2.0,
        doc="all friction coefficients over those of the models",
    )
    torso_mass_ratio: float = bounded(
        1.0,
        above=0.1,
        most=3.0,
        doc="the torso's mass and inertia over those of the controller's model",
    )

    @property
    def has_noise(self) -> bool:
        """True if measurements have noise."""
        return (
            self.joint_noise > 0.0
            or self.joint_speed_noise > 0.0
            or self.pelvis_noise > 0.0
            or self.pelvis_speed_noise > 0.0
        )


class StateSensor(Block):
    """Delays the state of the plant and the foot forces, and adds noise.

    `state` is [q, v] of the plant, or as estimated; `measured_state` the
    delayed and noisy [q, v]; `measured_foot_forces` are the delayed
    `foot_forces` (2,) [N].  Forces and the orientation of the pelvis have no
    noise.  The discrete state is the buffer of delayed samples, the latest
    first, NaN before the start, where the first sample stands for those before
    it.  The noise of a tick depends on the seed and the tick's number only.

    Args:
        plant: plant that holds the robot alone.
        imperfections: delay and noise of the measurements.
        period: control period [s].
        seed: of the noise.

    Raises:
        ValueError: the delay is not a multiple of the period.

    .. pydrake_system::

        name: StateSensor
        input_ports: [state, foot_forces]
        output_ports: [measured_state, measured_foot_forces]
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        imperfections: Imperfections,
        period: float,
        seed: int = 0,
    ) -> None:
        super().__init__()
        ticks = whole_ticks("delay", imperfections.delay, period)
        self._period, self._seed = period, seed
        nq = plant.num_positions()
        self._size = size = plant.num_multibody_states()
        self._deviations = np.zeros(size)
        self._deviations[7:nq] = imperfections.joint_noise
        self._deviations[4:7] = imperfections.pelvis_noise  # position
        self._deviations[nq : nq + 6] = imperfections.pelvis_speed_noise
        self._deviations[nq + 6 :] = imperfections.joint_speed_noise
        self._state = input_port(self, "state", size)
        self._forces = input_port(self, "foot_forces")
        self._past: Any = self.DeclareDiscreteState(
            cast(Any, np.full(ticks * (size + 2), np.nan))
        )
        tickets = {self.all_state_ticket(), self.time_ticket()}
        self.DeclareVectorOutputPort(
            "measured_state",
            size,
            self._calc_state,
            {*tickets, self._state.ticket()},
        )
        self.DeclareVectorOutputPort(
            "measured_foot_forces",
            2,
            self._calc_forces,
            {*tickets, self._forces.ticket()},
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._shift)

    def _shift(self, context: Context, new: Any) -> None:
        past = context.get_discrete_state(self._past).value()
        latest = np.concatenate(
            (self._state(context), self._forces(context), past)
        )
        new.get_mutable_vector(self._past).SetFromVector(latest[: past.size])

    def _calc_state(self, context: Context, output: BasicVector) -> None:
        seed = self._seed, round(context.get_time() / self._period)
        random = np.random.default_rng(seed).standard_normal(self._size)
        state = self._oldest(context, self._state, slice(0, self._size))
        output.SetFromVector(state + self._deviations * random)

    def _calc_forces(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(
            self._oldest(context, self._forces, slice(self._size, None))
        )

    def _oldest(self, context: Context, port: Input, part: slice) -> Any:
        """The `part` of the oldest sample; the value of the `port` if none."""
        now = port(context)
        past: Any = context.get_discrete_state(self._past).value()
        samples = past.reshape(-1, self._size + 2)[:, part]
        recorded = samples[~np.isnan(samples[:, 0])]
        return recorded[-1] if len(recorded) else now
