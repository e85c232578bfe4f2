"""Vertical force on each foot."""

import numpy as np
from pydrake.multibody.plant import ContactModel, ContactResults, MultibodyPlant
from pydrake.systems.framework import EventStatus, LeafSystem, System

from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.vocabulary import Side
from nadia_balance.robot.model import RobotModel


class FootForceSensor(LeafSystem):
    """Computes the mean vertical contact force on each foot over a period.

    `foot_forces` are the components along z of W (the normal forces on level
    ground), clipped at 0 in every step.  Contacts among the
    robot's own bodies are left out.  After a hard touchdown a foot bounces
    within one step of the plant, so every step is measured.  The first group
    of the discrete state is the output, the second holds the forces in the
    steps of the period, the latest first.

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
        self._contact_results = self.DeclareAbstractInputPort(
            "contact_results",
            engine.GetOutputPort("contact_results").Allocate(),
        )
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
        left, right = self._forces(self._contact_results.Eval(context))
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
