"""The loop on a wire that is a script, and a clock that is that wire's."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.wire import loop
from nadia_balance.wire.messages import RefusedError, RobotState
from nadia_balance.wire.process import Phase, RobotProcess
from tests.wire.examples import BEARS, LIMITS, STANDING, FakeBalance, state

DT = 0.002
BEGIN = 100.0


class Scripted:
    """A robot: each entry is what one read gives, and how long it takes.

    States come when its clock and this one say so, which began together.
    """

    def __init__(self, script) -> None:
        self.script, self.now, self.sent, self.others = script, BEGIN, [], 0
        self.time = 0.0  # of the last state that was read

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds

    def read(self, timeout: float):
        answer, delay = self.script.pop(0)
        self.time = getattr(answer, "time", self.time)
        self.now += min(delay, timeout) if answer is None else delay
        if isinstance(answer, Exception):
            raise answer
        return answer

    def waiting(self) -> int:
        states = [one for one, _ in self.script if isinstance(one, RobotState)]
        return sum(
            self.time < one.time <= self.now - BEGIN + 1e-9 for one in states
        )

    def write(self, command) -> None:
        self.sent.append(command)

    def has_rivals(self) -> bool:
        return self.others > 0

    def close(self) -> None:
        pass


def ran(monkeypatch, script, slower=1.0, rival=lambda process: False):
    """The wire, the process, the delays and the lines after a script.

    Someone else commands while `rival` of the process is true.
    """
    wire, lines = Scripted(list(script)), []
    monkeypatch.setattr(loop, "time", wire)
    balance = FakeBalance()
    balance.shares = np.array([0.5, 0.5])
    process = RobotProcess(
        balance, STANDING, LIMITS, BEARS, np.ones((2, 3)), tell=lines.append
    )
    process.start()

    def each():
        wire.others = int(rival(process))
        return bool(wire.script)

    delays = loop.run(wire, process, each, slower=slower)
    return wire, process, delays, lines


def samples(count: int, begin: float = 0.0, delay: float = DT):
    return [(state(begin + DT * i), delay) for i in range(1, count + 1)]


def test_answers_each_sample_and_lets_go_at_the_end(monkeypatch):
    """Oracle: by hand."""
    wire, process, delays, _ = ran(monkeypatch, samples(1500))
    assert len(wire.sent) == 1501
    assert process.counts.ticks > 100
    assert delays.balanced
    assert process.phase is Phase.DAMPING
    assert not wire.sent[-1].tau.any()
    assert (delays.late, delays.longest) == (0, pytest.approx(0.0, abs=1e-9))


def test_a_silent_wire_lets_go_though_there_is_noise_on_it(monkeypatch):
    """RefusedError messages are none: 50 ms after the last good one."""
    noise = [(RefusedError("crc = 1: must be the checksum"), 0.01)] * 6
    script = [*samples(1500), *noise, *[(None, 0.06)] * 10]
    wire, process, _, lines = ran(monkeypatch, script)
    assert wire.now >= 100.0 + 3.0 + 0.06 + 9 * 0.05  # it waits
    assert process.counts.silences == 1
    assert process.counts.refused == 6
    assert "refused: crc = 1" in " ".join(lines)
    assert lines[-1].endswith("damping: the robot is silent")


@pytest.mark.parametrize(
    "bad",
    [
        state(3.002, q=np.full(len(STANDING), np.nan)),  # not finite
        state(3.0),  # a clock that stands still
    ],
)
def test_samples_that_are_not_used_are_a_silence(monkeypatch, bad):
    """Oracle: 50 ms after the last good one; halted, at once."""
    script = [*samples(1500), *[(bad, DT)] * 40]
    wire, process, delays, lines = ran(monkeypatch, script)
    assert process.counts.silences == 1
    assert lines[-1].endswith("damping: the robot is silent")
    assert not wire.sent[-1].kp.any()
    assert not delays.balanced
    script = [*samples(1500), (replace(bad, halt=True), DT), *[(bad, DT)] * 5]
    wire, process, _, lines = ran(monkeypatch, script)
    assert lines[-1].endswith("damping: its remote control")
    assert process.counts.silences == 0


def test_a_robot_in_lock_step_may_be_slow(monkeypatch):
    """Oracle: 20 times 50 ms."""
    script = [*samples(1500), (None, 0.9), *samples(10, begin=3.0)]
    _, process, _, _ = ran(monkeypatch, script, slower=20.0)
    assert process.counts.silences == 0


def test_counts_answers_that_are_late(monkeypatch):
    """Oracle: by hand: 5 samples come while the first one waits for 10.5 ms.

    Each of the next ones takes 1 of 2 ms: 4, 4, 3, 3, 2, 2, 1 .. wait then.
    """
    slow = samples(1, begin=3.0, delay=0.0125)
    script = [*samples(1500), *slow, *samples(20, begin=3.002, delay=0.001)]
    _, process, delays, _ = ran(monkeypatch, script)
    assert process.counts.silences == 0
    assert delays.longest == pytest.approx(0.010)
    assert delays.late == 7


def test_passes_over_every_second_tick_while_it_is_late(monkeypatch):
    """Oracle: by hand: ticks are due each second sample, and are late for 7."""
    slow = samples(1, begin=3.0, delay=0.0125)
    script = [*samples(1500), *slow, *samples(20, begin=3.002, delay=0.001)]
    _, process, _, _ = ran(monkeypatch, script)
    counts = process.counts
    assert counts.passed == 2
    assert counts.ticks - counts.passed == len(process._balance.ticks)
    times = [time for time, _ in process._balance.passed]
    assert np.diff(times) == pytest.approx([0.008])
    np.testing.assert_allclose(
        [imu[:3] for _, imu in process._balance.passed],
        np.outer(np.array(times) - 0.5 * DT, [1.0, -2.0, 3.0]),
    )


def test_lets_go_when_it_is_too_far_behind(monkeypatch):
    """A command for a robot of 50 ms ago is none.

    Oracle: by hand: 20 samples, each later by 2.7 ms: 27 wait.
    """
    script = samples(1500) + samples(60, begin=3.0, delay=0.0047)
    _, _, _, lines = ran(monkeypatch, script)
    (line,) = [line for line in lines if "behind" in line]
    assert line.endswith("damping: 54 ms behind the robot")


def test_lets_go_when_someone_else_commands(monkeypatch):
    """Two who balance one robot do not, nor does one who lifts it up."""
    for rival, most in (
        (lambda process: process.counts.ticks > 20, 30),
        (lambda process: process.phase is Phase.POSTURE, 0),
    ):
        script = samples(1500)
        _, process, _, lines = ran(monkeypatch, script, rival=rival)
        assert process.counts.ticks <= most
        assert lines[-1].endswith("another controller commands it")


def test_an_error_leaves_the_robot_damped(monkeypatch):
    """Oracle: what is sent last, after stiff joints; the error."""
    script = [*samples(300), (OSError("hung up"), 0.0)]
    wires = []

    class Kept(Scripted):
        def __init__(self, script):
            super().__init__(script)
            wires.append(self)

    monkeypatch.setitem(globals(), "Scripted", Kept)
    with pytest.raises(OSError, match="hung up"):
        ran(monkeypatch, script)
    ((*_, before, last),) = [wire.sent for wire in wires]
    assert before.kp.any() and not last.kp.any() and not last.tau.any()


def test_does_not_begin_where_someone_else_commands(monkeypatch):
    """Oracle: the error."""
    wire = Scripted([])
    monkeypatch.setattr(loop, "time", wire)
    loop.refuse_rivals(wire)
    assert not wire.sent
    wire.others = 1
    with pytest.raises(ValueError, match="must be the only one"):
        loop.refuse_rivals(wire)


def test_says_nothing_to_a_robot_that_was_never_heard(monkeypatch):
    """Oracle: what is sent."""
    wire, *_ = ran(monkeypatch, [(None, 0.06)] * 5)
    assert not wire.sent
