"""Oracles: the plan of the steps as they were taken, the QP, formulas."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.feedback import icp_step_control, icp_step_qp
from nadia_balance.core.math.polygon import contains, shrink
from nadia_balance.core.plan.atlas_icp_plan import (
    AtlasIcpPlanParams,
    plan_atlas_icp,
)
from nadia_balance.core.plan.icp_plan import reference_of
from nadia_balance.core.plan.walking_state_machine import (
    StateMachine,
    WalkingStateMachineParams,
)
from nadia_balance.core.walking.state import (
    FootPose,
    Phase,
    Side,
    WalkingState,
    support_polygon,
)
from tests.core.body.test_ground import square
from tests.example_walks import (
    MODEL,
    SOLE,
    mirrored,
    moved,
    random_walks,
    swing,
    walk,
)

PARAMS, PLAN = icp_step_qp.IcpStepQpParams(), AtlasIcpPlanParams()
GAIN, MIDDLE = PARAMS.feedback_gain, 0.35  # [-], of the swing [s]


def plan_of(state):
    return plan_atlas_icp(state.schedule, PLAN, MODEL)


def feedback(state, icp, params=PARAMS, on=True, qp=None, model=MODEL):
    control = icp_step_control.IcpStepControl(params, model)
    control.qp = qp or control.qp
    phase = control.phase(state)
    return control.feedback(state, phase, plan_of(state), icp, on)


def next_tick(state, adjustment):
    """The walking state that the state machine makes of it."""
    machine = StateMachine(WalkingStateMachineParams(), MODEL, 1e-9)
    return machine.advance(
        state,
        plan_of(state),
        feet=state.schedule.feet,
        forces=np.ones(2),
        icp=np.zeros(2),
        footsteps=lambda: None,
        adjustment=adjustment,
    )


def in_swing(**gait):
    return WalkingState(swing(**gait), MIDDLE, MIDDLE)


def reference_icp(state):
    return reference_of(plan_of(state), state).icp


@pytest.mark.parametrize("num_steps", [1, 3])
@given(random_walks(), st.floats(0.05, 0.9), st.integers(0, 10**6))
def test_the_plan_that_is_optimised_is_executed(num_steps, walk, share, seed):
    """Oracle: the next plan, of the footholds that the state machine took.

    Twice, so that the second time footholds have been moved before.
    """
    params = replace(PARAMS, num_steps=num_steps)
    rng = np.random.default_rng(seed)
    time = share * walk.duration
    state = WalkingState(walk, time, time)
    for _ in range(2):
        icp = reference_icp(state) + rng.uniform(-0.2, 0.2, 2)
        output = feedback(state, icp, params)
        assert output.result.solved
        taken = next_tick(state, output.adjustment)
        then = replace(state, schedule=taken.schedule)
        now = reference_of(plan_of(taken), then)
        for name in "icp", "icp_velocity", "cop", "ecmp":
            expected = pytest.approx(getattr(now, name), abs=1e-9)
            assert getattr(output.reference, name) == expected
        state = replace(taken, time_in_phase=time)


def test_delta_is_that_of_the_qp():
    """Oracle: Eq. 19, and the sole's edge: what is left over is nothing."""
    state = in_swing(length=0.0)
    icp = reference_icp(state) + [0.1, 0.0]
    output = feedback(state, icp)
    delta = output.ecmp - output.reference.ecmp
    left = icp - output.reference.icp - delta / GAIN
    assert np.abs(left).max() < 1e-3
    sole = support_polygon(state.schedule, MODEL.sole)
    assert output.ecmp[0] == pytest.approx(0.12)
    assert contains(output.ecmp, shrink(sole, 0.005), 1e-9)
    assert output.adjustment.pose.p_WF[0] > 0.2


def test_the_shift_counts_from_the_nominal_foothold_beyond_the_dead_band():
    """Oracles: the same answer with the new foothold; back without error; the
    dead band: by Eq. 18, 1 mm of ICP is 1 mm / Gamma.
    """
    state = in_swing(length=0.0)
    planned, straight = state.schedule.footsteps[0].pose, reference_icp(state)
    gamma, icp = plan_of(state).moves_of(state)[0, 0], straight + [0.1, 0.0]
    first = feedback(state, icp).adjustment
    moved = replace(next_tick(state, first), time_in_phase=MIDDLE)
    again, near, far = (
        feedback(moved, icp + [gamma * move * PARAMS.dead_band, 0.0]).adjustment
        for move in (0.0, 0.5, 2.0)
    )
    assert again.pose is near.pose is first.pose
    assert again.nominal.pose is planned
    assert feedback(moved, straight).adjustment.pose is planned
    move = far.pose.p_WF[0] - first.pose.p_WF[0]
    assert move == pytest.approx(2.0 * PARAMS.dead_band, rel=0.02)


@pytest.mark.parametrize("push", [[0.03, -0.08], [-0.06, 0.02]], ids=str)
def test_weights_are_those_of_the_robot_not_of_the_world(push):
    """Oracle: the same walk mirrored, and turned: the same answer, likewise.

    No weight is alike in all directions; the steps turn.
    """
    params = replace(
        PARAMS,
        num_steps=2,
        step_weights=[[[4.0, 3.0], [3.0, 9.0]], [[30.0, 5.0], [5.0, 10.0]]],
        feedback_weight=[[1.0, 0.8], [0.8, 2.0]],
        slack_weight=[[100.0, 50.0], [50.0, 400.0]],
    )
    schedule, angle, shift = swing(turn=0.3), 1.1, np.array([0.4, -0.2])
    c, s = np.cos(angle), np.sin(angle)
    R, flip = np.array([[c, -s], [s, c]]), np.diag([1.0, -1.0])

    def answer(schedule, A):
        state = WalkingState(schedule, MIDDLE, MIDDLE)
        found = feedback(state, reference_icp(state) + A @ push, params)
        made = found.adjustment, *found.adjustment.later
        return np.array([found.ecmp, *(s.pose.p_WF[:2] for s in made)])

    usual = answer(schedule, np.eye(2))
    first = np.linalg.norm(usual[1] - schedule.footsteps[0].pose.p_WF[:2])
    assert first > 0.03
    turned = answer(moved(schedule, angle, shift), R)
    assert turned == pytest.approx(usual @ R.T + shift, abs=1e-9)
    seen = answer(mirrored(schedule), flip)
    assert seen == pytest.approx(usual @ flip, abs=1e-9)


def stones(schedule, normal=(0.0, 0.0, 1.0)):
    """A square about each foothold, not centred, and one beside them."""
    first, second, _ = (step.pose.p_WF[:2] for step in schedule.footsteps)
    regions = (
        square("beside", 0.0, -0.9, side=0.4),
        square("first", *(first + [0.0, 0.02]), normal=list(normal)),
        square("second", *(second + [0.03, -0.04]), side=0.45),
    )
    return Ground(regions, SOLE)


def test_each_sole_stays_on_the_region_of_its_foothold():
    """Oracle: shapely: the whole turned sole, 2 cm from the edges."""
    steps = walk(length=0.4, turn=0.3).footsteps[:2]
    ground = stones(walk(length=0.4, turn=0.3))
    A, b = icp_step_control.region_room(steps, ground)
    shifts = np.random.default_rng(4).uniform(-0.2, 0.2, (1000, 2, 2))
    inside = np.zeros(2)
    for shift in shifts:
        good = []
        for step, move, region in zip(
            steps, shift, ground.regions[1:], strict=True
        ):
            foot = FootPose(step.pose.p_WF + [*move, 0.0], step.pose.yaw)
            stone = shapely.Polygon(region.polygon).buffer(
                -0.02, join_style="mitre"
            )
            good.append(stone.covers(shapely.Polygon(foot.to_world(SOLE))))
        assert (A @ shift.ravel() <= b).all() == all(good)
        inside += good
    assert inside.min() > 50


def test_a_moved_foot_stands_on_the_plane_of_its_region():
    """Oracles: the plane by hand; the foothold goes to its edge, no farther."""
    normal = np.array([0.1, -0.05, 1.0])
    state = in_swing(length=0.0)
    ground = stones(state.schedule, normal)
    model = replace(MODEL, ground=ground)
    icp = reference_icp(state) + [0.1, 0.0]
    free = feedback(state, icp).adjustment.pose
    pose = feedback(state, icp, model=model).adjustment.pose
    region = ground.regions[1]
    away = pose.p_WF - [*region.polygon.mean(axis=0), region.height]
    assert away @ normal == pytest.approx(0.0, abs=1e-12)
    assert pose.normal == pytest.approx(normal / np.linalg.norm(normal))
    assert pose.p_WF[0] < free.p_WF[0] - 0.05
    toes = pose.outline(SOLE)[:, 0].max()
    assert toes == pytest.approx(region.polygon[:, 0].max() - 0.02, abs=1e-9)


def test_without_a_solution_no_foothold_moves():
    """Oracle: that of feedback alone, which is there in any case."""
    state = in_swing(length=0.0)
    icp = reference_icp(state) + [0.1, 0.05]

    class Unsolved(icp_step_qp.IcpStepQp):
        def solve(self, *arguments, **named):
            shifts, result = super().solve(*arguments, **named)
            return shifts, result._replace(solved=False)

    output = feedback(state, icp, qp=Unsolved(PARAMS))
    alone = feedback(state, icp, on=False)
    assert not output.result.solved
    assert alone.result.solved
    assert alone.adjustment is None
    assert output.adjustment.pose is state.schedule.footsteps[0].pose
    assert output.ecmp.tolist() == alone.ecmp.tolist()


@pytest.mark.parametrize("side", Side)
def test_each_foothold_is_within_reach_of_the_one_before(side):
    """Oracle: the reach and the width of the soles, point by point."""
    params = replace(PARAMS, sole_clearance=0.01)
    reach = icp_step_control.uncrossed_reach(params, MODEL)
    first, second, _ = walk(length=0.2, turn=0.3).footsteps
    first, second = replace(first, side=side), replace(second, side=side.other)
    stance = FootPose([0.3, -0.2, 0.0], 0.4)
    A, b = icp_step_control.reach_room(stance, (first, second), reach)
    shifts = np.random.default_rng(3).uniform(-1.2, 1.2, (20000, 4))
    inside = (shifts @ A.T <= b).all(axis=1)
    assert np.sum(inside) > 100
    for shift in shifts[inside].reshape(-1, 2, 2):
        foot = stance
        for step, move in zip((first, second), shift, strict=True):
            landed = step.pose.p_WF + [*move, 0.0]
            x, y = foot.to_sole(landed[None, :2])[0]
            assert MODEL.reach.in_base_region(x, step.side.sign * y)
            assert step.side.sign * y >= 0.12 + 0.01
            foot = FootPose(landed, step.pose.yaw)
    # Nothing that is within is left out: a vertex of the reach, either side.
    for vertex in reach * [1.0, side.sign]:
        move = stance.to_world(vertex[None])[0] - first.pose.p_WF[:2]
        assert (A[: len(reach), :2] @ move <= b[: len(reach)] + 1e-9).all()


@pytest.mark.parametrize(
    "phase, t, elapsed, may",
    [
        (Phase.SWING, 0.35, 0.35, True),
        (Phase.SWING, 0.002, 0.002, False),  # just lifted
        (Phase.SWING, 0.35, 0.005, False),  # the clock was advanced
        (Phase.SWING, 0.66, 0.66, False),  # about to land
        (Phase.TRANSFER, 0.29, 0.1, True),
        (Phase.TRANSFER, 0.1, 0.005, False),
        (Phase.STANDING, 1.0, 1.0, False),
    ],
)
def test_a_foothold_moves_only_while_the_foot_can_follow(
    phase, t, elapsed, may
):
    """Oracle: settling and freeze time, by hand."""
    schedule = swing() if phase is Phase.SWING else replace(walk(), phase=phase)
    control = icp_step_control.IcpStepControl(PARAMS, MODEL)
    assert control.may_move(WalkingState(schedule, t, elapsed)) is may
    last = replace(schedule, footsteps=())
    assert not control.may_move(WalkingState(last, t, elapsed))
