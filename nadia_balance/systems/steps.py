"""Where the next foot goes, and how: its foothold, and its motion."""

from pydrake.systems.framework import LeafSystem

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.body.swing_detour import edges_on_way
from nadia_balance.core.steps import capture_region, swing_foot
from nadia_balance.core.steps import foothold_adjustment as rules
from nadia_balance.core.steps.foothold_adjustment import CaptureRegions, Landing
from nadia_balance.core.walking import state as walking
from nadia_balance.parameters.bounds import check
from nadia_balance.systems import ports
from nadia_balance.systems.signals import sizes


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
        params: capture_region.CaptureRegionStepAdjusterParams,
        model: PointMassModel,
        period: float,
    ):
        super().__init__()
        check(params)
        params.usable_foot(model.cop_area)  # raises if it is empty
        self._params, self._model, self._period = params, model, period
        names = "alip_icp walking_state time_adjustment foot_poses? mechanisms"
        ins = ports.inputs(self, names)
        self._icp, self._walking_state, self._time, self._feet, self._on = ins
        self._landing = ports.declare_cache(self, "landing", self._calc_landing)
        self._adjustment = ports.declare_output(
            self, "adjustment", self._calc_adjustment, [self._landing]
        )
        ports.declare_output(
            self, "capture_regions", self._calc_regions, [self._landing]
        )

    def _calc_landing(self, context, last) -> Landing | tuple[()]:
        """The Landing of this tick; outside of a swing (), which is false."""
        state, on = self._walking_state(context), self._on(context)
        if state.schedule.phase is not walking.Phase.SWING:
            return ()
        key = capture_region.geometry_key(state.schedule, on)
        geometry = last.geometry if last else None
        if geometry is None or geometry.key != key:
            of = state.schedule, self._params, self._model, on
            geometry = capture_region.SwingGeometry(*of)
        foot = None
        if on.swing and (feet := self._feet(context)) is not None:
            foot = feet[geometry.swing].p_WF[:2]
        clock_gain = float(self._time(context)[1])
        touchdown = rules.touchdown_interval(state, clock_gain, self._params)
        return Landing(geometry, self._icp(context), touchdown, foot)

    def _calc_adjustment(self, context) -> walking.Adjustment | None:
        if not self._on(context).step:
            return None
        state = self._walking_state(context)
        if not (landing := self._landing.Eval(context)):
            return rules.unadjusted(state.schedule)
        tick = landing, self._params, self._period
        return rules.propose_adjustment(state, *tick)

    def _calc_regions(self, context) -> CaptureRegions:
        if not (landing := self._landing.Eval(context)):
            return CaptureRegions()
        # While `step` is off, the previous adjustment holds.
        now = self._adjustment.Eval(context) or rules.current_adjustment(
            self._walking_state(context)
        )
        return rules.capture_regions(landing, now)


class SwingFootPlanner(LeafSystem):
    """Computes the swing foot's reference, continued from its last value.

    The reference clears the edges of uneven ground that the model contains.
    It is that of the foot that swings, or swings next: like the state of a
    StatePredictor, positions a `lead` ahead, velocities not.  The discrete
    state is the output of the last tick, and the motion without the lead.

    .. pydrake_system::

        name: SwingFootPlanner
        input_ports: [walking_state]
        output_ports: [swing_foot_reference]
    """

    def __init__(
        self,
        params: swing_foot.SwingFootParams,
        model: PointMassModel,
        period: float,
        lead: float = 0.0,
    ):
        super().__init__()
        check(params)
        self._foot = swing_foot.SwingFoot(params, model, period, lead)
        (self._walking,) = ports.inputs(self, "walking_state")
        over = model.ground, params.clearance
        self._edges = ports.declare_plan(
            self, self._walking, lambda now: edges_on_way(now.schedule, *over)
        )
        # The initial state is not used: the first swing begins at the pose of
        # the standing foot.
        told = sizes("swing_foot_reference")
        ports.Outcome(self, told, {"motion": 12}, self._calc, period)

    def _calc(self, context, last) -> tuple:
        walks, (_, edges) = self._walking(context), self._edges.Eval(context)
        previous = last["motion"].reshape(3, 4)
        motion, ahead = self._foot.motion(previous, walks, edges)
        return swing_foot.as_reference(ahead, self._foot.lead), motion.ravel()
