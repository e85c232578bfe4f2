"""A policy of Isaac Lab walks by its deploy.yaml.

The network is a linear map written by hand (onnx_bytes); observation, history
and torques are formed here joint by joint, by the motors' numbers.
"""

import re

import numpy as np
import pytest
from pydrake.math import RollPitchYaw

from nadia_balance.policy.controller import PolicyController
from nadia_balance.robot.model import load_robot
from nadia_balance.robot.plants import actuators
from tests.blocks import answer, fix, running
from tests.policy.deploys import DEPLOY, MAP, MOTORS, M, N, changed, write

ROBOT = load_robot("g1")
PLANT = ROBOT.control_plant()
NQ = PLANT.num_positions()
JOINTS = {drive.joint().name(): drive.joint() for drive in actuators(PLANT)}
# In the order of the policy.
POLICY = [JOINTS[f"{MOTORS[i]}_joint"] for i in MAP]
RNG = np.random.default_rng(1)
R_WB = RollPitchYaw(0.2, -0.3, 2.0)


def some_state(spin: float):
    """A tilted, turned robot, whose pelvis spins about its own axes."""
    state = RNG.normal(scale=0.1, size=NQ + PLANT.num_velocities())
    state[:4] = R_WB.ToQuaternion().wxyz()
    R = R_WB.ToRotationMatrix().matrix()
    state[NQ : NQ + 3] = R @ [spin, 2.0 * spin, -spin]
    return state


def terms(state, command, action, spin: float) -> list:
    """The six terms of a tick, by hand."""
    q = np.array([state[joint.position_start()] for joint in POLICY])
    v = np.array([state[NQ + joint.velocity_start()] for joint in POLICY])
    return [
        np.array([0.2, 0.3, 0.4]) * [spin, 2.0 * spin, -spin],
        -R_WB.ToRotationMatrix().matrix()[2],
        command,
        q - 0.01 * np.arange(N),
        0.05 * v,
        action,
    ]


@pytest.mark.parametrize("by_tick", [False, True])
def test_the_history_is_of_each_term_or_of_each_tick(tmp_path, by_tick):
    """Oracle: the rows by hand; the first tick stands for those before it.

    The command beyond the ranges of the training is clipped: 0.9 rad/s at 0.2.
    """
    deploy = DEPLOY
    if by_tick:
        observations = {
            name: term | {"history_length": 2}
            for name, term in DEPLOY["observations"].items()
        }
        observations["use_gym_history"] = True
        deploy = changed("observations", observations)
    size = 2 * (9 + 3 * N) if by_tick else M
    path, W, b = write(tmp_path, deploy, size)
    controller = PolicyController(ROBOT, path)
    states = [some_state(spin) for spin in (0.1, 0.2, 0.3)]
    simulator, context = running(controller, estimated_state=states[0])
    rows, action = [], np.zeros(N)
    for i, state in enumerate(states):
        command = np.array([0.1 * i, 0.2, 0.9])
        fix(controller, context, estimated_state=state)
        fix(controller, context, velocity_command=command)
        spin, command = 0.1 * (i + 1), np.array([0.1 * i, 0.2, 0.2])
        rows.append(terms(state, command, action, spin))
        last = [rows[max(i - k, 0)] for k in (4, 3, 2, 1, 0)]
        if by_tick:
            expected = np.concatenate([np.concatenate(row) for row in last[3:]])
        else:
            depths = [5, 5, 5, 3, 5, 1]
            expected = np.concatenate(
                [row[j] for j, d in enumerate(depths) for row in last[-d:]]
            )
        assert controller.observe(context) == pytest.approx(expected, abs=1e-6)
        simulator.AdvanceTo(0.02 * i + 0.01)
        action = W @ expected + b
    assert len(expected) == size


def test_gains_are_of_motors_and_targets_of_the_policy(tmp_path):
    """Oracle: the spring of each motor, by its name, after one tick."""
    deploy = changed(
        "actions.JointPositionAction.clip",
        [[-0.2, 0.15 + 0.01 * i] for i in range(N)],
    )
    path, W, b = write(tmp_path, deploy)
    controller = PolicyController(ROBOT, path)
    state = some_state(0.1)
    simulator, context = running(controller, estimated_state=state)
    action = W @ controller.observe(context) + b
    simulator.AdvanceTo(0.01)
    limits = PLANT.GetEffortUpperLimits()
    torques = answer(controller, context, "actuation")
    for i, joint in enumerate(JOINTS.values()):
        motor = MOTORS.index(joint.name().removesuffix("_joint"))
        k = MAP.index(motor)
        target = 0.02 * k + (0.25 + 0.001 * k) * action[k]
        target = min(max(target, -0.2), 0.15 + 0.01 * k)
        q = state[joint.position_start()]
        v = state[NQ + joint.velocity_start()]
        spring = (100.0 + motor) * (target - q) - (2.0 + 0.1 * motor) * v
        expected = min(max(spring, -limits[i]), limits[i])
        assert torques[i] == pytest.approx(expected, abs=1e-4), joint.name()


def test_a_clock_of_one_phase(tmp_path):
    """Oracle: unitree_rl_lab adds a tick first: 2 pi 0.02 / 0.8 at time 0."""
    deploy = changed(
        "observations",
        {
            "gait_phase": {"params": {"period": 0.8}, "scale": None},
            "base_ang_vel": {"clip": [-0.1, 0.05], "scale": [2.0]},
        },
    )
    path, _, _ = write(tmp_path, deploy, size=5)
    controller = PolicyController(ROBOT, path)
    simulator, context = running(controller, estimated_state=some_state(0.06))
    turn = 2.0 * np.pi * 0.02 / 0.8
    clipped = [0.1, 0.1, -0.12]  # 0.06, 0.12, -0.06 in [-0.1, 0.05], twice
    for ticks in (1, 2):
        phases = [np.sin(ticks * turn), np.cos(ticks * turn)]
        expected = [*phases, *clipped]
        assert controller.observe(context) == pytest.approx(expected)
        simulator.AdvanceTo(0.02 * ticks)


TERM = "observations.joint_pos_rel"
ACTION = "actions.JointPositionAction"


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (
            "joint_ids_map",
            MAP[:-1],
            "default_joint_pos = 29 values: must be 28, one for each joint",
        ),
        (
            "joint_ids_map",
            [*MAP[:-1], 29],
            "joint_ids_map[28] = 29: must be a motor of the robot, 0 to 28",
        ),
        (
            "joint_ids_map",
            [*MAP[:-1], 0],
            "joint_ids_map[28] = 0: must come on",
        ),
        ("joint_ids_map", None, "joint_ids_map = None: must be a list"),
        ("stiffness", [1.0] * 28, "stiffness = 28 values: must be 29, one for"),
        ("damping", [-1.0] * 29, "damping[0] = -1.0: must be >= 0"),
        (f"{TERM}.history_length", 0, f"{TERM}.history_length = 0: must be >="),
        (f"{TERM}.history_length", 5000, "observation[3].history = 5000: must"),
        (f"{TERM}.scale", [1.0] * 28, "observation[3].scale = 28 values: must"),
        (f"{TERM}.noise", 0.1, f"{TERM}.noise: unknown field, must be one of"),
        (f"{TERM}.params", 5, f"{TERM}.params = 5: must be a mapping"),
        (
            "observations.gait_phase",
            {"params": None},
            "gait_phase.params.period = None",
        ),
        (f"{TERM}.params", {"ids": 1}, f"{TERM}.params.ids: unknown field"),
        (
            "observations.height_scan",
            {"scale": None},
            "observation[6].name = 'height_scan': must be one of base_lin_vel",
        ),
        ("actions", {}, f"{ACTION} = None: must be a mapping"),
        (f"{ACTION}.joint_ids", [0], f"{ACTION}.joint_ids: must be null, or"),
        (
            f"{ACTION}.offsets",
            [0.0] * 29,
            f"{ACTION}.offsets: unknown field, m",
        ),
        ("step_dt", 0.0, "period = 0.0: must be"),
        ("step_dt", "soon", "step_dt = 'soon': must be a number"),
        ("step_dt", None, "step_dt = None: must be a number"),
        (f"{ACTION}.joint_names", ["left_.*"], ".joint_names = ['left_.*']:"),
        (
            "actions.JointVelocityAction",
            {},
            "Action: unknown field, must be on",
        ),
        (
            "commands.base_velocity.ranges.lin_vel_y",
            None,
            "base_velocity.ranges.lin_vel_y = None: must be a list",
        ),
    ],
)
def test_what_is_wrong_is_named(tmp_path, path, value, message):
    """Oracle: one line: the file, the field, its value and what is allowed."""
    onnx, _, _ = write(tmp_path, changed(path, value))
    with pytest.raises(ValueError, match=re.escape(message)) as raised:
        PolicyController(ROBOT, onnx)
    assert "deploy.yaml" in str(raised.value)
    assert "\n" not in str(raised.value)


def test_a_joint_too_few_is_named(tmp_path):
    """Oracle: the last motor of the map, the right wrist's yaw."""
    deploy = changed("joint_ids_map", MAP[:-1])
    deploy["default_joint_pos"] = [0.0] * 28
    action = deploy["actions"]["JointPositionAction"]
    action |= {"offset": [0.0] * 28, "scale": 0.25}
    for name in ("joint_pos_rel", "joint_vel_rel", "last_action"):
        deploy["observations"][name]["scale"] = None
    deploy["stiffness"], deploy["damping"] = [1.0] * 28, [1.0] * 28
    onnx, _, _ = write(tmp_path, deploy)
    message = (
        "deploy.yaml: joints must be those of the robot: lacks "
        "right_wrist_yaw_joint"
    )
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        PolicyController(ROBOT, onnx)


def test_a_network_of_another_size_is_named(tmp_path):
    """Oracle: the size of the observation, by hand."""
    onnx, _, _ = write(tmp_path, size=M - 1)
    with pytest.raises(ValueError, match=rf"one input .* \[1, {M}\]"):
        PolicyController(ROBOT, onnx)
