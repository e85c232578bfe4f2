"""The robot's state now, from what was measured a while ago."""

import math

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import EventStatus, LeafSystem, ValueProducer

from nadia_balance.core.joint_drives import lag_share
from nadia_balance.robot import RobotModel
from nadia_balance.systems.ports import VectorInput


class StatePredictor(LeafSystem):
    """Takes a late state to now, by what was commanded in the meantime.

    `delayed_state` is [q, v] of the robot's `control_plant`, a `delay` ago,
    and `estimated_state` the same, now.  `generalized_acceleration` (nv,) is
    what the torques of a tick are to bring about, see WholeBodyInverseDynamics;
    it comes with the lag of the drives.  A Smith predictor: what was commanded
    before the measurement is in it.  The discrete state is the acceleration
    that is there by now, and its means in the periods of the delay, the last
    one first; 0 at the start.

    Evaluating the output, or an update, raises RuntimeError if the input is
    not finite.

    .. pydrake_system::

        name: StatePredictor
        input_ports: [delayed_state, generalized_acceleration]
        output_ports: [estimated_state]
    """

    def __init__(self, robot: RobotModel, period: float, delay: float):
        """Predicts the state of `robot`, a `delay` of some `period`s [s]."""
        super().__init__()
        self._period = period
        self._plant = plant = robot.control_plant()
        self._nq, self._nv = plant.num_positions(), plant.num_velocities()
        # What of a step in acceleration is there after a period; on average.
        self._share, self._mean_share = 1.0, 1.0
        if robot.drives is not None:
            self._share = lag_share(robot.drives.bandwidth, period)
            self._mean_share -= self._share * robot.drives.lag / period
        size = plant.num_multibody_states()
        self._delayed_state = VectorInput(self, "delayed_state", size)
        self._commanded = VectorInput(
            self, "generalized_acceleration", self._nv
        )
        # Memory to compute in.
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
        """(1 + n, nv): now, and the means of n periods, the last one first."""
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
