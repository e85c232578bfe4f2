"""What the picture of an envelope shows, read from the drawing itself."""

from dataclasses import replace
from functools import partial

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from nadia_balance.core.mechanisms import ATLAS_MECHANISMS, MECHANISMS
from nadia_balance.results.plots.style import RC
from nadia_balance.scripts.envelope_sweep.physical import Physical
from nadia_balance.scripts.envelope_sweep.plots import (
    COLORS,
    HIPS_LABEL,
    LIMIT_LABEL,
    SEARCHED_LABEL,
    direction_name,
    draw_envelope,
)
from nadia_balance.scripts.envelope_sweep.protocols import PROTOCOLS
from nadia_balance.scripts.envelope_sweep.search import (
    Cell,
    SearchParams,
    Situation,
)
from nadia_balance.scripts.envelope_sweep.table import Scale
from tests.scripts.envelope_sweep.made_up import (
    AT,
    made_up_table,
    paper_times,
)

ALL = "all_with_cross_over"
LEFT = Situation("push", "left swing 25 %")
SEARCH = SearchParams(resolution=0.1, stride=4)
envelope_from = partial(made_up_table, search=SEARCH)
ROUND = {0.0: 0.8, 90.0: 0.3, 180.0: 0.6, 270.0: 0.5}
CELLS = {Cell(ALL, AT, angle): value for angle, value in ROUND.items()}
# Forward is up, left is left.
CORNERS = [(0.0, 0.8), (-0.3, 0.0), (0.0, -0.6), (0.5, 0.0), (0.0, 0.8)]


def lines_named(ax, name):
    return [line for line in ax.lines if line.get_label() == name]


def legend_of(figure):
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()]


def dashed(ax):
    return [line for line in ax.lines if line.get_linestyle() == "--"]


def test_the_line_goes_through_the_limits():
    """Oracle: the corners by hand."""
    (ax,) = draw_envelope(envelope_from(CELLS)).axes
    (line,) = lines_named(ax, ALL)
    assert line.get_xydata() == pytest.approx(np.array(CORNERS), abs=1e-9)
    written = {text.get_text() for text in ax.texts}
    assert written >= {"0.80", "0.30", "0.60", "0.50"}
    assert written >= {"forward", "left\n(inward)", "right\n(outward)"}


@pytest.mark.parametrize("hurried", [None, 90.0])
def test_limits_that_are_still_searched_for_are_hollow(hurried):
    """Oracle: the one cell that was left unfinished."""
    envelope = envelope_from(
        CELLS, is_unfinished=lambda c: c.direction_deg == hurried
    )
    figure = draw_envelope(envelope)
    dots = [line for line in figure.axes[0].lines if line.get_marker() == "o"]
    hollow = [d for d in dots if d.get_markerfacecolor() == "white"]
    count = 1 if hurried else 0
    assert len(hollow) == count
    for dot in hollow:
        assert dot.get_xydata() == pytest.approx(np.array([CORNERS[1]]))
    assert legend_of(figure).count(SEARCHED_LABEL) == count


def test_the_paper_and_the_limit_are_beside_the_reference_moment_only():
    """Oracle: the paper's 1.15 m/s forward, limits made up; 90 x 1 N s."""
    around = dict.fromkeys((15.0 * i for i in range(24)), 1.9)
    limits = Physical(
        limit={ALL: around | {0.0: 1.86}},
        with_hips={ALL: {angle: 2.1 for angle in around}},
        assumptions="a point mass",
    )
    cells = paper_times(1.1) | {Cell(ALL, LEFT, 0.0): 1.0}
    envelope = envelope_from(cells, physical=limits)
    scale = Scale(mass=90.0, speed=2.0)
    figure = draw_envelope(replace(envelope, scale=scale))
    known, other = figure.axes
    (line,) = dashed(known)
    assert line.get_xydata()[0] == pytest.approx([0.0, 1.15])
    assert line.get_xydata()[9] == pytest.approx([0.85, 0.0])
    tops = [patch.get_path().vertices[:, 1].max() for patch in known.patches]
    assert max(tops) == pytest.approx(1.86)
    (hips,) = [line for line in known.lines if line.get_linestyle() == ":"]
    assert hips.get_ydata().max() == pytest.approx(2.1)
    assert not dashed(other)
    words = legend_of(figure)
    assert "the Nadia paper's, Fig. 10" in words
    assert {LIMIT_LABEL, HIPS_LABEL} <= set(words)
    assert "1 m/s is 90 N s,\n0.500 $\\sqrt{gz}$" in words
    assert any(word.startswith("the paper's: only for") for word in words)


def test_the_atlas_papers_figure_has_a_panel_for_each_gait():
    """Oracle: its Fig. 6 by hand: 1.92 weights forward, fast and in place."""
    cells = {}
    for name in PROTOCOLS["atlas_fig6"].scenario_name.split(","):
        gait = Situation(name, "right swing 50 %")
        cells |= paper_times(0.8, gait, "atlas")
    figure = draw_envelope(envelope_from(cells, robot="atlas"))
    assert [ax.get_title() for ax in figure.axes] == sorted(
        f"{name}, right swing 50 %" for name in {c.situation[0] for c in cells}
    )
    fast = figure.axes[2]
    most = [line.get_xydata()[0] for line in dashed(fast)]
    assert max(way[1] for way in most) == pytest.approx(1.92 * 0.981)
    assert {"1 weight"} <= {t.get_text() for t in fast.texts}
    assert "the Atlas paper's, Fig. 6" in legend_of(figure)
    for label in (*ATLAS_MECHANISMS,):
        assert len(lines_named(fast, label)) == 1


@pytest.mark.parametrize("factor", [0.5, 1.0, 3.0])
def test_all_that_is_drawn_can_be_seen(factor):
    """Oracle: the limits of the axes."""
    cells = paper_times(factor) | paper_times(factor, LEFT)
    for ax in draw_envelope(envelope_from(cells)).axes:
        seen = np.array([ax.get_xlim(), ax.get_ylim()])
        for line in [*dashed(ax), *(lines_named(ax, m)[0] for m in MECHANISMS)]:
            corners = line.get_xydata()
            assert np.all(corners > seen[:, 0])
            assert np.all(corners < seen[:, 1])


def test_odd_envelopes_can_be_drawn():
    """Oracle: no warning, as all of them are errors; all figures finite."""
    for robot, cells in (
        ("nadia", {Cell(ALL, AT, 90.0): 0.0}),
        ("atlas", {Cell(ALL, AT, 9.0): 0.0, Cell("step", LEFT, 20.0): 0.0}),
        ("nadia", {Cell(ALL, AT, 5.0 * i): 0.5 for i in range(72)}),
        ("nadia", {Cell("step", LEFT, 350.0): 9.0}),
    ):
        with mpl.rc_context(RC):
            figure = draw_envelope(envelope_from(cells, robot=robot))
            figure.draw_without_rendering()
        for ax in figure.axes:
            assert np.all(np.isfinite([ax.get_xlim(), ax.get_ylim()]))
            assert ax.bbox.width > 100


@pytest.mark.parametrize(
    ("moment", "words"),
    [
        ("right swing 25 %", ("left (inward)", "right (outward)")),
        ("left swing 25 %", ("left (outward)", "right (inward)")),
        ("left transfer 0 %", ("left (outward)", "right (inward)")),
    ],
)
def test_inward_is_toward_the_stance_foot(moment, words):
    """Oracle: by hand; the foot that does not swing stands."""
    names = [direction_name(a, moment) for a in (90.0, 270.0)]
    assert names == list(words)
    assert direction_name(0.0, moment) == "forward"
    assert direction_name(22.5, moment) == "22.5°"


def test_the_mechanisms_can_be_told_apart_without_colours():
    """Oracle: relative luminance as WCAG defines it; ever darker."""
    found = []
    for name in MECHANISMS:
        part = np.array(to_rgb(COLORS[name]))
        part = np.where(
            part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4
        )
        found.append(part @ [0.2126, 0.7152, 0.0722])
    contrast = (np.array(found[:-1]) + 0.05) / (np.array(found[1:]) + 0.05)
    assert np.all(contrast > 1.35)
