"""Adjustment of the walking clock to the ICP error."""

from pydrake.systems.framework import LeafSystem

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.bounds import check
from nadia_balance.core.plan.icp_plan import IcpPlan
from nadia_balance.core.plan.time_adjustment import Timing, TimingAdapterParams
from nadia_balance.core.walking.vocabulary import FootPoses, WalkingState
from nadia_balance.systems.ports import MechanismsInput, ValueInput, VectorInput


class TimingAdapter(LeafSystem):
    """Computes the time by which to advance the walking clock (Nadia, Sec. VI).

    `icp` (2,) [m] in W; `walking_state` is a WalkingState, `icp_plan` the
    IcpPlan of its schedule; `foot_poses` are measured FootPoses; `mechanisms`
    (4,), all on if not connected.  `time_adjustment` (2,) [s] is the time to
    add to the clock in this tick, besides the control period, and the present
    estimate of the total over this and the next ticks; the clock is held while
    it is negative.

    .. pydrake_system::

        name: TimingAdapter
        input_ports: [icp, icp_plan, walking_state, foot_poses,
                      mechanisms]
        output_ports: [time_adjustment]
    """

    def __init__(
        self, params: TimingAdapterParams, model: PointMassModel, period: float
    ):
        super().__init__()
        check(params)
        self._timing = Timing(params, model, period)
        self._icp = VectorInput(self, "icp", 2)
        self._plan = ValueInput(self, "icp_plan", IcpPlan)
        self._state = ValueInput(self, "walking_state", WalkingState)
        self._feet = ValueInput(self, "foot_poses", FootPoses)
        self._mechanisms = MechanismsInput(self)
        self.DeclareVectorOutputPort("time_adjustment", 2, self._calc)

    def _calc(self, context, output):
        adjustment = self._timing.adjustment(
            self._state(context),
            self._plan(context),
            self._icp(context),
            self._feet(context),
            self._mechanisms(context),
        )
        output.SetFromVector(adjustment)
