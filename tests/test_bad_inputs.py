"""No bad value gets through a block: it names itself and the port.

The blocks are taken out of the closed diagrams, in the middle of a swing.
"""

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, System

from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import load_scenario
from tests.blocks import fix
from tests.test_ports import systems_in

OURS = ("nadia_balance.engines.", "nadia_balance.systems.")
MID_SWING = 0.68  # as a tick is due [s]
PORTS = {
    HumanoidDiagram: {
        "centroidal_estimator": "predicted_state",
        "whole_body_inverse_dynamics": (
            "whole_body_terms momentum_rate swing_foot_reference walking_state "
            "friction"
        ),
        "imu": "state",
        "joint_encoders": "state",
        "state_estimator": "imu joints foot_forces",
        "state_sensor": "state foot_forces",
        "state_predictor": "estimated_state generalized_acceleration",
        "friction_estimator": "whole_body_terms foot_wrenches",
        "joint_drives": "actuation state",
    },
    LipmDiagram: {
        "walking_state_machine": (
            "foot_poses foot_forces icp icp_plan time_adjustment adjustment"
        ),
        "icp_planner": "walking_state",
        "timing_adapter": "icp icp_plan walking_state foot_poses mechanisms",
        "step_adjuster": (
            "alip_icp walking_state time_adjustment foot_poses mechanisms"
        ),
        "momentum_qp": "icp icp_reference walking_state",
        "com_height_controller": "com_state ecmp_command walking_state",
        "swing_foot_planner": "walking_state",
        "plant": "ecmp_command swing_foot_reference walking_state push_force",
        "push_source": "walking_state",
    },
}
CASES = [
    (kind, block, port)
    for kind, blocks in PORTS.items()
    for block, ports in blocks.items()
    for port in ports.split()
]


@pytest.fixture(scope="module")
def runs() -> dict[type, Simulator]:
    """Both diagrams in the middle of a swing; nothing moves them on.

    The push is still to come, so that its source watches the walking state;
    with sensors and a delay, all blocks of measurements are there.
    """
    text = (
        "{fidelity: realistic, mechanisms: all_with_cross_over, "
        "imperfections: {delay: 0.004}, pushes: [{delta_v: 0.1, at: 5 s}], "
        "gait: {initial_transfer_duration: 0.4, standing_duration: 0.05, "
        "num_steps: 2}}"
    )
    scenario = load_scenario("walk_in_place", text=text)
    simulators = {}
    for kind, sensors in zip(PORTS, ("consumer", "perfect"), strict=True):
        made = kind(replace(scenario, sensors=sensors))
        simulators[kind] = simulator = Simulator(made)
        simulator.get_system().set_initial_state(
            simulator.get_mutable_context()
        )
        simulator.AdvanceTo(MID_SWING)
    return simulators


def our_blocks(simulator: Simulator) -> Iterator[tuple[System, Context]]:
    """The blocks of a diagram, and their contexts."""
    for block in systems_in(simulator.get_system()):
        if type(block).__module__.startswith(OURS):
            yield block, block.GetMyContextFromRoot(simulator.get_context())


def connected(block: System, context: Context) -> dict[str, object]:
    """The values of its inputs by name, as far as there are any."""
    ports = map(block.get_input_port, range(block.num_input_ports()))
    return {p.get_name(): p.Eval(context) for p in ports if p.HasValue(context)}


def test_knows_all_inputs_that_are_in_use(runs):
    """Oracle: the ports that our systems report themselves."""
    found = {
        (block.get_name(), port)
        for simulator in runs.values()
        for block, context in our_blocks(simulator)
        for port in connected(block, context)
    }
    # Drake's own type, of which Drake takes care.
    found.remove(("foot_force_sensor", "contact_results"))
    assert found == {(block, port) for _, block, port in CASES}


@pytest.mark.parametrize(("diagram", "name", "port"), CASES)
def test_whatever_depends_on_it_is_an_error(runs, diagram, name, port):
    """Oracle: the message, from each output that depends on the port.

    If none does, it is the update that must not take it.
    """
    block, source = next(
        (block, context)
        for block, context in our_blocks(runs[diagram])
        if block.get_name() == name
    )
    value = connected(block, source)[port]
    if isinstance(value, np.ndarray):
        what = "is not finite"
        spoilt = [np.append(value[:-1], bad) for bad in (np.nan, -np.inf)]
        spoilt.append(np.append(np.inf, value[1:]))
    else:
        what, spoilt = "got a tuple, needs a [WFIA]", [("no", "such", "thing")]
    index = block.GetInputPort(port).get_index()
    outputs = map(block.get_output_port, range(block.num_output_ports()))
    dependent = [
        output
        for output in outputs
        if block.HasDirectFeedthrough(index, output.get_index())
    ]
    message = f"^{re.escape(name)}: input port '{port}' {what}"
    for bad in spoilt:
        alone = Simulator(block)
        context = alone.get_mutable_context()
        context.SetTimeStateAndParametersFrom(source)
        fix(block, context, **connected(block, source) | {port: bad})
        for output in dependent:
            with pytest.raises((RuntimeError, TypeError), match=message):
                output.Eval(context)
        if not dependent:
            with pytest.raises((RuntimeError, TypeError), match=message):
                alone.AdvanceTo(MID_SWING + 0.002)
