"""Reference ICP of the present phase, planned from the next footsteps."""

import numpy as np
from pydrake.common.containers import namedview
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.atlas_icp_plan import AtlasIcpPlanParams, plan_atlas_icp
from nadia_balance.core.bounds import check
from nadia_balance.core.icp_plan import (
    IcpPlan,
    IcpPlanParams,
    plan_icp,
    reference_of,
)
from nadia_balance.core.model import PointMassModel
from nadia_balance.core.walking import ContactSchedule, WalkingState
from nadia_balance.systems.ports import (
    ValueInput,
    declare_cache,
    declare_output,
    entries,
    size,
)


class IcpReference(
    namedview(
        "IcpReference",
        [
            *("icp_x", "icp_y", "icp_velocity_x", "icp_velocity_y"),
            *("cop_x", "cop_y", "ecmp_x", "ecmp_y"),
        ],
    )
):
    """The ICP plan at the present time, xy in W [m], [m/s]."""

    icp, icp_velocity = entries(0, 2), entries(2, 4)
    cop, ecmp = entries(4, 6), entries(6, 8)


class IcpPlanner(LeafSystem):
    """Plans the ICP for each new contact schedule.

    The plan is that of the Nadia paper (Eq. 4) or of the Atlas paper (Sec.
    II-A).  `walking_state` is a WalkingState, `icp_plan` the IcpPlan of its
    schedule (an AtlasIcpPlan with AtlasIcpPlanParams), `icp_reference` an
    IcpReference; `has_reference` says whether that port exists.

    .. pydrake_system::

        name: IcpPlanner
        input_ports: [walking_state]
        output_ports: [icp_plan, icp_reference]
    """

    def __init__(
        self,
        params: IcpPlanParams | AtlasIcpPlanParams,
        model: PointMassModel,
        period: float,
        has_reference: bool = True,
    ):
        """Plans for the point mass `model`; `period` [s] is not used.

        Raises ValueError for `params` that are out of range.
        """
        super().__init__()
        check(params)
        self._params, self._model = params, model
        self._walking_state = ValueInput(self, "walking_state", WalkingState)
        self._planned = declare_cache(
            self,
            "schedule and its plan",
            self._calc_planned,
            {self._walking_state.ticket()},
            (None, None),
        )
        declare_output(self, "icp_plan", self._plan, {self._planned.ticket()})
        if has_reference:
            self.DeclareVectorOutputPort(
                "icp_reference",
                size(IcpReference),
                self._calc_reference,
                {self._planned.ticket()},
            )

    def _plan(self, context) -> IcpPlan:
        return self._planned.Eval(context)[1]

    def _calc_planned(self, context, last) -> tuple[ContactSchedule, IcpPlan]:
        schedule = self._walking_state(context).schedule
        if schedule is last[0]:
            return last
        if isinstance(self._params, AtlasIcpPlanParams):
            return schedule, plan_atlas_icp(schedule, self._params, self._model)
        return schedule, plan_icp(schedule, self._params, self._model)

    def _calc_reference(self, context, output):
        now = reference_of(self._plan(context), self._walking_state(context))
        output.SetFromVector(
            np.concatenate([now.icp, now.icp_velocity, now.cop, now.ecmp])
        )
