"""How fast the walking clock is to run."""

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.icp_plan import IcpPlan
from nadia_balance.core.time_adjustment import (
    TimingAdapterParams,
    time_adjustment,
)
from nadia_balance.core.walking import FootPoses, WalkingState
from nadia_balance.systems.ports import eval_typed


class TimingAdapter(LeafSystem):
    """Proposes by how much to advance the walking clock (Nadia, Sec. VI).

    `time_adjustment` [s] is ready to be added to the clock in this tick, on
    top of the control period; if negative, the clock is to be held.

    .. pydrake_system::

        name: TimingAdapter
        input_ports: [icp, icp_plan, walking_state, foot_poses]
        output_ports: [time_adjustment]
    """

    def __init__(self, params: TimingAdapterParams, sole: np.ndarray):
        """`sole` (n, 2) [m] are the corners of either sole in its frame."""
        super().__init__()
        params.validate()
        self._params, self._sole = params, sole
        self._icp = self.DeclareVectorInputPort("icp", 2)
        self._plan, self._state, self._feet = (
            self.DeclareAbstractInputPort(name, Value(object()))
            for name in ("icp_plan", "walking_state", "foot_poses")
        )
        self.DeclareVectorOutputPort("time_adjustment", 1, self._calc)

    def _calc(self, context, output):
        output[0] = time_adjustment(
            self._icp.Eval(context),
            eval_typed(self, context, self._plan, IcpPlan),
            eval_typed(self, context, self._state, WalkingState),
            eval_typed(self, context, self._feet, FootPoses),
            self._sole,
            self._params,
        )
