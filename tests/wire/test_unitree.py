"""What an end of Unitree's wire sends, the other one reads, as its SDK."""

import os
from dataclasses import replace

import numpy as np
import pytest
from unitree_sdk2py.idl.unitree_hg.msg.dds_ import LowCmd_, LowState_
from unitree_sdk2py.utils.crc import CRC

from nadia_balance.wire import unitree
from nadia_balance.wire.g1_motors import JOINTS
from nadia_balance.wire.messages import Mode, RefusedError
from nadia_balance.wire.unitree import UnitreeRobotWire, UnitreeWire
from tests.wire import ends
from tests.wire.examples import command, state

N = 29
DOMAIN = 100 + os.getpid() % 100  # of this test alone
SINGLE = 1e-6  # relative precision of the message's numbers
# In an order of one's own, which is not Unitree's.
MIXED = tuple(np.random.default_rng(3).permutation(JOINTS))


class Tap:
    """Keeps what is sent in the place of sending it."""

    def send(self, data: bytes) -> None:
        self.data = data


@pytest.fixture
def both():
    """The robot's end and the controller's."""
    robot = UnitreeRobotWire(MIXED, domain=DOMAIN)
    controller = UnitreeWire(MIXED, domain=DOMAIN)
    ends.wait_for_each_other(robot, controller, N)
    yield robot, controller
    robot.close()
    controller.close()


def test_both_messages_arrive_as_they_were(both):
    """Oracle: what was sent; times to a millisecond, single precision."""
    ends.assert_states_arrive(*both, N, tolerance=SINGLE)
    ends.assert_commands_arrive(*both, N, tolerance=SINGLE)


def test_a_state_is_one_of_the_sdk(both):
    """Oracle: the SDK's parser and its checksum."""
    robot, _ = both
    sent = state(1.234, n=N, sticks=np.array([0.25, -0.5, 1.0]), halt=True)
    robot._states = tap = Tap()
    robot.write(sent)
    message = LowState_.deserialize(tap.data)
    assert message.crc == CRC().Crc(message)
    assert (message.tick, message.mode_pr, message.mode_machine) == (1234, 0, 5)
    by_name = dict(zip(JOINTS, message.motor_state, strict=False))
    for i, joint in enumerate(MIXED):
        assert by_name[joint].mode == 1
        assert by_name[joint].q == pytest.approx(sent.q[i], rel=SINGLE)
        assert by_name[joint].dq == pytest.approx(sent.dq[i], rel=SINGLE)
        assert by_name[joint].tau_est == pytest.approx(sent.tau[i], rel=SINGLE)
    assert not any(motor.mode for motor in message.motor_state[N:])
    imu = message.imu_state
    np.testing.assert_allclose(imu.quaternion, sent.quaternion)
    np.testing.assert_allclose(imu.gyroscope, sent.gyro, rtol=SINGLE)
    np.testing.assert_allclose(imu.accelerometer, sent.force, rtol=SINGLE)
    remote = bytes(message.wireless_remote)
    axes = [np.frombuffer(remote, "<f4", 1, i)[0] for i in (4, 8, 20)]
    np.testing.assert_allclose(axes, [0.5, -1.0, 0.25])
    assert int.from_bytes(remote[2:4], "little") == 1 << 9  # B


def test_a_command_is_one_of_the_sdk(both):
    """Oracle: the SDK's parser and its checksum."""
    robot, controller = both
    robot.write(state(1.0, n=N))
    assert controller.read(1.0) is not None  # whose machine it answers
    sent = command(N)
    controller._commands = tap = Tap()
    controller.write(sent)
    message = LowCmd_.deserialize(tap.data)
    assert message.crc == CRC().Crc(message)
    assert (message.mode_pr, message.mode_machine) == (0, 5)
    by_name = dict(zip(JOINTS, message.motor_cmd, strict=False))
    for i, joint in enumerate(MIXED):
        assert by_name[joint].mode == 1
        for name in ("q", "dq", "tau", "kp", "kd"):
            value = getattr(by_name[joint], name)
            assert value == pytest.approx(getattr(sent, name)[i], rel=SINGLE)
    assert not any(motor.mode for motor in message.motor_cmd[N:])


def changed(robot, **fields) -> bytes:
    """A state of the SDK's own parser and checksum, with other fields."""
    usual, robot._states = robot._states, Tap()
    robot.write(state(1.0, n=N))
    data, robot._states = robot._states.data, usual
    message = LowState_.deserialize(data)
    for name, value in fields.items():
        setattr(message, name, value)
    message.crc = fields.get("crc", CRC().Crc(message))
    return message.serialize()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"crc": 1}, "crc = 1: must be the checksum"),
        ({"mode_machine": 4}, "mode_machine = 4: must be one of 2, 5, a G1"),
        ({"mode_pr": 1}, "mode_pr = 1: must be 0, pitch and roll"),
    ],
)
def test_refuses_what_is_not_of_this_robot(both, fields, message):
    """A G1 with 23 joints, ankles by their motors, a bit that fell over."""
    robot, controller = both
    robot._states.send(changed(robot, **fields))
    with pytest.raises(RefusedError, match=message):
        controller.read(1.0)


def test_reads_a_state_of_the_first_g1_and_of_a_simulator(both):
    """Their machine has another number, their checksum is 0."""
    robot, controller = both
    robot._states.send(changed(robot, mode_machine=2, crc=0))
    assert controller.read(1.0).time == 1.0
    controller._commands = tap = Tap()
    controller.write(command(N))
    assert LowCmd_.deserialize(tap.data).mode_machine == 2


def test_drives_are_on_or_off_all_together(both):
    """Oracle: by hand."""
    robot, controller = both
    controller._machine = 5
    controller.write(replace(command(N), mode=Mode.OFF))
    assert robot.read(1.0)[1].mode is Mode.OFF
    record = unitree._COMMANDS.empty()
    record["mode_machine"] = 5
    record["motor"]["mode"][0, :3] = 1
    controller._commands.send(unitree._COMMANDS.encoded(record))
    with pytest.raises(RefusedError, match=r"mode = \[0, 1\]: must be 0 or 1"):
        robot.read(1.0)


def test_hears_who_else_commands_the_robot(both):
    """Oracle: who has sent."""
    other = UnitreeWire(MIXED, domain=DOMAIN)
    ends.wait_for_each_other(both[0], other, N)
    both[1].read(0.0)
    ends.assert_rivals_are_heard(*both, other, N)


def test_a_message_of_other_motors_has_another_size():
    """A robot of another kind has another message."""
    with pytest.raises(RefusedError, match="must be of 1000, of 35 motors"):
        unitree._COMMANDS.decoded(bytes(4 + 972))


def test_another_robot_has_no_such_wire():
    """Oracle: the names."""
    with pytest.raises(
        ValueError, match="wire = 'unitree': must be of a robot"
    ):
        UnitreeWire(["knee"])
