"""Adjustment of the walking clock to the ICP error."""

from pydrake.systems.framework import LeafSystem

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.bounds import check
from nadia_balance.core.plan.time_adjustment import Timing, TimingAdapterParams
from nadia_balance.systems import ports


class TimingAdapter(LeafSystem):
    """Computes the time by which to advance the walking clock (Nadia, Sec. VI).

    `time_adjustment` is the time to add to the clock in this tick, besides the
    control period, and the present estimate of the total over this and the next
    ticks; the clock is held while it is negative.

    .. pydrake_system::

        name: TimingAdapter
        input_ports: [walking_state, icp_plan, icp, foot_poses, mechanisms]
        output_ports: [time_adjustment]
    """

    def __init__(
        self, params: TimingAdapterParams, model: PointMassModel, period: float
    ):
        super().__init__()
        check(params)
        self._timing = Timing(params, model, period)
        names = "walking_state icp_plan icp foot_poses mechanisms"
        self._inputs = list(ports.inputs(self, names))
        ports.declare_output(self, "time_adjustment", self._calc)

    def _calc(self, context) -> tuple[float, float]:
        signals = [read(context) for read in self._inputs]
        return self._timing.adjustment(*signals)
