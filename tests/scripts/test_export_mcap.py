"""A run as MCAP, read by the library of MCAP's makers."""

import json
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from pydrake.math import RigidTransform

from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.scripts import export_mcap
from tests.results.made_up_run import cut, make_log, without_robot
from tests.scripts.running import assert_refused, full_disk, run_script
from tests.whole_body_examples import context_at, kinematics, random_state

ROWS = 17  # of which 0, 8 and 16 are pictures
# Shapes of the URDF: kind, lengths and centre in the frame of the foot [m].
SOLE = "cubes", [0.25, 0.12, 0.014], [0.053, 0.0, -0.081]
SHOE = "spheres", [0.236, 0.114, 0.06], [0.05, 0.0, -0.058]


@pytest.fixture
def log() -> dict[str, np.ndarray]:
    """A robot that tumbles."""
    states = np.array([random_state(row, 20.0) for row in range(ROWS)])
    return cut(without_robot(make_log()), ROWS) | {"state": states}


@pytest.fixture
def run(log, tmp_path) -> Path:
    """The folder of its run."""
    np.savez(tmp_path / "log.npz", **log)
    text = Scenario().as_yaml("stand")
    (tmp_path / "scenario.yaml").write_text(text)
    return tmp_path


def told(run: Path, capsys) -> dict[str, list]:
    """By topic, the time [s] and the value of every exported message."""
    found = run_script(export_mcap, [run], capsys)
    assert (found.code, found.out) == (0, [f"wrote {run}/run.mcap"])
    topics = defaultdict(list)
    with open(run / "run.mcap", "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            read = (
                json.loads
                if channel.message_encoding == "json"
                else parser(schema)
            )
            now = message.log_time / 1e9, read(message.data)
            topics[channel.topic].append(now)
    return topics


def parser(schema):
    """A reader of messages, by the description that is in the file."""
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    kind = pool.FindMessageTypeByName(schema.name)
    return message_factory.GetMessageClass(kind).FromString


def test_the_file_has_every_signal_at_every_tick(log, run, capsys):
    """Oracle: the log; what is not finite is null."""
    topics = told(run, capsys)
    signals = {name for name in log if len(log[name]) == ROWS} - {"t"}
    assert {*topics} == {"/scene", *(f"/{name}" for name in signals)}
    assert [t for t, _ in topics["/scene"]] == pytest.approx(log["t"][::8])
    for name in signals:
        times, values = zip(*topics[f"/{name}"], strict=True)
        assert times == pytest.approx(log["t"], abs=1e-9)
        rows = np.array([[*row.values()] for row in values], dtype=float)
        finite = np.where(np.isfinite(log[name]), log[name], np.nan)
        assert np.array_equal(rows, finite, equal_nan=True), name
    assert topics["/icp_reference"][3][1]["cop_y"] == log["icp_reference"][3, 5]
    knee = kinematics().plant.GetJointByName("LEFT_KNEE_Y").position_start()
    assert topics["/state"][3][1]["LEFT_KNEE_Y_q"] == log["state"][3, knee]
    assert topics["/walking_signal"][0][1]["duration"] is None


def test_the_scene_has_the_robot_as_it_lies(log, run, capsys):
    """Oracles: Drake's kinematics, shapes of the URDF; the log's ICP."""
    body = kinematics().plant.GetBodyByName("LEFT_FOOT_LINK")
    for row, (_, scene) in enumerate(told(run, capsys)["/scene"]):
        context = context_at(log["state"][8 * row])
        X_WF = kinematics().plant.EvalBodyPoseInWorld(context, body)
        (entity,) = scene.entities
        for kind, lengths, centre in (SOLE, SHOE):
            X_WS = X_WF @ RigidTransform(centre)
            wxyz = X_WS.rotation().ToQuaternion().wxyz()
            expected = [*lengths, *X_WS.translation(), *wxyz]
            errors = [
                np.abs(np.subtract(numbers(one), expected)).max()
                for one in getattr(entity, kind)
            ]
            assert min(errors) < 1e-12
        at = [*log["icp"][8 * row], 0.0]
        assert at in [numbers(one)[3:6] for one in entity.spheres]


def numbers(shape) -> list[float]:
    """Lengths, place in W and quaternion of a shape."""
    place, turn, size = shape.pose.position, shape.pose.orientation, shape.size
    lengths, place = ([v.x, v.y, v.z] for v in (size, place))
    return [*lengths, *place, turn.w, turn.x, turn.y, turn.z]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda run: (run / "log.npz").write_bytes(b"PK"), "run = %r: must be"),
        (lambda run: (run / "scenario.yaml").unlink(), "run = %r: must be the"),
        (
            lambda run: np.savez(run / "log.npz", t=[0.0], state=np.eye(1)),
            "run = %r: must be the folder of a run, with log.npz, scenario.yaml"
            " (state has 1 columns)",
        ),
        (
            lambda run: (
                np.savez(run / "log.npz", t=[0.0], icp=np.eye(1)),
                (run / "summary.json").write_text(
                    '{"versions": {"nadia_balance": "0.1.0"}}'
                ),
            ),
            "run = %r: must be the folder of a run, with log.npz, scenario.yaml"
            " (icp has 1 columns; nadia_balance 0.1.0 wrote it, this is ",
        ),
        (
            lambda run: (run / "run.mcap").touch(),
            "run = %r: must be a folder without run.mcap",
        ),
    ],
)
def test_refuses_what_is_no_run(spoil, message, run, capsys):
    spoil(run)
    outcome = run_script(export_mcap, [run], capsys)
    assert_refused(outcome, message % str(run))


def test_says_how_the_extra_is_installed(run, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "foxglove", None)
    how = "foxglove is missing: pip install 'nadia_balance[mcap]'"
    assert_refused(run_script(export_mcap, [run], capsys), how)


def test_a_full_disk_leaves_no_half_file(run, monkeypatch, capsys):
    monkeypatch.setattr(Path, "write_bytes", full_disk)
    assert run_script(export_mcap, [run], capsys).code == 4
    assert {file.name for file in run.iterdir()} == {"log.npz", "scenario.yaml"}
