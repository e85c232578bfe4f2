"""The papers' stories, told by the robots: Figs. 12 to 14, and 6 to 8."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from shapely import Point, Polygon

from nadia_balance.core.body.reachability import FORWARD, ReachabilityParams
from nadia_balance.core.body.reachability import cross_over_region as crossed
from nadia_balance.core.walking.state import Phase, Side
from nadia_balance.diagrams.scenario import Scenario, load_scenario
from nadia_balance.results.log import (
    Log,
    PushSpan,
    Step,
    phase_spans,
    pushes,
    sole_pose,
    steps,
)
from tests.diagrams.simulated import run_of, soon

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
        begun = self.push.start
        return [s for s in steps(self.log) if s.swing.end > begun]

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


def told(scenario: Scenario, plant: str = "humanoid") -> Story:
    run = run_of(scenario, plant)
    return Story(run.logs, run.summary)


def tell(name: str, duration: float) -> Story:
    """Simulates a scenario, no longer than it takes to see it out.

    The robot begins to walk 0.85 s sooner, and takes one step less before.
    """
    scenario = soon(load_scenario(name, duration=duration))
    scenario.pushes[0].after_steps = 1
    gait = replace(scenario.gait, first_swing="left")
    return told(scenario.changed(gait=gait))


@pytest.fixture(scope="module")
def backward_shove() -> Story:
    return tell("backward_shove", 3.9)


@pytest.fixture(scope="module")
def cross_over() -> Story:
    return tell("cross_over", 4.3)


@pytest.fixture(scope="module")
def atlas_steps() -> Story:
    return tell("atlas_steps", 7.0)


def pushed_in(story: Story) -> tuple[Side, float]:
    """The foot in the air when the push began, and how far its swing was."""
    start = story.push.start
    span = next(s for s in phase_spans(story.log) if start <= s.end)
    assert span.phase is Phase.SWING
    return span.swing_side, (start - span.start) / span.planned


@pytest.mark.parametrize(
    ("name", "part", "way", "swing", "transfer", "length"),
    [
        # The Nadia paper, Sec. VII: at the very end; ours: 0.1 m a step.
        ("backward_shove", 0.975, [-1, 0], 0.6, 0.2, 0.1),
        ("cross_over", 0.25, [0, 1], 0.7, 0.3, 0.0),
        # The Atlas paper, Fig. 6: steps of 0.5 m and 0.95 s.
        ("atlas_steps", 0.5, [0, -1], 0.7, 0.25, 0.5),
    ],
)
def test_is_shoved_in_a_right_swing_and_recovers_by_its_feet_alone(
    name, part, way, swing, transfer, length, request
):
    """Oracles: the papers; the summary: upright, no contact but the soles'."""
    story = request.getfixturevalue(name)
    # No longer than it takes to see it out is too short for all 8 steps.
    assert story.summary["outcome"] != "failed", story.summary["reason"]
    side, found = pushed_in(story)
    assert side is Side.RIGHT
    assert found == pytest.approx(part, abs=0.0251)
    force = story.force
    assert force @ way == pytest.approx(np.linalg.norm(force), rel=1e-3)
    taken, shoved = steps(story.log), story.steps[0]
    before = taken[shoved.number - 2]
    assert before.swing.duration == pytest.approx(swing, abs=0.02)
    assert shoved.transfer.duration == pytest.approx(transfer, abs=0.02)
    forward, _ = story.seen_from_stance(before)
    assert forward == pytest.approx(length, abs=0.02)


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


def test_the_right_foot_crosses_in_front_within_reach(cross_over):
    """Oracle: R_fwd of Fig. 8; the stance foot's centre line is its x axis.

    A sole may land 1 cm beside where it was to.
    """
    crossing = cross_over.steps[0]
    assert crossing.side is Side.RIGHT
    forward, out = cross_over.seen_from_stance(crossing)
    assert out < 0.0, "beyond the centre line"
    assert forward > 0.25, "in front: the soles, 0.25 m long, do not meet"
    region = Polygon(crossed(CROSSING, FORWARD))
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


def test_the_qp_steps_out(atlas_steps):
    """Oracle: the Atlas paper, Sec. IV."""
    hit = atlas_steps.steps[0]
    assert hit.adjustment[1] < -0.2
    assert hit.swing.duration < 0.7


@pytest.mark.parametrize(
    "name, after, length",
    [("backward_shove", 3, 0.1), ("cross_over", 3, 0), ("atlas_steps", 5, 0.5)],
)
def test_the_feet_go_back_to_their_footholds(name, after, length, request):
    """Oracle: the n-th of the gait's footholds is n lengths ahead.

    The bar of the project: back within 3 cm, at most 6 steps after the push.
    """
    step = request.getfixturevalue(name).steps[after]
    foothold = length * step.number, step.side.sign * HALF_WIDTH, 0.0
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
    scenario = load_scenario(name, duration=10.0, lipm_period=0.02)
    scenario.pushes[0].after_steps = 0
    story = told(scenario, "lipm")
    assert story.summary["recovered"]
    hit, *_, last = story.steps
    for phase in last.transfer, last.swing:
        assert phase.duration == pytest.approx(1.0, abs=0.03)
    force = np.linalg.norm(story.push.force)
    assert story.push.force[:2] @ way == pytest.approx(force)
    assert hit.swing.duration < 0.8
    assert hit.adjustment[:2] @ way > 0.1
