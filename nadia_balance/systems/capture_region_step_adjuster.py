"""Moves the foothold of the step in the air to where it captures the robot."""

from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem, ValueProducer

from nadia_balance.core.foothold_adjustment import (
    CaptureRegions,
    Landing,
    capture_regions,
    current_adjustment,
    propose_adjustment,
    touchdown_interval,
    unadjusted,
)
from nadia_balance.core.foothold_adjustment_params import (
    CaptureRegionStepAdjusterParams,
)
from nadia_balance.core.mechanisms import switched_adjuster
from nadia_balance.core.swing_geometry import geometry_key, swing_geometry
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


class Tick(NamedTuple):
    """The inputs of one tick; `key`, of the geometry, and `landing` of a swing.

    Outside of a swing they are empty.
    """

    state: WalkingState | None = None
    params: CaptureRegionStepAdjusterParams | None = None
    key: tuple[object, ...] = ()
    landing: Landing | None = None

    def __deepcopy__(self, memo: object) -> "Tick":
        return self


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
        # A pure function of the inputs.  Keeping the last one only saves
        # making its geometry anew while the footsteps are the same.
        self._tick = self.DeclareCacheEntry(
            "tick",
            ValueProducer(lambda: Value(Tick()), self._calc_tick),
            {
                self._icp.ticket(),
                self._walking_state.ticket(),
                self._time_adjustment.ticket(),
                self._params.ticket,
            },
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

    def _time_gain(self, context) -> float:
        port = self._time_adjustment
        if not port.HasValue(context):
            return 0.0
        return float(eval_finite(self, context, port)[0])

    def _calc_tick(self, context, tick):
        state = eval_typed(self, context, self._walking_state, WalkingState)
        params = self._params(context)
        key, landing = (), None
        if state.schedule.phase is Phase.SWING:
            key, last = geometry_key(state.schedule, params), tick.get_value()
            geometry = (
                last.landing.geometry
                if key == last.key
                else swing_geometry(
                    state.schedule, self._sole, params, self._omega
                )
            )
            landing = Landing(
                geometry,
                eval_finite(self, context, self._icp),
                self._omega,
                touchdown_interval(state, self._time_gain(context), params),
            )
        tick.set_value(Tick(state, params, key, landing))

    def _calc_adjustment(self, context, output):
        now = self._tick.Eval(context)
        if not now.params.enabled:
            proposal = None
        elif now.landing is None:
            proposal = unadjusted(now.state.schedule)
        else:
            proposal = propose_adjustment(
                now.state, now.landing, now.params, self._period
            )
        output.set_value(proposal)

    def _calc_capture_regions(self, context, output):
        now = self._tick.Eval(context)
        if now.landing is None:
            output.set_value(CaptureRegions())
            return
        # None if it is switched off: that of before holds.
        adjustment = self._adjustment.Eval(context) or current_adjustment(
            now.state
        )
        output.set_value(capture_regions(now.landing, adjustment))
