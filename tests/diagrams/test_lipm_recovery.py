"""The point mass recovers, with all mechanisms and with fewer of them.

Of the protocol of the Nadia paper's Fig. 10: a push of 0.1 s at 25 % of the
first right swing, while stepping in place.
"""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.feedback.icp_step_qp import IcpStepQpParams
from nadia_balance.core.walking.mechanisms import ATLAS_MECHANISMS, MECHANISMS
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.robot.model import load_robot
from tests.diagrams.simulated import run_of, simulated

ALL = "all_with_cross_over"
PUSH = "pushes: [{delta_v: 0.0, at: right swing 25 %}]"
PUSH = f"{{gait: {{num_steps: 4}}, lipm_period: 0.02, duration: 6, {PUSH}}}"


def recovers(mechanisms, direction, delta_v, qp=None) -> bool:
    """Whether all steps of the gait end with the ICP error below 5 cm.

    It is pushed in this direction [deg], so hard [m/s].  Adjusted by the `qp`
    of the Atlas paper, if told.
    """
    scenario = load_scenario("push", text=PUSH, fidelity="ideal")
    controller = replace(scenario.controller, icp_step_qp=qp)
    scenario = scenario.changed(mechanisms=mechanisms, controller=controller)
    scenario = scenario.with_push(direction, delta_v)
    found = run_of(scenario, "lipm").summary
    return found["recovered"] and found["steps_after_push"] >= 4


@pytest.mark.parametrize(
    ("direction", "delta_v", "fewest"),
    [(270, 0.4, "step"), (90, 0.6, "step_swing"), (90, 1.05, ALL)],
)
def test_more_mechanisms_never_recover_less(direction, delta_v, fewest):
    """Oracle: the order of the mechanisms, of which each adds one.

    `fewest` is the first that recovers, `icp_only` never does: its limits are
    0.3 and 0.22 m/s, the feet and the hips in place.  After the gait, the
    planner takes more steps: without crossing, 0.95 m/s can be caught, too.
    """
    names = list(MECHANISMS)
    found = [name for name in names if recovers(name, direction, delta_v)]
    assert found == names[names.index(fewest) :]


BOTH, FEWER = {"feedback_step_timing"}, {*ATLAS_MECHANISMS} - {"feedback"}


@pytest.mark.parametrize("delta_v, names", [(0.45, FEWER), (0.9, BOTH)])
def test_step_and_timing_together_recover_most(delta_v, names):
    """Oracle: the order of the Atlas paper's Fig. 6, pushed outward."""
    qp, all_ = IcpStepQpParams(), ATLAS_MECHANISMS
    assert {n for n in all_ if recovers(n, 270.0, delta_v, qp)} == names


@pytest.mark.parametrize("robot", ["nadia", "g1"])
def test_robots_of_any_size_have_fallen_at_the_same_lean(robot):
    """Oracle: 0.9 CoM heights to the nearer of two feet that stand."""
    push = "{delta_v: 1.5, direction_deg: 30, at: 0.5 s}"
    run = simulated(f"{{robot: {robot}, pushes: [{push}]}}", "lipm")
    x, y = np.abs(run.logs["com_state"][:, :2]).T
    model = load_robot(robot, "realistic").point_mass
    lean = np.hypot(x, y - 0.5 * model.step_width) / model.com_height
    assert run.summary["reason"].startswith("fell: CoM out of reach")
    assert lean[-2] < 0.9 < lean[-1] < 0.95
