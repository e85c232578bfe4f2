"""Prediction of the robot's present state from a delayed measurement."""

import math

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import EventStatus, LeafSystem, ValueProducer

from nadia_balance.core.joint_drives import lag_share
from nadia_balance.robot import RobotModel
from nadia_balance.systems.ports import VectorInput


class StatePredictor(LeafSystem):
    """Predicts the present state by the accelerations commanded since then.

    A Smith predictor.  `delayed_state` is [q, v] of the robot's
    `control_plant` a `delay` ago, `estimated_state` the same now.
    `generalized_acceleration` (nv,) is the acceleration that the QP expects of
    the torques of a tick, see WholeBodyInverseDynamics; the drives' lag filters
    it.  The discrete state is the filtered acceleration now, and its means over
    the periods of the delay, the latest first; 0 at the start.

    Evaluating the output, or an update, raises RuntimeError if the input is
    not finite.

    .. pydrake_system::

        name: StatePredictor
        input_ports: [delayed_state, generalized_acceleration]
        output_ports: [estimated_state]
    """

    def __init__(self, robot: RobotModel, period: float, delay: float):
        """Predicts over a `delay` [s], a multiple of the `period` [s]."""
        super().__init__()
        self._period = period
        self._plant = plant = robot.control_plant()
        self._nq, self._nv = plant.num_positions(), plant.num_velocities()
        # Response to a step in acceleration: after one period, and its mean.
        self._share, self._mean_share = 1.0, 1.0
        if robot.drives is not None:
            self._share = lag_share(robot.drives.bandwidth, period)
            self._mean_share -= self._share * robot.drives.lag / period
        size = plant.num_multibody_states()
        self._delayed_state = VectorInput(self, "delayed_state", size)
        self._commanded = VectorInput(
            self, "generalized_acceleration", self._nv
        )
        # Scratch memory.
        self._scratch = self.DeclareCacheEntry(
            "plant context",
            ValueProducer(
                allocate=lambda: Value(plant.CreateDefaultContext()),
                calc=ValueProducer.NoopCalc,
            ),
            prerequisites_of_calc={self.nothing_ticket()},
        )
        self.DeclareDiscreteState((1 + round(delay / period)) * self._nv)
        self.DeclareVectorOutputPort(
            "estimated_state",
            size,
            self._calc_state,
            prerequisites_of_calc={
                self._delayed_state.ticket(),
                self.all_state_ticket(),
            },
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._remember)

    def _accelerations(self, context) -> np.ndarray:
        """Accelerations (1 + n, nv): now, and n means, the latest first."""
        values = context.get_discrete_state_vector().value()
        return values.reshape(-1, self._nv)

    def _remember(self, context, new):
        now, *means = self._accelerations(context)
        missing = self._commanded(context) - now
        latest = now + self._share * missing, now + self._mean_share * missing
        new.set_value(np.concatenate((*latest, *means[:-1])))
        return EventStatus.Succeeded()

    def _calc_state(self, context, output):
        q, v = np.split(self._delayed_state(context), [self._nq])
        h, way = self._period, np.zeros(self._nv)
        for acceleration in self._accelerations(context)[:0:-1]:
            way += h * (v + 0.5 * h * acceleration)
            v = v + h * acceleration
        plant_context = self._scratch.Eval(context)
        self._plant.SetPositions(plant_context, q)
        q = q + self._plant.MapVelocityToQDot(plant_context, way)
        q[:4] /= math.hypot(*q[:4].tolist())
        output.SetFromVector(np.concatenate((q, v)))
