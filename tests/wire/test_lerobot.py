"""LeRobot's caller finds what it asks for, and its drives do what we ask."""

import re
import shutil
from types import SimpleNamespace

import numpy as np
import pytest

from nadia_balance.wire.g1_motors import JOINTS
from nadia_balance.wire.lerobot import LeRobotController, lerobot_name
from nadia_balance.wire.messages import JointCommand
from nadia_balance.wire.process import Phase
from tests.source_files import ROOT


class FakeCaller:
    """As LeRobot's UnitreeG1: one state, one call, one command a period."""

    def __init__(self, controller) -> None:
        self.controller = controller
        self.motors = [
            SimpleNamespace(q=0.0, dq=0.0, tau_est=0.0) for _ in range(35)
        ]
        self.imu = SimpleNamespace(
            quaternion=[1.0, 0.0, 0.0, 0.0],
            gyroscope=[0.0, 0.0, 0.0],
            accelerometer=[0.0, 0.0, 9.81],
            rpy=[0.0, 0.0, 0.0],
        )

    def step(self, **action: float):
        """The torques of its drives (29,), and the targets by key."""
        state = SimpleNamespace(
            motor_state=self.motors,
            imu_state=self.imu,
            wireless_remote=bytes(40),
            mode_machine=5,
        )
        targets = self.controller.run_step(action, state)
        q = np.array([motor.q for motor in self.motors[:29]])
        dq = np.array([motor.dq for motor in self.motors[:29]])
        commanded = np.array([targets[lerobot_name(name)] for name in JOINTS])
        kp, kd = self.controller.kp, self.controller.kd
        return kp * (commanded - q) - kd * dq, targets


@pytest.fixture(scope="module")
def controller():
    return LeRobotController()


def test_has_the_names_and_shapes_of_its_socket(controller):
    """Oracle: LeRobot's protocol and its enumeration of joints."""
    assert controller.control_dt == 0.004
    assert controller.kp.shape == controller.kd.shape == (29,)
    keys = list(FakeCaller(controller).step()[1])
    assert keys[:4] == [
        "kLeftHipPitch.q",
        "kLeftHipRoll.q",
        "kLeftHipYaw.q",
        "kLeftKnee.q",
    ]
    assert keys[12:16] == [
        "kWaistYaw.q",
        "kWaistRoll.q",
        "kWaistPitch.q",
        "kLeftShoulderPitch.q",
    ]
    assert keys[28] == "kRightWristYaw.q"


def test_its_drives_give_the_torques_of_the_command(controller, monkeypatch):
    """Oracle: the law of a JointCommand, in the order of the motors."""
    caller, random = FakeCaller(controller), np.random.default_rng(0)
    for motor in caller.motors:
        motor.q, motor.dq = random.standard_normal(2)
    sent = JointCommand(*random.random((5, 29)))
    monkeypatch.setattr(controller._process, "hear", lambda _: sent)
    q = np.array([motor.q for motor in caller.motors[:29]])
    dq = np.array([motor.dq for motor in caller.motors[:29]])
    expected = sent.tau + sent.kp * (sent.q - q) + sent.kd * (sent.dq - dq)
    np.testing.assert_allclose(caller.step()[0], expected, atol=1e-12)


def test_joints_are_known_by_their_names(tmp_path, controller):
    """Oracle: the same robot, whose URDF has its motors the other way round."""
    folder = tmp_path / "g1"
    shutil.copytree(ROOT / "models" / "g1", folder)
    text = (folder / "g1.urdf").read_text("utf-8")
    motors = re.findall(r"<transmission .*?</transmission>", text, re.DOTALL)
    backward = iter(motors[::-1])
    text = re.sub(
        r"<transmission .*?</transmission>",
        lambda _: next(backward),
        text,
        flags=re.DOTALL,
    )
    (folder / "g1.urdf").write_text(text, "utf-8")
    turned = LeRobotController(str(folder / "robot.yaml"))
    controller.reset()
    np.testing.assert_array_equal(turned.kp, controller.kp)
    callers = FakeCaller(turned), FakeCaller(controller)
    for caller in callers:
        for i, motor in enumerate(caller.motors):
            motor.q = 0.01 * i
    for _ in range(100):
        (ours, targets), (theirs, others) = (one.step() for one in callers)
    assert targets == pytest.approx(others, abs=1e-9)
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


def test_another_robot_is_refused():
    """Oracle: the joints of LeRobot's G1."""
    message = "^robot = 'nadia': must be of a robot with the 29 joints of the"
    with pytest.raises(ValueError, match=message):
        LeRobotController("nadia")


def test_takes_the_posture_and_begins_anew_after_a_reset(controller):
    """Oracle: the posture of standing, 2 s after either."""
    caller = FakeCaller(controller)
    for _ in range(2):
        controller.reset()
        _, first = caller.step()
        assert max(map(abs, first.values())) < 1e-12
        for _ in range(501):
            _, targets = caller.step()
        assert controller._process.phase is Phase.LOAD
        assert targets["kLeftKnee.q"] == pytest.approx(0.669, abs=0.05)
        assert targets["kLeftShoulderPitch.q"] == pytest.approx(0.2, abs=0.05)


def test_states_that_are_not_finite_damp_once_it_is_silent(controller):
    """Oracle: the torques before, for 50 ms; then those of dampers.

    These are against each joint's speed, and nothing where it rests.
    """
    caller = FakeCaller(controller)
    controller.reset()
    for _ in range(100):
        before, _ = caller.step()
    lost = controller._process.counts.lost
    caller.motors[3].dq = 2.0
    caller.imu.gyroscope = [np.nan, 0.0, 0.0]
    for _ in range(12):
        torques, _ = caller.step()
    assert np.abs(np.delete(torques - before, 3)).max() < 1e-9
    assert np.abs(torques).max() > 1.0
    torques, _ = caller.step()
    assert torques[3] == pytest.approx(-0.03 * 111.0 * 2.0)
    assert np.abs(np.delete(torques, 3)).max() < 1e-12
    assert controller._process.counts.silences == 1
    assert controller._process.counts.lost == lost == 0


def test_a_robot_with_fewer_joints_is_refused(controller):
    """Oracle: the number of a G1's; LeRobot's states have more."""
    caller = FakeCaller(controller)
    del caller.motors[28:]
    with pytest.raises(ValueError, match="has 28 motors: must have 29"):
        caller.step()


def test_joints_that_are_not_finite_keep_the_last_targets(controller):
    """Oracle: those of the step before; without one, where the joints are."""
    for has_begun in False, True:
        caller = FakeCaller(controller)
        controller.reset()
        targets = caller.step()[1] if has_begun else None
        caller.motors[5].q = np.nan
        _, found = caller.step()
        if targets is None:
            assert np.isfinite([*found.values()]).all()
        else:
            assert found == targets


def test_walks_by_its_remote_control(controller, monkeypatch):
    """Oracle: LeRobot's axes: ly forward, lx to the right, rx clockwise."""
    heard = []
    monkeypatch.setattr(controller._process, "hear", heard.append)
    axes = {"remote.ly": 0.5, "remote.lx": 0.25, "remote.rx": -1.0}
    FakeCaller(controller).step(**axes, other=3.0)
    np.testing.assert_array_equal(heard[0].sticks, [0.5, -0.25, 1.0])
