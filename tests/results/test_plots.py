"""What the plots show, read from the drawing itself."""

import itertools

import numpy as np
import pytest
from matplotlib.colors import to_hex
from shapely import Polygon

from nadia_balance import palette
from nadia_balance.core.body.reachability import (
    ReachabilityParams,
    step_regions,
)
from nadia_balance.core.walking.vocabulary import Side
from nadia_balance.results.log import contacts, pushes
from nadia_balance.results.plots import effort, footsteps, timeline
from tests.results.made_up_run import (
    HALF_WIDTH,
    JOINTS,
    Recipe,
    make_log,
    summary_of,
)


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


def test_durations_of_short_phases_do_not_run_into_each_other():
    """Oracle: the boxes of the texts as drawn, two by two."""
    hurried = {n: (np.zeros(2), 0.4, 0.05) for n in range(2, 7)}
    log = make_log(Recipe(changed=hurried))
    figure = timeline.draw(log, summary_of(log))
    figure.draw_without_rendering()
    (ax,) = figure.axes
    boxes = [t.get_window_extent() for t in ax.texts]
    assert len(boxes) > 20
    for one, other in itertools.combinations(boxes, 2):
        assert not one.overlaps(other)


def test_a_long_timeline_names_a_push_in_the_row_of_its_time():
    """Oracle: 31.3 s in rows of about ten; a name has no room outside."""
    log = make_log(Recipe(num_steps=29, changed={}))
    figure = timeline.draw(log, summary_of(log))
    figure.draw_without_rendering()
    width = figure.bbox.width
    assert len(figure.axes) == 3
    limits = [ax.get_xlim() for ax in figure.axes]
    assert limits[0][1] == pytest.approx(limits[1][0])
    assert limits[-1][1] == pytest.approx(log["t"][-1])
    assert all(ax.get_window_extent().width > 0.8 * width for ax in figure.axes)
    shown = [
        (row, text.get_text())
        for row, ax in enumerate(figure.axes)
        for text in ax.texts
        if text.get_text().startswith("push")
        and text.get_tightbbox().width > 0.0
    ]
    assert shown == [(0, "push 545 N")]


def entries(figure):
    """The legend below the axes: label -> handle."""
    (legend,) = figure.legends
    names = [text.get_text() for text in legend.get_texts()]
    return dict(zip(names, legend.legend_handles, strict=True))


@pytest.mark.parametrize("draw", [effort.draw_icp, effort.draw])
def test_bands_have_their_entry_in_the_legend(draw, log):
    """Oracle: the colours of the palette."""
    found = entries(draw(log, summary_of(log)))
    assert {n: to_hex(h.get_facecolor()) for n, h in found.items()} == {
        "left foot swings": palette.LEFT,
        "right foot swings": palette.RIGHT,
        "push": palette.PUSH,
    }


def test_the_legend_of_the_timeline_has_a_push_if_there_is_one(log):
    """Oracle: the recipes, with a push and without."""
    with_push = set(entries(timeline.draw(log, summary_of(log))))
    calm = make_log(Recipe(pushed_step=None, changed={}))
    without = set(entries(timeline.draw(calm, summary_of(calm))))
    assert with_push - without == {"push"}
    assert {"transfer [s]", "contact as planned"} <= without


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


def test_footsteps_say_how_long_each_step_took(log):
    """Oracle: the recipe, and the colours of the feet."""
    figure = footsteps.draw(log, summary_of(log))
    for label, side in (
        ("2 left: 0.30 s transfer, 0.43 s swing", Side.LEFT),
        ("3 right: 0.04 s transfer, 0.50 s swing", Side.RIGHT),
        ("4 left: 0.30 s transfer, 0.70 s swing", Side.LEFT),
    ):
        color = to_hex(labelled(figure, label).get_edgecolor())
        assert color == palette.foot_color(side)


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


@pytest.mark.parametrize(("length", "numbers"), [(0.3, "12345"), (0.0, "12")])
def test_footsteps_of_a_walk_are_numbered_where_they_do_not_overlap(
    length, numbers
):
    """Oracle: five steps, ahead or in place."""
    recipe = Recipe(num_steps=5, length=length, pushed_step=None, changed={})
    log = make_log(recipe)
    assert footsteps.window(log, []) == (0, len(log["t"]) - 1)
    figure = footsteps.draw(log, summary_of(log))
    assert texts(figure) == list(numbers)
    moved = [patch.get_label() for patch in figure.axes[0].patches]
    assert not any(str(label).startswith("reach") for label in moved)


def test_every_joint_belongs_to_the_group_of_its_name():
    """Oracle: the joints of Nadia and of Atlas, sorted by hand."""
    groups = effort.joint_groups(np.array([*JOINTS, "LEFT_ELBOW_Y"]))
    sizes = {name: len(members) for name, members in groups.items()}
    assert sizes == {"hips": 6, "knees": 2, "ankles": 4, "spine": 3, "arms": 1}
    names = ["l_leg_hpx", "r_leg_kny", "r_leg_akx", "back_bkz", "l_arm_shz"]
    groups = effort.joint_groups(np.array(names))
    assert groups == {g: [i] for i, g in enumerate(effort.GROUPS)}
