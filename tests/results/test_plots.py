"""What the plots show, read from the drawing itself."""

import numpy as np
import pytest
from shapely import Polygon

from nadia_balance.core.body.reachability import (
    ReachabilityParams,
    step_regions,
)
from nadia_balance.core.walking.vocabulary import Side
from nadia_balance.results.log import contacts, pushes
from nadia_balance.results.plots import footsteps, over_time
from tests.results.made_up_run import HALF_WIDTH, Recipe, make_log, summary_of


@pytest.fixture(scope="module")
def log():
    return make_log(Recipe())


def texts(figure):
    return [t.get_text() for ax in figure.axes for t in ax.texts]


def test_the_timeline_says_how_long_each_phase_took(log):
    """Oracle: the recipe; plans in brackets where it was hurried."""
    written = texts(over_time.draw_contacts(log, summary_of(log)))
    for duration in ("0.30", "0.70", "0.43", "0.04", "0.50", "0.80"):
        assert duration in written
    assert written.count("(0.70)") == 2
    assert written.count("(0.30)") == 1
    assert "push 545 N" in written


def entries(figure):
    """The legend below the axes: label -> handle."""
    (legend,) = figure.legends
    names = [text.get_text() for text in legend.get_texts()]
    return dict(zip(names, legend.legend_handles, strict=True))


def test_footsteps_tell_planned_from_adjusted_footholds():
    """Oracle: the recipe: one foothold was moved by (0.3, -0.1) m."""
    move = np.array([0.3, -0.1])
    log = make_log(Recipe(pushed_step=3, changed={3: (move, 0.5, 0.3)}, miss=0))
    figure = footsteps.draw(log, summary_of(log))
    planned, adjusted = (
        [
            patch.get_xy()[:-1].mean(axis=0)
            for patch in figure.axes[0].patches
            if patch.get_linestyle()
            == labelled(figure, f"foothold as {word}").get_linestyle()
        ]
        for word in ("planned", "adjusted")
    )
    moved = np.array(adjusted) - planned
    assert moved == pytest.approx(np.array([move, 0 * move, 0 * move]))


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


def test_the_estimate_is_drawn_with_its_error_and_three_deviations():
    """Oracle: by hand: 20 mm/s of 10 too fast to y, 0.01 rad about y."""
    state = np.zeros((5, 15))
    state[:, 0] = 1.0
    told, P = state.copy(), np.zeros((5, 81))
    told[:, 2], told[:, 12], P[:, [10, 40]] = 0.005, 0.02, [1e-6, 1e-4]
    log = {"t": np.arange(5.0), "estimated_state": told, "state": state}
    log["estimate_covariance"] = P
    summary = {"robot": "r", "mechanisms": "m", "pushes": [], "fell_at": None}
    figure = over_time.draw_estimate(log, summary)
    x, y = (line.get_ydata() for line in figure.axes[1].lines)
    assert (x[0], y[0]) == pytest.approx((0.0, 20.0))
    band = figure.axes[1].collections[1].get_paths()[0].vertices[:, 1]
    assert (band.min(), band.max()) == pytest.approx((-30.0, 30.0))
    x, y = (line.get_ydata() for line in figure.axes[3].lines)
    assert (x[0], y[0]) == pytest.approx((np.degrees(0.01), 0.0), rel=1e-4)
    band = figure.axes[3].collections[0].get_paths()[0].vertices[:, 1]
    assert band.max() == pytest.approx(np.degrees(0.003))


def labelled(figure, start):
    """The artist whose label begins like this."""
    (ax,) = figure.axes
    artists = [*ax.patches, *ax.lines]
    (found,) = [a for a in artists if str(a.get_label()).startswith(start)]
    return found


def test_footsteps_are_drawn_from_the_push_until_both_feet_are_back(log):
    """Oracle: pushed in step 2 from 1.8 s on; steps 2 and 3 are adjusted.

    Steps 4 and 5 bring the feet back, each in its second.
    """
    first, last = footsteps.window(log, pushes(log))
    assert log["t"][first] == pytest.approx(1.8)
    assert log["t"][last] == pytest.approx(1.8 + 0.43 + 0.54 + 2.0)
    written = texts(footsteps.draw(log, summary_of(log)))
    assert [text for text in written if text] == [*"2345", *"2345"]


@pytest.mark.parametrize(
    ("move", "word", "region"),
    [
        ((0.34, 0.34), "crossing in front", "forward"),
        ((-0.45, 0.18), "crossing behind", "backward"),
        ((0.3, -0.1), "feet side by side", "base"),
    ],
)
def test_footsteps_show_what_the_step_that_moved_most_could_reach(
    move, word, region
):
    """Oracle: Fig. 8's polygon about the left foot, mirrored by hand."""
    changed = {3: (np.array(move), 0.5, 0.3)}
    log = make_log(Recipe(pushed_step=3, changed=changed, miss=0.0))
    patch = labelled(footsteps.draw(log, summary_of(log)), "reach of step 3")
    assert patch.get_label().endswith(word)
    reach = ReachabilityParams()
    polygon = step_regions(reach, cross_over=True)[region] * [1.0, -1.0]
    polygon[:, 1] += HALF_WIDTH
    drawn, expected = Polygon(patch.get_xy()), Polygon(polygon)
    assert drawn.symmetric_difference(expected).area < 1e-12
