"""What holds for both ends of any wire; each end waits for a second at most."""

import time

import numpy as np

from nadia_balance.wire.messages import fault_of
from tests.wire.examples import command, numbers, state


def assert_states_arrive(robot, controller, n: int, tolerance: float) -> None:
    """In order, with all their numbers."""
    sent = [
        state(
            1.234,
            n=n,
            quaternion=np.array([0.5, -0.5, 0.5, 0.5]),
            sticks=np.array([0.25, -0.5, 1.0]),
            halt=True,
        ),
        state(1.236, n=n),
    ]
    assert controller.waiting() == 0
    for one in sent:
        robot.write(one)
    wait_until(lambda: controller.waiting() == 2)
    for left, one in zip((1, 0), sent, strict=True):
        assert_equal(controller.read(1.0), one, tolerance)
        assert controller.waiting() == left


def assert_commands_arrive(robot, controller, n: int, tolerance: float) -> None:
    """In order, and by one sender."""
    sent = [command(n, seed=1), command(n, seed=2)]
    for one in sent:
        controller.write(one)
    senders = set()
    for one in sent:
        sender, heard = robot.read(1.0)
        senders.add(sender)
        assert fault_of(heard, n) == ""
        assert_equal(heard, one, tolerance)
    assert len(senders) == 1


def assert_equal(heard, sent, tolerance: float) -> None:
    for name, value in numbers(sent).items():
        np.testing.assert_allclose(
            numbers(heard)[name], value, rtol=tolerance, atol=1e-9, err_msg=name
        )


def assert_rivals_are_heard(robot, controller, other, n: int) -> None:
    """Who has not sent anything is none; the robot tells them apart."""
    ends = controller, other
    while any(end.has_rivals() for end in ends):  # whoever was here before
        time.sleep(0.05)
    message = command(n)
    controller.write(message)
    wait_until(other.has_rivals)
    assert not controller.has_rivals()
    other.write(message)
    wait_until(controller.has_rivals)
    assert not any(end.has_rivals() for end in ends)
    assert len({robot.read(1.0)[0], robot.read(1.0)[0]}) == 2
    other.close()


def wait_until(is_so) -> None:
    end = time.monotonic() + 1.0
    while not is_so():
        assert time.monotonic() < end
        time.sleep(0.01)


def wait_for_each_other(robot, controller, n: int) -> None:
    """Until each reads what the other one sends: DDS takes its time."""
    heard, end = False, time.monotonic() + 10.0
    while not heard or not robot.read(0.01):
        assert time.monotonic() < end
        robot.write(state(0.001, n=n))
        heard = heard or controller.read(0.01) is not None
        if heard:
            controller.write(command(n))
    while robot.read(0.05) or controller.read(0.05):
        pass
