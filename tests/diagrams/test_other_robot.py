"""Another robot is another folder: Atlas, with Nadia's scenarios and gains.

Twice Nadia's mass, the CoM a third higher.
"""

from tests.diagrams.simulated import EARLY, figures

SHOVED = (
    "{robot: atlas, mechanisms: all_with_cross_over, duration: 3.5, "
    f"{EARLY % 'num_steps: 4'}, pushes: "
    "[{delta_v: 0.41, at: right swing 25 %, direction_deg: 90.0}]}"
)


def test_recovers_from_what_the_paper_shows_for_nadia():
    """Oracle: Fig. 10 of the Nadia paper, inward, all mechanisms [m/s].

    Outward it is pushed in test_stories.  The QP meets its torque limits to
    1e-8 (core/math/qp.py).
    """
    found = figures(SHOVED)
    assert found["recovered"], found["reason"]
    assert found["steps_after_push"] >= 3
    assert found["max_torque_ratio"] <= 1.0 + 1e-8
