"""The swing foot's reference, continuous whatever is re-planned."""

from pydrake.systems.framework import EventStatus, LeafSystem

from nadia_balance.core.swing_foot import (
    FootMotion,
    SwingFootParams,
    swing_foot_motion,
)
from nadia_balance.core.walking import WalkingState
from nadia_balance.systems.ports import declare_input, eval_typed


class SwingFootPlanner(LeafSystem):
    """Continues the swing foot's reference from its last value.

    Output: [p(3), v(3), a(3), yaw, yawdot, yawddot] of the sole of the foot
    that swings, or that will swing next, in W.  The discrete state is the
    output of the last tick.

    .. pydrake_system::

        name: SwingFootPlanner
        input_ports: [walking_state]
        output_ports: [swing_foot_reference]
    """

    def __init__(
        self,
        params: SwingFootParams,
        initial: WalkingState,
        control_period: float,
    ):
        """Starts at rest in `initial`; `control_period` [s]."""
        super().__init__()
        params.validate()
        self._params, self._period = params, control_period
        self._walking_state = declare_input(self, "walking_state", initial)
        schedule = initial.schedule
        rest = FootMotion.at_rest(schedule.feet[schedule.support_side.other])
        self._previous = self.DeclareDiscreteState(rest.as_vector())
        self._reference = self.DeclareVectorOutputPort(
            "swing_foot_reference",
            12,
            self._calc,
            prerequisites_of_calc={
                self._walking_state.ticket(),
                self.discrete_state_ticket(self._previous),
            },
        )
        self.DeclarePeriodicDiscreteUpdateEvent(
            period_sec=control_period, offset_sec=0.0, update=self._remember
        )

    def _calc(self, context, output):
        previous = context.get_discrete_state(self._previous).value()
        motion = swing_foot_motion(
            FootMotion.from_vector(previous),
            eval_typed(self, context, self._walking_state, WalkingState),
            self._period,
            self._params,
        )
        output.SetFromVector(motion.as_vector())

    def _remember(self, context, state):
        state.set_value(self._previous, self._reference.Eval(context))
        return EventStatus.Succeeded()
