"""The whole robot in closed loop, moved by MuJoCo."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from nadia_balance.diagrams.simulation import start
from tests.diagrams.simulated import EARLY, diagram_of, figures, simulated

PUSHED = (
    "{engine: mujoco, duration: 2.8, calm_steps: 0, mechanisms: step, "
    f"{EARLY % 'num_steps: 2, transfer_duration: 0.3'}, "
    "time_step: 0.001, "
    "pushes: [{delta_v: 0.2, at: right swing 25 %, direction_deg: 90}]}"
)


def test_recovers_by_steps():
    """Oracle: the verdict, that of any engine."""
    found = figures(PUSHED)
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
    x, y = (
        diagram.engine.GetOutputPort("state").Eval(
            diagram.engine.GetMyContextFromRoot(simulator.get_context())
        )
        for simulator in (first, second)
    )
    assert np.array_equal(x, y)
    log = simulated(PUSHED).logs
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
