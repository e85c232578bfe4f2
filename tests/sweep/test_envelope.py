"""The picture of a sweep's limits, read from the drawing itself."""

import math

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from shapely import LineString, box

from nadia_balance.results.plots.style import save
from nadia_balance.sweep.envelope_plot import draw_envelope
from nadia_balance.sweep.search import SearchParams
from nadia_balance.sweep.trials import Cell
from tests.sweep.made_up import AT, made_up_rows, table_of

ALL = "all_with_cross_over"
COARSE = SearchParams(resolution=0.1, stride=4, largest=2.0)


def test_the_line_goes_through_the_limits():
    """Oracle: the corners by hand; forward is up, left is left."""
    limits = {0.0: 0.8, 90.0: 0.3, 180.0: 0.6, 270.0: 0.5}
    cells = {Cell(*AT, ALL, way): limit for way, limit in limits.items()}
    rows = made_up_rows(cells, COARSE)
    (ax,) = draw_envelope(table_of(rows, COARSE)).axes
    (line,) = [line for line in ax.lines if line.get_label() == ALL]
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


def limits_of(curves, at=AT):
    """Limits at 0, 45, ... deg, of each of these mechanisms."""
    return {
        Cell(*at, mechanisms, 45.0 * i): limit
        for mechanisms, curve in curves.items()
        for i, limit in enumerate(curve)
    }


CROWDED = {
    ALL: (1.2, 0.9, 0.5, 0.4, 0.9, 1.3, 1.2, 1.4),
    "step_swing_transfer": (1.4, 1.1, 0.7, 0.6, 1.1, 1.5, 1.4, 1.6),
}


def test_panels_that_are_compared_have_one_radius():
    """Oracle: by hand: 1.9 m/s and 5 % of room make four rings of 0.5."""
    later = "push", "left swing 25 %"
    cells = limits_of({ALL: (0.5,) * 8}) | limits_of({ALL: (1.9,) * 8}, later)
    rows = made_up_rows(cells, COARSE)
    limits = table_of(rows, COARSE)
    for record in limits.records:
        record |= {"limit": 1.0, "with_hips": 1.2}
    small, large = draw_envelope(limits).axes
    assert small.get_rmax() == large.get_rmax() == 2.0


def test_no_number_lies_on_a_curve_or_on_another():
    """Oracle: the pixels of texts and lines, by shapely."""
    limits = table_of(made_up_rows(limits_of(CROWDED), COARSE), COARSE)
    for record in limits.records:
        record |= {"limit": 1.6, "with_hips": 1.8}
    figure = draw_envelope(limits)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    (ax,) = figure.axes
    curves = [
        LineString(ax.transData.transform(line.get_xydata()))
        for line in ax.lines
        if line.get_label() in CROWDED
    ]
    plates = {
        text.get_text(): box(*text.get_window_extent().extents)
        for text in ax.texts
        if not text.get_text().endswith("m/s")
    }
    numbers = [box(*t.get_window_extent().extents) for t in ax.texts]
    assert len(plates) == len({*CROWDED[ALL]})
    for number, plate in plates.items():
        assert not any(plate.intersects(curve) for curve in curves), number
    for i, plate in enumerate(numbers):
        assert not any(plate.intersects(other) for other in numbers[:i])


def test_the_drawing_has_words_and_the_same_bytes(tmp_path):
    """Oracle: the file itself; its legend says nothing of any controller,
    as the curves of one may be beyond the limit of a point mass.
    """
    limits = table_of(made_up_rows(limits_of(CROWDED), COARSE), COARSE)
    texts = []
    for name in ("one", "two"):
        save(draw_envelope(limits), tmp_path / f"{name}.png")
        texts.append((tmp_path / f"{name}.svg").read_text("utf-8"))
    assert texts[0] == texts[1]
    assert ">forward<" in texts[0]
    assert "more than a point mass" in texts[0]
    assert "any controller" not in texts[0]
