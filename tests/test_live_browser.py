"""Live Meshcat in a real browser: what is clicked there arrives.

The simulation runs in a thread of its own, in real time, while the browser
clicks.  Where it can, what stands still takes the place of a robot.
"""

import math
import queue
import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from playwright.sync_api import Browser, Page
from pydrake.common.value import Value
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, EventStatus
from pydrake.systems.primitives import ConstantValueSource, LogVectorOutput

from nadia_balance.core.mechanisms import MECHANISMS, Mechanisms
from nadia_balance.core.walking import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
)
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.diagrams.simulation import start
from nadia_balance.systems.live_controls import LiveControls
from nadia_balance.systems.ports import connect
from nadia_balance.systems.push_source import PushSignal, PushSource

MASS, PERIOD = 90.0, 0.002
ALL = MECHANISMS["all_with_cross_over"]
PUSH_TICKS = 50  # 0.1 s
LONGEST = 60.0  # of a simulation that nobody ends [s]
REST = ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2))
FEET = FootPoses(FootPose([0.0, 0.125, 0.0]), FootPose([0.0, -0.125, 0.0]))
STANDING = WalkingState(
    ContactSchedule(Phase.STANDING, Side.LEFT, np.inf, FEET, (), REST)
)


class LiveRun:
    """A simulation in real time, in a thread, until it is told to end.

    All of it is in that thread: Meshcat obeys only the one that made it.
    """

    def __init__(self):
        self._url: queue.Queue[str] = queue.Queue()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        self.url = self._url.get(timeout=10.0)

    def _run(self):
        meshcat = Meshcat()
        simulator = self._start(meshcat)
        simulator.set_target_realtime_rate(1.0)
        simulator.set_monitor(self._watch)
        self._url.put(meshcat.web_url())
        simulator.AdvanceTo(LONGEST)
        self._finish(simulator.get_context())

    def _watch(self, root):
        self._look(root)
        if self._end.is_set():
            return EventStatus.ReachedTermination(None, "told to end")
        return EventStatus.DidNothing()

    def end(self) -> None:
        """Ends the run."""
        self._end.set()
        self._thread.join(timeout=10.0)


def wait_until(page: Page, has_come: Callable[[], bool]) -> None:
    """Waits, while the page lives on."""
    for _ in range(400):
        if has_come():
            return
        page.wait_for_timeout(50)
    raise TimeoutError


class StandingRun(LiveRun):
    """Controls and a push source, beside what stands still."""

    def __init__(self):
        self._pushed, self.pushes_over = False, 0
        self.logs: dict[str, np.ndarray] = {}  # (n, size), in the end
        super().__init__()

    def _start(self, meshcat):
        builder = DiagramBuilder()
        controls = builder.AddSystem(LiveControls(meshcat, ALL))
        state = builder.AddSystem(ConstantValueSource(Value(STANDING)))
        self._source = builder.AddSystem(PushSource([], MASS, PERIOD))
        connect(builder, controls, self._source, "live_push")
        builder.Connect(
            state.get_output_port(), self._source.GetInputPort("walking_state")
        )
        self._sinks = {
            port: LogVectorOutput(
                system.GetOutputPort(port), builder, publish_period=PERIOD
            )
            for system, port in (
                (self._source, "push_signal"),
                (controls, "mechanisms"),
            )
        }
        return Simulator(builder.Build())

    def _look(self, root):
        context = self._source.GetMyContextFromRoot(root)
        signal = self._source.GetOutputPort("push_signal").Eval(context)
        pushed = PushSignal(signal).number > 0
        self.pushes_over += self._pushed and not pushed
        self._pushed = pushed

    def _finish(self, root):
        for name, sink in self._sinks.items():
            self.logs[name] = sink.FindLog(root).data().T.copy()


class RobotRun(LiveRun):
    """The whole robot, by ankles and hips alone until it is told otherwise."""

    def __init__(self):
        self.swings = {False: 0, True: 0}  # that were adjusted, or not
        self.moved = 0.0  # the largest adjustment [m]
        self._swings = False
        super().__init__()

    def _start(self, meshcat):
        text = "{mechanisms: icp_only, gait: {num_steps: 70}}"
        scenario = load_scenario("walk_in_place", text=text)
        self._diagram = HumanoidDiagram(scenario, meshcat)
        return start(self._diagram)

    def _look(self, root):
        controller = self._diagram.controller
        state = controller.GetOutputPort("walking_state").Eval(
            controller.GetMyContextFromRoot(root)
        )
        adjusted = state.adjustment is not None
        # In its first tick, a swing has not been adjusted yet.
        swings = state.schedule.phase is Phase.SWING and state.elapsed > 0.0
        self.swings[adjusted] += swings and not self._swings
        self._swings = swings
        if adjusted:
            p, q = state.adjustment.pose, state.adjustment.nominal.pose
            self.moved = max(self.moved, math.dist(p.p_WF, q.p_WF))

    def _finish(self, root):
        pass


@pytest.fixture(params=[StandingRun])
def run(request) -> Iterator[LiveRun]:
    run = request.param()
    yield run
    run.end()


@pytest.fixture
def page(browser: Browser, run: LiveRun) -> Iterator[Page]:
    """Meshcat, with its controls open."""
    page = browser.new_page(viewport={"width": 900, "height": 700})
    page.goto(run.url)
    page.get_by_text("Open Controls").click()
    page.get_by_text("Push", exact=True).wait_for()
    yield page
    page.close()


def click(page: Page, label: str) -> None:
    page.get_by_text(label, exact=True).click()


def set_sliders(page: Page, size: str, direction: str) -> None:
    for label, text in ("size [m/s]", size), ("direction [deg]", direction):
        box = page.locator("li.cr", has_text=label).locator("input")
        box.fill(text)
        box.press("Enter")


def test_a_click_on_push_arrives_while_the_simulation_runs(run, page):
    """Oracle: m delta_v / 0.1 s, for 50 ticks, once per click.

    To the left at first; then what is typed into the boxes beside the sliders.
    """
    click(page, "Push")
    wait_until(page, lambda: run.pushes_over >= 1)
    set_sliders(page, "0.72", "180")
    page.wait_for_timeout(200)
    page.keyboard.press("p")  # the key of the button
    wait_until(page, lambda: run.pushes_over >= 2)
    run.end()
    signal = PushSignal(run.logs["push_signal"].T)
    acts = signal.number > 0
    assert np.count_nonzero(acts) == 2 * PUSH_TICKS
    edges = np.flatnonzero(np.diff(acts.astype(int)))
    assert len(edges) == 4
    assert np.diff(edges)[::2].tolist() == [PUSH_TICKS, PUSH_TICKS]
    sizes = [[0.0, MASS * 0.3 / 0.1, 0.0], [-MASS * 0.72 / 0.1, 0.0, 0.0]]
    expected = np.repeat(sizes, PUSH_TICKS, axis=0)
    assert signal.force.T[acts] == pytest.approx(expected, abs=1e-9)


def test_a_toggle_switches_its_mechanism_and_says_so(run, page):
    """Oracle: on, off, on; in the log and on the button."""
    click(page, "cross-over: on")
    page.get_by_text("cross-over: off", exact=True).wait_for()
    page.wait_for_timeout(100)
    click(page, "cross-over: off")
    page.get_by_text("cross-over: on", exact=True).wait_for()
    run.end()
    mechanisms = run.logs["mechanisms"]
    switched = np.flatnonzero(np.any(np.diff(mechanisms, axis=0), axis=1)) + 1
    on = [Mechanisms.from_vector(mechanisms[row]) for row in switched]
    assert on == [MECHANISMS["step_swing_transfer"], ALL]


@pytest.mark.parametrize("run", [RobotRun], indirect=True)
def test_a_toggle_lets_the_walking_robot_move_its_foothold(run, page):
    """Oracle: no swing is adjusted before; then the next push moves a foot.

    Until it is pushed, each foot lands where it was to land.  Forward, at
    0.5 m/s, ankles and hips are not enough, in whichever phase it comes.
    """
    set_sliders(page, "0.5", "0")
    wait_until(page, lambda: run.swings[False] > 0)
    assert run.swings[True] == 0
    click(page, "step adjustment: off")
    wait_until(page, lambda: run.swings[True] > 0)
    assert run.moved == 0.0
    swings = run.swings[True]
    click(page, "Push")
    # A click that came late in a swing, or in a transfer, moves the next one.
    wait_until(page, lambda: run.moved > 0.02 or run.swings[True] > swings + 2)
    assert run.moved > 0.02
