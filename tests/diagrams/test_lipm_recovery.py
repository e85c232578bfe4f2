"""The point mass recovers, with all mechanisms and with fewer of them.

Of the protocol of the Nadia paper's Fig. 10: a push of 0.1 s at 25 % of the
first right swing, while stepping in place.
"""

import numpy as np
import pytest

from nadia_balance.core.feedback.icp_step_qp import IcpStepQpParams
from nadia_balance.core.walking.mechanisms import ATLAS_MECHANISMS, MECHANISMS
from nadia_balance.diagrams.scenario import Scenario, load_scenario
from nadia_balance.results.log import pushes, steps
from nadia_balance.results.summary import Run
from nadia_balance.robot.model import load_robot
from tests.diagrams.simulated import judged, run_of
from tests.results.made_up_run import cut

ALL = "all_with_cross_over"
# The largest push [m/s] that any controller could recover from by these means,
# by direction [deg]: exhaustive reachability on the linear inverted pendulum,
# up to 4 steps, foot 0.24 m x 0.12 m, CoM height 1.0 m, swing 0.7 s (0.4 s at
# least), transfer 0.3 s (0.05 s at least), no angular momentum.  Column
# all_with_cross_over of lipm_limit.csv, with which the project began.
LIMIT = {
    **{0: 1.86, 30: 1.58, 60: 0.95, 90: 0.82, 120: 0.71, 150: 1.15},
    **{180: 1.86, 210: 2.00, 240: 1.75, 270: 1.56, 300: 1.79, 330: 2.00},
}
PUSH = """
gait: {num_steps: %d}
duration: %d
pushes: [{delta_v: 0.0, at: right swing 25 %%}]
"""


def pushed(
    mechanisms: str, direction: float, delta_v: float, num_steps: int = 8
) -> Scenario:
    """The push in this direction [deg], so hard [m/s]."""
    text = PUSH % (num_steps, 2 + num_steps)
    scenario = load_scenario("push", text=text, fidelity="ideal")
    scenario.mechanisms = mechanisms
    (push,) = scenario.pushes
    push.direction_deg, push.delta_v = direction, delta_v
    return scenario


def moderate(direction: int) -> Run:
    """All mechanisms, a push of 0.6 of the limit."""
    return run_of(pushed(ALL, direction, 0.6 * LIMIT[direction]), "lipm")


def recovers(
    mechanisms: str,
    direction: float,
    delta_v: float,
    num_steps: int = 4,
    by_qp: bool = False,
) -> bool:
    """Whether all steps of the gait end with the ICP error below 5 cm.

    Adjusted by the QP of the Atlas paper, if told.
    """
    scenario = pushed(mechanisms, direction, delta_v, num_steps)
    if by_qp:
        scenario.controller.icp_step_qp = IcpStepQpParams()
    found = judged(scenario, "lipm")
    return found["recovered"] and found["steps_after_push"] >= num_steps


@pytest.mark.parametrize(
    ("direction", "delta_v", "fewest"),
    [(270, 0.4, "step"), (90, 0.6, "step_swing"), (90, 0.95, ALL)],
)
def test_more_mechanisms_never_recover_less(direction, delta_v, fewest):
    """Oracle: the order of the mechanisms, of which each adds one.

    `fewest` is the first that recovers, `icp_only` never does: its limits are
    0.3 and 0.22 m/s, the feet and the hips in place.
    """
    names = list(MECHANISMS)
    found = [name for name in names if recovers(name, direction, delta_v)]
    assert found == names[names.index(fewest) :]


@pytest.mark.parametrize("direction, delta_v", [(180, 0.92), (300, 0.55)])
def test_the_atlas_paper_s_qp_recovers_what_ankles_do_not(direction, delta_v):
    """Oracle: column step of lipm_limit.csv [m/s], and icp_only."""
    assert recovers("step", direction, delta_v, by_qp=True)
    assert not recovers("icp_only", direction, delta_v)


@pytest.mark.parametrize(
    "delta_v, names",
    [
        (0.45, set(ATLAS_MECHANISMS) - {"feedback"}),
        (0.9, {"feedback_step_timing"}),
    ],
)
def test_step_and_timing_together_recover_most(delta_v, names):
    """Oracle: the order of the Atlas paper's Fig. 6, pushed outward."""
    found = {
        name
        for name in ATLAS_MECHANISMS
        if recovers(name, 270.0, delta_v, by_qp=True)
    }
    assert found == names


def commanded_steps(num_steps: int):
    """The footsteps of the gait."""
    model = load_robot("nadia").point_mass
    return pushed(ALL, 0.0, 0.0, num_steps).start(model).schedule.footsteps


@pytest.mark.parametrize("direction", [0, 240])
def test_goes_back_to_the_commanded_footholds(direction):
    """Oracle: the gait as it was commanded; 3 cm, from the 6th step on."""
    log = moderate(direction).logs
    commanded = commanded_steps(8)
    push = pushes(log)[0]
    after = [step for step in steps(log) if step.swing.end > push.start]
    away = [
        np.linalg.norm(
            step.achieved.p_WF - commanded[step.number - 1].pose.p_WF
        )
        for step in after
    ]
    assert len(away) == 8
    assert away[0] > 0.1  # it did step elsewhere
    assert max(away[5:]) < 0.03


def test_the_mirrored_push_is_recovered_from_in_the_mirror(direction=240):
    """Oracle: the mirror; rounding alone tells left from right."""
    scenario = pushed(ALL, direction, 0.6 * LIMIT[direction])
    scenario.gait.first_swing = "left"
    (push,) = scenario.pushes
    push.at, push.direction_deg = "left swing 25 %", -push.direction_deg
    scenario.duration = 4.5  # until the third step has landed
    other = run_of(scenario, "lipm").logs
    log = cut(moderate(direction).logs, len(other["t"]))
    for name in ("icp", "icp_reference", "ecmp_command", "com_state"):
        signs = np.ones(log[name].shape[1])
        signs[1 :: 3 if name == "com_state" else 2] = -1.0
        assert log[name] == pytest.approx(other[name] * signs, abs=1e-9)
