"""The contract of all systems: documented ports, feedthrough, no hidden state.

The systems are taken out of the closed diagrams, where they get real inputs.
"""

import importlib
import inspect
import pkgutil
import textwrap
from collections.abc import Iterator

import numpy as np
import pytest
import yaml
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, LeafSystem, System

import nadia_balance.systems
from nadia_balance.balance_controller import BalanceController
from nadia_balance.capture_point_controller import CapturePointController
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.results.scene import start_meshcat
from nadia_balance.systems.mujoco_plant import PointContacts

# output port: the input ports that it depends on within the same instant.
ICP_CONTROL = {"icp", "icp_reference", "walking_state"}
JOINT_CONTROL = {
    "whole_body_terms",
    "momentum_rate",
    "swing_foot_reference",
    "walking_state",
    "friction",
}
STEP_ADJUSTMENT = {
    "icp",
    "walking_state",
    "time_adjustment",
    "foot_poses",
    "mechanisms",
}
TIME_ADJUSTMENT = {
    "icp",
    "icp_plan",
    "walking_state",
    "mechanisms",
    "foot_poses",
}
STEP_CONTROL = STEP_ADJUSTMENT - {"foot_poses"} | {"icp_plan"}
FEEDTHROUGH = {
    "BalanceVisualizer": {},
    "CaptureRegionStepAdjuster": {
        "adjustment": STEP_ADJUSTMENT,
        "capture_regions": STEP_ADJUSTMENT,
    },
    "CentroidalEstimator": {
        "com_state": {"predicted_state"},
        "icp": {"predicted_state"},
        "foot_poses": {"predicted_state"},
        "whole_body_terms": {"predicted_state"},
    },
    "ComHeightController": {
        "momentum_rate": {"com_state", "ecmp_command", "walking_state"}
    },
    "FootForceSensor": {"foot_forces": set()},  # held between two ticks
    "FrictionEstimator": {"friction": set()},  # one tick late
    "IcpStepController": {
        "adjustment": STEP_CONTROL,
        "capture_regions": STEP_CONTROL,
        "ecmp_command": STEP_CONTROL,
        "momentum_qp_status": STEP_CONTROL,
        "icp_reference": STEP_CONTROL,
    },
    "IcpPlanner": {
        "icp_plan": {"walking_state"},
        "icp_reference": {"walking_state"},
    },
    "JointDrives": {"torques": set()},  # one step late
    "LiveControls": {"live_push": set(), "mechanisms": set()},
    "MomentumQp": {
        "ecmp_command": ICP_CONTROL,
        "momentum_qp_status": ICP_CONTROL,
    },
    "MujocoPlant": {
        "state": set(),
        "contact_results": {"actuation", "applied_spatial_force"},
    },
    "PointMassPlant": {
        "com_state": set(),
        "icp": set(),
        "foot_poses": {"walking_state"},
        "foot_forces": {"walking_state"},
    },
    "PushSource": {
        "push_force": set(),
        "push_signal": set(),
        "spatial_forces": set(),
    },
    "StatePredictor": {"predicted_state": {"estimated_state"}},
    "StateSensor": {"measured_state": set(), "measured_foot_forces": set()},
    "TimingAdapter": {"time_adjustment": TIME_ADJUSTMENT},
    "SwingFootPlanner": {"swing_foot_reference": {"walking_state"}},
    "WalkingStateMachine": {"walking_state": set(), "walking_signal": set()},
    "WholeBodyInverseDynamics": {
        "actuation": JOINT_CONTROL,
        "foot_wrenches": JOINT_CONTROL,
        "whole_body_qp_status": JOINT_CONTROL,
        "generalized_acceleration": JOINT_CONTROL,
    },
}


def leaf_systems() -> Iterator[type[LeafSystem]]:
    """All LeafSystem classes defined in nadia_balance.systems."""
    for module_info in pkgutil.iter_modules(nadia_balance.systems.__path__):
        name = f"nadia_balance.systems.{module_info.name}"
        for value in vars(importlib.import_module(name)).values():
            if (
                inspect.isclass(value)
                and issubclass(value, LeafSystem)
                and value.__module__ == name
            ):
                yield value


LEAVES = sorted(leaf_systems(), key=lambda kind: kind.__name__)
DIAGRAMS = [CapturePointController, BalanceController]


def systems_in(diagram: Diagram) -> Iterator[System]:
    for system in diagram.GetSystems():
        yield system
        if isinstance(system, Diagram):
            yield from systems_in(system)


@pytest.fixture(scope="module")
def diagrams() -> list[Diagram]:
    text = (
        "{fidelity: realistic, mechanisms: all_with_cross_over, "
        "imperfections: {delay: 0.004}}"
    )
    scenario = load_scenario("walk_in_place", text=text)
    text = "{mechanisms: step_swing, controller: {icp_step_qp: {}}}"
    by_qp = load_scenario("walk_in_place", text=text)
    return [
        HumanoidDiagram(scenario, start_meshcat()[0]),
        LipmDiagram(scenario),
        LipmDiagram(by_qp),
        HumanoidDiagram(load_scenario("walk_in_place", engine="mujoco")),
    ]


@pytest.fixture(scope="module")
def systems(diagrams) -> dict[type, System]:
    """One instance of every class, from the first diagram that has it."""
    found: dict[type, System] = {}
    for diagram in diagrams:
        for system in systems_in(diagram):
            found.setdefault(type(system), system)
    return found


def input_names(system: System) -> list[str]:
    count = range(system.num_input_ports())
    return [system.get_input_port(i).get_name() for i in count]


def output_names(system: System) -> list[str]:
    count = range(system.num_output_ports())
    return [system.get_output_port(i).get_name() for i in count]


@pytest.mark.parametrize("kind", LEAVES + DIAGRAMS)
def test_docstring_lists_the_real_ports(kind, systems):
    """Oracle: the ports that the system itself reports, in order."""
    block = inspect.getdoc(kind).split(".. pydrake_system::")[1]
    documented = yaml.safe_load(textwrap.dedent(block))
    assert documented == {
        "name": kind.__name__,
        "input_ports": input_names(systems[kind]),
        "output_ports": output_names(systems[kind]),
    }


@pytest.mark.parametrize("kind", LEAVES)
def test_outputs_depend_at_once_on_no_more_than_they_must(kind, systems):
    """Oracle: the table of architecture decisions above."""
    system = systems[kind]
    inputs, outputs = input_names(system), output_names(system)
    assert FEEDTHROUGH[kind.__name__] == {
        output: {
            name
            for i, name in enumerate(inputs)
            if system.HasDirectFeedthrough(i, j)
        }
        for j, output in enumerate(outputs)
    }


def our_outputs(diagram: Diagram, root: Context) -> dict[str, str]:
    """Every output of our systems in `diagram`, to the last bit, as text."""
    values = {}
    for system in systems_in(diagram):
        if not type(system).__module__.startswith("nadia_balance."):
            continue
        context = system.GetMyContextFromRoot(root)
        for name in output_names(system):
            value = system.GetOutputPort(name).Eval(context)
            values[f"{system.GetSystemPathname()}:{name}"] = text(value)
    return values


def text(value: object) -> str:
    """Equal for equal numbers, arrays and dataclasses, and only for them."""
    # The repr of what is Drake's is an address.
    if isinstance(value, list):
        value = [(f.body_index, f.F_Bq_W.get_coeffs()) for f in value]
    if isinstance(value, PointContacts):
        value = [(c.contact_force(), c.contact_point()) for c in value.pairs]
    with np.printoptions(floatmode="unique", threshold=10**6):
        return repr(value)


@pytest.mark.parametrize(
    "index", range(4), ids=["humanoid", "lipm", "by qp", "mujoco"]
)
def test_equal_contexts_give_equal_outputs(index, diagrams):
    """Oracle: the state that a run led to, given to new contexts.

    A system that keeps anything on itself would remember the start, which is
    looked at in between.  A cache entry that misses one of its prerequisites
    would be out of date in the run's own context.
    """
    diagram = diagrams[index]
    simulator = Simulator(diagram)
    diagram.set_initial_state(simulator.get_mutable_context())
    simulator.AdvanceTo(1.2)  # into the first swing
    run = simulator.get_context()
    at_start, at_end = [], [our_outputs(diagram, run)]
    for _ in range(2):
        context = diagram.CreateDefaultContext()
        diagram.set_initial_state(context)
        at_start.append(our_outputs(diagram, context))
        context.SetTimeStateAndParametersFrom(run)
        at_end.append(our_outputs(diagram, context))
    assert at_start[0] == at_start[1] != at_end[0]
    assert at_end[0] == at_end[1] == at_end[2]
