"""Live Meshcat in a real browser: what is clicked there arrives.

The simulation runs in a thread of its own, in real time, while the browser
clicks.  What stands still takes the place of a robot: in the robot's diagram,
clicks are tested in test_humanoid.  The program `push.py --live` is clicked,
too, on the point mass.
"""

import queue
import subprocess
import sys
import threading
from collections.abc import Callable

import numpy as np
import pytest
from playwright.sync_api import Browser, Page
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, EventStatus
from pydrake.systems.primitives import ConstantValueSource, LogVectorOutput

from nadia_balance.core.mechanisms import MECHANISMS, Mechanisms
from nadia_balance.core.walking import WalkingState
from nadia_balance.results.scene import start_meshcat
from nadia_balance.systems.live_controls import LiveControls
from nadia_balance.systems.ports import connect
from nadia_balance.systems.push_source import PushSignal, PushSource
from tests.example_walks import standing
from tests.scripts.running import environment

MASS, PERIOD = 90.0, 0.002
ALL = MECHANISMS["all_with_cross_over"]
PUSH_TICKS = 50  # 0.1 s
LONGEST = 120.0  # of a simulation that nobody ends [s]
PATIENCE = 60.0  # with a machine that is busy [s]


class StandingRun:
    """Controls and a push source, beside what stands still.

    In real time, in a thread, until it is told to end.  All of it is in that
    thread: Meshcat obeys only the one that made it.
    """

    def __init__(self):
        self.pushes_over = 0
        self.logs: dict[str, np.ndarray] = {}  # (n, size), in the end
        self._pushed, self._end = False, threading.Event()
        self._url: queue.Queue[str] = queue.Queue()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        self.url = self._url.get(timeout=PATIENCE)

    def _run(self):
        meshcat = start_meshcat()[0]
        builder = DiagramBuilder()
        controls = builder.AddSystem(LiveControls(meshcat, ALL))
        state = builder.AddSystem(
            ConstantValueSource(Value(WalkingState(standing())))
        )
        self._source = builder.AddSystem(PushSource([], MASS, PERIOD))
        connect(builder, controls, self._source, "live_push")
        builder.Connect(
            state.get_output_port(), self._source.GetInputPort("walking_state")
        )
        sinks = {
            port: LogVectorOutput(
                system.GetOutputPort(port), builder, publish_period=PERIOD
            )
            for system, port in (
                (self._source, "push_signal"),
                (controls, "mechanisms"),
            )
        }
        simulator = Simulator(builder.Build())
        simulator.set_target_realtime_rate(1.0)
        simulator.set_monitor(self._watch)
        self._url.put(meshcat.web_url())
        simulator.AdvanceTo(LONGEST)
        for name, sink in sinks.items():
            log = sink.FindLog(simulator.get_context())
            self.logs[name] = log.data().T.copy()

    def _watch(self, root):
        context = self._source.GetMyContextFromRoot(root)
        signal = self._source.GetOutputPort("push_signal").Eval(context)
        pushed = PushSignal(signal).number > 0
        self.pushes_over += self._pushed and not pushed
        self._pushed = pushed
        if self._end.is_set():
            return EventStatus.ReachedTermination(None, "told to end")
        return EventStatus.DidNothing()

    def end(self) -> None:
        """Ends the run."""
        self._end.set()
        self._thread.join(timeout=PATIENCE)


def wait_until(page: Page, has_come: Callable[[], bool]) -> None:
    """Waits, while the page lives on."""
    for _ in range(round(PATIENCE / 0.05)):
        if has_come():
            return
        page.wait_for_timeout(50)
    raise TimeoutError


def click(page: Page, label: str) -> None:
    page.get_by_text(label, exact=True).click()


def set_sliders(page: Page, size: str, direction: str) -> None:
    for label, text in ("size [m/s]", size), ("direction [deg]", direction):
        box = page.locator("li.cr", has_text=label).locator("input")
        box.fill(text)
        box.press("Enter")


@pytest.fixture(scope="module")
def logs(browser: Browser) -> dict[str, np.ndarray]:
    """What comes of two pushes, and of cross-over switched off and on."""
    run = StandingRun()
    # No larger than the controls: all pixels are computed without a GPU.
    page = browser.new_page(viewport={"width": 400, "height": 300})
    page.goto(run.url)
    page.get_by_text("Open Controls").click()
    click(page, "Push")
    wait_until(page, lambda: run.pushes_over >= 1)
    set_sliders(page, "0.72", "180")
    page.wait_for_timeout(200)
    page.keyboard.press("p")  # the key of the button
    wait_until(page, lambda: run.pushes_over >= 2)
    click(page, "cross-over: on")
    page.get_by_text("cross-over: off", exact=True).wait_for()
    page.wait_for_timeout(100)
    click(page, "cross-over: off")
    page.get_by_text("cross-over: on", exact=True).wait_for()
    page.wait_for_timeout(100)
    run.end()
    page.close()
    return run.logs


def test_a_click_on_push_arrives_while_the_simulation_runs(logs):
    """Oracle: m delta_v / 0.1 s, for 50 ticks, once per click.

    To the left at first; then what is typed into the boxes beside the sliders.
    """
    signal = PushSignal(logs["push_signal"].T)
    acts = signal.number > 0
    assert np.count_nonzero(acts) == 2 * PUSH_TICKS
    edges = np.flatnonzero(np.diff(acts.astype(int)))
    assert len(edges) == 4
    assert np.diff(edges)[::2].tolist() == [PUSH_TICKS, PUSH_TICKS]
    sizes = [[0.0, MASS * 0.3 / 0.1, 0.0], [-MASS * 0.72 / 0.1, 0.0, 0.0]]
    expected = np.repeat(sizes, PUSH_TICKS, axis=0)
    assert signal.force.T[acts] == pytest.approx(expected, abs=1e-9)


def test_a_toggle_switches_its_mechanism_and_says_so(logs):
    """Oracle: on, off, on; in the log, and before on the button."""
    mechanisms = logs["mechanisms"]
    switched = np.flatnonzero(np.any(np.diff(mechanisms, axis=0), axis=1)) + 1
    on = [Mechanisms.from_vector(mechanisms[row]) for row in switched]
    assert on == [MECHANISMS["step_swing_transfer"], ALL]


WALK = "gait: {num_steps: 30, step: {length: 0.4}}"


def test_a_user_pushes_pauses_resets_toggles_and_stops(browser):
    """Oracles: the page's text, its camera, the exit code, the terminal."""
    argv = [
        *(sys.executable, "-m", "nadia_balance.scripts.push", "--live"),
        *("--plant", "lipm", "--scenario_text", WALK),
    ]
    with subprocess.Popen(
        argv, env=environment(), stdout=subprocess.PIPE, text=True
    ) as program:
        try:
            use(browser, program)
            assert program.wait(PATIENCE) == 0
            pushed, *_, reset = program.stdout.read().splitlines()
        finally:
            program.kill()
    assert "  push 0.30 m/s " in pushed
    assert reset.endswith("  reset")


def use(browser: Browser, program: subprocess.Popen) -> None:
    """Does what the test is called after, and looks at the page."""
    url = next(
        line.split()[1] for line in program.stdout if line.startswith("Live:")
    )
    page = browser.new_page(viewport={"width": 600, "height": 450})
    page.goto(url)
    text = page.locator("#status")

    def has_come(*words: str) -> Callable[[], bool]:
        return lambda: all(word in text.inner_text() for word in words)

    wait_until(page, has_come("t = ", "ICP error", "walks", "factor"))
    heights = [
        page.get_by_text(label, exact=True).bounding_box()["y"]
        for label in ("Push", "Pause", "cross-over: on", "Scene")
    ]
    assert heights == sorted(heights) and heights[0] < 30.0
    click(page, "Push")
    wait_until(page, has_come("last push 0.30 m/s "))
    click(page, "cross-over: on")
    page.get_by_text("cross-over: off", exact=True).wait_for()
    x = "viewer.controls.target.x"
    wait_until(page, lambda: page.evaluate(x) > 0.5)
    click(page, "Pause")
    wait_until(page, has_come("PAUSED"))
    before = text.inner_text()
    page.wait_for_timeout(500)
    assert text.inner_text() == before
    click(page, "Reset")
    wait_until(page, has_come("t = 0.00 s", "walks", "PAUSED"))
    page.get_by_text("cross-over: off", exact=True).wait_for()
    click(page, "Pause")
    wait_until(page, lambda: not has_come("t = 0.00 s")())
    click(page, "Stop")
    wait_until(page, has_come("has ended"))
    page.close()
