"""Where the next foot goes, and how: its foothold, and its motion."""

from typing import Any, NamedTuple

from pydrake.systems.framework import Context

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.body.swing_detour import edges_on_way
from nadia_balance.core.steps.capture_region import (
    CaptureRegionStepAdjusterParams,
    SwingGeometry,
    geometry_key,
)
from nadia_balance.core.steps.foothold_adjustment import (
    CaptureRegions,
    Landing,
    capture_regions,
    current_adjustment,
    lacks_ground,
    propose_adjustment,
    touchdown_interval,
    unadjusted,
)
from nadia_balance.core.steps.swing_foot import (
    SwingFoot,
    SwingFootParams,
    as_reference,
)
from nadia_balance.core.walking.mechanisms import USUAL, Mechanisms
from nadia_balance.core.walking.state import Adjustment, Phase, WalkingState
from nadia_balance.parameters.bounds import check
from nadia_balance.systems.ports import (
    Block,
    declare_cache,
    declare_outcome,
    declare_output,
    input_port,
    once_per_schedule,
    optional_input,
)
from nadia_balance.systems.signals import SwingFootReference, size


class _Tick(NamedTuple):
    """What the outputs of a CaptureRegionStepAdjuster follow from."""

    state: WalkingState
    on: Mechanisms
    landing: Landing | None  # None outside of a swing


class CaptureRegionStepAdjuster(Block):
    """Computes the swing foot's foothold from capture regions.

    Nadia paper, Sec. IV and V.  Without `foot_poses` the time that the foot
    needs to a foothold is ignored.  Outside of a swing `adjustment` is the
    unchanged next foothold, and `capture_regions` are empty.  `no_foothold` is
    1 while the capture region is in reach, but no ground there, else 0.  The
    block has no state: its memory is the Adjustment in the walking state.

    Args:
        params: rules of the adjustment.
        model: point mass of the robot.
        period: control period [s].

    .. pydrake_system::

        name: CaptureRegionStepAdjuster
        input_ports: [alip_icp, walking_state, time_adjustment, foot_poses,
                      mechanisms]
        output_ports: [adjustment, capture_regions, no_foothold]
    """

    def __init__(
        self,
        params: CaptureRegionStepAdjusterParams,
        model: PointMassModel,
        period: float,
    ) -> None:
        super().__init__()
        check(params)
        params.usable_foot(model.cop_area)  # raises if it is empty
        self._params = params
        self._model = model
        self._period = period
        self._icp = input_port(self, "alip_icp")
        self._walking = input_port(self, "walking_state")
        self._time = optional_input(self, "time_adjustment", default=(0.0, 0.0))
        self._feet = optional_input(self, "foot_poses")
        self._mechanisms = optional_input(self, "mechanisms", default=USUAL)
        self._tick: Any = declare_cache(self, "tick", self._calc_tick)
        self._adjustment: Any = declare_output(
            self, "adjustment", self._calc_adjustment, needs=[self._tick]
        )
        declare_output(
            self, "capture_regions", self._calc_regions, needs=[self._tick]
        )
        declare_output(
            self, "no_foothold", self._calc_no_foothold, needs=[self._tick]
        )

    def _calc_tick(self, context: Context, last: _Tick | None) -> _Tick:
        state = self._walking(context)
        mechanisms = self._mechanisms(context)
        if state.schedule.phase is not Phase.SWING:
            return _Tick(state, mechanisms, None)
        geometry = last.landing.geometry if last and last.landing else None
        if geometry is None or geometry.key != geometry_key(
            state.schedule, mechanisms
        ):
            geometry = SwingGeometry(
                state.schedule, self._params, model=self._model, on=mechanisms
            )
        feet = self._feet(context) if mechanisms.swing else None
        landing = Landing(
            geometry,
            icp=self._icp(context),
            touchdown=touchdown_interval(
                state, float(self._time(context)[1]), self._params
            ),
            foot=None if feet is None else feet[geometry.swing].p_WF[:2],
        )
        return _Tick(state, mechanisms, landing)

    def _calc_adjustment(self, context: Context) -> Adjustment | None:
        state, on, landing = self._tick.Eval(context)
        if not on.step:
            return None
        if landing is None:
            return unadjusted(state.schedule)
        return propose_adjustment(
            state, landing, params=self._params, period=self._period
        )

    def _calc_regions(self, context: Context) -> CaptureRegions:
        state, _, landing = self._tick.Eval(context)
        if landing is None:
            return CaptureRegions()
        # While `step` is off, the previous adjustment holds.
        return capture_regions(
            landing, self._adjustment.Eval(context) or current_adjustment(state)
        )

    def _calc_no_foothold(self, context: Context) -> list[float]:
        _, on, landing = self._tick.Eval(context)
        steps = landing is not None and on.step
        return [float(steps and lacks_ground(landing))]


class SwingFootPlanner(Block):
    """Computes the swing foot's reference, continued from its last value.

    The reference clears the edges of uneven ground that the model contains.
    It is that of the foot that swings, or swings next: like the state of a
    StatePredictor, positions a `lead` ahead, velocities not.  The discrete
    state is the output of the last tick, and the motion without the lead.

    Args:
        params: shape of the swing.
        model: point mass of the robot, with the ground.
        period: control period [s].
        lead: time until the torques of a tick act [s].

    .. pydrake_system::

        name: SwingFootPlanner
        input_ports: [walking_state]
        output_ports: [swing_foot_reference]
    """

    def __init__(
        self,
        params: SwingFootParams,
        model: PointMassModel,
        period: float,
        lead: float = 0.0,
    ) -> None:
        super().__init__()
        check(params)
        self._foot = SwingFoot(params, model, period, lead=lead)
        self._walking = input_port(self, "walking_state")
        self._edges = once_per_schedule(
            lambda state: edges_on_way(
                state.schedule, model.ground, params.clearance
            )
        )
        # The initial state is not used: the first swing begins at the pose of
        # the standing foot.
        declare_outcome(
            self,
            outputs={"swing_foot_reference": size(SwingFootReference)},
            memory={"motion": 12},
            calc=self._calc,
            period=period,
        )

    def _calc(self, context: Context, last: dict[str, Any]) -> tuple[Any, ...]:
        state = self._walking(context)
        motion, ahead = self._foot.motion(
            last["motion"].reshape(3, 4), state, edges=self._edges(state)
        )
        return as_reference(ahead, self._foot.lead), motion.ravel()
