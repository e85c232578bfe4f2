"""What the plots show, read from the drawing itself."""

import numpy as np
import pytest

from nadia_balance.core.walking.state import Side
from nadia_balance.results.log import contacts, pushes
from nadia_balance.results.plots import footsteps, style
from nadia_balance.results.plots.time_series import draw_contacts, draw_effort
from tests.results.made_up_run import Recipe, make_log, summary_of


@pytest.fixture(scope="module")
def log():
    return make_log(Recipe())


def texts(figure):
    return [t.get_text() for ax in figure.axes for t in ax.texts]


def test_the_timeline_says_how_long_each_phase_took(log):
    """Oracle: the recipe; plans in brackets where it was hurried."""
    figure = draw_contacts(log, summary_of(log))
    written = "\n".join(texts(figure)).split("\n")
    for duration in ("0.30", "0.70", "0.43", "0.04", "0.50", "0.80"):
        assert duration in written
    assert written.count("(0.70)") == 2
    assert written.count("(0.30)") == 1
    assert "push 545 N" in written
    (axes,) = figure.axes
    assert [label.get_text() for label in axes.get_yticklabels()] == [
        *("left", "right", "mode")
    ]
    named = [text.get_text() for text in axes.get_legend().get_texts()]
    assert named[2:] == ["standing", "walking", "recovering"]


def test_many_pushes_keep_their_picture_as_wide(log):
    """Oracle: by hand: three are told one by one, more are counted."""
    summary = summary_of(log)
    push = {"delta_v": 0.4, "direction_deg": 9.6}
    for count, told in (
        (3, ", ".join(["push 0.40 m/s at 10°"] * 3)),
        (4, "4 pushes of up to 0.70 m/s"),
    ):
        pushed = [*[push] * (count - 1), push | {"direction_deg": 10.4}]
        pushed[-1]["delta_v"] = 0.4 if count == 3 else 0.7
        words = style.title(summary | {"pushes": pushed}, "ICP")
        assert words.startswith(f"ICP   ·   nadia, step, {told}, "), words


def test_the_velocity_walked_is_beside_that_commanded():
    """Oracle: steps of 0.2 m in 1 s each; the CoM goes along."""
    log = make_log(Recipe(length=0.2, pushed_step=None, changed={}))
    log["velocity_command"] = np.tile([0.2, 0.0, 0.0], (len(log["t"]), 1))
    _, axes = draw_contacts(log, summary_of(log)).axes
    lines = {line.get_label(): line.get_ydata() for line in axes.lines}
    late = (log["t"] > 3.5) & (log["t"] < 5.0)
    assert lines["forward [m/s]"][late] == pytest.approx(0.2, abs=0.01)
    assert lines["left [m/s]"][late] == pytest.approx(0.0, abs=0.02)
    assert lines["turn [rad/s]"] == pytest.approx(0.0)
    assert (axes.lines[0].get_ydata() == 0.2).all()
    log["velocity_command"][:] = 0.0
    assert len(draw_contacts(log, summary_of(log)).axes) == 1


def test_measured_contacts_are_those_of_the_forces(log):
    """Oracle: forces set by hand; an impact does not hide the weight."""
    forces = np.tile([900.0, 0.0], (len(log["t"]), 1))
    forces[500:1000] = [450.0, 450.0]
    forces[1000] = [900.0, 90_000.0]
    log = {**log, "foot_forces": forces}
    ((start, duration),) = contacts(log, Side.RIGHT)
    assert (start, duration) == pytest.approx((1.0, 1.002))
    ((start, duration),) = contacts(log, Side.LEFT)
    assert (start, duration) == pytest.approx((0.0, log["t"][-1]))


@pytest.mark.parametrize(
    ("joint", "group"),
    [
        ("waist_roll_joint", "waist"),  # the G1's
        ("back_bkx", "waist"),  # Atlas'
        ("SPINE_Z", "waist"),
        ("torso_joint", "waist"),
        ("left_hip_yaw_joint", "hips"),
        ("l_leg_kny", "knees"),
        ("RIGHT_ANKLE_X", "ankles"),
        ("left_wrist_yaw_joint", "arms"),
    ],
)
def test_the_effort_is_that_of_groups_up_to_its_limits(log, joint, group):
    """Oracle: by hand, one joint that is at 80 % of its speed limit."""
    names = np.full(len(log["actuator_names"]), "HIP_" * 5)
    names[3] = joint
    speed = np.zeros_like(log["state"])
    speed[:, log["joint_speed_columns"][3]] = -16.0
    changed = {**log, "actuator_names": names, "state": speed}
    _, axes, _ = draw_effort(changed, summary_of(log)).axes
    lines = {line.get_label(): line.get_ydata() for line in axes.lines}
    assert lines[group] == pytest.approx(80.0)
    assert lines["limit"] == pytest.approx(100.0)
    assert axes.get_ylabel() == "speed [% of limit]"


def test_footsteps_show_the_last_capture_regions_of_the_largest_move(log):
    """Oracle: by hand; step 3 is moved most, and lands at 2.77 s.

    What is of another step, or older, is not drawn.
    """
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    rows = [
        [time, n, *(size * corner)]
        for time, sizes in ((2.2, (7, 8)), (2.7, (5, 6)), (2.75, (2, 3)))
        for n, size in zip((1, 3), sizes, strict=True)
        for corner in square
    ]
    log = {**log, "capture_regions": np.array(rows)}
    (ax,) = footsteps.draw(log, summary_of(log)).axes
    drawn = {
        patch.get_label().split(" of")[0]: patch.get_xy()[:4]
        for patch in ax.patches
        if (patch.get_label() or "").startswith("C$_")
    }
    assert [*drawn] == ["C$_3$", "C$_1$"]
    assert drawn["C$_1$"] == pytest.approx(2.0 * square)
    assert drawn["C$_3$"] == pytest.approx(3.0 * square)


def test_footsteps_are_drawn_from_the_push_until_both_feet_are_back(log):
    """Oracle: pushed in step 2 from 1.8 s on; steps 2 and 3 are adjusted.

    Steps 4 and 5 bring the feet back, each in its second.
    """
    first, last = footsteps.window(log, pushes(log))
    assert log["t"][first] == pytest.approx(1.8)
    assert log["t"][last] == pytest.approx(1.8 + 0.43 + 0.54 + 2.0)
    written = texts(footsteps.draw(log, summary_of(log)))
    assert [text for text in written if text] == [*"2345"]
