"""The papers' stories, told by the robots: Figs. 12 to 14, and 6 to 8."""

from dataclasses import dataclass

import numpy as np
import pytest
from shapely import Point, Polygon

from nadia_balance.core.reachability import (
    FORWARD,
    ReachabilityParams,
    cross_over_region,
)
from nadia_balance.core.walking import FootPose, Phase, Side
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.results.log import (
    Log,
    PushSpan,
    Step,
    phase_spans,
    pushes,
    sole_pose,
    steps,
)
from tests.diagrams.simulated import judged, run_of

CROSSING = ReachabilityParams()
HALF_WIDTH, BACK = 0.125, 0.03  # of a stance; back at its foothold [m]


@dataclass(frozen=True)
class Story:
    """A run, from its push on."""

    log: Log
    summary: dict

    @property
    def push(self) -> PushSpan:
        (push,) = pushes(self.log)
        return push

    @property
    def steps(self) -> list[Step]:
        """Those that landed after the push had begun."""
        return [s for s in steps(self.log) if s.swing.end > self.push.start]

    @property
    def force(self) -> np.ndarray:
        """Of the push, seen from the foot that carries: forward, left [N]."""
        side, _ = pushed_in(self)
        stance = sole_pose(self.log, self.push.first, side.other)
        return stance.rotation.T @ self.push.force[:2]

    def seen_from_stance(self, step: Step) -> np.ndarray:
        """Where a step landed: forward, and toward its own side [m]."""
        stance = sole_pose(self.log, step.swing.last, step.side.other)
        p_F = stance.to_sole(step.achieved.p_WF[None, :2])[0]
        return p_F * [1.0, step.side.sign]


def tell(name: str, duration: float, plant: str = "humanoid") -> Story:
    """Simulates a scenario, no longer than it takes to see it out."""
    scenario = load_scenario(name, text=f"{{duration: {duration}}}")
    return Story(run_of(scenario, plant).logs, judged(scenario, plant))


@pytest.fixture(scope="module")
def backward_shove() -> Story:
    return tell("backward_shove", 6.4)


@pytest.fixture(scope="module")
def cross_over() -> Story:
    return tell("cross_over", 6.7)


@pytest.fixture(scope="module")
def atlas_steps() -> Story:
    return tell("atlas_steps", 8.8)


def pushed_in(story: Story) -> tuple[Side, float]:
    """The foot in the air when the push began, and how far its swing was."""
    start = story.push.start
    span = next(s for s in phase_spans(story.log) if start <= s.end)
    assert span.phase is Phase.SWING
    return span.swing_side, (start - span.start) / span.planned


def distance(step: Step, x: float) -> float:
    """How far it landed from the foothold x [m] ahead of the start."""
    foothold = FootPose(np.array([x, step.side.sign * HALF_WIDTH, 0.0]))
    return float(np.linalg.norm(step.achieved.p_WF - foothold.p_WF))


@pytest.mark.parametrize(
    "name", ["backward_shove", "cross_over", "atlas_steps"]
)
def test_recovers_by_its_feet_alone(name, request):
    """Oracle: the summary: upright, the ICP back, no contact but the soles'."""
    summary = request.getfixturevalue(name).summary
    # No longer than it takes to see it out is too short for all 8 steps.
    assert summary["outcome"] != "failed", summary["reason"]
    assert summary["steps_after_push"] >= 2


def test_is_shoved_backward_at_the_very_end_of_a_right_swing(backward_shove):
    """Oracle: the paper, Sec. VII: swing 0.6 s, transfer 0.2 s, forward."""
    side, part = pushed_in(backward_shove)
    assert side is Side.RIGHT
    assert 0.95 - 1e-9 <= part <= 1.0
    force = backward_shove.force
    assert force[0] < 0.0
    assert force[1] == pytest.approx(0.0, abs=1e-9 * abs(force[0]))
    before = steps(backward_shove.log)[1]
    assert before.swing.duration == pytest.approx(0.6, abs=0.02)
    assert before.transfer.duration == pytest.approx(0.2, abs=0.02)
    assert backward_shove.seen_from_stance(before)[0] > 0.05


def test_after_a_backward_shove_the_next_transfer_shrinks(backward_shove):
    """Oracle: Fig. 12: 0.03 s in place of 0.2 s; the swing 0.4 s, not 0.6 s.

    It stepped back by about 0.3 m from where it was to step.
    """
    hurried = backward_shove.steps[1]
    assert hurried.side is Side.LEFT
    assert hurried.transfer.duration < 0.1
    assert hurried.swing.duration < 0.5
    assert hurried.adjustment[0] < -0.2
    assert backward_shove.seen_from_stance(hurried)[0] < -0.1


def test_after_a_backward_shove_it_walks_on(backward_shove):
    """Oracle: the n-th of the gait's footholds is n times 0.1 m ahead.

    The bar of the project: back within 3 cm, at most 6 steps after the push.
    """
    last = backward_shove.steps[3:7]
    assert {step.side for step in last} == set(Side)
    for step in last:
        assert distance(step, 0.1 * step.number) < BACK


def test_is_shoved_inward_while_stepping_in_place(cross_over):
    """Oracle: the paper, Sec. VII: 25 % of a right swing, 0.7 s and 0.3 s."""
    side, part = pushed_in(cross_over)
    assert side is Side.RIGHT
    assert part == pytest.approx(0.25, abs=0.01)
    force = cross_over.push.force
    assert force[1] > 0.0, "toward the left foot, on which it stands"
    assert force[0] == pytest.approx(0.0, abs=1e-3 * force[1])
    before = steps(cross_over.log)[1]
    assert before.swing.duration == pytest.approx(0.7, abs=0.02)
    assert before.transfer.duration == pytest.approx(0.3, abs=0.02)
    assert distance(before, 0.0) < 0.02


def test_the_right_foot_crosses_in_front_within_reach(cross_over):
    """Oracle: R_fwd of Fig. 8; the stance foot's centre line is its x axis.

    A sole may land 1 cm beside where it was to.
    """
    crossing = cross_over.steps[0]
    assert crossing.side is Side.RIGHT
    forward, out = cross_over.seen_from_stance(crossing)
    assert out < 0.0, "beyond the centre line"
    assert forward > 0.25, "in front: the soles, 0.25 m long, do not meet"
    region = Polygon(cross_over_region(CROSSING, FORWARD))
    assert region.distance(Point(forward, out)) < 0.01
    planned = crossing.commanded.p_WF[1]
    assert planned == pytest.approx(-HALF_WIDTH, abs=0.01)


def test_the_next_step_uncrosses_the_legs(cross_over):
    """Oracle: the base region: no nearer to the other foot than w_min."""
    uncrossing = cross_over.steps[1]
    assert uncrossing.side is Side.LEFT
    forward, out = cross_over.seen_from_stance(uncrossing)
    assert out > CROSSING.width_min - 0.01
    assert np.hypot(forward, out) > 0.2, "the soles, 0.12 m wide, are apart"
    assert uncrossing.achieved.p_WF[1] > HALF_WIDTH + 0.1, "it steps out"


def test_after_crossing_the_feet_go_back_to_their_footholds(cross_over):
    """Oracle: the bar of the project: 3 cm, in at most 6 steps."""
    last = cross_over.steps[2:6]
    assert {step.side for step in last} == set(Side)
    for step in last:
        assert distance(step, 0.0) < BACK


def test_atlas_is_shoved_outward_half_way_through_a_right_swing(atlas_steps):
    """Oracle: the Atlas paper, Fig. 6: steps of 0.5 m and 0.95 s, forward."""
    side, part = pushed_in(atlas_steps)
    assert side is Side.RIGHT
    assert part == pytest.approx(0.5, abs=0.01)
    force = atlas_steps.force
    assert force[1] < 0.0
    assert force[0] == pytest.approx(0.0, abs=1e-9 * abs(force[1]))
    before = steps(atlas_steps.log)[1]
    lasts = before.transfer.duration + before.swing.duration
    assert lasts == pytest.approx(0.95, abs=0.03)
    forward, _ = atlas_steps.seen_from_stance(before)
    assert forward == pytest.approx(0.5, abs=0.02)


def test_the_qp_steps_out_and_atlas_walks_on(atlas_steps):
    """Oracle: Sec. IV; the n-th of the gait's footholds is n times 0.5 m ahead.

    Back within 3 cm, at most 6 steps after the push.
    """
    hit, later = atlas_steps.steps[0], atlas_steps.steps[5:]
    assert hit.adjustment[1] < -0.2
    assert hit.swing.duration < 0.7
    assert len(later) >= 1
    for step in later:
        foothold = [0.5 * step.number, step.side.sign * HALF_WIDTH, 0.0]
        assert np.linalg.norm(step.achieved.p_WF - foothold) < BACK


@pytest.mark.parametrize(
    ("name", "way"),
    [("atlas_outward_push", [0, -1]), ("atlas_forward_push", [1, 0])],
)
def test_the_papers_pushes_of_atlas_speed_up_the_swing_and_move_the_foot(
    name, way
):
    """Oracle: Sec. V, Figs. 7 and 8: 1 s of swing, 1 s of transfer.

    The foot moves the way of the push.  On the point mass, which is quick.
    """
    story = tell(name, 26.0, "lipm")
    assert story.summary["recovered"]
    before, hit = steps(story.log)[1], story.steps[0]
    for phase in before.transfer, before.swing:
        assert phase.duration == pytest.approx(1.0, abs=0.03)
    force = np.linalg.norm(story.push.force)
    assert story.push.force[:2] @ way == pytest.approx(force)
    assert hit.swing.duration < 0.8
    assert hit.adjustment[:2] @ way > 0.1
