"""The capture regions of a run, as rows of a log.

They are logged where they are drawn, at the same times: at other times than
those of the ticks, or of the drawings, all that they follow from would be
computed once more.
"""

from typing import Any

import numpy as np
from pydrake.systems.framework import Context, DiagramBuilder, OutputPort
from pydrake.systems.primitives import LogVectorOutput, VectorLogSink

from nadia_balance.core.math.arrays import Array
from nadia_balance.systems.ports import Block, input_port
from nadia_balance.view.balance_visualizer import REGIONS_PERIOD

MOST_CORNERS = 64  # of a region; of one with more, some are left out
_SIZE = 2 * (1 + 2 * MOST_CORNERS)  # of a row: n of C_n and corners, twice


class RegionCorners(Block):
    """Writes the first and the last capture region into one vector.

    For each of C_1 and C_N these are n and the corners x, y [m]; behind them, 0
    and NaN.  Outside of swings all are.

    .. pydrake_system::

        name: RegionCorners
        input_ports: [capture_regions]
        output_ports: [corners]
    """

    def __init__(self) -> None:
        super().__init__()
        self._regions = input_port(self, "capture_regions")
        self.DeclareVectorOutputPort("corners", _SIZE, self._calc)

    def _calc(self, context: Context, output: Any) -> None:
        regions = self._regions(context).regions
        rows = np.full((2, 1 + 2 * MOST_CORNERS), np.nan)
        rows[:, 0] = 0.0
        numbers = sorted({1, len(regions)}) if regions else []
        for row, number in zip(rows, numbers, strict=False):
            polygon = regions[number - 1]
            corners = polygon[:: 1 + (len(polygon) - 1) // MOST_CORNERS]
            row[0] = number
            row[1 : 1 + corners.size] = corners.ravel()
        output.SetFromVector(rows.ravel())


def add_region_log(
    builder: DiagramBuilder, regions: OutputPort
) -> VectorLogSink:
    """Adds a log of capture regions.

    Args:
        builder: builder of the diagram.
        regions: port of the capture regions, in the builder.

    Returns:
        The log, a row every REGIONS_PERIOD.
    """
    corners = builder.AddNamedSystem("region_corners", RegionCorners())
    builder.Connect(regions, corners.get_input_port())
    log = LogVectorOutput(
        corners.get_output_port(), builder, publish_period=REGIONS_PERIOD
    )
    log.set_name("region_log")
    return log


def region_rows(times: Array, rows: Array) -> Array:
    """Unpacks what a log of RegionCorners has.

    Args:
        times: of the log (n,) [s].
        rows: of the log (n, m).

    Returns:
        (k, 4): time [s], n of C_n, and x, y [m] of each corner.
    """
    regions = rows.reshape(2 * len(rows), _SIZE // 2)
    number = regions[:, 0].repeat(MOST_CORNERS)
    corners = regions[:, 1:].reshape(-1, 2)
    time = times.repeat(2 * MOST_CORNERS)
    is_given = np.isfinite(corners[:, 0])
    return np.column_stack([time, number, corners])[is_given]
