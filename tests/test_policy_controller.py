"""A policy in the place of our controller, with a network known to the tests.

The network is a linear map written by hand (onnx_bytes), so that observation,
action and torques have closed forms.
"""

import json
import re
import sys

import numpy as np
import pytest
from pydrake.math import RollPitchYaw

from nadia_balance.diagrams import live
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.live import LiveSession, endless
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.diagrams.simulation import closed_loop, simulate, start
from nadia_balance.policy.controller import PolicyController
from nadia_balance.results.pages import write_plots
from nadia_balance.results.story import telling_lines
from nadia_balance.robot.model import load_robot
from nadia_balance.robot.plants import actuators
from nadia_balance.scripts import envelope, push
from nadia_balance.sweep.run_trial import run_trial, search
from nadia_balance.view.live_controls import FORWARD, PUSH, SIZE, TURN
from nadia_balance.view.scene import start_meshcat
from tests.blocks import answer, fix, running
from tests.clicks import click
from tests.onnx_bytes import linear_policy
from tests.scripts.running import assert_refused, run_script

ROBOT = load_robot("g1")
PLANT = ROBOT.control_plant()
JOINTS = [drive.joint() for drive in actuators(PLANT)]
NAMES = [joint.name() for joint in reversed(JOINTS)]  # the policy's own order
N, NQ = len(NAMES), PLANT.num_positions()
KP, KD = 20.0 + np.arange(N), 0.1 * np.arange(N)
RNG = np.random.default_rng(0)
W, B = RNG.normal(size=(N, 3 * N + 13)), RNG.normal(size=N)
GOOD = {"dof_names": NAMES, "kp": KP.tolist(), "kd": KD.tolist()}
SWING = "left swing 5 %"
# holosoma_inference 0.1.3, config/config_values/robot.py: the angles of both
# sides that are not 0.
POSE = {
    "left_hip_pitch_joint": -0.312,
    "left_knee_joint": 0.669,
    "left_ankle_pitch_joint": -0.363,
    "left_shoulder_pitch_joint": 0.2,
    "left_shoulder_roll_joint": 0.2,
    "left_elbow_joint": 0.6,
    "right_hip_pitch_joint": -0.312,
    "right_knee_joint": 0.669,
    "right_ankle_pitch_joint": -0.363,
    "right_shoulder_pitch_joint": 0.2,
    "right_shoulder_roll_joint": -0.2,
    "right_elbow_joint": 0.6,
}
ANGLES = {"left_knee_joint": 0.7, "right_elbow_joint": -0.3}


@pytest.fixture
def made(tmp_path):
    """Writes a policy file; returns its path."""

    def make(W=W, b=B, shape=None, **changes):
        data = linear_policy(W, b, shape, **GOOD | changes)
        (tmp_path / "policy.onnx").write_bytes(data)
        return tmp_path / "policy.onnx"

    return make


def test_observes_and_acts_in_the_order_of_the_policy(made):
    """Oracle: the closed form, joint by joint, of a tilted, turned robot."""
    command = {"velocity_command": np.array([0.3, -0.2, 0.1])}
    fields = json.dumps({"default_angles": ANGLES, "stride": 0.8})
    controller = PolicyController(ROBOT, made(), [fields])
    R_WB = RollPitchYaw(0.2, -0.3, 2.0)
    state = RNG.normal(scale=0.1, size=NQ + PLANT.num_velocities())
    state[:4] = R_WB.ToQuaternion().wxyz()
    simulator, context = running(controller, estimated_state=state, **command)
    q = np.array([state[j.position_start()] for j in reversed(JOINTS)])
    v = np.array([state[NQ + j.velocity_start()] for j in reversed(JOINTS)])
    q0 = np.array([(POSE | ANGLES).get(name, 0.0) for name in NAMES])
    action, R_BW = np.zeros(N), R_WB.ToRotationMatrix().matrix().T
    limits = PLANT.GetEffortUpperLimits()
    for tick in (1, 2):  # the network counts in single precision
        phases = np.array([0.0, np.pi]) + 2.0 * np.pi * 0.02 / 0.8 * tick
        turn, command = 0.25 * (R_BW @ state[NQ : NQ + 3]), [0.1, 0.3, -0.2]
        joints, down = np.r_[q - q0, 0.05 * v], -R_BW[:, 2]
        seen = np.r_[action, turn, command, np.cos(phases), joints, down]
        seen = np.r_[seen, np.sin(phases)]
        assert controller.observe(context) == pytest.approx(seen, abs=1e-5)
        simulator.AdvanceTo((tick - 0.5) * 0.02)
        action = W @ seen + B
        torques = (KP * (q0 + 0.25 * action - q) - KD * v)[::-1]
        actuation = answer(controller, context, "actuation")
        expected = np.clip(torques, -limits, limits)
        assert actuation == pytest.approx(expected, abs=1e-2)
        simulator.AdvanceTo(tick * 0.02 - 1e-6)
    assert np.any(np.abs(torques) > limits)


def test_a_policy_that_is_to_stand_has_no_phases(made):
    """Oracle: both feet at pi, on the ground; it never swings one.

    Told to walk, it begins as at the start: the left foot is to be highest.
    """
    text = "{gait: {num_steps: 0, step: {length: 0.3}}}"
    scenario = load_scenario("push", robot="g1", text=text, pushes=[])
    still = closed_loop(scenario, controller=made()).controller
    state = np.eye(NQ + N + 6)[0]
    simulator, context = running(still, estimated_state=state)
    simulator.AdvanceTo(0.05)
    assert np.allclose(still.observe(context)[N + 6 : N + 8], -1.0)
    fix(still, context, velocity_command=np.array([0.0, 0.0, 0.3]))
    turn = 2.0 * np.pi * 0.02
    expected = [np.cos(turn), np.cos(np.pi + turn)]
    assert still.observe(context)[N + 6 : N + 8] == pytest.approx(expected)


def test_pushes_are_timed_by_contacts_once_it_walks(made):
    """Oracle: the clock's phases, and eight steps before the first push."""
    scenario = load_scenario("push", robot="g1")
    diagram = closed_loop(scenario, controller=made())
    (push,) = diagram.scenario.pushes
    assert (push.at, push.after_steps) == ("right swing 25 %", 8)
    assert scenario.pushes[0].after_steps < 8
    clock = diagram.GetSubsystemByName("contact_clock")
    assert diagram.AreConnected(
        clock.GetOutputPort("walking_state"),
        diagram.push.GetInputPort("walking_state"),
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"W": W[:, 1:]}, "have one input tensor(float) [1, 100] for its c"),
        ({"W": W[1:], "b": B[1:]}, "have one output tensor(float) [1, 29] for"),
    ],
)
def test_names_what_differs_from_the_contract(made, changes, message):
    """Oracle: one line with the file, and what is wrong with it."""
    path = made(**changes)
    begin = f"controller = {str(path)!r}: must {message}"
    with pytest.raises(ValueError, match=f"^{re.escape(begin)}"):
        PolicyController(ROBOT, path)


def test_bad_files_and_flags_are_refused(made, tmp_path, capsys, monkeypatch):
    """Oracle: exit code 2, and one line; no file of a run is written."""
    good = made()
    (tmp_path / "bare.onnx").write_bytes(linear_policy(W, B))
    (tmp_path / "bad.onnx").write_text("this is no network\n")
    for name, rule in {
        "none.onnx": "be a file",
        "bad.onnx": "be an ONNX model (",
        "bare.onnx": "have metadata dof_names, kp, kd, or a contract: ",
    }.items():
        message = f"controller = {str(tmp_path / name)!r}: must {rule}"
        with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
            PolicyController(ROBOT, tmp_path / name)

    def refused(script, message, *argv):
        flags = ["--robot", "g1", "--controller", good, *argv]
        assert_refused(run_script(script, flags, capsys), message)

    out = tmp_path / "run"
    must = f"controller = {str(good)!r}: must "
    refused(push, f"{must}not", "--no-meshcat", "--out", out, "--plant", "lipm")
    refused(envelope, f"{must}not come with", "--mechanisms", "step")
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    refused(
        push,
        f"{must}have its package: pip install onnxruntime",
        "--no-meshcat",
        "--out",
        out,
    )
    assert not out.exists()


@pytest.mark.parametrize("engine", ["drake", "mujoco"])
def test_a_run_is_told_without_what_it_lacks(made, tmp_path, engine):
    """Oracle: the push; a robot that is held by springs alone tips over.

    No ICP, no planned step, no plot of either.
    """
    path = made(W=0.0 * W, b=0.0 * B, kp=[200.0] * N, kd=[5.0] * N)
    text = "pushes: [{delta_v: 1.0, direction_deg: 90.0, at: 0.1 s}]"
    scenario = load_scenario(
        "push", robot="g1", engine=engine, duration=1.2, text=text
    )
    diagram = HumanoidDiagram(scenario, None, PolicyController(ROBOT, path))
    run = simulate(diagram, 1.2)
    summary = run.summary
    assert summary["mechanisms"] == path.name
    assert summary["outcome"] == "failed"
    (felt,) = summary["pushes"]
    assert (felt["time_s"], felt["direction_deg"]) == pytest.approx((0.1, 90.0))
    for name in ("max_icp_error_m", "stance_slip_m", "recovery_time_s"):
        assert summary[name] is None
    lines = telling_lines(run.logs, summary)
    assert lines[0].startswith("t=0.10 s  push 1.00 m/s left ")
    assert "FELL" in lines[-1]
    plots = write_plots(tmp_path, run.logs, summary)
    assert plots == ["timeline.png", "effort.png"]


def test_a_sweep_pushes_the_policy_and_knows_its_file(made, tmp_path):
    """Oracle: a robot that is held by springs alone tips over.

    A trial of another file than the sweep began with is refused.
    """
    path = made(W=0.0 * W, b=0.0 * B, kp=[200.0] * N, kd=[5.0] * N)
    argv = ["--robot", "g1", "--controller", str(path), "--duration", "1.2"]
    args = envelope.parser_of().parse_args([*argv, "--at", "0.1 s"])
    sweep = envelope.sweep_from(args)
    identity, cell = sweep.identity(), sweep.cells()[3]
    assert identity["controller"].startswith("policy.onnx ")
    assert str(tmp_path) not in str(identity)
    row = run_trial(sweep, cell, 1.0, 0)
    assert (row["outcome"], row["predicted_at_push"]) == ("failed", None)
    made()
    with pytest.raises(ValueError, match=r"controller = .*: must be policy"):
        search(sweep, identity, cell, {})


def test_the_user_commands_it_where_the_scenario_does_not(made):
    """Oracle: the value of the slider in Meshcat, at the policy's port.

    There are no buttons of the mechanisms, as it has none.
    """
    meshcat = start_meshcat()[0]
    scenario = endless(load_scenario("push", robot="g1"))
    diagram = closed_loop(
        scenario, controller=made(0.0 * W, 0.0 * B), meshcat=meshcat
    )
    meshcat.SetSliderValue(FORWARD, 0.2)
    simulator = start(diagram)
    simulator.AdvanceTo(0.1)
    policy = diagram.controller
    context = policy.GetMyContextFromRoot(simulator.get_context())
    command = policy.GetInputPort("velocity_command").Eval(context)
    assert command == pytest.approx([0.2, 0.0, 0.0])
    assert {*meshcat.GetButtonNames()} == {"Push", "Stop walking"}


def test_a_live_page_commands_what_its_contract_allows(made):
    """Oracle: by hand, from the contract; without it, our planner's limits.

    Ours bound a command that goes forward and turns as a whole, the policy's
    do not.
    """
    ranges = [[-0.4, 0.9], [-0.1, 0.2], [-0.6, 0.5]]
    scenario = endless(load_scenario("push", robot="g1"))
    path, meshcat = made(0.0 * W, 0.0 * B), start_meshcat()[0]
    diagram = closed_loop(
        scenario,
        controller=path,
        meshcat=meshcat,
        contract=[f"{{command_limits: {ranges}}}"],
    )
    np.testing.assert_allclose(diagram.velocity_limits.T, ranges)
    session = LiveSession(diagram, meshcat, print)
    for name in FORWARD, TURN:
        meshcat.SetSliderValue(name, 9.0)
    values = [meshcat.GetSliderValue(name) for name in (FORWARD, TURN)]
    assert values == pytest.approx([0.9, 0.5])
    session.tick()
    assert "0.90" in session.status()[1]
    assert not any("more than it can walk" in line for line in session.status())
    plain = closed_loop(scenario, controller=path)
    np.testing.assert_allclose(
        plain.velocity_limits, closed_loop(scenario).velocity_limits
    )


def test_it_is_pushed_in_a_live_page(made, monkeypatch):
    """Oracle: springs bear a light push, and tip over by a hard one.

    m delta_v / 0.1 s; the time of STEADY after the push; the clock again.
    """
    monkeypatch.setattr(live, "LYING", 0.0)
    path = made(W=0.0 * W, b=0.0 * B, kp=[300.0] * N, kd=[10.0] * N)
    meshcat, told = start_meshcat()[0], []
    scenario = endless(load_scenario("push", robot="g1"))
    diagram = closed_loop(scenario, controller=path, meshcat=meshcat)
    session = LiveSession(diagram, meshcat, told.append, 10.0)
    light, hard, mass = 0.05, 1.2, ROBOT.mass
    for size, lines in (light, 2), (hard, 4):
        meshcat.SetSliderValue(SIZE, size)
        click(meshcat, PUSH)
        for _ in range(150):
            if len(told) < lines:
                session.tick()
    assert told == [
        f"t=0.02 s  push {light:.2f} m/s left, standing  "
        f"F = {mass * light / 0.1:.0f} N",
        "t=2.10 s  UPRIGHT 2 s after the push",
        f"t=2.12 s  push {hard:.2f} m/s left, standing  "
        f"F = {mass * hard / 0.1:.0f} N",
        told[-1],
    ]
    assert told[-1].endswith("  FELL: pelvis tilted")
    assert not any("ICP" in line for line in session.status())
    session.tick()
    session.tick()
    assert session.context.get_time() < 0.1
