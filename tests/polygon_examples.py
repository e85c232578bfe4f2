"""Strategies of points (2,) and polygons (n, 2) [m] for tests."""

import numpy as np
from hypothesis import strategies as st

from nadia_balance.core.polygon import convex_hull

# On a grid of 1 cm, so that many are on one line or coincide, while no
# triangle is so flat that its orientation is a matter of rounding.
GRID = st.tuples(st.integers(-30, 30), st.integers(-30, 30))
POINT = GRID.map(lambda p: 0.01 * np.array(p))
POINTS = st.lists(GRID, min_size=1, max_size=12).map(
    lambda points: 0.01 * np.array(points)
)
POLYGON = POINTS.map(convex_hull).filter(lambda hull: len(hull) > 2)
FLOAT = st.floats(-1.0, 1.0, allow_subnormal=False)
ROUNDED = st.lists(st.tuples(FLOAT, FLOAT), min_size=3, max_size=12).map(
    lambda points: convex_hull(np.array(points))
)
