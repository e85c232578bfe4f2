"""What the robot's side does with samples and commands."""

import numpy as np
import pytest

from nadia_balance.wire.messages import JointCommand
from nadia_balance.wire.process import damping
from nadia_balance.wire.serve import Bus, BusFaults, Listener, Pace
from tests.wire.examples import LIMITS, N, command, state

DT = 0.002
DAMPING = damping(np.zeros(N), LIMITS)


def arrivals(faults: BusFaults, samples: int = 5000) -> tuple[Bus, list, list]:
    """The bus, the times of the samples, and those at which they arrive."""
    bus, sent, came = Bus(faults, seed=1), [], []
    for tick in range(samples):
        now = DT * tick
        bus.send(state(now), alone=now)
        for sample in bus.arrived(now):
            sent.append(sample.time)
            came.append(now)
    return bus, sent, came


def test_a_bus_without_faults_delivers_at_once():
    """Oracle: by hand."""
    bus, sent, came = arrivals(BusFaults())
    assert sent == came == [DT * tick for tick in range(5000)]
    assert bus.lost == bus.late == 0


def test_a_bus_delays_all_samples():
    """Oracle: by hand."""
    _, sent, came = arrivals(BusFaults(delay=0.006))
    np.testing.assert_allclose(np.subtract(came, sent), 0.006)
    assert len(sent) == 5000 - 3


def test_a_bus_loses_and_holds_back_at_random():
    """Oracle: binomial, within four deviations; late ones are overtaken."""
    bus, sent, came = arrivals(BusFaults(lost=0.02, late=0.01))
    assert bus.lost == pytest.approx(100, abs=40)
    assert bus.late == pytest.approx(50, abs=28)
    delays = np.subtract(came, sent)
    assert np.count_nonzero(np.isclose(delays, 0.004)) == bus.late
    assert np.count_nonzero(np.isclose(delays, 0.0, atol=1e-9)) == (
        len(sent) - bus.late
    )
    assert np.count_nonzero(np.diff(sent) < 0.0) > 30


def test_a_bus_is_silent_once():
    """Oracle: by hand: 200 ms from 3 s on."""
    bus, sent, _ = arrivals(BusFaults(silence=0.2, silent_at=3.0))
    gap = np.argmax(np.diff(sent))
    assert bus.lost == 100
    assert sent[gap + 1] - sent[gap] == pytest.approx(0.202)
    assert sent[gap + 1] == pytest.approx(3.2)


def test_a_silence_goes_on_though_the_robot_is_lifted():
    """Oracle: by hand: it stands alone for 10 ms."""
    bus = Bus(BusFaults(silence=0.2, silent_at=0.006))
    for tick in range(300):
        bus.send(state(DT * tick), alone=DT * tick if tick < 5 else 0.0)
    assert bus.lost == 100


def test_a_share_is_one():
    """Oracle: its bounds."""
    with pytest.raises(ValueError, match=r"lost = 2.0: must be in \[0, 1\]"):
        Bus(BusFaults(lost=2.0))


class TestListener:
    """It obeys one controller, and none that is silent."""

    def setup_method(self):
        self.lines = []
        self.listener = Listener(N, DAMPING, self.lines.append)

    def test_obeys_until_a_silence(self):
        """Oracle: 50 ms."""
        assert self.listener.command is DAMPING
        assert self.listener.is_new
        assert not self.listener.is_left
        sent = command()
        self.listener.hear(7, sent, now=1.0)
        self.listener.release_if_silent(1.05)
        assert self.listener.command is sent
        assert not self.listener.is_left
        self.listener.release_if_silent(1.052)
        assert self.listener.command is DAMPING
        assert self.listener.is_left
        assert self.lines == ["it is commanded", "no commands: damping"]
        again = command(seed=1)
        self.listener.hear(8, again, now=2.0)  # as after a restart
        assert self.listener.command is again

    def test_refuses_what_is_unfit_and_lets_go(self):
        """A controller that sends nothing else is as good as silent."""
        self.listener.hear(7, command(), now=1.0)
        bad = JointCommand(*np.full((5, N), np.nan))
        for tick in range(1, 30):
            now = 1.0 + DT * tick
            self.listener.hear(7, bad, now)
            self.listener.hear(7, command(n=4), now)
            self.listener.release_if_silent(now)
        assert self.listener.command is DAMPING
        assert self.listener.refused == 58
        assert [line for line in self.lines if line.startswith("refused")] == [
            "refused: q = [nan, nan, nan]: must be finite",
            "refused: q has 4 numbers: must be 3",
        ]

    def test_ignores_a_second_controller(self):
        """And tells so once."""
        first = command()
        for tick in range(100):
            self.listener.hear(7, first, DT * tick)
            self.listener.hear(8, command(seed=1), DT * tick)
            self.listener.release_if_silent(DT * tick)
            assert self.listener.command is first
        assert len(self.lines) == 2
        assert "a second controller" in self.lines[1]


def test_a_clock_makes_up_for_what_is_late():
    """Oracle: by hand: 10 ms late of a step that takes 1 ms, 50 at the most."""
    pace = Pace(due=7.0, debt=0.05)
    assert pace.rest(7.0005) == pytest.approx(0.0015)
    rests = [pace.rest(7.014 + 0.001 * i) for i in range(14)]
    assert rests[:10] == [0.0] * 10  # due at 7.004, 7.006 ..
    np.testing.assert_allclose(rests[10:], [0.0, 0.001, 0.002, 0.003])
    assert pace.lost == 0.0
    assert pace.rest(8.0) == 0.0
    assert pace.due == pytest.approx(7.95)
    assert pace.lost == pytest.approx(7.95 - 7.032)
