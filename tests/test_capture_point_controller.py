"""What the brain is made of; what takes time in it, at any control period."""

import math
from dataclasses import replace

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.geometry import Meshcat

from diagrams.humanoid import HumanoidDiagram
from diagrams.lipm import LipmDiagram
from diagrams.scenario import load_scenario
from nadia_balance.core.icp_plan import IcpPlanParams, plan_icp
from nadia_balance.core.time_adjustment import fraction_done, time_ahead
from nadia_balance.core.walking import Adjustment, FootPose, Phase, WalkingState
from nadia_balance.systems.icp_step_adjuster import IcpStepAdjuster
from tests.example_walks import OMEGA, SOLE, successor, walk

PERIODS = [0.001, 0.002, 0.01]


def evaluated(name, period, output, **inputs):
    """What a system of the brain answers to `inputs`, in a loop of `period`."""
    scenario = load_scenario("push")
    scenario.mechanisms, scenario.lipm_period = "step_swing_transfer", period
    system = LipmDiagram(scenario).brain.GetSubsystemByName(name)
    context = system.CreateDefaultContext()
    for port, value in inputs.items():
        fixed = value if port == "icp" else Value(value)
        system.GetInputPort(port).FixValue(context, fixed)
    return system.GetOutputPort(output).Eval(context)


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize(
    ("phase", "ahead", "time_constant"),
    [(Phase.SWING, 0.4, 0.01898), (Phase.TRANSFER, 0.1, 0.003915)],
)
def test_the_clock_makes_up_for_its_time(phase, ahead, time_constant, period):
    """Oracle: the exponential, times all the time that the ICP is ahead."""
    schedule = walk(length=0.0)
    plan = plan_icp(schedule, SOLE, IcpPlanParams(), OMEGA)
    if phase is Phase.SWING:
        schedule = successor(schedule, plan)
        plan = plan_icp(schedule, SOLE, IcpPlanParams(), OMEGA)
    icp = plan.at(0.1 + ahead).icp
    gain = evaluated(
        "timing_adapter",
        period,
        "time_adjustment",
        icp=icp,
        icp_plan=plan,
        walking_state=WalkingState(schedule, 0.1, 0.1),
        foot_poses=schedule.feet,
    )
    done = fraction_done(icp, plan.at(0.1).icp, plan.icp_end)
    whole = time_ahead(done, schedule.duration - 0.1, OMEGA)
    assert whole > 0.1
    share = 1.0 - math.exp(-period / time_constant)
    assert gain == pytest.approx([share * whole], rel=1e-9)


@pytest.mark.parametrize("period", PERIODS)
def test_a_foothold_goes_back_after_50_ms(period):
    """Oracle: the number of ticks by hand."""
    schedule = replace(walk(length=0.0), phase=Phase.SWING, duration=0.7)
    near = FootPose([0.03, -0.15, 0.0])
    last = round(0.05 / period)
    for ticks, stays in (last - 1, True), (last, False):
        before = Adjustment(schedule.footsteps[0], near, "base", ticks - 1)
        found = evaluated(
            "step_adjuster",
            period,
            "adjustment",
            icp=np.array([0.0, 0.07]),
            walking_state=WalkingState(schedule, 0.3, 0.3, adjustment=before),
        )
        assert (found.pose is near) is stays


def by_qp(mechanisms):
    text = f"{{mechanisms: {mechanisms}, controller: {{icp_step_qp: {{}}}}}}"
    return load_scenario("push", text=text)


def test_one_qp_takes_the_place_of_the_capture_regions():
    """Oracle: the class of the block; with no step to adjust there is none."""
    adjuster = LipmDiagram(by_qp("step")).brain.GetSubsystemByName(
        "step_adjuster"
    )
    assert type(adjuster) is IcpStepAdjuster
    brain = LipmDiagram(by_qp("icp_only")).brain
    assert not brain.HasSubsystemNamed("step_adjuster")


def test_the_qp_does_not_go_with_crossed_legs():
    """Oracle: the message names the field, and what is at odds with it."""
    message = "icp_step_qp: must be null .* all_with_cross_over"
    with pytest.raises(ValueError, match=message):
        LipmDiagram(by_qp("all_with_cross_over"))


def test_the_qp_can_be_switched_in_the_tab():
    """Oracle: with a tab there are both adapters, and their switches."""
    loop = HumanoidDiagram(by_qp("icp_only"), Meshcat())
    brain = loop.controller.GetSubsystemByName("capture_point_controller")
    adjuster = brain.GetSubsystemByName("step_adjuster")
    context = adjuster.GetMyContextFromRoot(loop.CreateDefaultContext())
    assert adjuster.GetOutputPort("adjustment").Eval(context) is None
