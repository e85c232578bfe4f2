"""What the pictures of an envelope show, read from the drawing itself."""

from functools import partial

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from diagrams.envelope.limit_search import SearchParams
from diagrams.envelope.moment import Moment
from diagrams.envelope.references import MOMENT
from diagrams.mechanisms import MECHANISMS
from diagrams.plots import envelope as polar
from diagrams.plots import envelope_bars as bars
from diagrams.plots import envelope_phases as phases
from diagrams.plots.envelope_style import (
    COLORS,
    LIMIT_LABEL,
    PAPER_LABEL,
    SEARCHED_LABEL,
    direction_name,
)
from diagrams.plots.style import RC
from tests.diagrams.envelope.made_up_trials import (
    made_up_envelope,
    paper_times,
)

ALL = "all_with_cross_over"
LEFT = Moment.parse("left swing 25 %")
SEARCH = SearchParams(resolution=0.1, stride=4)
envelope_from = partial(made_up_envelope, search=SEARCH)
ROUND = {0.0: 0.8, 90.0: 0.3, 180.0: 0.6, 270.0: 0.5}
CELLS = {(ALL, MOMENT, angle): value for angle, value in ROUND.items()}
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
    (ax,) = polar.draw(envelope_from(CELLS)).axes
    (line,) = lines_named(ax, ALL)
    assert line.get_xydata() == pytest.approx(np.array(CORNERS), abs=1e-9)
    written = {text.get_text() for text in ax.texts}
    assert written >= {"0.80", "0.30", "0.60", "0.50"}
    assert written >= {"forward", "left\n(inward)", "right\n(outward)"}


def test_the_line_is_broken_where_directions_are_far_apart():
    """Oracle: by hand; from 0 to 270 degrees nothing was tried."""
    cells = {(ALL, MOMENT, 0.0): 0.8, (ALL, MOMENT, 270.0): 0.5}
    (ax,) = polar.draw(envelope_from(cells)).axes
    (line,) = lines_named(ax, ALL)
    nan = (np.nan, np.nan)
    expected = [(0.0, 0.8), nan, (0.5, 0.0), (0.0, 0.8)]
    assert line.get_xydata() == pytest.approx(
        np.array(expected), abs=1e-9, nan_ok=True
    )


@pytest.mark.parametrize("hurried", [None, 90.0])
def test_limits_that_are_still_searched_for_are_hollow(hurried):
    """Oracle: the one cell that was left unfinished."""
    envelope = envelope_from(CELLS, is_unfinished=lambda c: c[2] == hurried)
    figure = polar.draw(envelope)
    dots = [line for line in figure.axes[0].lines if line.get_marker() == "o"]
    hollow = [d for d in dots if d.get_markerfacecolor() == "white"]
    count = 1 if hurried else 0
    assert len(hollow) == count
    for dot in hollow:
        assert dot.get_xydata() == pytest.approx(np.array([CORNERS[1]]))
    assert legend_of(figure).count(SEARCHED_LABEL) == count
    figure = bars.draw(envelope)
    faces = [to_rgb(patch.get_facecolor()) for patch in figure.axes[0].patches]
    assert faces.count((1.0, 1.0, 1.0)) == count
    assert legend_of(figure).count(SEARCHED_LABEL) == count


def test_the_paper_and_the_limit_are_beside_the_reference_moment_only():
    """Oracle: the paper's 1.15 m/s forward, the limit's 1.86 m/s."""
    figure = polar.draw(envelope_from(paper_times(1.1) | {(ALL, LEFT, 0): 1}))
    known, other = figure.axes
    (line,) = dashed(known)
    assert line.get_xydata()[0] == pytest.approx([0.0, 1.15])
    assert line.get_xydata()[9] == pytest.approx([0.85, 0.0])
    tops = [patch.get_path().vertices[:, 1].max() for patch in known.patches]
    assert max(tops) == pytest.approx(1.86)
    assert not dashed(other)
    words = legend_of(figure)
    assert PAPER_LABEL in words
    assert LIMIT_LABEL in words
    assert any(word.startswith("references: only for") for word in words)


def test_another_robot_has_no_references():
    figure = polar.draw(envelope_from(CELLS, robot="atlas"))
    assert not dashed(figure.axes[0])
    words = legend_of(figure)
    assert PAPER_LABEL not in words
    assert words[-1].endswith("nadia, push, right swing 25 %")
    assert PAPER_LABEL not in legend_of(
        bars.draw(envelope_from(CELLS, robot="a"))
    )


def test_the_key_names_what_is_added_only_if_all_before_it_is_there():
    """Oracle: by hand."""
    assert legend_of(polar.draw(envelope_from(CELLS)))[0] == ALL
    words = legend_of(polar.draw(envelope_from(paper_times(1.0))))
    assert words[:2] == ["ankles and hips only", "+ where to step"]
    assert words[4] == "+ crossing the legs"


@pytest.mark.parametrize("factor", [0.5, 1.0, 3.0])
def test_all_that_is_drawn_can_be_seen(factor):
    """Oracle: the limits of the axes."""
    cells = paper_times(factor) | paper_times(factor, LEFT)
    for ax in polar.draw(envelope_from(cells)).axes:
        seen = np.array([ax.get_xlim(), ax.get_ylim()])
        for line in [*dashed(ax), *(lines_named(ax, m)[0] for m in MECHANISMS)]:
            corners = line.get_xydata()
            assert np.all(corners > seen[:, 0])
            assert np.all(corners < seen[:, 1])


def test_bars_are_as_high_as_their_figures():
    """Oracle: by hand; the paper has 0.41, the limit is 0.82 inward."""
    figure = bars.draw(envelope_from(CELLS))
    (ax,) = figure.axes
    heights = sorted(
        patch.get_height()
        for patch in ax.patches
        if abs(patch.get_x() + 0.5 * patch.get_width() - 1.0) < 0.5
    )
    assert heights == pytest.approx([0.3, 0.41, 0.82])
    words = [label.get_text() for label in ax.get_xticklabels()]
    assert words == [
        "forward",
        "left\n(inward)",
        "backward",
        "right\n(outward)",
    ]
    assert legend_of(figure)[1] == PAPER_LABEL


def test_rows_of_bars_have_one_scale():
    """Oracle: metres per second per inch of each row, as laid out."""
    figure = bars.draw(envelope_from(paper_times(1.0)))
    figure.draw_without_rendering()
    scales = [ax.get_ylim()[1] / ax.bbox.height for ax in figure.axes]
    assert len(scales) == 5
    assert scales == pytest.approx([scales[0]] * 5, rel=1e-3)


def test_the_band_is_from_the_worst_to_the_best_moment():
    """Oracle: by hand."""
    cells = CELLS | {(ALL, LEFT, 0.0): 0.5, (ALL, LEFT, 90.0): 0.7}
    envelope = envelope_from(cells)
    expected = {0.0: (0.5, 0.8), 90.0: (0.3, 0.7)}
    found = phases.band(envelope, ALL)
    assert list(found) == list(expected)
    for angle, ends in expected.items():
        assert found[angle] == pytest.approx(ends)
    (ax,) = phases.draw(envelope).axes
    (worst,), (best,) = lines_named(ax, "worst"), lines_named(ax, "best")
    assert worst.get_ydata() == pytest.approx([0.5, 0.3, 0.5])
    assert best.get_ydata() == pytest.approx([0.8, 0.7, 0.8])
    assert best.get_xdata() == pytest.approx([0.0, 90.0, 360.0])


def test_the_key_of_phases_has_all_that_is_in_any_panel():
    """Oracle: by hand; only `step` has a common direction."""
    cells = {("step", m, 0.0): 0.5 for m in (MOMENT, LEFT)}
    last = {(ALL, MOMENT, 0.0): 0.5}
    names = ["worst", "best", str(MOMENT), str(LEFT)]
    assert legend_of(phases.draw(envelope_from(cells))) == names
    # At LEFT the last one is not begun.
    figure = phases.draw(envelope_from(cells | last))
    assert legend_of(figure) == [*names, SEARCHED_LABEL]


def test_a_limit_that_may_be_larger_is_marked():
    """Oracle: nothing above 3 m/s is tried."""
    envelope = envelope_from(CELLS | {(ALL, MOMENT, 0.0): 9.0})
    for draw in (polar.draw, bars.draw):
        written = [text.get_text() for text in draw(envelope).axes[0].texts]
        assert written.count(">=3.00") == 1
        assert written.count("0.30") == 1


def test_one_moment_has_no_band():
    assert phases.draw(envelope_from(CELLS)) is None


@pytest.mark.parametrize(
    "cells",
    [
        {(ALL, MOMENT, 90.0): 0.0},
        {(ALL, MOMENT, 10.0): 0.0, ("step", LEFT, 20.0): 0.0},
        {(ALL, MOMENT, float(a)): 0.5 for a in range(0, 360, 5)},
        {("step", LEFT, 350.0): 9.0},
    ],
)
@pytest.mark.parametrize("robot", ["nadia", "atlas"])
def test_odd_envelopes_can_be_drawn(cells, robot):
    """Oracle: no warning, as all of them are errors; all figures finite."""
    envelope = envelope_from(cells, robot=robot)
    with mpl.rc_context(RC):
        for draw in (polar.draw, bars.draw, phases.draw):
            if (figure := draw(envelope)) is not None:
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
    names = [direction_name(a, Moment.parse(moment)) for a in (90.0, 270.0)]
    assert names == list(words)
    assert direction_name(0.0, Moment.parse(moment)) == "forward"
    assert direction_name(22.5, Moment.parse(moment)) == "22.5°"


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
