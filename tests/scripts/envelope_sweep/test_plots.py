"""What the picture of an envelope shows, read from the drawing itself."""

import math

import matplotlib as mpl
import numpy as np
import pytest

from nadia_balance.results.plots.style import RC
from nadia_balance.scripts.envelope_sweep import report
from nadia_balance.scripts.envelope_sweep.sweep import Cell, SearchParams
from tests.scripts.envelope_sweep.made_up import (
    AT,
    made_up_rows,
    paper_times,
    table_of,
)

ALL = "all_with_cross_over"
LEFT = ("push", "left swing 25 %")
SEARCH = SearchParams(resolution=0.1, stride=4)
ROUND = {0.0: 0.8, 90.0: 0.3, 180.0: 0.6, 270.0: 0.5}
CELLS = {Cell(*AT, ALL, angle): value for angle, value in ROUND.items()}


def drawn(cells, robot="nadia"):
    rows = made_up_rows(cells, SEARCH)
    return report.draw_envelope(table_of(rows, SEARCH, robot))


def lines_named(ax, name):
    return [line for line in ax.lines if line.get_label() == name]


def legend_of(figure):
    (legend,) = figure.legends
    return [text.get_text() for text in legend.get_texts()]


def styled(ax, style):
    return [line for line in ax.lines if line.get_linestyle() == style]


def test_the_line_goes_through_the_limits():
    """Oracle: the corners by hand; forward is up, left is left."""
    (ax,) = drawn(CELLS).axes
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


def test_the_paper_is_beside_its_moment_only_the_limit_beside_all():
    """Oracle: the paper's 1.15 m/s forward, 0.85 at 270; limits made up."""
    cells = {cell: v for cell, v in paper_times(1.1).items() if ALL in cell}
    figure = drawn(cells | {Cell(*LEFT, ALL, 0.0): 1.0})
    known, other = figure.axes
    (line,) = styled(known, "--")
    assert line.get_xydata()[0] == pytest.approx([0.0, 1.15])
    assert line.get_ydata()[9] == pytest.approx(0.85)
    tops = [patch.get_path().vertices[:, 1].max() for patch in known.patches]
    assert max(tops) == pytest.approx(1.86)
    (hips,) = styled(known, ":")
    assert hips.get_ydata().max() == pytest.approx(2.6)
    assert not styled(other, "--")
    words = {
        "the Nadia paper's, Fig. 10",
        report.LIMIT_LABEL,
        report.HIPS_LABEL,
    }
    assert words | {ALL} == set(legend_of(figure))


def test_odd_envelopes_can_be_drawn_and_seen():
    """Oracle: no warning, as all of them are errors; all is in the axes."""
    for robot, cells in (
        ("nadia", paper_times(3.0)),
        ("nadia", {Cell(*AT, ALL, 90.0): 0.0}),
        ("atlas", {Cell(*AT, ALL, 9.0): 0.0, Cell(*LEFT, "step", 20.0): 0.0}),
        ("nadia", {Cell(*AT, ALL, 5.0 * i): 0.5 for i in range(72)}),
    ):
        with mpl.rc_context(RC):
            figure = drawn(cells, robot)
            figure.draw_without_rendering()
        for ax in figure.axes:
            assert ax.bbox.width > 100
            for line in ax.lines:
                assert np.all(line.get_ydata() < ax.get_rmax())
