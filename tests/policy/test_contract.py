"""Where the fields of a contract come from, and that a run keeps them."""

import json
import re

import numpy as np
import pytest

from nadia_balance.policy.contract import read_contract
from nadia_balance.policy.network import Network
from nadia_balance.scripts import envelope, push
from tests.onnx_bytes import linear_policy
from tests.policy.deploys import MOTORS, N, write
from tests.scripts.running import assert_refused, run_script

G1 = [f"{name}_joint" for name in MOTORS]
# holosoma_inference 0.1.3, config/config_values/robot.py: t1_29dof.
T1_POSE = {
    "AAHead_yaw": 0.0,
    "Head_pitch": 0.0,
    "Left_Shoulder_Pitch": 0.2,
    "Left_Shoulder_Roll": -1.35,
    "Left_Elbow_Pitch": 0.0,
    "Left_Elbow_Yaw": -0.5,
    "Left_Wrist_Pitch": 0.0,
    "Left_Wrist_Yaw": 0.0,
    "Left_Hand_Roll": 0.0,
    "Right_Shoulder_Pitch": 0.2,
    "Right_Shoulder_Roll": 1.35,
    "Right_Elbow_Pitch": 0.0,
    "Right_Elbow_Yaw": 0.5,
    "Right_Wrist_Pitch": 0.0,
    "Right_Wrist_Yaw": 0.0,
    "Right_Hand_Roll": 0.0,
    "Waist": 0.0,
    "Left_Hip_Pitch": -0.2,
    "Left_Hip_Roll": 0.0,
    "Left_Hip_Yaw": 0.0,
    "Left_Knee_Pitch": 0.4,
    "Left_Ankle_Pitch": -0.25,
    "Left_Ankle_Roll": 0.0,
    "Right_Hip_Pitch": -0.2,
    "Right_Hip_Roll": 0.0,
    "Right_Hip_Yaw": 0.0,
    "Right_Knee_Pitch": 0.4,
    "Right_Ankle_Pitch": -0.25,
    "Right_Ankle_Roll": 0.0,
}


def holosoma(path, names=tuple(G1), **metadata):
    """The network of a file with holosoma's metadata."""
    n = len(names)
    texts = {
        "dof_names": names,
        "kp": [50.0] * n,
        "kd": [5.0] * n,
        "command_ranges": {
            "lin_vel_x": [-1.0, 1.0],
            "lin_vel_y": [-0.5, 0.5],
            "ang_vel_yaw": [-0.8, 0.8],
            "heading": [-3.14, 3.14],
        },
    }
    W = np.zeros((n, 3 * n + 13))
    path.write_bytes(linear_policy(W, np.zeros(n), **texts | metadata))
    return Network(path)


def test_holosomas_t1_has_its_own_pose_and_scales(tmp_path):
    """Oracle: holosoma's own tables; the order of its names' alphabet."""
    network = holosoma(tmp_path / "t1.onnx", [*T1_POSE])
    contract = read_contract(network, [*T1_POSE][::-1])
    params = contract.params
    pose = {name: params.default_angles.get(name, 0.0) for name in T1_POSE}
    assert pose == T1_POSE
    assert [term.name for term in params.observation] == [
        "last_action",  # actions
        "base_ang_vel",
        "command_ang_vel",
        "command_lin_vel",
        "cos_phase",
        "joint_pos_rel",  # dof_pos
        "joint_vel_rel",  # dof_vel
        "projected_gravity",
        "sin_phase",
    ]
    scales = {term.name: term.scale for term in params.observation}
    assert scales == dict.fromkeys(scales, [1.0]) | {"joint_vel_rel": [0.1]}
    assert params.command_limits == [[-1.0, 1.0], [-0.5, 0.5], [-0.8, 0.8]]
    assert contract.source("default_angles") == "default, holosoma's t1_29dof"
    assert contract.source("stiffness") == "metadata of t1.onnx"
    assert contract.source("period") == "default"


def test_a_later_source_counts_more_and_is_named(tmp_path):
    """Oracle: by hand; one field of each source, the last one a flag."""
    path, _, _ = write(tmp_path)
    extra = tmp_path / "mine.yaml"
    extra.write_text("{damping: %s, period: 0.03}" % ([7.0] * N))
    given = [str(extra), "{period: 0.01, default_angles: {waist_yaw_joint: 9}}"]
    contract = read_contract(Network(path), G1, given)
    params = contract.params
    assert (params.period, contract.source("period")) == (0.01, "flag")
    assert (params.damping, contract.source("damping")) == (
        [7.0] * N,
        "mine.yaml",
    )
    assert contract.source("stiffness") == "deploy.yaml"
    assert params.default_angles["waist_yaw_joint"] == 9.0
    assert params.default_angles["right_hip_pitch_joint"] == 0.01
    assert contract.source("default_angles") == "deploy.yaml, flag"
    assert "period = 0.01  (flag)" in contract.lines()
    kept = tmp_path / "policy.yaml"
    kept.write_text(contract.as_yaml())
    assert "period: 0.01  # flag\n" in kept.read_text()
    assert read_contract(Network(path), G1, [str(kept)]).params == params


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ({"kp": None}, "metadata of p.onnx: stiffness = None: must be a list"),
        ({"kp": [1.0]}, "metadata of p.onnx: stiffness = 1 values: must be 29"),
        ({"kd": [-1.0] * N}, "metadata of p.onnx: damping[0] = -1.0: must"),
        ({"dof_names": [G1[0]] * N}, "metadata of p.onnx: joints = left_hip"),
        ({"dof_names": ["tail", *G1[1:]]}, "observation = []: must have terms"),
        (
            {"dof_names": [*G1[:-1], "tail"]},
            "metadata of p.onnx: joints must be those of the robot: lacks "
            f"{G1[-1]}; has besides tail",
        ),
    ],
)
def test_bad_metadata_are_named(tmp_path, metadata, message):
    """Oracle: one line: source, field, value and what is allowed.

    The pose is known only of holosoma's robots, here without a hip.
    """
    network = holosoma(tmp_path / "p.onnx", **metadata)
    with pytest.raises(ValueError, match=re.escape(message)):
        read_contract(network, G1)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("{period: -1}", "flag: period = -1.0: must be > 0"),
        ("{gain: 1}", "flag: gain: unknown field, must be one of joints, st"),
        ("{tail: ", "flag: malformed YAML"),
        ("{default_angles: {tail: 1}}", "flag: default_angles.tail: must be a"),
        ("{action_scale: [1, 2]}", "flag: action_scale = 2 values: must be 1"),
        ("none.yaml", "contract = 'none.yaml': must be a file"),
    ],
)
def test_bad_fields_of_a_user_are_named(tmp_path, given, message):
    """Oracle: one line that begins with whose field it is."""
    network = holosoma(tmp_path / "p.onnx")
    with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
        read_contract(network, G1, [given])


def test_a_run_tells_and_keeps_its_contract(tmp_path, capsys):
    """Oracle: the lines and the file of the contract; springs tip over."""
    network = holosoma(tmp_path / "p.onnx")
    flag, out = "{action_limit: 20}", tmp_path / "run"
    argv = ["--robot", "g1", "--controller", network.path, "--contract", flag]
    argv += ["--no-meshcat", "--duration", "0.1", "--out", out]
    said = run_script(push, argv, capsys).out
    lines = [line for line in said if line.startswith("policy: ")]
    contract = read_contract(network, G1, [flag])
    assert lines == [f"policy: {line}" for line in contract.lines()]
    assert (out / "policy.yaml").read_text() == contract.as_yaml()
    ours = run_script(push, ["--contract", flag, *argv[-5:]], capsys)
    assert_refused(ours, f"contract = {flag}: must come with the ONNX file")


def test_rows_of_another_contract_are_others(tmp_path):
    """Oracle: a sweep's identity, as the file beside the network changes."""
    path, _, _ = write(tmp_path)

    def identity(*flags) -> dict:
        argv = ["--robot", "g1", "--controller", str(path), *flags]
        args = envelope.parser_of().parse_args(argv)
        return envelope.sweep_from(args).identity()

    before = identity()
    assert identity() == before
    assert identity("--contract", "{action_limit: 9}") != before
    file = tmp_path / "params" / "deploy.yaml"
    file.write_text(file.read_text() + "# another\n")
    assert {
        key for key, value in identity().items() if before[key] != value
    } == {"contract"}
    assert json.dumps(before).count(str(tmp_path)) == 0
