"""The live tab in a real browser: what is clicked there arrives.

The simulation runs in a thread of its own, in real time, while the browser
clicks.  A walking state that stands still takes the place of a robot.
"""

import functools
import queue
import threading
from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import Browser, Page
from pydrake.common.value import Value
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, EventStatus
from pydrake.systems.primitives import ConstantValueSource, LogVectorOutput

from nadia_balance.core.walking import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
)
from nadia_balance.systems.live_controls import LiveControls
from nadia_balance.systems.ports import connect
from nadia_balance.systems.push_source import PushSource

MASS, PERIOD = 90.0, 0.002
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
        self._pushed, self.pushes_over = False, 0
        self._logs: dict[str, np.ndarray] = {}
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        self.url = self._url.get(timeout=10.0)

    def _run(self):
        meshcat = Meshcat()
        builder = DiagramBuilder()
        controls = builder.AddSystem(LiveControls(meshcat, delta_v=0.3))
        state = builder.AddSystem(ConstantValueSource(Value(STANDING)))
        source = builder.AddSystem(PushSource([], MASS, PERIOD))
        connect(builder, controls, source, "live_push")
        builder.Connect(
            state.get_output_port(), source.GetInputPort("walking_state")
        )
        sinks = {
            port: LogVectorOutput(
                system.GetOutputPort(port), builder, publish_period=PERIOD
            )
            for system, port in (
                (source, "push_force"),
                (controls, "mechanisms"),
            )
        }
        simulator = Simulator(builder.Build())
        simulator.set_target_realtime_rate(1.0)
        simulator.set_monitor(functools.partial(self._watch, source))
        self._url.put(meshcat.web_url())
        simulator.AdvanceTo(LONGEST)
        context = simulator.get_context()
        for name, sink in sinks.items():
            self._logs[name] = sink.FindLog(context).data().T.copy()

    def _watch(self, source, root):
        context = source.GetMyContextFromRoot(root)
        force = source.GetOutputPort("push_force").Eval(context)
        pushed = bool(np.any(force != 0.0))
        self.pushes_over += self._pushed and not pushed
        self._pushed = pushed
        if self._end.is_set():
            return EventStatus.ReachedTermination(None, "told to end")
        return EventStatus.DidNothing()

    def wait_for_pushes(self, count: int, page: Page) -> None:
        """Waits until so many pushes are over."""
        for _ in range(200):
            if self.pushes_over >= count:
                return
            page.wait_for_timeout(50)
        raise TimeoutError(f"{self.pushes_over} pushes came, not {count}")

    def end(self) -> dict[str, np.ndarray]:
        """Ends the run; returns its logs (n, size)."""
        self._end.set()
        self._thread.join(timeout=10.0)
        return self._logs


@pytest.fixture
def run() -> Iterator[LiveRun]:
    run = LiveRun()
    yield run
    run.end()


@pytest.fixture
def page(browser: Browser, run: LiveRun) -> Iterator[Page]:
    """The tab, with its controls open."""
    page = browser.new_page(viewport={"width": 900, "height": 700})
    page.goto(run.url)
    page.get_by_text("Open Controls").click()
    page.get_by_text("Push", exact=True).wait_for()
    yield page
    page.close()


def click(page: Page, label: str) -> None:
    page.get_by_text(label, exact=True).click()


def test_a_click_on_push_arrives_while_the_simulation_runs(run, page):
    """Oracle: m delta_v / 0.1 s to the left, for 50 ticks, once per click."""
    for count in (1, 2):
        click(page, "Push")
        run.wait_for_pushes(count, page)
    force = run.end()["push_force"]
    acts = np.linalg.norm(force, axis=1) > 0.0
    assert np.count_nonzero(acts) == 2 * PUSH_TICKS
    edges = np.flatnonzero(np.diff(acts.astype(int)))
    assert len(edges) == 4
    assert np.diff(edges)[::2].tolist() == [PUSH_TICKS, PUSH_TICKS]
    expected = np.tile([0.0, MASS * 0.3 / 0.1, 0.0], (2 * PUSH_TICKS, 1))
    assert force[acts] == pytest.approx(expected, abs=1e-9)


def test_the_sliders_set_size_and_direction(run, page):
    """Oracle: typed into the boxes beside the sliders: 0.72 m/s, 180 deg."""
    for label, text in ("size [m/s]", "0.72"), ("direction [deg]", "180"):
        box = page.locator("li.cr", has_text=label).locator("input")
        box.fill(text)
        box.press("Enter")
    page.wait_for_timeout(200)
    page.keyboard.press("p")  # the key of the button
    run.wait_for_pushes(1, page)
    force = run.end()["push_force"]
    acts = np.linalg.norm(force, axis=1) > 0.0
    assert np.count_nonzero(acts) == PUSH_TICKS
    assert force[acts][0] == pytest.approx([-MASS * 0.72 / 0.1, 0.0, 0.0])


def test_a_toggle_switches_its_mechanism_and_says_so(run, page):
    """Oracle: on, off, on; in the log and on the button."""
    click(page, "cross-over: on")
    page.get_by_text("cross-over: off", exact=True).wait_for()
    page.wait_for_timeout(100)
    click(page, "cross-over: off")
    page.get_by_text("cross-over: on", exact=True).wait_for()
    mechanisms = run.end()["mechanisms"]
    changes = mechanisms[np.flatnonzero(np.diff(mechanisms[:, 3])) + 1]
    assert changes.tolist() == [[1, 1, 1, 0], [1, 1, 1, 1]]
    assert np.all(mechanisms[:, :3] == 1.0)
