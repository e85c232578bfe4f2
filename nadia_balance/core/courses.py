"""The courses of the package: lists of regions.

Stepping stones, gap and blocks follow the tests of IHMC's open controller, the
pile follows the Nadia paper's Fig. 11, which gives no sizes: blocks are 0.4 m
wide and 0.15 m high, like two cinder blocks side by side.
"""

import math
from collections.abc import Callable, Iterator

import numpy as np

from nadia_balance.core.ground import Region

_BLOCK, _GAP = 0.4, 0.01  # side of a block, gap between blocks [m]
_LAYER = 0.15  # a block's height [m]
_TILT = math.radians(15.0)
_SLOPE = math.radians(10.0)


def _rectangle(
    name: str,
    x: tuple[float, float],
    y: tuple[float, float],
    height: float = 0.0,
    slope: tuple[float, float] = (0.0, 0.0),
) -> Region:
    """Region from x[0] to x[1], y[0] to y[1]; `slope` is (forward, left)."""
    (x0, x1), (y0, y1) = x, y
    return Region(
        name=name,
        vertices=[[x1, y1], [x0, y1], [x0, y0], [x1, y0]],
        height=height,
        normal=[-slope[0], -slope[1], 1.0],
    )


def stepping_stones(seed: int) -> Iterator[Region]:
    """Stones of 0.5 m x 0.5 m, 0.5 m apart along x, on alternating sides.

    They extend in front of and behind a start for both feet.
    """
    yield _rectangle("start", (-0.25, 0.25), (-0.45, 0.45))
    for i in (*range(1, 9), *range(-1, -9, -1)):
        x, y = 0.5 * i, 0.2 * (-1.0) ** i
        yield _rectangle(
            f"stone {i}", (x - 0.25, x + 0.25), (y - 0.25, y + 0.25)
        )


def gap(seed: int) -> Iterator[Region]:
    """Two platforms with a gap of 0.1 m, and a strip beside them."""
    yield _rectangle("near platform", (-0.2, 0.5), (-0.35, 0.35))
    yield _rectangle("far platform", (0.6, 1.6), (-0.35, 0.35))
    yield _rectangle("strip", (-0.2, 1.6), (-0.57, -0.39))


def cinder_blocks(seed: int) -> Iterator[Region]:
    """A pile of flat blocks, up and down (Nadia paper, Fig. 11)."""
    yield from _pile(np.zeros((0, 2)))


def tilted_blocks(seed: int) -> Iterator[Region]:
    """The same pile, its blocks tilted by 15 degrees in four directions."""
    turns = math.tan(_TILT) * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
    yield from _pile(turns)


def _pile(slopes: np.ndarray) -> Iterator[Region]:
    yield _rectangle("near ground", (-1.0, 0.3), (-0.82, 0.82))
    layers = (1, 2, 3, 3, 2, 1)
    pitch = _BLOCK + _GAP
    for row, layer in enumerate(layers):
        x = 0.3 + _GAP + row * pitch
        for column in range(4):
            y = (column - 2) * pitch
            slope = (0.0, 0.0)
            if len(slopes):
                slope = tuple(slopes[(row + column) % len(slopes)])
            yield _rectangle(
                f"block {row + 1}-{column + 1}",
                (x, x + _BLOCK),
                (y, y + _BLOCK),
                layer * _LAYER,
                slope,
            )
    end = 0.3 + _GAP + len(layers) * pitch
    yield _rectangle("far ground", (end, end + 1.5), (-0.82, 0.82))


def stairs(seed: int) -> Iterator[Region]:
    """Five steps of 0.18 m up, a landing, and the same steps down."""
    yield _rectangle("near floor", (-1.0, 0.3), (-0.6, 0.6))
    treads = [*range(1, 6), *range(4, 0, -1)]
    x = 0.3
    for number, rise in enumerate(treads, start=1):
        end = x + (1.0 if rise == 5 else 0.32)
        yield _rectangle(f"tread {number}", (x, end), (-0.6, 0.6), 0.18 * rise)
        x = end
    yield _rectangle("far floor", (x, x + 1.5), (-0.6, 0.6))


def slopes(seed: int) -> Iterator[Region]:
    """Slopes of 10 degrees: up, down, and lateral."""
    rise = math.tan(_SLOPE)
    wide = (-0.8, 0.8)
    yield _rectangle("near floor", (-1.0, 0.4), wide)
    yield _rectangle("up", (0.4, 2.4), wide, rise, (rise, 0.0))
    yield _rectangle("top", (2.4, 3.4), wide, 2.0 * rise)
    yield _rectangle("down", (3.4, 5.4), wide, rise, (-rise, 0.0))
    yield _rectangle("far floor", (5.4, 6.4), wide)
    yield _rectangle("across", (6.4, 9.0), wide, 0.0, (0.0, rise))


def tiles(seed: int) -> Iterator[Region]:
    """Tiles of 0.5 m with random heights of +-3 cm and tilts of +-3 deg."""
    yield _rectangle("start", (-0.5, 0.5), (-0.5, 0.5))
    rng = np.random.default_rng(seed)
    slope = math.tan(math.radians(3.0))
    for i in range(20):
        for j in range(4):
            x, y = 0.5 + 0.5 * i, 0.5 * (j - 2)
            height, *tilt = (rng.uniform(-1.0, 1.0, 3)).tolist()
            yield _rectangle(
                f"tile {i + 1}-{j + 1}",
                (x, x + 0.5),
                (y, y + 0.5),
                0.03 * height,
                (slope * tilt[0], slope * tilt[1]),
            )


COURSES: dict[str, Callable[[int], Iterator[Region]]] = {
    course.__name__: course
    for course in (
        *(stepping_stones, gap, cinder_blocks, tilted_blocks),
        *(stairs, slopes, tiles),
    )
}
