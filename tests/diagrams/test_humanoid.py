"""The whole robot, closed loop: stands, walks, recovers; exactly repeatable.

All by ankles and hips alone (icp_only), on Nadia.
"""

import hashlib
import json
import math
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest
from pydrake.geometry import Meshcat
from pydrake.multibody.plant import ContactResults

from diagrams.humanoid import HumanoidDiagram
from diagrams.mechanisms import MECHANISMS
from diagrams.run_log import switches
from diagrams.simulation import advance, simulate, start
from nadia_balance.core.walking import Side
from nadia_balance.robot import MODELS
from nadia_balance.systems.live_controls import LABELS
from tests.diagrams.simulated import (
    diagram_of,
    figures,
    scenario_of,
    simulated,
)
from tests.source_files import ROOT
from tests.tab import click

GRAVITY = 9.81
STAND = "{duration: 3.0}"
IN_PLACE = "{duration: 6.0, gait: {num_steps: 4}}"
WALKS = {
    "forward": "{duration: 4.6, gait: {num_steps: 2, step: {length: 0.3}}}",
    "backward": "{duration: 4.6, gait: {num_steps: 2, step: {length: -0.2}}}",
    "sideways": "{duration: 4.6, gait: {num_steps: 2, step: {sideways: 0.1}, "
    "first_swing: left}}",
    "turning": "{duration: 4.6, gait: {num_steps: 2, step: {yaw_deg: 15.0}, "
    "first_swing: left}}",
}


def pushed(side, direction, delta_v=0.2):
    """Pushed at 25 % of the first swing."""
    return (
        f"{{duration: 4.6, gait: {{num_steps: 3, first_swing: {side}}}, "
        f"pushes: [{{delta_v: {delta_v}, phase: swing, side: {side}, "
        f"direction_deg: {direction}}}]}}"
    )


SHOVES = {
    "forward": pushed("right", 0.0),
    "inward": pushed("right", 90.0),
    "backward": pushed("right", 180.0),
    "outward": pushed("right", 270.0),
}
RUNS = {
    "stand": STAND,
    "in_place": IN_PLACE,
    **WALKS,
    **{f"shove {direction}": text for direction, text in SHOVES.items()},
}


@pytest.fixture(scope="module")
def robot():
    return diagram_of().robot


def test_refuses_a_stance_that_the_legs_are_too_short_for(tmp_path):
    """Oracle: Pythagoras; legs of 0.78 m, hips that are 0.26 m apart.

    0.99 m between the feet take 0.1 m of the height; no arms make up for it.
    """
    shutil.copytree(MODELS / "nadia", tmp_path / "nadia")
    path = tmp_path / "nadia" / "robot.yaml"
    text = path.read_text().replace("com_height: 0.888", "com_height: 0.94")
    path.write_text(text)
    message = "^step_width = 0.99, com_height = 0.94: must be within reach"
    with pytest.raises(ValueError, match=message):
        diagram_of(f"{{robot: {path}, gait: {{step_width: 0.99}}}}")
    diagram_of(f"{{robot: {path}, gait: {{step_width: 0.3}}}}")


def test_judges_a_fall_without_having_been_started():
    """Oracle: the height at the start, which the diagram has from the start."""
    diagram = diagram_of()
    context = diagram.CreateDefaultContext()
    plant_context = diagram.plant.GetMyMutableContextFromRoot(context)
    q = diagram.robot.standing_positions(0.25)
    for share, reason in ((1.0, ""), (0.61, ""), (0.59, "pelvis too low")):
        low = q.copy()
        low[6] *= share
        diagram.plant.SetPositions(plant_context, low)
        assert diagram.fall_reason(context) == reason


def test_stands_still():
    """Oracle: the reference is a point; 1 mm is a thousandth of her height."""
    found = figures(STAND)
    assert found["recovered"]
    assert found["max_icp_error_m"] < 0.001
    assert found["stance_slip_m"] < 1e-5


def test_the_ground_carries_her_weight_where_the_controller_says(robot):
    """Oracle: gravity; and the commanded wrenches, in quasi-static standing.

    The solver of the contact stops at 1e-5 of the momentum, and she still
    sinks and sways by some um: 0.1 % of the weight is 0.9 N.
    """
    logs = simulated(STAND).logs
    weight = robot.mass * GRAVITY
    measured, wrenches = logs["foot_forces"][-1], logs["foot_wrenches"][-1]
    commanded = wrenches[[5, 11]]
    assert np.sum(measured) == pytest.approx(weight, rel=1e-3)
    assert np.sum(commanded) == pytest.approx(weight, rel=1e-3)
    assert measured == pytest.approx(commanded, rel=2e-3)


def test_the_ground_acts_with_the_commanded_moments():
    """Oracle: the sum of Drake's contact forces about each sole centre.

    0.5 N m at 446 N move the centre of pressure by 1 mm.
    """
    diagram = diagram_of(STAND)
    simulator = start(diagram)
    run = advance(simulator, 1.5)
    plant = diagram.plant
    context = plant.GetMyContextFromRoot(simulator.get_context())
    results = plant.get_contact_results_output_port().Eval(context)
    commanded = run.logs["foot_wrenches"][-1].reshape(2, 6)
    for side, wrench in zip(Side, commanded, strict=True):
        body = plant.GetBodyByName(diagram.robot.foot_bodies[side])
        X_WF = body.EvalPoseInWorld(context) @ diagram.robot.X_FootSole[side]
        measured = measured_wrench(results, body, X_WF.translation())
        assert measured[:3] == pytest.approx(wrench[:3], abs=0.5)
        assert measured[3:] == pytest.approx(wrench[3:], abs=2.0)


def measured_wrench(results: ContactResults, body, p_WF) -> np.ndarray:
    """[moment about p_WF, force] (6,) of all contacts on `body`, in W."""
    total = np.zeros(6)
    for i in range(results.num_point_pair_contacts()):
        contact = results.point_pair_contact_info(i)
        # The force is that on body B.
        for index, sign in (
            (contact.bodyA_index(), -1.0),
            (contact.bodyB_index(), 1.0),
        ):
            if index == body.index():
                force = sign * contact.contact_force()
                arm = contact.contact_point() - p_WF
                total += np.concatenate([np.cross(arm, force), force])
    return total


def test_walks_in_place():
    """Oracle: the bar of the project, 5 mm of ICP error, no QP failure."""
    found = figures(IN_PLACE)
    assert found["recovered"]
    assert found["steps_taken"] == 4
    assert found["max_icp_error_m"] < 0.005
    assert found["qp_failures"] == 0


@pytest.mark.parametrize("walk", WALKS)
def test_walks_where_she_is_told(walk):
    """Oracle: the footholds, and the bars: 2 cm beside them, 5 mm of slip."""
    found = figures(WALKS[walk])
    assert found["recovered"]
    assert found["steps_taken"] == 3
    assert found["footstep_error_m"] < 0.02
    assert found["stance_slip_m"] < 0.005
    assert found["max_icp_error_m"] < 0.008
    assert found["qp_failures"] == 0


@pytest.mark.parametrize("direction", SHOVES)
def test_recovers_from_a_shove_in_the_swing(direction):
    """Oracle: 18 N s are 0.2 m/s, within what Fig. 10 gives to ICP control."""
    found = figures(SHOVES[direction])
    assert found["recovered"]
    assert found["fell_at"] is None
    assert found["steps_after_push"] >= 3
    assert 0.04 < found["max_icp_error_m"] < 0.12
    assert found["qp_failures"] == 0


@pytest.mark.parametrize(
    ("direction_deg", "impulse"), [(0, 28), (180, 28), (90, 35), (270, 35)]
)
def test_takes_a_shove_without_a_step(direction_deg, impulse):
    """Oracle: the bar of the project [N s], in 0.1 s at the pelvis."""
    text = (
        f"{{duration: 2.2, pushes: [{{force: {10 * impulse}, time: 0.1, "
        f"direction_deg: {direction_deg}}}]}}"
    )
    found = figures(text)
    assert found["recovered"]
    assert found["steps_taken"] == 0
    assert found["max_icp_error_m"] > 0.06


def test_a_hopeless_shove_is_a_fall():
    """Oracle: 2 m/s need a step of 0.6 m, which is not allowed here."""
    run = simulated("{duration: 4.0, pushes: [{delta_v: 2.0, time: 0.1}]}")
    assert run.fall_reason in ("pelvis too low", "pelvis tilted")
    assert 0.3 < run.fell_at < 3.0
    assert run.logs["t"][-1] < run.fell_at


@pytest.mark.parametrize("run", RUNS)
def test_torques_stay_within_their_limits(run):
    """Oracle: the limits of the plant; these runs use two thirds at most."""
    logs = simulated(RUNS[run]).logs
    ratio = np.abs(logs["actuation"]) / logs["effort_limits"]
    assert 0.05 < np.max(ratio) < 0.67
    assert np.all(np.isfinite(logs["actuation"]))


def test_the_mirrored_shove_gives_the_mirrored_path():
    """Oracle: the mirror image of the ICP's path, within 1.5 mm.

    She is not quite symmetric: her right arm is weaker, two links differ, and
    standing the pelvis is 0.3 mm beside the middle.  That makes 0.1 mm, and
    may make a foot land a control period sooner, when the ICP is moving at
    0.5 m/s: another millimetre.
    """
    right = simulated(pushed("right", 90.0)).logs
    left = simulated(pushed("left", -90.0)).logs
    mirror = np.array([1.0, -1.0])
    apart = np.abs(right["icp"] - left["icp"] * mirror)
    assert np.ptp(right["icp"][:, 1]) > 0.2
    assert np.max(apart) < 1.5e-3
    assert np.mean(apart) < 1e-4
    phases = [logs["walking_signal"][:, 0] for logs in (right, left)]
    assert np.count_nonzero(phases[0] != phases[1]) <= 6  # of 6 changes


REPEATED = (
    "{duration: 1.7, seed: %d, gait: {num_steps: 2}, "
    "pushes: [{delta_v: 0.2, phase: swing, direction_deg: 30.0}]}"
)


def digest(logs) -> str:
    """A fingerprint of every bit of every array."""
    found = hashlib.sha256()
    for name in sorted(logs):
        values = np.ascontiguousarray(logs[name])
        found.update(f"{name} {values.dtype} {values.shape}".encode())
        found.update(values.tobytes())
    return found.hexdigest()


def test_the_same_seed_gives_the_same_bits():
    """Oracle: every array of the log, of one diagram and of a new one."""
    diagram = diagram_of(REPEATED % 3)
    first, second = (simulate(diagram, 1.7).logs for _ in range(2))
    third = simulated(REPEATED % 3).logs
    assert np.linalg.norm(first["push_force"], axis=1).any()
    for name, values in first.items():
        equal_nan = values.dtype.kind == "f"
        for other in (second, third):
            assert np.array_equal(values, other[name], equal_nan), name


def test_another_process_gives_the_same_bits():
    """Oracle: the digest of all logs; Python hashes differently there."""
    script = (
        "import json\n"
        "from tests.diagrams.simulated import simulated\n"
        "from tests.diagrams.test_humanoid import REPEATED, digest\n"
        "print(json.dumps(digest(simulated(REPEATED % 3).logs)))\n"
    )
    output = subprocess.run(
        [sys.executable, "-c", script],
        cwd=ROOT,
        env={**os.environ, "PYTHONHASHSEED": "17"},
        capture_output=True,
        check=True,
        text=True,
    ).stdout
    assert json.loads(output) == digest(simulated(REPEATED % 3).logs)


def test_the_tab_changes_no_bit():
    """Oracle: the digest of the same run without Meshcat."""
    diagram = HumanoidDiagram(scenario_of(REPEATED % 3), Meshcat())
    logs = simulate(diagram, 1.7).logs
    assert not switches(logs)
    del logs["mechanisms"]  # only the tab has them
    assert digest(logs) == digest(simulated(REPEATED % 3).logs)


def test_toggles_do_what_the_scenario_would():
    """Oracle: the bits of a run with all mechanisms and without Meshcat."""
    text = (
        "{%s, duration: 1.9, gait: {num_steps: 2}, "
        "pushes: [{delta_v: 0.4, phase: swing, direction_deg: 90.0}]}"
    )
    meshcat = Meshcat()
    diagram = HumanoidDiagram(
        scenario_of(text % "mechanisms: icp_only"), meshcat
    )
    simulator = start(diagram)
    simulator.Initialize()
    for label in LABELS.values():
        click(meshcat, f"{label}: off")
    simulator.AdvanceTo(1.9)
    switched = diagram.read_logs(simulator.get_context())
    ((when, on),) = switches(switched)
    assert when <= 0.02
    assert on == MECHANISMS["all_with_cross_over"]
    del switched["mechanisms"]  # only the tab has them
    built = simulated(text % "mechanisms: all_with_cross_over").logs
    assert digest(switched) == digest(built)
    signal = switched["walking_signal"]
    footholds = signal[signal[:, 0] == 2.0, 12:14]  # in the swings
    assert math.dist(footholds[0], footholds[-1]) > 0.1
    assert np.max(np.diff(signal[:, 2])) > 1.05 * 0.002  # a hurried clock


def test_another_seed_gives_another_run():
    """Oracle: 10 um at the start, and not much more from there."""
    logs = [simulate(diagram_of(REPEATED % s), 0.1).logs for s in (3, 4)]
    assert digest(logs[0]) != digest(logs[1])
    apart = np.abs(logs[0]["icp"] - logs[1]["icp"])
    assert 1e-9 < np.max(apart) < 1e-3


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("of", ["position", "velocity"])
def test_a_number_that_is_none_stops_the_robot(of, bad):
    """Oracle: it enters at 0.1 s; no torque follows from it."""
    simulator = start(diagram_of())
    diagram, context = simulator.get_system(), simulator.get_mutable_context()
    plant_context = diagram.plant.GetMyMutableContextFromRoot(context)
    first = 0 if of == "position" else diagram.plant.num_positions()

    def poison(_):
        if context.get_time() >= 0.1:
            state = plant_context.get_mutable_discrete_state_vector()
            state[first + 10] = bad
        return ""

    diagram.fall_reason = poison
    run = advance(simulator, 1.0)
    assert run.simulated_time == pytest.approx(0.1, abs=0.003)
    assert run.error  # of Drake's scene graph or contact solver
    assert (run.fell_at, run.fall_reason) == (None, "")
    assert len(run.logs["t"]) >= 49
    assert np.all(np.isfinite(run.logs["actuation"]))


@pytest.mark.parametrize("bad", [np.nan, -np.inf])
def test_the_controller_names_the_number_that_is_none(bad, robot):
    """Oracle: the name of the joint, in every output that depends on it."""
    controller = diagram_of().controller
    context = controller.CreateDefaultContext()
    plant = robot.control_plant()
    state = np.zeros(plant.num_multibody_states())
    state[: plant.num_positions()] = robot.standing_positions()
    knee = plant.GetJointByName("LEFT_KNEE_Y").position_start()
    state[knee] = bad
    controller.GetInputPort("estimated_state").FixValue(context, state)
    controller.GetInputPort("foot_forces").FixValue(context, [450.0, 450.0])
    for name in ("actuation", "icp", "com_state", "momentum_rate"):
        with pytest.raises(RuntimeError, match="finite.*LEFT_KNEE_Y"):
            controller.GetOutputPort(name).Eval(context)


@pytest.mark.parametrize(
    "change",
    [
        "controller: {control_period: 0.004}",
        "plant_config: {time_step: 0.002}",
        "plant_config: {use_sampled_output_ports: false}",
        "plant_config: {discrete_contact_approximation: similar}",
        "controller: {balance: {solver: clarabel}}",
    ],
)
def test_steps_in_other_circumstances_too(change):
    """Oracle: a step, upright, with some mm of error more than else."""
    found = figures(f"{{duration: 2.6, gait: {{num_steps: 1}}, {change}}}")
    assert found["recovered"]
    assert found["steps_taken"] == 1
    assert found["max_icp_error_m"] < 0.012
    assert found["qp_failures"] == 0


@pytest.mark.parametrize(
    "gait",
    [
        "step_width: 0.3",
        "step_width: 0.15",
        "swing_duration: 0.5, transfer_duration: 0.15",
    ],
)
def test_steps_in_other_ways_too(gait):
    """Oracle: as in place."""
    text = f"{{duration: 3.4, gait: {{num_steps: 2, {gait}}}}}"
    found = figures(text)
    assert found["recovered"]
    assert found["steps_taken"] == 2
    assert found["max_icp_error_m"] < 0.006
    assert found["qp_failures"] == 0
