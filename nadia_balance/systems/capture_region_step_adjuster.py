"""Moves the foothold of the step in the air to where it captures the robot."""

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem, ValueProducer

from nadia_balance.core.foothold_adjustment import (
    CaptureRegions,
    capture_regions,
    propose_adjustment,
    unadjusted,
)
from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.swing_geometry import (
    SwingGeometry,
    geometry_key,
    swing_geometry,
)
from nadia_balance.core.walking import (
    Adjustment,
    FootPose,
    Footstep,
    Phase,
    Side,
    WalkingState,
)
from nadia_balance.systems.ports import eval_typed


class CaptureRegionStepAdjuster(LeafSystem):
    """Proposes where the swing foot should land (Nadia paper, Sec. IV, V).

    What it has to remember is in the `Adjustment` that it reads back from the
    walking state.  Outside of a swing it proposes the next foothold as it is,
    and the capture regions are empty.  Without a `time_adjustment` [s] the
    clock keeps its pace.

    .. pydrake_system::

        name: CaptureRegionStepAdjuster
        input_ports: [icp, walking_state, time_adjustment]
        output_ports: [adjustment, capture_regions]
    """

    def __init__(
        self,
        params: CaptureRegionStepAdjusterParams,
        sole: np.ndarray,
        omega: float,
    ):
        """For soles with the corners `sole` (n, 2) [m]; omega [rad/s]."""
        super().__init__()
        params.validate()
        params.usable_foot(sole)  # raises if nothing is left of it
        self._params, self._sole, self._omega = params, sole, omega
        self._icp = self.DeclareVectorInputPort("icp", 2)
        self._walking_state = self.DeclareAbstractInputPort(
            "walking_state", Value(object())
        )
        self._time_adjustment = self.DeclareVectorInputPort(
            "time_adjustment", 1
        )
        # A pure function of the footsteps.  Keeping the last one only saves
        # the work while the ICP and the clock are all that changes.
        self._geometry = self.DeclareCacheEntry(
            "swing geometry",
            ValueProducer(lambda: Value((None, None)), self._calc_geometry),
            {self.input_port_ticket(self._walking_state.get_index())},
        )
        step = Footstep(Side.LEFT, FootPose(), 0.0, 0.0)
        self._adjustment = self.DeclareAbstractOutputPort(
            "adjustment",
            lambda: Value(Adjustment(step, step.pose)),
            self._calc_adjustment,
        )
        self.DeclareAbstractOutputPort(
            "capture_regions",
            lambda: Value(CaptureRegions()),
            self._calc_capture_regions,
        )

    def _state(self, context) -> WalkingState:
        return eval_typed(self, context, self._walking_state, WalkingState)

    def _time_gain(self, context) -> float:
        port = self._time_adjustment
        return float(port.Eval(context)[0]) if port.HasValue(context) else 0.0

    def _swing_geometry(self, context) -> SwingGeometry:
        return self._geometry.Eval(context)[1]

    def _calc_geometry(self, context, geometry):
        schedule = self._state(context).schedule
        key, last = geometry_key(schedule), geometry.get_value()[0]
        if (
            last is None
            or len(key) != len(last)
            or any(a is not b for a, b in zip(key, last, strict=True))
        ):
            found = swing_geometry(
                schedule, self._sole, self._params, self._omega
            )
            geometry.set_value((key, found))

    def _calc_adjustment(self, context, output):
        state = self._state(context)
        if state.schedule.phase is not Phase.SWING:
            output.set_value(unadjusted(state.schedule))
            return
        output.set_value(
            propose_adjustment(
                state,
                self._icp.Eval(context),
                self._time_gain(context),
                self._swing_geometry(context),
                self._params,
                self._omega,
            )
        )

    def _calc_capture_regions(self, context, output):
        state = self._state(context)
        if state.schedule.phase is not Phase.SWING:
            output.set_value(CaptureRegions())
            return
        output.set_value(
            capture_regions(
                state,
                self._icp.Eval(context),
                self._time_gain(context),
                self._adjustment.Eval(context),
                self._swing_geometry(context),
                self._params,
                self._omega,
            )
        )
