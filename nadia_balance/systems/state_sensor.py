"""Model of the state measurement: delay and noise."""

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.walking.imperfections import Imperfections
from nadia_balance.core.walking.vocabulary import whole_ticks
from nadia_balance.systems.ports import Input

_FEET = 2
_PELVIS = slice(4, 7)  # pelvis position in q, behind the quaternion


class StateSensor(LeafSystem):
    """Delays the state of the plant and the foot forces, and adds noise.

    `state` is [q, v] of the plant, `measured_state` the delayed and noisy
    [q, v]; `measured_foot_forces` are the delayed `foot_forces` (2,) [N].
    Forces and the orientation of the pelvis have no noise.  The discrete state
    is the buffer of delayed samples, the latest first, filled with the initial
    state.  The noise of a tick depends on the seed and the tick's number only.

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
        self._deviations = np.zeros(size)
        self._deviations[7:nq] = imperfections.joint_noise
        self._deviations[_PELVIS] = imperfections.pelvis_noise
        self._deviations[nq : nq + 6] = imperfections.pelvis_speed_noise
        self._deviations[nq + 6 :] = imperfections.joint_speed_noise
        self._now = Input(self, "state", size)
        self._forces = Input(self, "foot_forces", _FEET)
        self._past = self.DeclareDiscreteState(self._ticks * (size + _FEET))
        delayed = {self.all_state_ticket()}
        for name, length, calc, port in (
            ("measured_state", size, self._calc_state, self._now),
            ("measured_foot_forces", _FEET, self._calc_forces, self._forces),
        ):
            depends = delayed if self._ticks else {port.ticket()}
            depends = depends | {self.time_ticket()}
            self.DeclareVectorOutputPort(
                name, length, calc, prerequisites_of_calc=depends
            )
        self.DeclareInitializationDiscreteUpdateEvent(self._fill)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._shift)

    def _sample(self, context) -> np.ndarray:
        """The present state and foot forces (n + 2,)."""
        return np.concatenate((self._now(context), self._forces(context)))

    def _fill(self, context, new):
        new.set_value(np.tile(self._sample(context), self._ticks))
        return EventStatus.Succeeded()

    def _shift(self, context, new):
        past = context.get_discrete_state(self._past).value()
        latest = np.concatenate((self._sample(context), past))
        new.get_mutable_vector(self._past).SetFromVector(latest[: past.size])
        return EventStatus.Succeeded()

    def _calc_state(self, context, output):
        tick = round(context.get_time() / self._period)
        noise = np.random.default_rng((self._seed, tick)).standard_normal(
            self._deviations.size
        )
        if self._ticks:
            state = self._oldest(context)[:-_FEET]
        else:
            state = self._now(context)
        output.SetFromVector(state + self._deviations * noise)

    def _calc_forces(self, context, output):
        if self._ticks:
            output.SetFromVector(self._oldest(context)[-_FEET:])
        else:
            output.SetFromVector(self._forces(context))

    def _oldest(self, context) -> np.ndarray:
        past = context.get_discrete_state(self._past).value()
        return past[-(self._deviations.size + _FEET) :]
