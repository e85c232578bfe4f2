"""No number that is none gets through a block: it names itself and the port.

The blocks are taken out of the closed diagrams, in the middle of a swing.
"""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import System

from diagrams.humanoid import HumanoidDiagram
from diagrams.lipm import LipmDiagram
from diagrams.scenario import load_scenario
from tests.test_ports import systems_in

MID_SWING = 1.65  # [s]
PORTS = [
    (HumanoidDiagram, "centroidal_estimator", "estimated_state"),
    (HumanoidDiagram, "whole_body_inverse_dynamics", "estimated_state"),
    (HumanoidDiagram, "whole_body_inverse_dynamics", "momentum_rate"),
    (HumanoidDiagram, "whole_body_inverse_dynamics", "swing_foot_reference"),
    (LipmDiagram, "momentum_qp", "com_state"),
    (LipmDiagram, "momentum_qp", "icp"),
    (LipmDiagram, "momentum_qp", "icp_reference"),
    (LipmDiagram, "plant", "ecmp_command"),
    (LipmDiagram, "plant", "push_force"),
    (LipmDiagram, "plant", "swing_foot_reference"),
    (LipmDiagram, "step_adjuster", "icp"),
    (LipmDiagram, "step_adjuster", "time_adjustment"),
    (LipmDiagram, "timing_adapter", "icp"),
    (LipmDiagram, "walking_state_machine", "foot_forces"),
    (LipmDiagram, "walking_state_machine", "icp"),
    (LipmDiagram, "walking_state_machine", "time_adjustment"),
]


@pytest.fixture(scope="module")
def runs() -> dict[type, Simulator]:
    """Both diagrams in the middle of a swing; nothing moves them on."""
    text = "{mechanisms: all_with_cross_over}"
    scenario = load_scenario("walk_in_place", text=text)
    simulators = {}
    for kind in (HumanoidDiagram, LipmDiagram):
        simulators[kind] = simulator = Simulator(kind(scenario))
        simulator.get_system().set_initial_state(
            simulator.get_mutable_context()
        )
        simulator.AdvanceTo(MID_SWING)
    return simulators


def test_knows_all_vector_inputs_that_are_in_use(runs):
    """Oracle: the ports that our systems report themselves."""
    found = {
        (block.get_name(), port.get_name())
        for simulator in runs.values()
        for block in systems_in(simulator.get_system())
        if type(block).__module__.startswith("nadia_balance.systems.")
        for port in connected_vectors(block, simulator)
    }
    assert found == {(block, port) for _, block, port in PORTS}


def connected_vectors(block: System, simulator: Simulator):
    context = block.GetMyContextFromRoot(simulator.get_context())
    ports = [block.get_input_port(i) for i in range(block.num_input_ports())]
    return [p for p in ports if p.size() and p.HasValue(context)]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize(("diagram", "name", "port"), PORTS)
def test_whatever_depends_on_it_is_an_error(runs, diagram, name, port, bad):
    """Oracle: the message, from each output that depends on the port.

    If none does, it is the update that must not take it.
    """
    root = runs[diagram].get_context()
    (block,) = (
        system
        for system in systems_in(runs[diagram].get_system())
        if system.get_name() == name
    )
    alone = Simulator(block)
    context = alone.get_mutable_context()
    source = block.GetMyContextFromRoot(root)
    context.SetTimeStateAndParametersFrom(source)
    for i in range(block.num_input_ports()):
        value = block.get_input_port(i)
        if value.HasValue(source):
            value.FixValue(context, value.Eval(source))
    spoilt = block.GetInputPort(port)
    spoilt.FixValue(context, np.full(spoilt.size(), bad))
    outputs = [
        block.get_output_port(j) for j in range(block.num_output_ports())
    ]
    dependent = [
        (lambda output=output: output.Eval(context))
        for output in outputs
        if block.HasDirectFeedthrough(spoilt.get_index(), output.get_index())
    ]
    for act in dependent or [lambda: alone.AdvanceTo(MID_SWING + 0.002)]:
        with pytest.raises(
            RuntimeError, match=f"^{name}: input port '{port}' is not finite"
        ):
            act()
