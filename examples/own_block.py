"""A step adjuster of one's own steps where the ICP will be at touchdown."""

from pydrake.common.value import Value
from pydrake.systems.framework import LeafSystem

import nadia_balance as nb
from nadia_balance.core.body import reachability
from nadia_balance.core.math import lipm, polygon
from nadia_balance.core.steps.foothold_adjustment import current_adjustment


class ErrorStepAdjuster(LeafSystem):
    def __init__(self, model):
        super().__init__()
        self.w, nothing = model.omega, Value(nb.NOTHING)
        self.base = reachability.base_region(model.reach)
        self.icp = self.DeclareVectorInputPort("icp", 2)
        self.plan = self.DeclareVectorInputPort("icp_reference", 8)
        self.walk = self.DeclareAbstractInputPort("walking_state", nothing)
        self.DeclareAbstractOutputPort("adjustment", nothing.Clone, self.calc)

    def calc(self, context, output):
        state, step = self.walk.Eval(context), nb.NOTHING  # no step to adjust
        error = self.icp.Eval(context) - self.plan.Eval(context)[:2]
        if state.schedule.phase is nb.Phase.SWING:
            step, time = current_adjustment(state), state.remaining_time
            if abs(error).max() > 0.03 and time > 0.1:  # [m], [s]
                side, feet = step.nominal.side, state.schedule.feet
                area = reachability.in_world(self.base, feet[side.other], side)
                error = lipm.icp_after(error, 0 * error, self.w, time)  # Eq. 3
                p_W = [*polygon.project(step.pose.p_WF[:2] + error, area), 0]
                step = nb.Adjustment(step.nominal, nb.FootPose(p_W))
        output.set_value(step)


if __name__ == "__main__":  # not in a sweep, which imports this file
    scenario = nb.load_scenario("push", mechanisms="icp_only")
    mine = ErrorStepAdjuster(nb.load_robot("nadia").point_mass)
    loop = nb.HumanoidDiagram(scenario.with_push("outward"), step_adjuster=mine)
    print(nb.simulate(loop, 5.5).fall_reason or "It keeps its feet.")
