"""The whole robot in closed loop, moved by MuJoCo."""

import numpy as np
from pydrake.systems.analysis import Simulator

from nadia_balance.diagrams.simulation import start
from tests.diagrams.simulated import EARLY, diagram_of, simulated

PUSHED = (
    "{engine: mujoco, duration: 2.8, calm_steps: 0, mechanisms: step, "
    f"{EARLY % 'num_steps: 2, transfer_duration: 0.3'}, "
    "time_step: 0.001, "
    "pushes: [{delta_v: 0.2, at: right swing 25 %, direction_deg: 90}]}"
)


def test_recovers_by_steps():
    """Oracle: the verdict, that of any engine."""
    found = simulated(PUSHED).summary
    assert found["recovered"], found["reason"]
    assert found["max_torque_ratio"] <= 1.0 + 1e-8
    assert found["stance_slip_m"] < 0.002
    assert not found["self_contacts"]


def test_a_copied_context_goes_on_with_the_same_bits():
    """Oracle: the run itself; the contexts take turns with one MuJoCo."""
    diagram = diagram_of(PUSHED)
    first = start(diagram)
    first.AdvanceTo(0.6)
    second = Simulator(diagram, first.get_context().Clone())
    second.Initialize()
    for time in (0.65, 0.7):
        first.AdvanceTo(time)
        second.AdvanceTo(time)
    engine, roots = diagram.engine, [s.get_context() for s in (first, second)]
    own = map(engine.GetMyContextFromRoot, roots)
    x, y = map(engine.GetOutputPort("state").Eval, own)
    assert np.array_equal(x, y)
    log = simulated(PUSHED).logs
    row = np.searchsorted(log["t"], 0.7 - 1e-9)
    assert np.array_equal(x, log["state"][row])
