"""Swing-foot reference, continuous when the step is re-planned."""

from pydrake.systems.framework import LeafSystem

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.bounds import check
from nadia_balance.core.steps import swing_foot
from nadia_balance.core.steps.swing_clearance import edges_on_way
from nadia_balance.systems import ports
from nadia_balance.systems.signals import sizes


class SwingFootPlanner(LeafSystem):
    """Computes the swing foot's reference, continued from its last value.

    The reference clears the edges of uneven ground that the model contains.
    It is that of the foot that swings, or swings next: like the state of a
    StatePredictor, positions a `lead` ahead, velocities not.  The discrete
    state is the output of the last tick, and the motion without the lead.

    .. pydrake_system::

        name: SwingFootPlanner
        input_ports: [walking_state]
        output_ports: [swing_foot_reference]
    """

    def __init__(
        self,
        params: swing_foot.SwingFootParams,
        model: PointMassModel,
        period: float,
        lead: float = 0.0,
    ):
        super().__init__()
        check(params)
        self._params, self._model = params, model
        self._period, self._lead = period, lead
        (self._walking,) = ports.inputs(self, "walking_state")
        self._edges = ports.declare_plan(
            self,
            self._walking,
            lambda state: edges_on_way(state.schedule, model, params.clearance),
        )
        # The initial state is not used: the first swing begins at the pose of
        # the standing foot.
        ports.Outcome(
            self,
            sizes("swing_foot_reference"),
            {"motion": 12},
            self._calc,
            period,
        )

    def _calc(self, context, last) -> tuple:
        motion, ahead = swing_foot.swing_foot_motion(
            swing_foot.FootMotion.from_vector(last["motion"]),
            self._walking(context),
            self._period,
            self._params,
            self._model,
            self._lead,
            self._edges.Eval(context)[1],
        )
        reference = swing_foot.velocity_now(ahead.as_vector(), self._lead)
        return reference, motion.as_vector()
