"""A robot gets up, is balanced and let go, by its own clock."""

import numpy as np
import pytest

from nadia_balance.wire.process import Phase, RobotProcess, between
from tests.wire.examples import (
    BEARS,
    LIMITS,
    STANDING,
    FakeBalance,
    numbers,
    state,
)

DT = 0.002  # of the bus [s]
VELOCITIES = np.array([[-0.2, -0.1, -0.5], [0.4, 0.1, 0.5]])


class Told:
    """A process, its balance, and what it told."""

    def __init__(self) -> None:
        self.balance, self.lines = FakeBalance(), []
        self.process = RobotProcess(
            self.balance,
            STANDING,
            LIMITS,
            BEARS,
            VELOCITIES,
            tell=self.lines.append,
        )
        self.now = 10.0  # of a clock that has run for a while [s]

    def hear(self, samples: int, **changes):
        """The answer to the last of some samples."""
        for _ in range(samples):
            self.now += DT
            answer = self.process.hear(state(self.now, **changes))
        return answer

    def balancing(self) -> "Told":
        self.process.start()
        self.balance.shares = np.array([0.5, 0.45])
        while self.process.phase is not Phase.BALANCE:
            self.hear(1)
        return self


def is_damping(command) -> bool:
    return not command.kp.any() and not command.tau.any()


def test_gets_up_by_its_phases():
    """Oracles: the law of each; a cubic by its ends, middle and slope."""
    told = Told()
    damping = told.hear(5)
    np.testing.assert_array_equal(damping.kd, 0.03 * LIMITS)
    assert is_damping(damping)
    told.process.start()
    first = told.hear(1)
    begin = state(told.now).q
    np.testing.assert_allclose(first.q, begin)
    np.testing.assert_allclose(first.kp, [4.0, 4.0, 1.0] * LIMITS)
    middle = told.hear(500)
    assert told.process.phase is Phase.POSTURE
    np.testing.assert_allclose(middle.q, 0.5 * (begin + STANDING))
    np.testing.assert_allclose(middle.dq, 1.5 * (STANDING - begin) / 2.0)
    last = told.hear(500)
    np.testing.assert_allclose(last.q, STANDING)
    np.testing.assert_allclose(last.dq, 0.0, atol=1e-12)
    for shares in ([0.0, 0.0], [0.9, 0.1], [0.4, 0.4]):
        told.balance.shares = np.array(shares)
        told.hear(200)
        assert told.process.phase is Phase.LOAD
    told.balance.shares = np.array([0.5, 0.45])
    told.hear(49)
    assert told.process.phase is Phase.LOAD
    told.hear(4)
    assert told.process.phase is Phase.BALANCE
    assert told.balance.begun == 1
    assert [line.split()[-1] for line in told.lines] == [
        "posture",
        "load",
        "balance",
    ]


def test_a_robot_that_falls_before_it_is_balanced_is_let_go():
    """Oracle: the phase, and the line; it is loaded, but lies."""
    told = Told()
    told.process.start()
    told.hear(1002)
    assert told.process.phase is Phase.LOAD
    lying = np.array([0.0, 1.0, 0.0, 0.0])
    assert is_damping(told.hear(1, quaternion=lying))
    assert told.lines[-1].endswith("damping: pelvis tilted")
    assert told.process.counts.falls == 1


def test_ticks_by_the_robots_clock_with_the_mean_of_the_imu():
    """Oracle: by hand: two samples a period, rates that rise with time."""
    told = Told().balancing()
    begin = told.balance.ticks[0][0]
    told.hear(10)
    times = [tick[0] for tick in told.balance.ticks]
    np.testing.assert_allclose(times, begin + 0.004 * np.arange(6))
    for time, imu, _, _ in told.balance.ticks[1:]:
        np.testing.assert_allclose(imu[:3], state(time - 0.5 * DT).gyro)
        np.testing.assert_allclose(imu[3:6], state(time - 0.5 * DT).force)
        np.testing.assert_allclose(imu[6:], state(time).gyro)


@pytest.mark.parametrize("lost", [1, 2, 20])
def test_bridges_lost_samples_and_keeps_its_time(lost):
    """Oracle: all numbers are linear in time, and so is what bridges them."""
    told = Told().balancing()
    told.hear(4)
    before = len(told.balance.ticks)
    told.now += lost * DT
    told.hear(1)
    told.hear(3)
    counts = told.process.counts
    assert (counts.lost, counts.late, counts.silences) == (lost, 0, 0)
    begin = told.balance.ticks[0][0]
    assert len(told.balance.ticks) == before + (lost + 4) // 2
    for i, (time, imu, sample, _) in enumerate(told.balance.ticks[1:], 1):
        assert time == pytest.approx(begin + 0.004 * i)
        true = numbers(state(time))
        for name, value in numbers(sample).items():
            np.testing.assert_allclose(value, true[name], atol=1e-12)
        np.testing.assert_allclose(imu[:3], state(time - 0.5 * DT).gyro)


def test_a_late_sample_is_counted_and_not_used():
    """Oracle: by hand."""
    told = Told().balancing()
    told.now += DT
    late = state(told.now)
    told.hear(2)
    ticks = len(told.balance.ticks)
    assert told.process.counts.lost == 1
    assert told.process.hear(late) is None
    assert told.process.hear(late) is None  # twice: lost only once
    counts = told.process.counts
    assert (counts.lost, counts.late) == (0, 2)
    assert len(told.balance.ticks) == ticks
    assert told.process.phase is Phase.BALANCE


def test_lets_go_of_a_robot_that_is_silent_until_it_is_started():
    """Oracle: 50 ms; by the caller's clock, or by the gap in the robot's."""
    told = Told()
    assert told.process.silent() is None
    told.balancing()
    told.now += 0.048
    assert not is_damping(told.hear(1))
    assert told.process.counts.lost == 24
    told.now += 0.2
    assert is_damping(told.hear(1))
    assert is_damping(told.hear(1000))
    assert told.process.counts.silences == 1
    told.balancing()
    for _ in range(3):
        assert is_damping(told.process.silent())
    told.now += 0.2
    assert is_damping(told.hear(1))
    assert told.process.counts.silences == 2
    assert told.balancing().balance.begun == 3


def test_lets_go_when_the_robots_clock_runs_back():
    """As after a restart; the new time is the robot's."""
    told = Told().balancing()
    told.now = 1.0
    assert is_damping(told.hear(1))
    assert "ran back by" in told.lines[-1]
    assert told.process.counts.lost == told.process.counts.late == 0
    told.balancing()
    assert told.process.time == pytest.approx(told.now)


def test_refuses_what_is_not_finite_and_tells_so_once():
    """The sample is bridged like a lost one."""
    told = Told().balancing()
    told.now += DT
    for _ in range(3):
        bad = state(told.now, gyro=np.array([0.0, np.nan, 0.0]))
        assert told.process.hear(bad) is None
    told.hear(1)
    counts = told.process.counts
    assert (counts.refused, counts.lost) == (3, 1)
    refusals = [line for line in told.lines if "refused" in line]
    (line,) = refusals
    assert line.endswith("gyro = [0.0, nan, 0.0]: must be finite")


@pytest.mark.parametrize("how", ["fall", "fault", "halt", "stop", "broken"])
def test_lets_go(how):
    """After a fall, without a command, and by two ways of being told."""
    told = Told().balancing()
    told.balance.fall = "pelvis tilted" if how == "fall" else ""
    told.balance.fault = "no QP" if how == "fault" else None
    told.balance.is_broken = how == "broken"
    if how == "stop":
        told.process.stop("a key")
    reasons = {
        "fall": "pelvis tilted",
        "fault": "no QP",
        "halt": "its remote control",
        "stop": "a key",
        "broken": "q = [nan, nan, nan]: must be finite",
    }
    assert is_damping(told.hear(2, halt=how == "halt"))
    assert told.lines[-1].endswith(f"damping: {reasons[how]}")
    assert told.process.counts.falls == (how == "fall")
    told.balance.fall, told.balance.fault = "", None
    told.balance.is_broken = False
    assert is_damping(told.hear(500))
    assert told.balancing().process.phase is Phase.BALANCE


def test_walks_as_keys_or_sticks_say():
    """Oracle: the limits, of two at once 0.5^0.5; none of a stick at rest."""
    told = Told().balancing()
    told.process.velocity = np.array([0.1, 0.0, 0.2])
    told.hear(2)
    np.testing.assert_array_equal(told.balance.ticks[-1][3], [0.1, 0.0, 0.2])
    told.hear(2, sticks=np.array([1.0, -1.0, 0.0]))
    np.testing.assert_allclose(
        told.balance.ticks[-1][3], np.sqrt(0.5) * np.array([0.4, -0.1, 0.0])
    )
    told.hear(2, sticks=np.array([0.0, 0.1, -1.0]))
    np.testing.assert_allclose(told.balance.ticks[-1][3], [0.0, 0.0, -0.5])
    told.process.stop("a key")
    assert not told.process.velocity.any()


def test_between_two_orientations_is_the_shorter_way():
    """Oracle: half of a turn of 0.2 rad; q and -q are one orientation."""
    turned = np.array([np.cos(0.1), 0.0, 0.0, np.sin(0.1)])
    half = between(state(0.0), state(1.0, quaternion=-turned), 0.5).quaternion
    np.testing.assert_allclose(half, [np.cos(0.05), 0.0, 0.0, np.sin(0.05)])
