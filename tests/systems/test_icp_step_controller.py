"""Oracles: the core functions, the plan of a run, a count."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from nadia_balance.core.feedback.icp_step_control import (
    step_feedback,
    step_phase,
    uncrossed_reach,
)
from nadia_balance.core.feedback.icp_step_qp import IcpStepQp, IcpStepQpParams
from nadia_balance.core.plan.atlas_icp_plan import (
    AtlasIcpPlanParams,
    plan_atlas_icp,
)
from nadia_balance.core.plan.icp_plan import reference_of
from nadia_balance.core.walking.vocabulary import WalkingState
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.systems.icp_step_controller import IcpStepController
from nadia_balance.systems.ports import NOTHING
from nadia_balance.systems.signals import EcmpCommand, IcpReference
from tests.blocks import answer, asked, fix
from tests.example_walks import MODEL, swing, walk

PARAMS, PERIOD = IcpStepQpParams(), 0.002
OUT = np.array([0.25, 0.05])  # an ICP that needs a step forward
IN_PLACE = swing(length=0.0)
IN_AIR = WalkingState(IN_PLACE, time_in_phase=0.3, elapsed=0.3)
ON_TWO_FEET = WalkingState(walk(length=0.0), time_in_phase=0.1, elapsed=0.001)


def plan_of(state):
    return plan_atlas_icp(state.schedule, AtlasIcpPlanParams(), MODEL)


@pytest.fixture
def controller():
    return IcpStepController(PARAMS, MODEL, PERIOD)


def inputs(state=IN_AIR, icp=OUT):
    plan = plan_of(state)
    return dict(walking_state=state, icp=icp, icp_plan=plan)


def expected_of(state, icp=OUT):
    reach, qp = uncrossed_reach(PARAMS, MODEL), IcpStepQp(PARAMS)
    phase = step_phase(state, reach, qp, PARAMS, MODEL)
    return step_feedback(state, phase, plan_of(state), icp, qp, PARAMS)


@pytest.mark.parametrize("gain, later", [(0.0, 0.3), (0.1, 0.4), (-0.1, 0.3)])
def test_its_outputs_are_those_of_the_core_at_t_plus(controller, gain, later):
    """Oracle: step_feedback() with the clock advanced."""
    context = asked(controller, time_adjustment=[gain, 0.5], **inputs())
    expected = expected_of(replace(IN_AIR, time_in_phase=later))
    found = answer(controller, context, "adjustment")
    assert found.nominal is IN_PLACE.footsteps[0]
    assert found.pose is not found.nominal.pose
    assert np.array_equal(found.pose.p_WF, expected.adjustment.pose.p_WF)
    ecmp = EcmpCommand(answer(controller, context, "ecmp_command"))
    assert ecmp.ecmp.tolist() == ecmp.cop.tolist() == expected.ecmp.tolist()
    view = IcpReference(answer(controller, context, "icp_reference"))
    for name in "icp", "icp_velocity", "cop", "ecmp":
        assert np.array_equal(
            getattr(view, name), getattr(expected.reference, name)
        )


@pytest.mark.parametrize(
    "state", [ON_TWO_FEET, replace(IN_AIR, elapsed=0.0)], ids=["two", "early"]
)
def test_leaves_the_foothold_while_it_may_not_move(controller, state):
    """Oracle: the very pose that was commanded."""
    context = asked(controller, **inputs(state))
    found = answer(controller, context, "adjustment")
    assert found.pose is state.schedule.footsteps[0].pose


def test_can_be_switched_off_and_on(controller):
    """Oracle: off, it proposes None, and the foothold stays."""
    context = asked(controller, mechanisms=[1, 0, 0, 0], **inputs())
    found = answer(controller, context, "adjustment")
    step = replace(IN_PLACE.footsteps[0], pose=found.pose)
    steps = (step, *IN_PLACE.footsteps[1:])
    moved = replace(IN_PLACE, footsteps=steps)
    state = replace(IN_AIR, schedule=moved, adjustment=found)
    fix(controller, context, mechanisms=[0, 0, 0, 0], **inputs(state))
    assert answer(controller, context, "adjustment") is NOTHING
    drawn = answer(controller, context, "capture_regions")
    assert drawn.adjusted is found.pose
    fix(controller, context, mechanisms=[1, 0, 0, 0], **inputs())
    again = answer(controller, context, "adjustment")
    np.testing.assert_array_equal(again.pose.p_WF, found.pose.p_WF)


def test_what_is_optimised_is_what_the_robot_executes():
    """Oracle: in each tick of a run, the plan of the next tick's footholds."""
    scenario = load_scenario(
        "push",
        text="{mechanisms: step_swing, pushes: [{delta_v: 0.6, direction_deg: "
        "250, at: right swing 25 %}], gait: {num_steps: 4}, controller: "
        "{icp_step_qp: {num_steps: 3}}}",
    )
    diagram = LipmDiagram(scenario)
    simulator = Simulator(diagram)
    diagram.set_initial_state(simulator.get_mutable_context())
    controller, model = diagram.controller, diagram.robot.point_mass
    context = controller.GetMyContextFromRoot(simulator.get_context())
    moved = 0
    for tick in range(1, 450):
        simulator.AdvanceTo((tick - 0.5) * scenario.lipm_period)
        told = IcpReference(answer(controller, context, "icp_reference"))
        state = answer(controller, context, "walking_state")
        gain = max(float(answer(controller, context, "time_adjustment")[0]), 0)
        simulator.AdvanceTo((tick + 0.5) * scenario.lipm_period)
        taken = answer(controller, context, "walking_state").schedule
        if taken.start is not state.schedule.start:
            continue  # another phase has begun
        moved += taken is not state.schedule
        plan = plan_atlas_icp(taken, AtlasIcpPlanParams(), model)
        time = min(state.time_in_phase + gain, taken.duration)
        now = reference_of(plan, replace(state, time_in_phase=time))
        for name in "icp", "icp_velocity", "cop", "ecmp":
            found, expected = getattr(told, name), getattr(now, name)
            assert found == pytest.approx(expected, abs=1e-9)
    assert moved > 2
