"""How much work a control tick is: counted, so the same on every machine."""

import sys
from collections import Counter
from collections.abc import Callable
from types import FrameType

import pytest
from pydrake.geometry import QueryObject
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import CacheEntry, InputPort, OutputPort

from nadia_balance.core.math.daqp_solver import solve_arrays
from nadia_balance.diagrams.simulation import start
from tests import run_cache
from tests.diagrams.simulated import diagram_of

TICKS = 100
TEXT = "{mechanisms: all_with_cross_over, gait: {num_steps: 6}}"
# The means of a tick in steps in place, all mechanisms on, as measured when
# this was written, and a few per cent more.  Who makes a tick lighter lowers
# them; who makes it heavier says why.  Three evaluations, and 20 calls, ask
# whether the velocity command has changed.
BOUNDS = {
    "Python calls": 400,
    "evaluations": 68,
    "Jacobians": 3.0,
    "quadratic programs": 2.0,
    "distance queries": 0.0,
}
# What Drake is asked for: by class, and the beginning of the method's name.
ASKED = {
    (CacheEntry, "Eval"): "evaluations",
    (InputPort, "Eval"): "evaluations",
    (OutputPort, "Eval"): "evaluations",
    (MultibodyPlant, "CalcJacobian"): "Jacobians",
    (QueryObject, "ComputeSignedDistancePair"): "distance queries",
}
# They are calls until Python 3.11 and none from 3.12 on: never counted.
COMPREHENSIONS = "<dictcomp>", "<listcomp>", "<setcomp>"


def is_ours(frame: FrameType) -> bool:
    """True for a call of this package: of other packages each version differs.

    That are Python's own modules, numpy's and Drake's.
    """
    module = frame.f_globals.get("__name__", "")
    is_package = module.split(".")[0] == "nadia_balance"
    return is_package and frame.f_code.co_name not in COMPREHENSIONS


def counting(counts: Counter, name: str, method: Callable) -> Callable:
    """Returns a method that counts its calls under `name`.

    Python's profiler sees no bound method of Drake from Python 3.12 on.
    """

    def counted_method(*args, **kwargs):
        counts[name] += 1
        return method(*args, **kwargs)

    return counted_method


def counted() -> dict[str, float]:
    """What a tick does, the mean of some in a swing and a transfer."""
    counts = Counter()

    def count(frame, event, _):
        if event == "call":
            counts["Python calls"] += is_ours(frame)
            is_solve = frame.f_code is solve_arrays.__code__
            counts["quadratic programs"] += is_solve

    with pytest.MonkeyPatch.context() as patch:
        for (kind, beginning), name in ASKED.items():
            methods = [m for m in dir(kind) if m.startswith(beginning)]
            assert methods, f"Drake has no {beginning}"
            for method in methods:
                original = getattr(kind, method)
                patch.setattr(kind, method, counting(counts, name, original))
        diagram = diagram_of(TEXT)
        simulator = start(diagram)
        simulator.AdvanceTo(1.3)
        counts.clear()
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

    That are feedback and whole body; two soles and the torso; a port at least
    for each of the controller's blocks, which are more than ten.
    """
    work = run_cache.once(__name__, "", counted)
    least = {"quadratic programs": 2.0, "Jacobians": 3.0}
    least |= {"Python calls": 100.0, "evaluations": 10.0}
    assert least.get(name, 0.0) <= work[name] <= BOUNDS[name]
