"""The whole robot in closed loop, moved by MuJoCo."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from nadia_balance.core.lipm import GRAVITY
from nadia_balance.core.walking import Side
from nadia_balance.diagrams.simulation import advance, start
from tests.diagrams.simulated import EARLY, diagram_of, figures, simulated
from tests.diagrams.test_humanoid import measured_wrench

STAND = "{engine: mujoco, duration: 1.5}"
PUSHED = (
    "{engine: mujoco, duration: 4.15, calm_steps: 0, mechanisms: step, "
    f"{EARLY % 'num_steps: 3, transfer_duration: 0.3'}, "
    "plant_config: {time_step: %s}, "
    "pushes: [{delta_v: 0.2, at: right swing 25 %%, direction_deg: 90}]}"
)


def test_stands_still():
    """Oracle: as with Drake's plant, 1 mm, and soles that do not creep."""
    found = figures(STAND)
    assert found["recovered"]
    assert found["engine"] == "mujoco"
    assert found["max_icp_error_m"] < 0.001
    assert found["stance_slip_m"] < 1e-5


def test_the_ground_acts_with_the_commanded_moments():
    """Oracles: gravity; MuJoCo's contact forces about each sole centre."""
    diagram = diagram_of(STAND)
    simulator = start(diagram)
    logs = advance(simulator, 1.5).logs
    engine, plant = diagram.engine, diagram.plant
    own = engine.GetMyContextFromRoot(simulator.get_context())
    results = engine.GetOutputPort("contact_results").Eval(own)
    commanded = logs["foot_wrenches"][-1].reshape(2, 6)
    weight = diagram.robot.mass * GRAVITY
    assert np.sum(logs["foot_forces"][-1]) == pytest.approx(weight, rel=1e-3)
    context = plant.CreateDefaultContext()
    state = engine.GetOutputPort("state").Eval(own)
    plant.SetPositionsAndVelocities(context, state)
    for side, wrench in zip(Side, commanded, strict=True):
        body = plant.GetBodyByName(diagram.robot.foot_bodies[side])
        X_WF = body.EvalPoseInWorld(context) @ diagram.robot.X_FootSole[side]
        measured = measured_wrench(results, body, X_WF.translation())
        assert measured[:3] == pytest.approx(wrench[:3], abs=0.5)
        assert measured[3:] == pytest.approx(wrench[3:], abs=2.0)


@pytest.mark.parametrize("step", [0.001, 0.0005])
def test_recovers_by_steps(step):
    """Oracle: the verdict, that of any engine."""
    found = figures(PUSHED % step)
    assert found["recovered"], found["reason"]
    assert found["max_torque_ratio"] <= 1.0 + 1e-8
    assert found["stance_slip_m"] < 0.002
    assert not found["self_contacts"]


def test_a_copied_context_goes_on_with_the_same_bits():
    """Oracle: the run itself; the contexts take turns with one MuJoCo."""
    diagram = diagram_of(PUSHED % 0.001)
    first = start(diagram)
    first.AdvanceTo(0.6)
    second = Simulator(diagram, first.get_context().Clone())
    second.Initialize()
    for time in (0.65, 0.7):
        first.AdvanceTo(time)
        second.AdvanceTo(time)
    x, y = (
        diagram.engine.GetOutputPort("state").Eval(
            diagram.engine.GetMyContextFromRoot(simulator.get_context())
        )
        for simulator in (first, second)
    )
    assert np.array_equal(x, y)
    log = simulated(PUSHED % 0.001).logs
    assert np.array_equal(
        x, log["state"][np.searchsorted(log["t"], 0.7 - 1e-9)]
    )


def test_a_robot_that_lies_touches_the_ground_as_with_drake():
    """Oracle: Drake's plant, in the same posture; shapes follow the state."""
    touching, poses = [], []
    for engine in ("drake", "mujoco"):
        diagram = diagram_of(f"{{engine: {engine}}}")
        root = start(diagram).get_mutable_context()
        context = diagram.engine.GetMyMutableContextFromRoot(root)
        q = diagram.plant.GetPositions(diagram.plant.CreateDefaultContext())
        q[:4], q[6] = [np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0], 0.08
        diagram.engine.SetPositions(context, q)
        assert diagram.fall_reason(root) == "pelvis too low"
        touching.append(diagram.improper_contacts(root))
        graph = diagram.scene_graph
        query = graph.get_query_output_port().Eval(
            graph.GetMyContextFromRoot(root)
        )
        frames = sorted(query.inspector().GetAllFrameIds())
        poses.append([query.GetPoseInWorld(i).GetAsMatrix4() for i in frames])
    assert touching[0] == touching[1] != set()
    assert np.array(poses[0]) == pytest.approx(np.array(poses[1]), abs=1e-12)


def test_a_point_mass_has_no_engine():
    """Oracle: the message, by hand."""
    message = "^engine = 'mujoco': must be drake for a point mass$"
    with pytest.raises(ValueError, match=message):
        diagram_of("{engine: mujoco}", "lipm")
