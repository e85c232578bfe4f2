"""Between plant and controller: drives, foot forces, errors of the state."""

from dataclasses import dataclass

import numpy as np
from pydrake.multibody.plant import ContactModel, ContactResults, MultibodyPlant
from pydrake.systems.framework import EventStatus, LeafSystem, System

from nadia_balance.core.body.model import lag_share, torque_limits
from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.state import Side, whole_ticks
from nadia_balance.parameters.bounds import bounded
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import actuated_velocities
from nadia_balance.systems.ports import Input


class JointDrives(LeafSystem):
    """Filters the commanded torques: first-order lag, torque-speed limits.

    `actuation` (nu,) [N m] are the commanded torques, `torques` (nu,) [N m]
    those of the drives, both in the order of the plant's actuators; `state` is
    [q, v] of the plant.  The discrete state is `torques`, 0 at the start; it is
    updated in every step of the plant, so that a command acts one step late.

    .. pydrake_system::

        name: JointDrives
        input_ports: [actuation, state]
        output_ports: [torques]
    """

    def __init__(self, plant: MultibodyPlant, robot: RobotModel):
        """Models the drives of `robot`, the only one in `plant`.

        Raises ValueError: the robot's fidelity is ideal: it has no drives.
        """
        super().__init__()
        if robot.drives is None:
            raise ValueError("fidelity = 'ideal': must be realistic")
        velocities = actuated_velocities(plant)
        self._speeds = plant.num_positions() + velocities
        most = (
            plant.GetEffortUpperLimits(),
            robot.max_joint_speeds[velocities - 6],
        )
        self._limits = *most, robot.drives.corner_speed
        step = plant.time_step()
        self._share = lag_share(robot.drives.bandwidth, step)
        self._actuation = Input(self, "actuation", velocities.size)
        self._plant_state = Input(self, "state", plant.num_multibody_states())
        state = self.DeclareDiscreteState(velocities.size)
        self.DeclareStateOutputPort("torques", state)
        self.DeclarePeriodicDiscreteUpdateEvent(step, 0.0, self._follow)

    def _follow(self, context, new):
        torques = context.get_discrete_state_vector().value()
        missing = self._actuation(context) - torques
        speeds = self._plant_state(context)[self._speeds]
        least, most = torque_limits(speeds, *self._limits)
        torques = torques + self._share * missing
        new.set_value(np.minimum(np.maximum(torques, least), most))
        return EventStatus.Succeeded()


class FootForceSensor(LeafSystem):
    """Computes the mean vertical contact force on each foot over a period.

    `foot_forces` are the components along z of W, clipped at 0 in every step,
    without contacts among the robot's own bodies.  After a hard touchdown a
    foot bounces within one step of the plant, so every step is measured.  The
    discrete state is the output, and the forces in each step, the latest first.

    .. pydrake_system::

        name: FootForceSensor
        input_ports: [contact_results]
        output_ports: [foot_forces]
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        robot: RobotModel,
        period: float,
        engine: System | None = None,
        sensors: SensorParams | None = None,
        seed: int = 0,
    ):
        """Measures the feet of `robot` in `plant`, over a `period` [s].

        `engine` is the system that computes the contacts, by default `plant`;
        `sensors` have noise, which depends on `seed` and time only.

        Raises ValueError: the period is not a multiple of the plant's time
        step, or not all contacts are points.
        """
        super().__init__()
        step = plant.time_step()
        self._steps = round(period / step) if step > 0.0 else 0
        if self._steps < 1 or abs(self._steps * step - period) > 1e-9:
            raise ValueError(
                f"period = {period}: must be a multiple of the plant's "
                f"time_step = {step} s"
            )
        engine, point = engine or plant, ContactModel.kPoint
        if engine is plant and plant.get_contact_model() != point:
            raise ValueError("contact_model of the plant: must be point")
        feet = [plant.GetBodyByName(robot.foot_bodies[side]) for side in Side]
        own = set(map(int, plant.GetBodyIndices(feet[0].model_instance())))
        # For bodies (A, B) in contact: the foot among them, and the sign of
        # the force on it; contact results list the force on B.
        self._foot_of = {}
        for i, foot in enumerate(feet):
            for other in set(range(plant.num_bodies())) - own:
                self._foot_of[other, int(foot.index())] = i, 1.0
                self._foot_of[int(foot.index()), other] = i, -1.0
        found = engine.GetOutputPort("contact_results").Allocate()
        self._found = self.DeclareAbstractInputPort("contact_results", found)
        self._mean = self.DeclareDiscreteState(2)
        self._samples = self.DeclareDiscreteState(2 * self._steps)
        self._step, self._seed, self._noise = step, seed, None
        if sensors and max(sensors.load_noise, sensors.load_bias) > 0.0:
            random = np.random.default_rng((seed, 0, 3)).standard_normal(2)
            bias = sensors.load_bias * robot.mass * GRAVITY * random
            self._noise = sensors.load_noise, bias
        # Matrix that averages the samples.
        self._average = np.tile(np.eye(2), self._steps) / self._steps
        self.DeclareStateOutputPort("foot_forces", self._mean)
        self.DeclarePeriodicDiscreteUpdateEvent(step, 0.0, self._measure)

    def _measure(self, context, state):
        left, right = self._forces(self._found.Eval(context))
        last = context.get_discrete_state(self._samples).value()[:-2]
        samples = np.array((max(left, 0.0), max(right, 0.0), *last.tolist()))
        state.set_value(self._samples, samples)
        mean = self._average @ samples
        if self._noise is not None:
            share, bias = self._noise
            step = round(context.get_time() / self._step)
            random = np.random.default_rng((self._seed, 1 + step, 3))
            noise = share * random.standard_normal(2)
            mean = np.maximum(mean * (1.0 + noise) + bias, 0.0)
        state.set_value(self._mean, mean)
        return EventStatus.Succeeded()

    def _forces(self, results: ContactResults) -> list[float]:
        """The vertical forces [N] on left and right foot in this step."""
        forces, foot_of = [0.0, 0.0], self._foot_of
        info = results.point_pair_contact_info
        for i in range(results.num_point_pair_contacts()):
            pair = info(i)
            bodies = int(pair.bodyA_index()), int(pair.bodyB_index())
            if found := foot_of.get(bodies):
                foot, sign = found
                forces[foot] += sign * float(pair.contact_force()[2])
        return forces


_FEET = 2
_PELVIS = slice(4, 7)  # pelvis position in q, behind the quaternion


@dataclass(kw_only=True)
class Imperfections:
    """Deviations of measurements, ground and model; none by default.

    Noise is white, Gaussian, of these standard deviations, new in each tick.
    """

    joint_noise: float = bounded(0.0, least=0.0, most=0.1, unit="rad")
    joint_speed_noise: float = bounded(0.0, least=0.0, most=10.0, unit="rad/s")
    # Noise of the position, and of linear and angular velocity.
    pelvis_noise: float = bounded(0.0, least=0.0, most=0.1, unit="m")
    pelvis_speed_noise: float = bounded(0.0, least=0.0, most=1.0, unit="m/s")
    # Delay from measurement to controller, a multiple of its period; the
    # controller knows it, as from time stamps.
    delay: float = bounded(0.0, least=0.0, most=0.1, unit="s")
    # Ratio of all friction coefficients to those of the models.
    friction_ratio: float = bounded(1.0, above=0.0, most=2.0)
    # Ratio of the torso's mass and inertia to those of the controller's model.
    torso_mass_ratio: float = bounded(1.0, above=0.1, most=3.0)

    @property
    def has_noise(self) -> bool:
        """True if measurements have noise."""
        noise = self.joint_noise, self.joint_speed_noise, self.pelvis_noise
        return max(*noise, self.pelvis_speed_noise) > 0.0


class StateSensor(LeafSystem):
    """Delays the state of the plant and the foot forces, and adds noise.

    `state` is [q, v] of the plant, or as estimated; `measured_state` the
    delayed and noisy [q, v]; `measured_foot_forces` are the delayed
    `foot_forces` (2,) [N].  Forces and the orientation of the pelvis have no
    noise.  The discrete state is the buffer of delayed samples, the latest
    first, NaN before the start, where the first sample stands for those before
    it.  The noise of a tick depends on the seed and the tick's number only.

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
    ):
        """Samples a `plant` that holds the robot alone every `period` [s].

        Raises ValueError: the delay is not a multiple of the period.
        """
        super().__init__()
        self._ticks = whole_ticks("delay", imperfections.delay, period)
        self._period, self._seed = period, seed
        nq, size = plant.num_positions(), plant.num_multibody_states()
        self._size, self._deviations = size, np.zeros(size)
        self._deviations[7:nq] = imperfections.joint_noise
        self._deviations[_PELVIS] = imperfections.pelvis_noise
        self._deviations[nq : nq + 6] = imperfections.pelvis_speed_noise
        self._deviations[nq + 6 :] = imperfections.joint_speed_noise
        self._now = Input(self, "state", size)
        self._forces = Input(self, "foot_forces", _FEET)
        past = np.full(self._ticks * (size + _FEET), np.nan)
        self._past = self.DeclareDiscreteState(past)
        depends = {self.all_state_ticket(), self.time_ticket()}
        for name, length, calc, port in (
            ("measured_state", size, self._calc_state, self._now),
            ("measured_foot_forces", _FEET, self._calc_forces, self._forces),
        ):
            needs = depends | {port.ticket()}
            self.DeclareVectorOutputPort(name, length, calc, needs)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._shift)

    def _shift(self, context, new):
        past = context.get_discrete_state(self._past).value()
        sample = self._now(context), self._forces(context)
        latest = np.concatenate((*sample, past))
        new.get_mutable_vector(self._past).SetFromVector(latest[: past.size])
        return EventStatus.Succeeded()

    def _calc_state(self, context, output):
        tick, size = round(context.get_time() / self._period), self._size
        random = np.random.default_rng((self._seed, tick))
        noise = self._deviations * random.standard_normal(size)
        state = self._oldest(context, self._now, slice(0, size))
        output.SetFromVector(state + noise)

    def _calc_forces(self, context, output):
        oldest = self._oldest(context, self._forces, slice(self._size, None))
        output.SetFromVector(oldest)

    def _oldest(self, context, port: Input, part: slice) -> np.ndarray:
        """The `part` of the oldest sample; the value of the `port` if none."""
        now, past = port(context), context.get_discrete_state(self._past)
        samples = past.value().reshape(-1, self._size + _FEET)[:, part]
        known = samples[~np.isnan(samples[:, 0])]
        return known[-1] if len(known) else now
