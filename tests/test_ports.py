"""The contract of all systems: ports, feedthrough, no hidden state, no NaN.

The systems are taken out of the closed diagrams, where they get real inputs.
"""

import inspect
import re
import textwrap
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import yaml
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram, LeafSystem, System

import nadia_balance
from nadia_balance.balance_controller import (
    BalanceController,
    CapturePointController,
    ControllerParams,
)
from nadia_balance.core.feedback.icp_step_qp import IcpStepQpParams
from nadia_balance.core.plan.footstep_plan import FootstepPlannerParams
from nadia_balance.core.plan.waypoints import Waypoint
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.engines.plants import PointContacts
from nadia_balance.policy.controller import PolicyController
from nadia_balance.systems.contact_clock import ContactClock
from nadia_balance.systems.given_joints import GivenJoints
from nadia_balance.systems.plan import FixedFootsteps, FootstepPlanner
from nadia_balance.systems.waypoints import WaypointFollower
from nadia_balance.view.scene import start_meshcat
from tests.blocks import answer, fix
from tests.diagrams.simulated import EARLY
from tests.example_walks import MODEL
from tests.onnx_bytes import linear_policy
from tests.test_policy_controller import GOOD, ROBOT, B, W

# output port: the input ports that it depends on within the same instant.
ICP_CONTROL = "icp icp_reference walking_state"
JOINT_CONTROL = (
    "whole_body_terms momentum_rate swing_foot_reference walking_state "
    "friction mechanisms icp icp_reference"
)
TIME_ADJUSTMENT = "icp alip_icp icp_plan walking_state mechanisms foot_poses"
STEP_ADJUSTMENT = "alip_icp walking_state time_adjustment foot_poses mechanisms"
STEP_CONTROL = "alip_icp walking_state time_adjustment mechanisms icp_plan"
HEIGHT_CONTROL = "com_state ecmp_command walking_state"
STEPS = "adjustment", "capture_regions"
WHOLE_BODY = "actuation", "foot_wrenches", "whole_body_qp_status"
WHOLE_BODY += ("generalized_acceleration", "joint_command")
QP, REFERENCE = ("ecmp_command", "momentum_qp_status"), "icp_reference"
FOOTSTEPS = dict.fromkeys(
    ("footsteps", "revised_footsteps"),
    "walking_state velocity_command alip_icp icp_plan foot_poses mechanisms",
)
FEEDTHROUGH = {
    "BalanceVisualizer": {},
    "CaptureRegionStepAdjuster": dict.fromkeys(
        (*STEPS, "no_foothold"), STEP_ADJUSTMENT
    ),
    "CentroidalEstimator": dict.fromkeys(
        ("com_state", "icp", "alip_icp", "foot_poses", "whole_body_terms"),
        "predicted_state",
    ),
    "ContactClock": {"walking_state": ""},  # one tick late
    "ComHeightController": {"momentum_rate": HEIGHT_CONTROL},
    "FootForceEstimator": {"foot_forces": "imu joints torques"},
    "FootForceSensor": {"foot_forces": "", "step_forces": ""},  # held
    "FixedFootsteps": FOOTSTEPS,
    "FootstepPlanner": FOOTSTEPS,
    "FrictionEstimator": {"friction": ""},  # one tick late
    "IcpStepController": dict.fromkeys((*STEPS, *QP, REFERENCE), STEP_CONTROL),
    "IcpPlanner": dict.fromkeys(("icp_plan", "icp_reference"), "walking_state"),
    "GivenJoints": {"joint_command": "joint_command"},
    "Imu": {"imu": "state"},
    "JointEncoders": {"joints": "state"},
    "StateEstimator": dict.fromkeys(
        ("estimated_state", "estimate_covariance"), "imu joints foot_forces"
    ),
    "JointDrives": {"torques": ""},  # one step late
    "PolicyController": {"actuation": "estimated_state"},
    "LiveControls": dict.fromkeys(
        ("live_push", "mechanisms", "velocity_command"), ""
    ),
    "MomentumQp": dict.fromkeys(QP, ICP_CONTROL),
    "MujocoPlant": {
        "state": "",
        "contact_results": "actuation applied_spatial_force",
    },
    "PointMassPlant": {
        **{"com_state": "", "icp": ""},
        **dict.fromkeys(("foot_poses", "foot_forces"), "walking_state"),
    },
    "PushSource": {"push_force": "", "push_signal": "", "spatial_forces": ""},
    "StatePredictor": {"predicted_state": "estimated_state"},
    "StateSensor": {
        "measured_state": "state",
        "measured_foot_forces": "foot_forces",
    },
    "TimingAdapter": {"time_adjustment": TIME_ADJUSTMENT},
    "SwingFootPlanner": {"swing_foot_reference": "walking_state"},
    "VelocityCommands": {"velocity_command": ""},
    "WaypointFollower": {
        "velocity_command": "walking_state foot_poses com_state predicted_state"
    },
    "WalkingStateMachine": {"walking_state": "", "walking_signal": ""},
    "WholeBodyInverseDynamics": dict.fromkeys(WHOLE_BODY, JOINT_CONTROL),
}


# test_front_door says that these are all there are.
LEAVES = [
    kind
    for kind in (getattr(nadia_balance, name) for name in nadia_balance.__all__)
    if inspect.isclass(kind) and issubclass(kind, LeafSystem)
]
DIAGRAMS = [CapturePointController, BalanceController]
# Drake's, and Meshcat's own numbers; and what only the end of a phase reads,
# tested in systems/test_walking_state_machine.py.
FOR_TASKS = "mechanisms", "icp", "icp_reference"
UNCHECKED = "contact_results", "live_push", "footsteps", "revised_footsteps"
MID_SWING, LATER = 0.68, 0.682  # as ticks are due [s]


def systems_in(diagram: Diagram) -> Iterator[System]:
    for system in diagram.GetSystems():
        yield system
        if isinstance(system, Diagram):
            yield from systems_in(system)


@pytest.fixture(scope="module")
def diagrams() -> list[Diagram]:
    real = "fidelity: realistic, mechanisms: all_with_cross_over, "
    real += "pushes: [{delta_v: 0.1, at: 5 s}], "
    delay = "imperfections: {delay: 0.004}, "
    qp = "mechanisms: step_swing, controller: {icp_step_qp: {}}, "

    def scenario(text="", **changes):
        text = f"{{{text}{EARLY % 'num_steps: 2'}}}"
        return load_scenario("walk_in_place", text=text, **changes)

    return [
        HumanoidDiagram(
            scenario(real + delay, sensors="proprioceptive"), start_meshcat()[0]
        ),
        LipmDiagram(scenario(real)),
        LipmDiagram(scenario(qp)),
        HumanoidDiagram(scenario(engine="mujoco")),
    ]


@pytest.fixture(scope="module")
def simulators(diagrams) -> list[Simulator]:
    """All of them in the middle of the first swing; nothing moves them on."""
    all_simulators = list(map(Simulator, diagrams))
    for diagram, simulator in zip(diagrams, all_simulators, strict=True):
        diagram.set_initial_state(simulator.get_mutable_context())
        simulator.AdvanceTo(MID_SWING)
    return all_simulators


@pytest.fixture(scope="module")
def systems(diagrams, tmp_path_factory) -> dict[type, System]:
    """One instance of every class, from the first diagram that has it."""
    policy = tmp_path_factory.mktemp("policy") / "policy.onnx"
    policy.write_bytes(linear_policy(W, B, **GOOD))
    by_class: dict[type, System] = {
        PolicyController: PolicyController(ROBOT, policy),
        ContactClock: ContactClock(1.0, 0.004),
        FootstepPlanner: FootstepPlanner(FootstepPlannerParams(), MODEL, 0.004),
        GivenJoints: GivenJoints({}, ROBOT.control_plant()),
        WaypointFollower: WaypointFollower(
            [Waypoint(0.0, 1.0, 0.0, 0.0)],
            ROBOT,
            np.outer([-1.0, 1.0], np.ones(3)),
        ),
    }
    for diagram in diagrams:
        for system in systems_in(diagram):
            by_class.setdefault(type(system), system)
    return by_class


def names(system: System, kind: str) -> list[str]:
    """Names of a block's ports; `kind` is input or output."""
    number = getattr(system, f"num_{kind}_ports")()
    port = getattr(system, f"get_{kind}_port")
    return [port(index).get_name() for index in range(number)]


@pytest.mark.parametrize("kind", LEAVES + DIAGRAMS)
def test_docstring_lists_the_real_ports(kind, systems):
    """Oracle: the ports that the system itself reports, in order."""
    block = inspect.getdoc(kind).split(".. pydrake_system::")[1]
    documented = yaml.safe_load(textwrap.dedent(block))
    assert documented == {
        "name": kind.__name__,
        "input_ports": names(systems[kind], "input"),
        "output_ports": names(systems[kind], "output"),
    }


@pytest.mark.parametrize("kind", LEAVES)
def test_outputs_depend_at_once_on_no_more_than_they_must(kind, systems):
    """Oracle: the table of architecture decisions above."""
    system = systems[kind]
    inputs, outputs = names(system, "input"), names(system, "output")
    expected = FEEDTHROUGH[kind.__name__]
    through, actual = system.HasDirectFeedthrough, {}
    for j, output in enumerate(outputs):
        actual[output] = {n for i, n in enumerate(inputs) if through(i, j)}
    assert {
        output: set(expected[output].split()) for output in expected
    } == actual


def our_outputs(diagram: Diagram, root: Context) -> dict[str, str]:
    """Every output of our systems in `diagram`, to the last bit, as text."""
    values = {}
    for system in systems_in(diagram):
        if not type(system).__module__.startswith("nadia_balance."):
            continue
        context = system.GetMyContextFromRoot(root)
        for name in names(system, "output"):
            value = answer(system, context, name)
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


@pytest.mark.parametrize("index", range(4), ids="robot lipm qp mujoco".split())
def test_equal_contexts_give_equal_outputs(index, diagrams, simulators):
    """Oracle: the state that a run led to, given to new contexts.

    A system that keeps anything on itself would remember the start, which is
    looked at in between.  A cache entry that misses one of its prerequisites
    would be out of date in the run's own context.
    """
    diagram, run = diagrams[index], simulators[index].get_context()
    at_start, at_end = [], [our_outputs(diagram, run)]
    for _ in range(2):
        context = diagram.CreateDefaultContext()
        diagram.set_initial_state(context)
        at_start.append(our_outputs(diagram, context))
        context.SetTimeStateAndParametersFrom(run)
        at_end.append(our_outputs(diagram, context))
    assert at_start[0] == at_start[1] != at_end[0]
    assert at_end[0] == at_end[1] == at_end[2]


@pytest.mark.parametrize(
    ("kind", "group", "name", "value"),
    [
        ("CaptureRegionStepAdjuster", "step_adjuster", "margin", -1.0),
        ("CaptureRegionStepAdjuster", "step_adjuster", "foot_front", 0.3),
        ("ComHeightController", "com_height", "damping_ratio", 0.0),
        ("IcpPlanner", "atlas_icp_plan", "margin", -1.0),
        ("IcpStepController", "icp_step_qp", "num_steps", 0),
        ("IcpStepController", "icp_step_qp", "cop_safe_distance", 0.06),
        ("IcpStepController", "icp_step_qp", "sole_clearance", 0.7),
        ("FootstepPlanner", "footstep_planner", "calm_error", 0.0),
        ("MomentumQp", "balance", "feedback_gain", 0.9),
        ("MomentumQp", "balance", "cop_safe_distance", 0.06),
        ("SwingFootPlanner", "swing_foot", "touchdown_velocity", -1.0),
        ("TimingAdapter", "timing_adapter", "max_speed_up", 0.5),
        ("WalkingStateMachine", "walking_state_machine", "contact_force", -1.0),
    ],
)
def test_refuses_a_bad_parameter_at_once(kind, group, name, value):
    """Oracle: field and value; soles are 0.12 m wide, the reach is 0.8 m."""
    params = ControllerParams(icp_step_qp=IcpStepQpParams())
    bad = replace(getattr(params, group), **{name: value})
    with pytest.raises(ValueError, match=f"^{name} = {value}[:,].* must"):
        getattr(nadia_balance, kind)(bad, MODEL, 0.002)


@pytest.mark.parametrize("index", [0, 1], ids=["humanoid", "lipm"])
def test_no_bad_value_gets_through_a_block(index, diagrams, simulators):
    """Oracle: the message, from each output that depends on the port.

    If none does, it is the update that must not take it.  FixedFootsteps reads
    as a FootstepPlanner only after its list (see its own tests).
    """
    root, tried = simulators[index].get_context(), 0
    rooms = "nadia_balance.engines.", "nadia_balance.systems."
    for block in systems_in(diagrams[index]):
        if isinstance(block, FixedFootsteps):
            continue
        if type(block).__module__.startswith(rooms):
            context = block.GetMyContextFromRoot(root)
            ports = map(block.get_input_port, range(block.num_input_ports()))
            values = {
                port.get_name(): port.Eval(context)
                for port in ports
                if port.HasValue(context) and port.get_name() not in UNCHECKED
            }
            if block.get_name() == "whole_body_inverse_dynamics":
                for port in FOR_TASKS:  # is not read without any
                    values.pop(port, None)
            for port in values:
                assert_not_taken(block, context, values, port)
            tried += len(values)
    assert tried > 15


def assert_not_taken(block, source, values, port):
    """Puts values that are not finite, or of no type, into this port."""
    name, value = block.get_name(), values[port]
    if isinstance(value, np.ndarray):
        fault = "is not finite"
        spoilt = [np.append(value[:-1], bad) for bad in (np.nan, -np.inf)]
        spoilt.append(np.append(np.inf, value[1:]))
    else:
        fault, spoilt = "got a tuple, needs a [WFIA]", [("no", "such", "thing")]
    message = f"^{re.escape(name)}: input port '{port}' {fault}"
    index = block.GetInputPort(port).get_index()
    outputs = [*map(block.get_output_port, range(block.num_output_ports()))]
    for bad in spoilt:
        alone = Simulator(block)
        context = alone.get_mutable_context()
        context.SetTimeStateAndParametersFrom(source)
        fix(block, context, **values | {port: bad})
        refusing = [
            partial(output.Eval, context)
            for output in outputs
            if block.HasDirectFeedthrough(index, output.get_index())
        ]
        for refuse in refusing or [partial(alone.AdvanceTo, LATER)]:
            with pytest.raises((RuntimeError, TypeError), match=message):
                refuse()
