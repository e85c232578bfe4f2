"""Reference ICP of the present phase, planned from the next footsteps."""

import numpy as np
from pydrake.systems.framework import LeafSystem

from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.bounds import check
from nadia_balance.core.plan import atlas_icp_plan, icp_plan
from nadia_balance.systems import ports


class IcpPlanner(LeafSystem):
    """Plans the ICP for each new contact schedule.

    The plan is that of the Nadia paper (Eq. 4) or, with AtlasIcpPlanParams, of
    the Atlas paper (Sec. II-A), an AtlasIcpPlan.  `icp_reference` exists only
    if it `has_reference`.

    .. pydrake_system::

        name: IcpPlanner
        input_ports: [walking_state]
        output_ports: [icp_plan, icp_reference]
    """

    def __init__(
        self,
        params: icp_plan.IcpPlanParams | atlas_icp_plan.AtlasIcpPlanParams,
        model: PointMassModel,
        period: float,
        has_reference: bool = True,
    ):
        super().__init__()
        check(params)
        (self._walking,) = ports.inputs(self, "walking_state")
        self._planned = ports.declare_plan(
            self,
            self._walking,
            lambda state: (
                atlas_icp_plan.plan_atlas_icp(state.schedule, params, model)
                if isinstance(params, atlas_icp_plan.AtlasIcpPlanParams)
                else icp_plan.plan_icp(state.schedule, params, model)
            ),
        )
        ports.declare_output(self, "icp_plan", self._plan, [self._planned])
        if has_reference:
            ports.declare_output(
                self, "icp_reference", self._calc_reference, [self._planned]
            )

    def _plan(self, context) -> icp_plan.IcpPlan:
        return self._planned.Eval(context)[1]

    def _calc_reference(self, context) -> np.ndarray:
        now = icp_plan.reference_of(self._plan(context), self._walking(context))
        return np.concatenate([now.icp, now.icp_velocity, now.cop, now.ecmp])
