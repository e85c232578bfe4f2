"""What one end of LCM sends, the other one reads."""

import os
import time
from dataclasses import replace

import numpy as np
import pytest
from pydrake.lcm import DrakeLcm

from nadia_balance.wire import lcm
from nadia_balance.wire.lcm import LcmRobotWire, LcmWire
from nadia_balance.wire.messages import Mode, RefusedError
from tests.wire import ends
from tests.wire.examples import N, command, state

JOINTS = ["knee", "hip", "ankle"]
DOMAIN = 100 + os.getpid() % 100  # of this test alone


@pytest.fixture
def both():
    """The robot's end and the controller's."""
    robot, controller = (
        LcmRobotWire(JOINTS, domain=DOMAIN),
        LcmWire(JOINTS, domain=DOMAIN),
    )
    yield robot, controller
    robot.close()
    controller.close()


def test_both_messages_arrive_as_they_were(both):
    """Oracle: what was sent; times to a microsecond."""
    ends.assert_states_arrive(*both, N, tolerance=1e-15)
    ends.assert_commands_arrive(*both, N, tolerance=0.0)


def test_waits_no_longer_than_it_is_told(both):
    """Oracle: a clock; its own commands, which it hears, are no answer."""
    robot, controller = both
    controller.write(command())
    began = time.monotonic()
    assert controller.read(0.05) is None
    assert 0.05 <= time.monotonic() - began < 5.0
    assert robot.read(1.0) is not None
    assert robot.read(0.0) is None


def test_hears_no_other_machine(both, monkeypatch):
    """Oracle: RFC 5737: 192.0.2.1 is nobody's address."""
    assert lcm.is_here("127.0.0.1")
    assert not lcm.is_here("192.0.2.1")
    robot, controller = both
    monkeypatch.setattr(lcm, "is_here", lambda address: False)
    robot.write(state(1.0))
    assert controller.read(0.05) is None
    monkeypatch.undo()
    robot.write(state(2.0))
    assert controller.read(1.0).time == 2.0


@pytest.mark.parametrize("interface", ["", "nope0"])
def test_refuses_an_interface_that_is_not_there(interface):
    message = f"^interface = '{interface}': must be one of .*lo"
    with pytest.raises(ValueError, match=message):
        LcmWire(JOINTS, interface, DOMAIN)


def test_refuses_what_is_not_of_this_robot(both):
    """Another robot has other joints; anyone may send anything."""
    robot, controller = both
    other = LcmRobotWire([*JOINTS, "toe"], domain=DOMAIN)
    other.write(state(1.0, n=4))
    other.close()
    with pytest.raises(RefusedError, match="has 26 numbers: must be of the 23"):
        controller.read(1.0)
    DrakeLcm(f"udpm://239.255.76.67:{7667 + DOMAIN}?ttl=0").Publish(
        "ROBOT_COMMAND", b"no message"
    )
    with pytest.raises(RefusedError, match="ROBOT_COMMAND is no lcmt"):
        robot.read(1.0)
    controller.write(replace(command(), mode=2))
    with pytest.raises(RefusedError, match="mode = 2: must be 0 or 1"):
        robot.read(1.0)
    controller.write(replace(command(), mode=Mode.OFF))
    assert robot.read(1.0)[1].mode is Mode.OFF


def test_hears_who_else_commands_the_robot(both):
    """Oracle: who has sent."""
    ends.assert_rivals_are_heard(*both, LcmWire(JOINTS, domain=DOMAIN), N)


def test_keeps_what_comes_while_nobody_reads(both):
    """Oracle: what was sent, in its order."""
    robot, controller = both
    for tick in range(40):
        robot.write(state(0.002 * tick))
    times = [controller.read(1.0).time for _ in range(40)]
    np.testing.assert_allclose(times, 0.002 * np.arange(40), atol=1e-9)


def test_numbers_that_are_not_finite_arrive(both):
    """They are refused by who reads them."""
    robot, controller = both
    robot.write(state(1.0, tau=np.array([np.nan, 1.0, -np.inf])))
    np.testing.assert_array_equal(
        controller.read(1.0).tau, [np.nan, 1.0, -np.inf]
    )


def test_a_domain_is_a_port():
    """Oracle: the rule."""
    with pytest.raises(ValueError, match="domain = 233: must be in"):
        LcmWire(JOINTS, domain=233)
