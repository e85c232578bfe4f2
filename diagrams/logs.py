"""A log that costs next to nothing: every signal is sampled once a tick."""

from dataclasses import replace

import numpy as np
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    OutputPort,
)
from pydrake.systems.primitives import (
    LogVectorOutput,
    Multiplexer,
    ZeroOrderHold,
)

from nadia_balance.core.reachability import ReachabilityParams, step_regions


class SignalLog:
    """Logs vector ports once per control period.

    A publish event sees the state after the update, so that logging a
    computed port would compute everything a second time.  A hold samples all
    signals in the update itself, where they have been computed already; the
    log then reads the hold, one period later.
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
        hold = builder.AddNamedSystem(
            "log_hold", ZeroOrderHold(period, sum(self._sizes.values()))
        )
        builder.Connect(multiplexer.get_output_port(), hold.get_input_port())
        self._sink = LogVectorOutput(
            hold.get_output_port(), builder, publish_period=period
        )
        self._sink.set_name("log")

    def read(self, context: Context) -> dict[str, np.ndarray]:
        """Returns name -> (n, size), and the times `t` (n,) [s].

        Row i is what was computed at t[i].
        """
        log = self._sink.FindLog(context)
        ends = np.cumsum(list(self._sizes.values()))[:-1]
        columns = np.split(log.data().T[1:], ends, axis=1)
        return {
            "t": log.sample_times()[:-1].copy(),
            **dict(zip(self._sizes, columns, strict=True)),
        }


def region_logs(reach: ReachabilityParams) -> dict[str, np.ndarray]:
    """Returns all regions (n, 2) [m] that a step can be put into.

    Those for crossed legs too, whether or not that is allowed: it may be
    switched on meanwhile.
    """
    crossing = replace(reach, cross_over=True)
    return {f"region_{k}": v for k, v in step_regions(crossing).items()}
