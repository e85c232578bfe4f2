"""Log of vector signals, sampled once per control tick."""

import numpy as np
from pydrake.systems.framework import Context, DiagramBuilder, OutputPort
from pydrake.systems.primitives import LogVectorOutput, Multiplexer

from nadia_balance.core.ground import Ground
from nadia_balance.core.reachability import ReachabilityParams, step_regions


class SignalLog:
    """Logs vector ports once per control period.

    Drake publishes at t before the updates of t, so row t contains the state,
    the references and the torques of t, all from the same x-.  The updates
    reuse the outputs that the log has evaluated from the cache.
    """

    def __init__(
        self,
        builder: DiagramBuilder,
        period: float,
        ports: dict[str, OutputPort],
    ):
        """Adds systems that log `ports`, by name, every `period` [s]."""
        self._sizes = {name: port.size() for name, port in ports.items()}
        multiplexer = builder.AddNamedSystem(
            "log_multiplexer", Multiplexer(list(self._sizes.values()))
        )
        for i, port in enumerate(ports.values()):
            builder.Connect(port, multiplexer.get_input_port(i))
        self._sink = LogVectorOutput(
            multiplexer.get_output_port(), builder, publish_period=period
        )
        self._sink.set_name("log")

    def forget(self, context: Context) -> None:
        """Clears the log."""
        self._sink.FindMutableLog(context).Clear()

    def read(self, context: Context) -> dict[str, np.ndarray]:
        """Returns name -> (n, size), and the times `t` (n,) [s].

        Row i contains the values at t[i], before its updates.
        """
        log = self._sink.FindLog(context)
        t, data = log.sample_times().copy(), log.data().T
        # A simulation from a cloned Context logs its first row a second time.
        last = np.diff(t, append=np.inf) > 0.0
        if not np.all(last):
            t, data = t[last], data[last]
        ends = np.cumsum(list(self._sizes.values()))[:-1]
        columns = np.split(data, ends, axis=1)
        return {"t": t, **dict(zip(self._sizes, columns, strict=True))}


def ground_logs(ground: Ground | None) -> dict[str, np.ndarray]:
    """Returns the corners of all regions to step on; none if it is flat."""
    if ground is None:
        return {}
    corners = [
        np.column_stack([np.full(len(region.polygon), i), region.polygon])
        for i, region in enumerate(ground.regions)
        if not region.obstacle
    ]
    return {"ground": np.concatenate(corners)}


def region_logs(reach: ReachabilityParams) -> dict[str, np.ndarray]:
    """Returns all regions (n, 2) [m] of possible footholds.

    They include those for crossed legs, which may be switched on in a run.
    """
    regions = step_regions(reach, cross_over=True)
    return {f"region_{name}": region for name, region in regions.items()}
