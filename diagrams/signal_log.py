"""A log that costs next to nothing: every signal is sampled once a tick."""

import numpy as np
from pydrake.systems.framework import Context, DiagramBuilder, OutputPort
from pydrake.systems.primitives import LogVectorOutput, Multiplexer

from nadia_balance.core.ground import Ground
from nadia_balance.core.reachability import ReachabilityParams, step_regions


class SignalLog:
    """Logs vector ports once per control period.

    A plain publish is enough: Drake publishes at t before the updates of t, so
    that row t has the state, the references and the torques of t, all from the
    same x-.  The updates then find in the cache what the log has evaluated:
    nothing is computed twice.
    """

    def __init__(
        self,
        builder: DiagramBuilder,
        period: float,
        ports: dict[str, OutputPort],
    ):
        """Adds what it takes to log `ports`, by name, every `period` [s]."""
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
        """Drops all that was logged."""
        self._sink.FindMutableLog(context).Clear()

    def read(self, context: Context) -> dict[str, np.ndarray]:
        """Returns name -> (n, size), and the times `t` (n,) [s].

        Row i is what held at t[i], before its updates.
        """
        log = self._sink.FindLog(context)
        t, data = log.sample_times().copy(), log.data().T
        # Who goes on from a copy of a Context logs its last row once more.
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
    """Returns all regions (n, 2) [m] that a step can be put into.

    Those for crossed legs too, whether or not that is allowed: it may be
    switched on meanwhile.
    """
    regions = step_regions(reach, cross_over=True)
    return {f"region_{name}": region for name, region in regions.items()}
