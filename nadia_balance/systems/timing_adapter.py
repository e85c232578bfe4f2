"""How fast the walking clock is to run."""

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.icp_plan import IcpPlan
from nadia_balance.core.mechanisms import switched_timing
from nadia_balance.core.swing_detour import SwingDetourParams
from nadia_balance.core.time_adjustment import (
    TimingAdapterParams,
    time_adjustment,
)
from nadia_balance.core.walking import FootPoses, WalkingState
from nadia_balance.systems.ports import eval_finite, eval_typed
from nadia_balance.systems.switched_params import SwitchedParams


class TimingAdapter(LeafSystem):
    """Proposes by how much to advance the walking clock (Nadia, Sec. VI).

    `time_adjustment` [s] is ready to be added to the clock in this tick, on
    top of the control period; if negative, the clock is to be held.  With the
    optional `mechanisms` it can be switched off and on (see SwitchedParams).

    .. pydrake_system::

        name: TimingAdapter
        input_ports: [icp, icp_plan, walking_state, foot_poses, mechanisms]
        output_ports: [time_adjustment]
    """

    def __init__(
        self,
        params: TimingAdapterParams,
        sole: np.ndarray,
        detour: SwingDetourParams,
        control_period: float,
    ):
        """For a foot that swings as `detour` says.

        `sole` (n, 2) [m] are the corners of either sole in its frame; the
        clock is advanced once per `control_period` [s].
        """
        super().__init__()
        params.validate()
        detour.validate()
        self._sole, self._detour = sole, detour
        self._period = control_period
        self._icp = self.DeclareVectorInputPort("icp", 2)
        self._plan, self._state, self._feet = (
            self.DeclareAbstractInputPort(name, Value(object()))
            for name in ("icp_plan", "walking_state", "foot_poses")
        )
        self._params = SwitchedParams(self, params, switched_timing)
        self.DeclareVectorOutputPort("time_adjustment", 1, self._calc)

    def _calc(self, context, output):
        output[0] = time_adjustment(
            eval_finite(self, context, self._icp),
            eval_typed(self, context, self._plan, IcpPlan),
            eval_typed(self, context, self._state, WalkingState),
            lambda: eval_typed(self, context, self._feet, FootPoses),
            self._sole,
            self._detour,
            self._params(context),
            self._period,
        )
