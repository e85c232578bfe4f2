"""What the plots show, read from the drawing itself."""

import numpy as np
import pytest

from diagrams.plots import effort, footsteps, icp, timeline
from diagrams.run_log import pushes
from diagrams.summary import RunInfo, summarize
from nadia_balance.core.walking import Side
from tests.diagrams.made_up_run import JOINTS, Recipe, make_log


def summary_of(log):
    return summarize(log, RunInfo(robot="nadia", mechanisms="step"))


@pytest.fixture(scope="module")
def log():
    return make_log(Recipe())


def texts(figure):
    return [t.get_text() for ax in figure.axes for t in ax.texts]


def test_the_timeline_says_how_long_each_phase_took(log):
    """Oracle: the recipe; plans in brackets where it was hurried."""
    written = texts(timeline.draw(log, summary_of(log)))
    for duration in ("0.30", "0.70", "0.43", "0.04", "0.50", "0.80"):
        assert duration in written
    assert written.count("(0.70)") == 2
    assert written.count("(0.30)") == 1
    assert "push 545 N" in written


def test_a_long_timeline_has_several_rows():
    """Oracle: 31.3 s in rows of about ten."""
    log = make_log(Recipe(num_steps=29, pushed_step=None, changed={}))
    figure = timeline.draw(log, summary_of(log))
    assert len(figure.axes) == 3
    limits = [ax.get_xlim() for ax in figure.axes]
    assert limits[0][1] == pytest.approx(limits[1][0])
    assert limits[-1][1] == pytest.approx(log["t"][-1])


def test_measured_contacts_are_those_of_the_forces(log):
    """Oracle: forces set by hand; an impact does not hide the weight."""
    forces = np.tile([900.0, 0.0], (len(log["t"]), 1))
    forces[500:1000] = [450.0, 450.0]
    forces[1000] = [900.0, 90_000.0]
    log = {**log, "foot_forces": forces}
    ((start, duration),) = timeline.measured(log, Side.RIGHT)
    assert (start, duration) == pytest.approx((1.0, 1.002))
    ((start, duration),) = timeline.measured(log, Side.LEFT)
    assert (start, duration) == pytest.approx((0.0, log["t"][-1]))


def test_footsteps_are_drawn_from_the_push_until_after_the_recovery(log):
    """Oracle: pushed in step 2 from 1.8 s on; steps 2 and 3 are adjusted.

    One more step lands before the window ends with the phase after it.
    """
    first, last = footsteps.window(log, pushes(log))
    assert log["t"][first] == pytest.approx(1.8)
    figure = footsteps.draw(log, summary_of(log))
    assert texts(figure)[:3] == ["2", "3", "4"]
    assert log["t"][last] > 2.77


def test_footsteps_of_a_walk_are_all_drawn():
    recipe = Recipe(num_steps=5, length=0.3, pushed_step=None, changed={})
    log = make_log(recipe)
    assert footsteps.window(log, []) == (0, len(log["t"]) - 1)
    assert texts(footsteps.draw(log, summary_of(log))) == list("12345")


def test_steps_in_place_are_numbered_once():
    recipe = Recipe(num_steps=20, pushed_step=None, changed={})
    log = make_log(recipe)
    assert texts(footsteps.draw(log, summary_of(log))) == ["1", "2"]


def test_the_icp_plot_shows_the_error_in_millimetres(log):
    """Oracle: the log's own columns."""
    axes = icp.draw(log, summary_of(log)).axes
    error = np.linalg.norm(log["icp"] - log["icp_reference"][:, :2], axis=1)
    (line, _) = axes[2].lines
    assert line.get_ydata() == pytest.approx(1000.0 * error)
    low, high = axes[0].get_ylim()
    assert high - low >= icp.SMALLEST_RANGE - 1e-12


def test_every_joint_belongs_to_the_group_of_its_name():
    groups = effort.joint_groups(np.array([*JOINTS, "LEFT_ELBOW_Y"]))
    sizes = {name: len(members) for name, members in groups.items()}
    assert sizes == {"hips": 6, "knees": 2, "ankles": 4, "spine": 3, "arms": 1}


def test_groups_know_the_names_of_other_robots():
    names = ["back_bkz", "l_arm_shz", "l_leg_hpx", "r_leg_kny", "r_leg_akx"]
    groups = effort.joint_groups(np.array(names))
    assert {g: names[i] for g, (i,) in groups.items()} == {
        "spine": "back_bkz",
        "arms": "l_arm_shz",
        "hips": "l_leg_hpx",
        "knees": "r_leg_kny",
        "ankles": "r_leg_akx",
    }
