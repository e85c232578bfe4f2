"""What the plots show, read from the drawing itself."""

import numpy as np
import pytest

from nadia_balance.core.walking.state import Side
from nadia_balance.results.log import contacts, pushes
from nadia_balance.results.plots import footsteps
from nadia_balance.results.plots.time_series import draw_contacts
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


def test_footsteps_are_drawn_from_the_push_until_both_feet_are_back(log):
    """Oracle: pushed in step 2 from 1.8 s on; steps 2 and 3 are adjusted.

    Steps 4 and 5 bring the feet back, each in its second.
    """
    first, last = footsteps.window(log, pushes(log))
    assert log["t"][first] == pytest.approx(1.8)
    assert log["t"][last] == pytest.approx(1.8 + 0.43 + 0.54 + 2.0)
    written = texts(footsteps.draw(log, summary_of(log)))
    assert [text for text in written if text] == [*"2345"]
