"""Live sessions of the point mass, clicked as a browser would."""

import signal

import pytest

from nadia_balance.diagrams import live, simulation
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.diagrams.live import RESET, LiveSession, endless
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.view.live_controls import (
    DIRECTION,
    FORWARD,
    HALT,
    PUSH,
    SIZE,
    TURN,
)
from nadia_balance.view.scene import start_meshcat
from tests.clicks import click, hold_sticks

LOOK = 0.02  # [s]


class Session(LiveSession):
    """As fast as can be, with what it has told; a look a control period."""

    def __init__(self, text="{lipm_period: 0.02}", name="push"):
        scenario = endless(load_scenario(name, text=text))
        self.meshcat, self.told = start_meshcat()[0], []
        diagram = LipmDiagram(scenario, self.meshcat)
        super().__init__(diagram, self.meshcat, self.told.append, 10.0)

    def ticks(self, number):
        for _ in range(number):
            self.tick()

    def state(self):
        own = self._diagram.plant.GetMyContextFromRoot(self.context)
        return own.get_discrete_state(0).CopyToVector()

    def walking_state(self):
        return self._diagram.GetOutputPort("walking_state").Eval(self.context)

    def times_logged(self):
        return self._diagram.read_logs(self.context)["t"]

    def push(self, size, direction):
        self.meshcat.SetSliderValue(SIZE, size)
        self.meshcat.SetSliderValue(DIRECTION, direction)
        click(self.meshcat, PUSH)


@pytest.fixture
def session(monkeypatch) -> Session:
    monkeypatch.setattr(live, "LYING", 0.0)
    return Session()


@pytest.mark.parametrize("name", ["push", "walk_by_command", "wander"])
def test_stands_and_listens_whatever_the_scenario(name):
    """Oracle: no step, push or command of the scenario is left; the words."""
    session = Session(name=name)
    session.ticks(100)
    assert session.context.get_time() == pytest.approx(2.0)
    assert session.walking_state().steps_taken == 0
    assert session.told == []
    assert session.status()[:2] == [
        "t = 2.00 s, standing",
        "commanded 0.00, walks 0.00 m/s",
    ]
    assert len(session.times_logged()) == 0


def test_walks_as_the_sliders_say_and_stops(session):
    """Oracle: 0.3 m/s for 6 s, less the start; then the feet are square.

    The last line is that of 4 s after the stop.
    """
    session.meshcat.SetSliderValue(FORWARD, 0.3)
    session.ticks(300)
    x = session.state()[0]
    assert 1.2 < x < 1.8
    session.ticks(80)  # two steps
    assert session.state()[0] - x == pytest.approx(0.3 * 1.6, abs=0.03)
    moment, velocity = session.status()[:2]
    assert moment.startswith("t = 7.60 s, walking (")
    # A landing is heard some ticks late, by which a step lasts longer.
    assert velocity in {f"commanded 0.30, walks 0.{n} m/s" for n in (29, 30)}
    click(session.meshcat, HALT)
    session.ticks(200)
    assert session.status()[:2] == [
        "t = 11.60 s, standing",
        "commanded 0.00, walks 0.00 m/s",
    ]
    feet = session.walking_state().schedule.feet
    ahead, _ = feet.left.to_sole(feet.right.p_WF[:2])
    assert ahead == pytest.approx(0.0, abs=0.05)
    assert session.told == []


def test_turns_and_a_held_stick_comes_first(session):
    """Oracle: the page's words: the sliders', the stick's, the sliders'."""
    session.meshcat.SetSliderValue(TURN, 0.4)
    session.ticks(250)
    (turn,) = (line for line in session.status() if line.startswith("turn"))
    assert turn == "turn: commanded 0.40, walks 0.40 rad/s"
    hold_sticks(session.meshcat, 0.0, -0.5, 0.0, 0.0)
    session.ticks(2)
    _, most = session._diagram.velocity_limits
    forward = most[0] * (0.5 - 0.15) / 0.85
    assert session.status()[1].startswith(f"commanded {forward:.2f}, ")
    hold_sticks(session.meshcat, 0.0, 0.0, 0.0, 0.0)
    session.ticks(2)
    assert session.status()[1].startswith("commanded 0.00, ")


def test_a_reset_begins_the_very_same_walk_with_what_is_on(session):
    """Oracle: the state of the first walk, bit for bit; the button's label.

    The sliders stay, so that it walks at once.
    """
    session.meshcat.SetSliderValue(FORWARD, 0.2)
    session.ticks(150)
    first = session.state()
    click(session.meshcat, PUSH)
    click(session.meshcat, "cross-over: on")
    session.ticks(50)
    click(session.meshcat, RESET)
    session.ticks(150)
    assert session.context.get_time() == pytest.approx(3.0)
    assert (session.state() == first).all()
    assert "cross-over: off" in session.meshcat.GetButtonNames()
    assert session.told[-1] == "t=4.00 s  reset"
    assert session.status()[1].startswith("commanded 0.20, ")


@pytest.mark.parametrize(
    ("size", "direction", "word", "result"),
    [
        (0.3, 90.0, "left", "RECOVERED without a step"),
        (1.0, 0.0, "forward", "RECOVERED in 2 steps"),
    ],
)
def test_tells_a_push_and_that_it_stands_again(
    session, size, direction, word, result
):
    """Oracles: m delta_v / 0.1 s; a step to catch itself, one to be square."""
    session.ticks(10)
    session.push(size, direction)
    session.ticks(20)
    mode = "recovering" if "2" in result else "standing"
    assert session.status()[0].startswith(f"t = 0.60 s, {mode}")
    session.ticks(180)
    pushed, recovered = session.told
    newtons = session._diagram.robot.mass * size / 0.1
    push = f"push {size:.2f} m/s {word}, standing  F = {newtons:.0f} N"
    assert pushed == f"t=0.24 s  {push}"
    assert recovered.endswith(f"  {result}")
    assert session.walking_state().steps_taken == int("2" in result) * 2
    error, *lines, _ = session.status()[2:]
    assert (error, lines) == ("ICP error 0.000 m", [f"last {push}", result])


def test_tells_a_recovery_on_the_way_too(session):
    """Oracle: two calm steps of 0.8 s, after the one that recovers it."""
    session.meshcat.SetSliderValue(FORWARD, 0.3)
    session.ticks(300)
    session.push(0.3, 90.0)
    session.ticks(250)
    pushed, recovered = session.told
    assert pushed.startswith("t=6.04 s  push 0.30 m/s ")
    assert recovered.endswith("  RECOVERED in 1 step")
    assert 7.6 < float(recovered[2:].split()[0]) < 9.6
    assert "walking" in session.status()[0]


def test_a_fall_says_why_and_begins_anew(session):
    """Oracle: 1.5 m/s are more than there is; then the clock, the sliders."""
    session.meshcat.SetSliderValue(TURN, 0.2)
    session.push(1.5, 90.0)
    while "FELL" not in "".join(session.told[-1:]):
        session.tick()
    result = session.told[-1].partition("  ")[2]
    reason, _, why = result.rpartition(": ")
    assert reason == "FELL: CoM out of reach of both feet"
    assert why.startswith("capture region out of reach by 0.")
    assert result in session.status()
    session.ticks(3)
    assert session.context.get_time() < 0.1
    assert session.status()[2].startswith("turn: commanded 0.20, ")
    assert session.status()[-2].startswith("ICP error")  # no push any more


def test_tells_that_there_is_no_ground_where_it_has_to_step(tmp_path):
    """Oracle: a plate of the two soles, with 10 cm around; once in a push."""
    (tmp_path / "plate.yaml").write_text(
        "regions: [{name: plate, vertices: [[0.25, 0.35], [-0.25, 0.35], "
        "[-0.25, -0.35], [0.25, -0.35]]}]\n"
    )
    terrain = f"terrain: {{name: {tmp_path / 'plate.yaml'}}}"
    session = Session(f"{{lipm_period: 0.02, {terrain}}}")
    session.push(1.0, 0.0)
    session.ticks(100)
    told = [line.partition("  ")[2] for line in session.told]
    assert told[1] == "no ground in reach where it has to step"
    assert told[2].startswith("FELL: ")


def test_an_error_ends_in_a_fall_that_tells_it(session, monkeypatch):
    """Oracle: the words of the error; the session goes on."""

    def fall_reason(context):
        raise RuntimeError("two\nlines")

    monkeypatch.setattr(session._diagram, "fall_reason", fall_reason)
    session.tick()
    assert session.told == ["t=0.02 s  FELL: two lines"]


def test_ctrl_c_ends_it_too(session):
    """Oracle: the signal, sent while the status is shown."""
    assert session.run(lambda _: signal.raise_signal(signal.SIGINT)) is True
    assert session.context.get_time() == pytest.approx(LOOK)


def commanded(diagram) -> list[float]:
    """What the controller is told at 0.6 s, by a slider at 0.2 m/s."""
    simulator = simulation.start(diagram)
    simulator.AdvanceTo(0.6)
    port = diagram.controller.GetInputPort("velocity_command")
    own = diagram.controller.GetMyContextFromRoot(simulator.get_context())
    return port.Eval(own).tolist()


def test_the_user_commands_where_the_scenario_does_not():
    """Oracle: the scenario's first row, from 0.5 s on; else the slider's."""
    told = []
    for change in (lambda own: own), endless:
        meshcat = start_meshcat()[0]
        scenario = change(load_scenario("walk_by_command"))
        diagram = LipmDiagram(scenario, meshcat)
        meshcat.SetSliderValue(FORWARD, 0.2)
        told.append(commanded(diagram))
    assert told == [[0.3, 0.0, 0.0], pytest.approx([0.2, 0.0, 0.0])]
