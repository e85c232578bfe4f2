"""Logs that cost next to nothing: every signal is sampled once a tick."""

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, ZeroOrderHold

SUFFIX = "_log"


def log_signals(builder: DiagramBuilder, period: float, ports: dict) -> None:
    """Logs the vector `ports` (name -> OutputPort) once per `period` [s].

    A publish event sees the state after the update, so that logging a
    computed port directly would compute everything a second time.  A hold
    samples it in the update itself, where it has been computed already; the
    log then reads the hold one period later.
    """
    for name, port in ports.items():
        hold = builder.AddNamedSystem(
            f"{name}_hold", ZeroOrderHold(period, port.size())
        )
        builder.Connect(port, hold.get_input_port())
        log_state(builder, period, name, hold.get_output_port())


def log_state(builder: DiagramBuilder, period: float, name: str, port) -> None:
    """Logs a `port` that depends on held state only."""
    sink = LogVectorOutput(port, builder, publish_period=period)
    sink.set_name(f"{name}{SUFFIX}")


def read_logs(
    diagram: Diagram, context: Context, now: set[str]
) -> dict[str, np.ndarray]:
    """Returns name -> (n, size) of all logs, and `t` (n,) [s].

    What is held was computed one period before it is logged; the names in
    `now` were logged at once.  Both are brought to the same instants here.
    """
    logs: dict[str, np.ndarray] = {}
    for system in diagram.GetSystems():
        name = system.get_name()
        if not name.endswith(SUFFIX):
            continue
        log = system.FindLog(context)
        data = log.data().T.copy()
        key = name.removesuffix(SUFFIX)
        logs["t"] = log.sample_times()[:-1].copy()
        logs[key] = data[:-1] if key in now else data[1:]
    return logs
