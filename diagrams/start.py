"""The walking state from which every diagram starts."""

import math

import numpy as np

from diagrams.scenario import Scenario
from nadia_balance.core.gait import make_footsteps, middle
from nadia_balance.core.walking import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
)
from nadia_balance.robot import load_robot_params


def initial_walking_state(scenario: Scenario) -> WalkingState:
    """Stands with the feet side by side about the origin, then walks."""
    gait = scenario.gait
    width = gait.step_width
    if width is None:
        width = load_robot_params(scenario.robot).step_width
    y = 0.5 * width
    feet = FootPoses(
        FootPose(np.array([0.0, y, 0.0])), FootPose(np.array([0.0, -y, 0.0]))
    )
    footsteps = make_footsteps(
        gait, feet, scenario.controller.step_adjuster.reachability
    )
    # No phase is shorter than a tick.
    wait = max(
        scenario.controller.walking_state_machine.standing_duration,
        scenario.controller.control_period,
    )
    first = footsteps[0].side if footsteps else Side(gait.first_swing)
    centre = middle(feet).p_WF[:2]
    schedule = ContactSchedule(
        phase=Phase.STANDING,
        support_side=first.other,
        duration=wait if footsteps else math.inf,
        feet=feet,
        footsteps=footsteps,
        start=ReferencePoint(centre, np.zeros(2), centre),
        final_transfer_duration=gait.final_transfer_duration,
    )
    return WalkingState(schedule, commanded=footsteps)
