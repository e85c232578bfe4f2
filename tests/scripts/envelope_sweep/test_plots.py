"""What the picture of an envelope shows, read from the drawing itself."""

import math
from dataclasses import replace
from functools import partial

import matplotlib as mpl
import numpy as np
import pytest

from nadia_balance.core.walking.mechanisms import ATLAS_MECHANISMS
from nadia_balance.results.plots.style import RC
from nadia_balance.scripts.envelope_sweep import plots
from nadia_balance.scripts.envelope_sweep.protocols import PROTOCOLS
from nadia_balance.scripts.envelope_sweep.search import (
    Cell,
    SearchParams,
    Situation,
)
from nadia_balance.scripts.envelope_sweep.table import References, Scale
from tests.scripts.envelope_sweep.made_up import AT, made_up_table, paper_times

ALL = "all_with_cross_over"
LEFT = Situation("push", "left swing 25 %")
SEARCH = SearchParams(resolution=0.1, stride=4)
table_from = partial(made_up_table, search=SEARCH)
ROUND = {0.0: 0.8, 90.0: 0.3, 180.0: 0.6, 270.0: 0.5}
CELLS = {Cell(*AT, ALL, angle): value for angle, value in ROUND.items()}


def lines_named(ax, name):
    return [line for line in ax.lines if line.get_label() == name]


def legend_of(figure):
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()]


def dashed(ax):
    return [line for line in ax.lines if line.get_linestyle() == "--"]


def test_the_line_goes_through_the_limits():
    """Oracle: the corners by hand; forward is up, left is left."""
    (ax,) = plots.draw_envelope(table_from(CELLS)).axes
    (line,) = lines_named(ax, ALL)
    angles = [0.0, math.pi / 2, math.pi, 1.5 * math.pi, 0.0]
    assert line.get_xdata() == pytest.approx(angles)
    assert line.get_ydata() == pytest.approx([0.8, 0.3, 0.6, 0.5, 0.8])
    ax.figure.draw_without_rendering()
    corners = ax.transData.transform(line.get_xydata())
    middle = ax.transData.transform([0.0, 0.0])
    seen = (corners - middle) / np.linalg.norm(corners[0] - middle)
    shown = [(0.0, 1.0), (-0.375, 0.0), (0.0, -0.75), (0.625, 0.0)]
    assert seen[:4] == pytest.approx(np.array(shown), abs=1e-6)
    assert {"0.80", "0.30", "0.60", "0.50"} <= {t.get_text() for t in ax.texts}


def test_limits_that_are_still_searched_for_are_hollow():
    """Oracle: the one cell that was left unfinished."""
    limits = table_from(CELLS, is_unfinished=lambda c: c.direction_deg == 90.0)
    figure = plots.draw_envelope(limits)
    dots = [line for line in figure.axes[0].lines if line.get_marker() == "o"]
    (dot,) = [d for d in dots if d.get_markerfacecolor() == "white"]
    assert len(dots) == 4
    assert dot.get_xydata()[0] == pytest.approx([math.pi / 2, 0.3])
    assert legend_of(figure).count(plots.SEARCHED_LABEL) == 1


def test_the_paper_and_the_limit_are_beside_the_reference_moment_only():
    """Oracle: the paper's 1.15 m/s forward, limits made up; 90 x 1 N s."""
    around = dict.fromkeys((15.0 * i for i in range(24)), 1.9)
    physical = References(
        limit={ALL: around | {0.0: 1.86}},
        with_hips={ALL: {angle: 2.1 for angle in around}},
        assumptions="a point mass",
    )
    cells = paper_times(1.1) | {Cell(*LEFT, ALL, 0.0): 1.0}
    limits = table_from(cells, physical=physical)
    scale = Scale(mass=90.0, speed=2.0)
    figure = plots.draw_envelope(replace(limits, scale=scale))
    known, other = figure.axes
    (line,) = dashed(known)
    assert line.get_xydata()[0] == pytest.approx([0.0, 1.15])
    assert line.get_ydata()[9] == pytest.approx(0.85)
    tops = [patch.get_path().vertices[:, 1].max() for patch in known.patches]
    assert max(tops) == pytest.approx(1.9)
    (hips,) = [line for line in known.lines if line.get_linestyle() == ":"]
    assert hips.get_ydata().max() == pytest.approx(2.1)
    assert not dashed(other)
    words = legend_of(figure)
    assert "the Nadia paper's, Fig. 10" in words
    assert {plots.LIMIT_LABEL, plots.HIPS_LABEL} <= set(words)
    assert "1 m/s is 90 N s,\n0.500 $\\sqrt{gz}$" in words
    assert any(word.startswith("the paper's: only for") for word in words)


def test_the_atlas_papers_figure_has_a_panel_for_each_gait_in_weights():
    """Oracle: its Fig. 6 by hand: 1.92 weights forward, fast and in place."""
    cells = {}
    for name in PROTOCOLS["atlas_fig6"].scenario_name.split(","):
        gait = Situation(name, "right swing 50 %")
        cells |= paper_times(0.8, gait, "atlas")
    figure = plots.draw_envelope(table_from(cells, robot="atlas"))
    assert [ax.get_title() for ax in figure.axes] == sorted(
        f"{name}, right swing 50 %" for name in {c.situation[0] for c in cells}
    )
    fast = figure.axes[2]
    (line,) = dashed(fast)
    assert line.get_xydata()[0] == pytest.approx([0.0, 1.92])
    assert fast.yaxis.get_major_formatter()(1.0, 0) == "1 weight"
    assert "the Atlas paper's, Fig. 6" in legend_of(figure)
    for label in ATLAS_MECHANISMS:
        assert len(lines_named(fast, label)) == 1


def test_odd_envelopes_can_be_drawn_and_seen():
    """Oracle: no warning, as all of them are errors; all is in the axes."""
    for robot, cells in (
        ("nadia", paper_times(3.0) | paper_times(0.5, LEFT)),
        ("nadia", {Cell(*AT, ALL, 90.0): 0.0}),
        ("atlas", {Cell(*AT, ALL, 9.0): 0.0, Cell(*LEFT, "step", 20.0): 0.0}),
        ("nadia", {Cell(*AT, ALL, 5.0 * i): 0.5 for i in range(72)}),
        ("nadia", {Cell(*LEFT, "step", 350.0): 9.0}),
    ):
        with mpl.rc_context(RC):
            figure = plots.draw_envelope(table_from(cells, robot=robot))
            figure.draw_without_rendering()
        for ax in figure.axes:
            assert ax.bbox.width > 100
            for line in ax.lines:
                radii = line.get_ydata()
                assert np.all(radii[~np.isnan(radii)] < ax.get_rmax())


@pytest.mark.parametrize(
    ("moment", "words"),
    [
        ("right swing 25 %", ("left\n(inward)", "right\n(outward)")),
        ("left swing 25 %", ("left\n(outward)", "right\n(inward)")),
        ("left transfer 0 %", ("left\n(outward)", "right\n(inward)")),
    ],
)
def test_inward_is_toward_the_stance_foot(moment, words):
    """Oracle: by hand; the foot that does not swing stands."""
    names = [plots.direction_name(a, moment) for a in (90.0, 270.0)]
    assert names == list(words)
    assert plots.direction_name(22.5, moment) == "22.5°"
