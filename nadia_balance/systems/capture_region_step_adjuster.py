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
from nadia_balance.core.mechanisms import switched_adjuster
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
from nadia_balance.systems.ports import eval_finite, eval_typed
from nadia_balance.systems.switched_params import SwitchedParams


class CaptureRegionStepAdjuster(LeafSystem):
    """Proposes where the swing foot should land (Nadia paper, Sec. IV, V).

    What it has to remember is in the `Adjustment` that it reads back from the
    walking state.  Outside of a swing it proposes the next foothold as it is,
    and the capture regions are empty; switched off, by its parameters or by
    the optional `mechanisms` (see SwitchedParams), it proposes None.  Without
    a `time_adjustment` [s] the clock keeps its pace.

    .. pydrake_system::

        name: CaptureRegionStepAdjuster
        input_ports: [icp, walking_state, time_adjustment, mechanisms]
        output_ports: [adjustment, capture_regions]
    """

    def __init__(
        self,
        params: CaptureRegionStepAdjusterParams,
        sole: np.ndarray,
        omega: float,
        control_period: float,
    ):
        """For soles with the corners `sole` (n, 2) [m]; omega [rad/s].

        The proposal is taken once per `control_period` [s].
        """
        super().__init__()
        params.validate()
        params.usable_foot(sole)  # raises if nothing is left of it
        self._sole, self._omega = sole, omega
        self._period = control_period
        self._icp = self.DeclareVectorInputPort("icp", 2)
        self._walking_state = self.DeclareAbstractInputPort(
            "walking_state", Value(object())
        )
        self._time_adjustment = self.DeclareVectorInputPort(
            "time_adjustment", 1
        )
        self._params = SwitchedParams(self, params, switched_adjuster)
        # A pure function of the footsteps.  Keeping the last one only saves
        # the work while the ICP and the clock are all that changes.
        self._geometry = self.DeclareCacheEntry(
            "swing geometry",
            ValueProducer(lambda: Value((None, None)), self._calc_geometry),
            {self._walking_state.ticket(), self._params.ticket},
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
        if not port.HasValue(context):
            return 0.0
        return float(eval_finite(self, context, port)[0])

    def _swing_geometry(self, context) -> SwingGeometry:
        return self._geometry.Eval(context)[1]

    def _calc_geometry(self, context, geometry):
        schedule, params = self._state(context).schedule, self._params(context)
        key, last = geometry_key(schedule, params), geometry.get_value()[0]
        if (
            last is None
            or len(key) != len(last)
            or any(a is not b for a, b in zip(key, last, strict=True))
        ):
            found = swing_geometry(schedule, self._sole, params, self._omega)
            geometry.set_value((key, found))

    def _calc_adjustment(self, context, output):
        params = self._params(context)
        if not params.enabled:
            output.set_value(None)
            return
        state = self._state(context)
        if state.schedule.phase is not Phase.SWING:
            output.set_value(unadjusted(state.schedule))
            return
        output.set_value(
            propose_adjustment(
                state,
                eval_finite(self, context, self._icp),
                self._time_gain(context),
                self._swing_geometry(context),
                params,
                self._omega,
                self._period,
            )
        )

    def _calc_capture_regions(self, context, output):
        state = self._state(context)
        if state.schedule.phase is not Phase.SWING:
            output.set_value(CaptureRegions())
            return
        adjustment = (
            self._adjustment.Eval(context)
            or state.adjustment  # of before it was switched off
            or unadjusted(state.schedule)
        )
        output.set_value(
            capture_regions(
                state,
                eval_finite(self, context, self._icp),
                self._time_gain(context),
                adjustment,
                self._swing_geometry(context),
                self._params(context),
                self._omega,
            )
        )
