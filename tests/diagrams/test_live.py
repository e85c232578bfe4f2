"""Live sessions of the point mass, clicked as a browser would."""

import signal

import pytest

from nadia_balance.diagrams import live
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.live import RESET, LiveSession, endless
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.view.live_controls import PUSH, SIZE
from nadia_balance.view.scene import start_meshcat
from tests.clicks import click

BEGIN = 0.5 + 0.8  # of the first swing: it stands, and shifts its weight [s]


class Session(LiveSession):
    """As fast as can be, with what it has told; a look a control period."""

    def __init__(self, text="{lipm_period: 0.02}"):
        scenario = endless(load_scenario("push", text=text))
        self.meshcat, self.told = start_meshcat()[0], []
        diagram = LipmDiagram(scenario, self.meshcat)
        super().__init__(diagram, self.meshcat, self.told.append, 10.0)

    def ticks(self, number):
        for _ in range(number):
            self.tick()

    def state(self):
        own = self._diagram.plant.GetMyContextFromRoot(self.context)
        return own.get_discrete_state(0).CopyToVector()

    def times_logged(self):
        return self._diagram.read_logs(self.context)["t"]


@pytest.fixture
def session(monkeypatch) -> Session:
    monkeypatch.setattr(live, "LYING", 0.0)
    return Session()


def test_walks_without_the_scripted_push_and_without_a_log(session):
    """Oracle: the steps of the gait: 0.5 s and 0.8 s, then 1 s each.

    It begins with the first swing.  Nothing that was logged is kept.
    """
    assert session.context.get_time() == pytest.approx(BEGIN)
    session.ticks(200)
    assert session.context.get_time() == pytest.approx(5.3)
    port = session._diagram.GetOutputPort("walking_state")
    assert port.Eval(session.context).steps_taken == 4
    assert session.told == []
    assert session.status()[2] == "walks"
    assert len(session.times_logged()) == 0


def test_a_reset_begins_the_very_same_walk_with_what_is_on(session):
    """Oracle: the state of the first walk, bit for bit; the button's label."""
    session.ticks(150)
    first = session.state()
    click(session.meshcat, PUSH)
    click(session.meshcat, "cross-over: on")
    session.ticks(50)
    click(session.meshcat, RESET)
    session.ticks(150)
    assert session.context.get_time() == pytest.approx(BEGIN + 3.0)
    assert (session.state() == first).all()
    assert "cross-over: off" in session.meshcat.GetButtonNames()
    assert session.told[-1] == "t=5.30 s  reset"
    assert session.status()[2] == "walks"


def test_tells_a_push_and_the_recovery(session):
    """Oracles: m delta_v / 0.1 s; by hand: inward, so the legs cross.

    Two whole steps of 1 s each, after the first one, which lands sooner.
    """
    session.meshcat.SetSliderValue(SIZE, 0.6)
    session.ticks(85)
    click(session.meshcat, PUSH)
    session.ticks(250)
    pushed, recovered = session.told
    newtons = session._diagram.robot.mass * 6.0
    push = f"push 0.60 m/s left, right transfer 0 %  F = {newtons:.0f} N"
    assert pushed == f"t=3.04 s  {push}"
    assert recovered.endswith("  RECOVERED in 1 step")
    assert 6.0 < float(recovered[2:].split()[0]) < 7.02
    assert session.status()[2:4] == [f"last {push}", "RECOVERED in 1 step"]


def test_a_fall_begins_anew(session):
    """Oracle: 1.5 m/s are more than there is; then the clock."""
    session.meshcat.SetSliderValue(SIZE, 1.5)
    session.ticks(100)
    click(session.meshcat, PUSH)
    while "FELL" not in "".join(session.told[-1:]):
        session.tick()
    assert session.told[-1].endswith("FELL: CoM out of reach of both feet")
    session.ticks(2)
    assert session.context.get_time() < BEGIN + 0.1


def test_ctrl_c_ends_it_too(session):
    """Oracle: the signal, sent while the status is shown."""
    assert session.run(lambda _: signal.raise_signal(signal.SIGINT)) is True
    assert session.context.get_time() == pytest.approx(BEGIN + 0.02)


def test_says_that_it_stands_where_there_are_no_steps():
    """Oracle: the scenario."""
    session = Session("{gait: {num_steps: 0}, pushes: []}")
    session.ticks(1)
    assert session.status()[0] == "t = 0.02 s, standing"
    assert session.status()[2] == "stands"
