"""Oracles: the ellipse by hand, and Eq. 3 integrated with the best eCMP."""

import math
from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.icp_plan import IcpPlanParams, plan_icp
from nadia_balance.core.lift_off import LiftOffParams, may_lift
from nadia_balance.core.lipm import icp_after
from nadia_balance.core.support_polygon import support_polygon
from nadia_balance.core.walking import FootPose, FootPoses
from tests.example_walks import OMEGA, SOLE, standing, successor, walk

PARAMS = LiftOffParams()
HASTY = LiftOffParams(held_patience=0.0)
PERIOD = 1e-3


def transfer():
    """A transfer to the left foot, its plan, and where the ICP should end."""
    first = walk(length=0.0)
    plan = plan_icp(first, SOLE, IcpPlanParams(), OMEGA)
    schedule = successor(first, plan)
    plan = plan_icp(schedule, SOLE, IcpPlanParams(), OMEGA)
    schedule = successor(schedule, plan)
    plan = plan_icp(schedule, SOLE, IcpPlanParams(), OMEGA)
    return schedule, plan, plan.at(schedule.duration).icp


def lifts(offset, waited=0.0, params=PARAMS):
    schedule, plan, end = transfer()
    icp = end + np.array(offset)
    return may_lift(schedule, plan, icp, SOLE, waited, params)


def test_lifts_within_the_ellipse():
    """Oracle: by hand; it is narrower on the outside of the foot."""
    schedule, _, _ = transfer()
    out = schedule.support_side.sign
    assert lifts((0.034, 0.0))
    assert lifts((-0.034, 0.0))
    assert not lifts((0.036, 0.0))
    assert lifts((0.0, -out * 0.0145))
    assert not lifts((0.0, -out * 0.0155))
    assert lifts((0.0, out * 0.0115))
    assert not lifts((0.0, out * 0.0125))
    assert lifts((0.0, 0.0))


@pytest.mark.parametrize("angle", np.linspace(0.0, 2.0 * math.pi, 13)[:-1])
@pytest.mark.parametrize("patience", [0.1, 0.3])
def test_waits_only_as_long_as_the_icp_can_return(angle, patience):
    """Oracle: roll out Eq. 3 with the eCMP as far beyond the ICP as can be.

    Along the error, that is; the least error for which there is no return
    within the patience is found by bisection, both ways.
    """
    schedule, plan, end = transfer()
    params = replace(HASTY, patience=patience)
    away = np.array([math.cos(angle), math.sin(angle)])
    support = support_polygon(schedule, SOLE)
    farthest = end + away * (np.max((support - end) @ away) + 0.03)

    def returns(length):
        icp = end + length * away
        for _ in range(round(patience / PERIOD)):
            icp = icp_after(icp, farthest, OMEGA, PERIOD)
            # Within the ellipse, as seen with endless patience gone.
            if may_lift(
                schedule, plan, icp, SOLE, 0.0, replace(params, patience=9e9)
            ):
                return True
        return False

    def hopeless(length):
        return lifts(length * away, params=params)

    edge = 0.04
    low, high = edge, 0.5
    assert hopeless(high)
    for _ in range(20):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if hopeless(middle) else (middle, high)
    assert not returns(high + 2e-3)
    if high > edge + 2e-3:
        assert returns(low - 2e-3)


def test_what_is_left_of_the_patience_counts():
    """Oracle: a wait that is worth while at first, and is not in the end."""
    assert not lifts((0.05, 0.0), waited=0.0, params=HASTY)
    assert lifts((0.05, 0.0), waited=HASTY.patience, params=HASTY)
    endless = replace(HASTY, patience=math.inf)
    assert not lifts((0.05, 0.0), waited=1e9, params=endless)
    assert lifts((1.0, 0.0), waited=0.0, params=endless)


@pytest.mark.parametrize("angle", np.linspace(0.0, 2.0 * math.pi, 13)[:-1])
def test_waits_longer_for_an_icp_that_is_held(angle):
    """Oracle: Eq. 3 by icp_after, the eCMP where the support ends.

    It moves the ICP back by room (e^wt - 1) in the time t.
    """
    schedule, _, end = transfer()
    away = np.array([math.cos(angle), math.sin(angle)])
    support = support_polygon(schedule, SOLE)
    reach, t = np.max((support - end) @ away), 0.1
    length = reach - PARAMS.held_room
    for more, held in ((-1e-3, True), (1e-3, False)):
        icp = end + (length + more) * away
        moved = (icp - icp_after(icp, end + reach * away, OMEGA, t)) @ away
        least = PARAMS.held_room * math.expm1(OMEGA * t)
        assert bool(moved > least) is held
        if np.linalg.norm(icp - end) < 0.04:  # near enough to lift anyway
            continue
        offset, patience = (length + more) * away, PARAMS.held_patience
        assert lifts(offset, waited=0.9 * patience) is not held
        assert lifts(offset, waited=patience)


def test_does_not_wait_longer_with_the_feet_far_apart():
    """Oracle: by hand, how far the left foot is to the left of the right."""
    schedule, plan, end = transfer()
    icp = end + (0.04, 0.0)
    right = schedule.feet.right
    for apart, held in ((0.44, True), (0.46, False)):
        left = FootPose(right.p_WF + [0.0, apart, 0.0], right.yaw)
        wide = replace(schedule, feet=FootPoses(left, right))
        waits = not may_lift(wide, plan, icp, SOLE, 0.5, PARAMS)
        assert waits is held


def test_does_not_wait_with_crossed_legs():
    """Oracle: by hand, how far the left foot is to the left of the right."""
    schedule, plan, end = transfer()
    right, endless = schedule.feet.right, replace(PARAMS, patience=math.inf)
    for apart, waits in ((0.01, True), (-0.01, False)):
        left = FootPose(right.p_WF + [0.3, apart, 0.0], right.yaw)
        crossed = replace(schedule, feet=FootPoses(left, right))
        lifted = may_lift(crossed, plan, end + 0.04, SOLE, 0.0, endless)
        assert lifted is not waits


def test_does_not_wait_when_no_foot_is_to_be_lifted():
    """Oracle: there is nothing to wait for, wherever the ICP is."""
    _, plan, end = transfer()
    last = replace(standing(), footsteps=())
    assert may_lift(last, plan, end + 9.0, SOLE, 0.0, PARAMS)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("icp_error_forward", 0.0),
        ("icp_error_inward", math.nan),
        ("icp_error_outward", math.inf),
        ("ecmp_outside", -0.1),
        ("patience", math.nan),
        ("held_patience", -0.1),
        ("held_room", math.nan),
        ("held_stance", -1.0),
    ],
)
def test_refuses_bad_parameters(field, value):
    """Oracle: the message names the field and the value."""
    with pytest.raises(ValueError, match=f"{field} = {value}: must be"):
        LiftOffParams(**{field: value}).validate()
