"""Oracles: core.plan.gait.within_reach; the planner, when the list is over."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.plan.footstep_plan import FootstepPlannerParams
from nadia_balance.core.plan.gait import Gait, walking_start, within_reach
from nadia_balance.core.walking.state import FootPose, Phase, Side
from nadia_balance.systems.plan import FixedFootsteps, FootstepPlanner
from tests.blocks import answer, asked
from tests.example_walks import FEET, MODEL, planned, standing

PERIOD = 0.004  # [s]
PARAMS = FootstepPlannerParams()
START = walking_start(Gait(num_steps=3), MODEL)
STEPS = START.schedule.footsteps


def footsteps(state, feet=FEET, block=FixedFootsteps, **more):
    """What the block plans in a walking state."""
    planner = block(PARAMS, MODEL, PERIOD, **more)
    context = asked(
        planner,
        walking_state=state,
        velocity_command=np.zeros(3),
        alip_icp=np.zeros(2),
        icp_plan=planned(standing()),
        foot_poses=feet,
    )
    revised = answer(planner, context, "revised_footsteps")
    return answer(planner, context, "footsteps"), revised


def test_waits_until_the_time_to_stand_is_over():
    """Oracle: 0.5 s, to the tick that ends them."""
    for time, expected in ((0.0, ()), (0.49, ()), (0.496, STEPS)):
        state = replace(START, time_in_phase=time)
        steps, revised = footsteps(state, footsteps=STEPS)
        assert steps == expected
        assert not revised


def test_the_rest_of_the_list_is_within_reach_of_where_the_foot_landed():
    """Oracle: within_reach, of the steps after the one in the air."""
    schedule = replace(
        START.schedule, phase=Phase.SWING, support_side=Side.LEFT, duration=0.7
    )
    far = FEET.with_foot(Side.RIGHT, FootPose([1.2, -0.5, 0.0]))
    state = replace(START, schedule=schedule, time_in_phase=0.6)
    steps, revised = footsteps(state, far, footsteps=STEPS)
    expected = within_reach(STEPS[1:], far, MODEL.reach, STEPS[0], None)
    assert steps == expected and steps != STEPS[1:]
    assert not revised


@pytest.mark.parametrize(
    ("steps", "message"),
    [
        (("x",), "has a str, needs Footsteps"),
        (STEPS[:1] * 2, "has feet right, right: they must take turns"),
        (
            (replace(STEPS[0], swing_duration=np.nan),),
            "has a transfer of 0.8 s and a swing of nan s",
        ),
    ],
)
def test_refuses_steps_that_nobody_could_make(steps, message):
    """Oracle: the message names what is wrong."""
    with pytest.raises(ValueError, match=f"^footsteps: {message}"):
        FixedFootsteps(PARAMS, MODEL, PERIOD, footsteps=steps)


def test_after_its_list_it_plans_as_the_planner():
    """Oracle: a FootstepPlanner; the feet are 0.3 m from side by side."""
    split = FEET.with_foot(Side.LEFT, FootPose([0.3, 0.125, 0.0]))
    state = replace(START, schedule=standing(split), steps_taken=3)
    steps, _ = footsteps(state, split, footsteps=STEPS)
    expected, _ = footsteps(state, split, FootstepPlanner)
    assert steps == expected and len(steps) == 1
