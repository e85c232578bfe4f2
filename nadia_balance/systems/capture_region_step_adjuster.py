"""LEAD'S STAND-IN until helper-9's system lands."""

from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.foothold_adjustment import (
    propose_adjustment,
    unadjusted,
)
from nadia_balance.core.swing_geometry import swing_geometry
from nadia_balance.core.walking import Phase, WalkingState
from nadia_balance.systems.ports import eval_typed


class CaptureRegionStepAdjuster(LeafSystem):
    """Stand-in.

    .. pydrake_system::

        name: CaptureRegionStepAdjuster
        input_ports: [icp, walking_state, time_adjustment]
        output_ports: [adjustment, capture_regions]
    """

    def __init__(self, params, sole, omega):
        super().__init__()
        self._params, self._sole, self._omega = params, sole, omega
        self._icp = self.DeclareVectorInputPort("icp", 2)
        self._state = self.DeclareAbstractInputPort(
            "walking_state", Value(object())
        )
        self._time = self.DeclareVectorInputPort("time_adjustment", 1)
        self.DeclareAbstractOutputPort(
            "adjustment", lambda: Value(object()), self._calc
        )
        self.DeclareAbstractOutputPort(
            "capture_regions", lambda: Value(object()), lambda c, o: None
        )

    def _calc(self, context, output):
        state = eval_typed(self, context, self._state, WalkingState)
        if state.schedule.phase is not Phase.SWING:
            output.set_value(unadjusted(state.schedule))
            return
        geometry = swing_geometry(
            state.schedule, self._sole, self._params, self._omega
        )
        output.set_value(
            propose_adjustment(
                state,
                self._icp.Eval(context),
                float(self._time.Eval(context)[0]),
                geometry,
                self._params,
                self._omega,
            )
        )
