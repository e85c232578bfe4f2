"""What the picture of an envelope shows, read from the drawing itself."""

import math

import numpy as np
import pytest

from nadia_balance.scripts.sweep import Cell, report
from nadia_balance.scripts.sweep.search import SearchParams
from tests.scripts.sweep.made_up import AT, made_up_rows, table_of

ALL = "all_with_cross_over"
SEARCH = SearchParams(resolution=0.1, stride=4)
ROUND = {0.0: 0.8, 90.0: 0.3, 180.0: 0.6, 270.0: 0.5}
CELLS = {Cell(*AT, ALL, angle): value for angle, value in ROUND.items()}


def test_the_line_goes_through_the_limits():
    """Oracle: the corners by hand; forward is up, left is left."""
    rows = made_up_rows(CELLS, SEARCH)
    (ax,) = report.draw_envelope(table_of(rows, SEARCH)).axes
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
