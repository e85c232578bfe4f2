"""Step adjustment: moves the swing foot's foothold into capture regions."""

from typing import NamedTuple

from pydrake.systems.framework import LeafSystem

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.bounds import check
from nadia_balance.core.steps import foothold_adjustment as rules
from nadia_balance.core.steps.foothold_adjustment import CaptureRegions, Landing
from nadia_balance.core.steps.swing_geometry import (
    CaptureRegionStepAdjusterParams,
    geometry_key,
    swing_geometry,
)
from nadia_balance.core.walking import vocabulary as walking
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.systems import ports


class Tick(NamedTuple):
    """The inputs of one tick; `landing` is None outside of a swing."""

    state: walking.WalkingState
    on: Mechanisms
    landing: Landing | None = None

    def __deepcopy__(self, memo: object) -> "Tick":
        return self


class CaptureRegionStepAdjuster(LeafSystem):
    """Computes the swing foot's foothold from capture regions.

    Nadia paper, Sec. IV and V.  Without `foot_poses` the time that the foot
    needs to a foothold is ignored.  Outside of a swing `adjustment` is the
    unchanged next foothold, and `capture_regions` are empty.  The block has no
    state: its memory is the Adjustment in the walking state.

    .. pydrake_system::

        name: CaptureRegionStepAdjuster
        input_ports: [alip_icp, walking_state, time_adjustment, foot_poses,
                      mechanisms]
        output_ports: [adjustment, capture_regions]
    """

    def __init__(
        self,
        params: CaptureRegionStepAdjusterParams,
        model: PointMassModel,
        period: float,
    ):
        super().__init__()
        check(params)
        params.usable_foot(model.cop_area)  # raises if it is empty
        self._params, self._model, self._period = params, model, period
        names = "alip_icp walking_state time_adjustment foot_poses? mechanisms"
        self._icp, self._walking_state, self._time, self._feet, self._on = (
            ports.inputs(self, names)
        )
        self._tick = ports.declare_cache(self, "tick", self._calc_tick)
        self._adjustment = ports.declare_output(
            self, "adjustment", self._calc_adjustment, [self._tick]
        )
        ports.declare_output(
            self, "capture_regions", self._calc_regions, [self._tick]
        )

    def _calc_tick(self, context, last: Tick | tuple[()]) -> Tick:
        state, on = self._walking_state(context), self._on(context)
        if state.schedule.phase is not walking.Phase.SWING:
            return Tick(state, on)
        key = geometry_key(state.schedule, on)
        if last and last.landing and key == last.landing.geometry.key:
            geometry = last.landing.geometry
        else:
            of = state.schedule, self._params, self._model, on
            geometry = swing_geometry(*of)
        foot = None
        if on.swing and (feet := self._feet(context)) is not None:
            foot = feet[geometry.swing].p_WF[:2]
        clock_gain = float(self._time(context)[1])
        touchdown = rules.touchdown_interval(state, clock_gain, self._params)
        landing = Landing(geometry, self._icp(context), touchdown, foot)
        return Tick(state, on, landing)

    def _calc_adjustment(self, context) -> walking.Adjustment | None:
        state, on, landing = self._tick.Eval(context)
        if not on.step:
            return None
        if landing is None:
            return rules.unadjusted(state.schedule)
        adjustment = rules.propose_adjustment
        return adjustment(state, landing, self._params, self._period)

    def _calc_regions(self, context) -> CaptureRegions:
        state, _, landing = self._tick.Eval(context)
        if landing is None:
            return CaptureRegions()
        # While `step` is off, the previous adjustment holds.
        proposed = self._adjustment.Eval(context)
        now = proposed or rules.current_adjustment(state)
        return rules.capture_regions(landing, now)
