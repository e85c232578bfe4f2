"""Estimate of the friction coefficient from slipping soles."""

import numpy as np
from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.whole_body.command import SOLES
from nadia_balance.core.whole_body.limits import (
    FrictionEstimate,
    friction_after,
)
from nadia_balance.core.whole_body.params import WholeBodyQpParams
from nadia_balance.systems import ports


class FrictionEstimator(LeafSystem):
    """Lowers the friction coefficient when a loaded sole slips.

    `foot_wrenches` are the commanded ones of this tick; `friction` is one tick
    late.  The discrete state is a FrictionEstimate.

    .. pydrake_system::

        name: FrictionEstimator
        input_ports: [whole_body_terms, foot_wrenches]
        output_ports: [friction]
    """

    def __init__(
        self, params: WholeBodyQpParams, model: PointMassModel, period: float
    ):
        """Updates every `period` [s], for a robot of the mass of `model`.

        The friction of `params` is the initial and the largest estimate.
        """
        super().__init__()
        self._params, self._period = params, period
        self._weight = model.mass * GRAVITY
        self._terms, self._wrenches = ports.inputs(
            self, "whole_body_terms", "foot_wrenches"
        )
        self.DeclareDiscreteState(FrictionEstimate(params.friction, 0.0, 0.0))
        ports.declare_output(
            self,
            "friction",
            lambda context: context.get_discrete_state_vector().value()[:1],
            [self.all_state_ticket()],
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._update)

    def _update(self, context, new):
        last = context.get_discrete_state_vector().value()
        terms, wrenches = self._terms(context), self._wrenches(context)
        # Force per weight and velocity of each sole, from W to its own frame.
        motion = np.empty((2, 2, 3))
        motion[:, 0] = wrenches.reshape(2, 6)[:, 3:]
        motion[:, 0] /= self._weight
        motion[:, 1] = terms.velocities[: SOLES[1].stop].reshape(2, 6)[:, 3:]
        motion = motion @ terms.rotations[:2]
        estimate = friction_after(
            FrictionEstimate(*last.tolist()),
            motion[:, 0],
            motion[:, 1],
            self._params.friction,
            self._params.slip,
            self._period,
        )
        new.get_mutable_discrete_state(0).set_value(np.array(estimate))
        return EventStatus.Succeeded()
