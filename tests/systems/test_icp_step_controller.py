"""Oracles: the core functions, the plan of a run, a count."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.feedback import icp_step_control, icp_step_qp
from nadia_balance.core.plan import atlas_icp_plan
from nadia_balance.core.walking.mechanisms import Mechanisms
from nadia_balance.core.walking.state import WalkingState
from nadia_balance.systems.feedback import IcpStepController
from nadia_balance.systems.ports import NOTHING
from nadia_balance.systems.signals import EcmpCommand
from tests.blocks import answer, asked, fix
from tests.example_walks import MODEL, swing
from tests.systems.test_icp_planner import assert_tells

PARAMS = icp_step_qp.IcpStepQpParams()
CONTROLLER = IcpStepController(PARAMS, MODEL, 0.002)
OUT = np.array([0.25, 0.05])  # an ICP that needs a step forward
OFF = Mechanisms().as_vector()
STEP = Mechanisms(step=True).as_vector()
IN_PLACE = swing(length=0.0)
IN_AIR = WalkingState(IN_PLACE, time_in_phase=0.3, elapsed=0.3)


def plan_of(state):
    params = atlas_icp_plan.AtlasIcpPlanParams()
    return atlas_icp_plan.plan_atlas_icp(state.schedule, params, MODEL)


def inputs(state=IN_AIR, icp=OUT):
    return dict(walking_state=state, alip_icp=icp, icp_plan=plan_of(state))


def expected_of(state, icp=OUT):
    control = icp_step_control.IcpStepControl(PARAMS, MODEL)
    return control.feedback(state, control.phase(state), plan_of(state), icp)


@pytest.mark.parametrize("gain, later", [(0.0, 0.3), (0.1, 0.4), (-0.1, 0.3)])
def test_its_outputs_are_those_of_the_core_at_t_plus(gain, later):
    """Oracle: IcpStepControl.feedback() with the clock advanced."""
    context = asked(CONTROLLER, time_adjustment=[gain, 0.5], **inputs())
    expected = expected_of(replace(IN_AIR, time_in_phase=later))
    proposed = answer(CONTROLLER, context, "adjustment")
    assert proposed.nominal is IN_PLACE.footsteps[0]
    assert proposed.pose is not proposed.nominal.pose
    assert np.array_equal(proposed.pose.p_WF, expected.adjustment.pose.p_WF)
    ecmp = EcmpCommand(answer(CONTROLLER, context, "ecmp_command"))
    assert ecmp.ecmp.tolist() == ecmp.cop.tolist() == expected.ecmp.tolist()
    assert_tells(CONTROLLER, context, expected.reference)


def test_can_be_switched_off_and_on():
    """Oracle: off, it proposes None, and the foothold stays."""
    context = asked(CONTROLLER, mechanisms=STEP, **inputs())
    proposed = answer(CONTROLLER, context, "adjustment")
    first, *rest = IN_PLACE.footsteps
    steps = replace(first, pose=proposed.pose), *rest
    moved = replace(IN_PLACE, footsteps=steps)
    state = replace(IN_AIR, schedule=moved, adjustment=proposed)
    fix(CONTROLLER, context, mechanisms=OFF, **inputs(state))
    assert answer(CONTROLLER, context, "adjustment") is NOTHING
    drawn = answer(CONTROLLER, context, "capture_regions")
    assert drawn.adjusted is proposed.pose
    fix(CONTROLLER, context, mechanisms=STEP, **inputs())
    again = answer(CONTROLLER, context, "adjustment")
    np.testing.assert_array_equal(again.pose.p_WF, proposed.pose.p_WF)
