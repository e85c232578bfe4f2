"""A row of the log is one instant: what every port has then."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant

from nadia_balance.diagrams.simulation import start
from nadia_balance.results import pushes
from tests.diagrams.simulated import diagram_of


@pytest.mark.parametrize("plant", ["lipm", "humanoid"])
def test_equals_the_ports_at_that_instant(plant):
    """Oracle: every logged port, evaluated by hand; exactly equal.

    The log has the time and the size of the push that the scenario asks for.
    """
    text = "{gait: {num_steps: 2}, pushes: [{delta_v: 0.1, at: 0.2 s}]}"
    diagram = diagram_of(text, plant)
    simulator = start(diagram)
    period = diagram.push.period
    k = round(0.252 / period)  # within the push
    simulator.AdvanceTo(period * k)
    by_hand = simulator.get_context().Clone()
    logs = diagram.read_logs(simulator.get_context())
    assert logs["t"][k] == pytest.approx(period * k)
    (push,) = pushes(logs)
    assert push.start == pytest.approx(0.2)
    assert push.delta_v == pytest.approx(0.1)
    newtons = diagram.robot.mass * 0.1 / 0.1
    assert np.linalg.norm(push.force) == pytest.approx(newtons)
    ports = ports_of(diagram)
    rows = len(logs["t"])
    names = {n for n, a in logs.items() if a.ndim == 2 and len(a) == rows}
    # Computed from the state; constant.
    names -= {"foot_poses", "trunk_tilt", "mechanisms"}
    assert len(names) >= 10
    for name in names:
        context = ports[name].get_system().GetMyContextFromRoot(by_hand)
        assert np.array_equal(ports[name].Eval(context), logs[name][k]), name


def ports_of(diagram):
    """Name -> output port, under the names of the log; outermost first."""
    systems, ports = [diagram], {}
    for system in systems:
        if hasattr(system, "GetSystems"):
            systems += system.GetSystems()
        for i in range(system.num_output_ports()):
            port = system.get_output_port(i)
            ports.setdefault(port.get_name(), port)
    if isinstance(diagram.plant, MultibodyPlant):
        ports["state"] = diagram.plant.get_state_output_port()
        if diagram.robot.drives is None:
            ports["torques"] = ports["actuation"]
    return ports
