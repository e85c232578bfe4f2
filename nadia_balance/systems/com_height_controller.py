"""Rate of the linear momentum from the eCMP and the height of the CoM."""

from pydrake.systems.framework import LeafSystem

from nadia_balance.core.body import com_height
from nadia_balance.core.body.com_height import ComHeightParams
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.feedback.momentum_qp import momentum_rate
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.bounds import check
from nadia_balance.core.walking.vocabulary import Phase
from nadia_balance.systems.ports import declare_output, declare_plan, inputs


class ComHeightController(LeafSystem):
    """Computes the momentum rate l_dot = m (omega^2 (c - eCMP), z_ddot).

    z_ddot = k_d clip(z_dot_d + k_p / k_d (z_d - z)) - k_d z_dot is a PD law on
    the planned height, limited; the horizontal part is the pendulum's (Nadia
    paper, Eqs. 1 and 5).  The block has no state.

    .. pydrake_system::

        name: ComHeightController
        input_ports: [com_state, ecmp_command, walking_state]
        output_ports: [momentum_rate]
    """

    def __init__(
        self, params: ComHeightParams, model: PointMassModel, period: float
    ):
        super().__init__()
        check(params)
        self._params, self._model = params, model
        self._com_state, self._ecmp_command, self._walking_state = inputs(
            self, "com_state", "ecmp_command", "walking_state"
        )
        self._height = declare_plan(
            self,
            self._walking_state,
            lambda state: com_height.plan_com_height(
                state.schedule, params, model
            ),
        )
        declare_output(self, "momentum_rate", self._calc_rate)

    def _calc_rate(self, context) -> Array:
        com = self._com_state(context)
        state, plan = self._walking_state(context), self._height.Eval(context)
        wanted = plan[1].at(state.time_in_phase)
        if state.schedule.phase is Phase.SWING:
            most = com_height.stance_limit(
                com.position[:2],
                com.velocity[:2],
                state.schedule,
                self._params,
                self._model,
            )
            wanted = min(wanted, most)
        acceleration = com_height.vertical_acceleration(
            float(com.z), float(com.vz), *wanted, self._params
        )
        ecmp = self._ecmp_command(context).ecmp
        return momentum_rate(com.position[:2], ecmp, acceleration, self._model)
