"""Step adjustment: moves the swing foot's foothold into capture regions."""

from typing import NamedTuple

from pydrake.systems.framework import LeafSystem

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.bounds import check
from nadia_balance.core.steps.foothold_adjustment import (
    CaptureRegions,
    Landing,
    capture_regions,
    current_adjustment,
    propose_adjustment,
    touchdown_interval,
    unadjusted,
)
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

    Nadia paper, Sec. IV and V.  Inputs: `alip_icp` (2,) [m] in W;
    `walking_state`, a WalkingState; `time_adjustment` (2,) [s] of a
    TimingAdapter, 0 if not connected; `foot_poses`, measured FootPoses: without
    them the time that the foot needs to a foothold is ignored; `mechanisms`
    (4,), all on if not connected.  Outputs: `adjustment`, an Adjustment:
    outside of a swing the unchanged next foothold, NOTHING (see ports) while
    `step` is off; `capture_regions`, CaptureRegions, empty outside of a swing.

    The block has no state: its memory is the Adjustment that it reads back
    from the walking state.

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
        touchdown = touchdown_interval(state, clock_gain, self._params)
        landing = Landing(geometry, self._icp(context), touchdown, foot)
        return Tick(state, on, landing)

    def _calc_adjustment(self, context) -> walking.Adjustment | None:
        state, on, landing = self._tick.Eval(context)
        if not on.step:
            return None
        if landing is None:
            return unadjusted(state.schedule)
        return propose_adjustment(state, landing, self._params, self._period)

    def _calc_regions(self, context) -> CaptureRegions:
        state, _, landing = self._tick.Eval(context)
        if landing is None:
            return CaptureRegions()
        # While `step` is off, the previous adjustment holds.
        proposed = self._adjustment.Eval(context)
        return capture_regions(landing, proposed or current_adjustment(state))
