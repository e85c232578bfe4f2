"""How much work a control tick is: counted, so the same on every machine."""

import sys
from collections import Counter

import pytest

from nadia_balance.core.math.daqp_solver import DaqpSolver
from nadia_balance.diagrams.simulation import start
from tests import run_cache
from tests.diagrams.simulated import diagram_of

TICKS = 100
TEXT = "{mechanisms: all_with_cross_over, gait: {num_steps: 6}}"
# The means of a tick in steps in place, all mechanisms on, as measured when
# this was written, and a few per cent more.  Who makes a tick lighter lowers
# them; who makes it heavier says why.
BOUNDS = {
    "Python calls": 690,
    "port evaluations": 74,
    "Jacobians": 3.0,
    "quadratic programs": 2.0,
    "distance queries": 0.0,
}


def counted() -> dict[str, float]:
    """What a tick does, the mean of some in a swing and a transfer."""
    diagram = diagram_of(TEXT)
    simulator = start(diagram)
    simulator.AdvanceTo(1.3)
    counts = Counter()

    def count(frame, event, function):
        if event == "call":
            counts["Python calls"] += 1
            is_solve = frame.f_code is DaqpSolver.solve.__code__
            counts["quadratic programs"] += is_solve
        elif event == "c_call":
            name = function.__name__
            counts["port evaluations"] += name == "Eval"
            counts["Jacobians"] += name.startswith("CalcJacobian")
            is_query = name.startswith("ComputeSignedDistancePair")
            counts["distance queries"] += is_query

    period = diagram.scenario.controller.control_period
    sys.setprofile(count)
    try:
        simulator.AdvanceTo(1.3 + TICKS * period)
    finally:
        sys.setprofile(None)
    return {name: counts[name] / TICKS for name in BOUNDS}


@pytest.mark.parametrize("name", BOUNDS)
def test_a_tick_does_no_more_than_it_did(name):
    """Oracles: Python's own profiler; the wiring, for what is counted at all.

    That are feedback and whole body; two soles and the torso.
    """
    work = run_cache.once(__name__, "", counted)
    least = {"quadratic programs": 2.0, "Jacobians": 3.0}
    assert least.get(name, 0.0) <= work[name] <= BOUNDS[name]
