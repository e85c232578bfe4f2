"""Live session: the robot walks until it is stopped; the user pushes it."""

import contextlib
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from nadia_balance.core.walking.vocabulary import Phase, Side, WalkingState
from nadia_balance.diagrams import simulation
from nadia_balance.diagrams.closed_loop import ClosedLoop
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.results.story import LiveStory, moment_words
from nadia_balance.systems.signals import WalkingSignal, read
from nadia_balance.view.balance_visualizer import FOOTPRINTS
from nadia_balance.view.scene import CONTROLS, move_floor

PAUSE, RESET, STOP, SPEED = "Pause", "Reset", "Stop", "speed"
MOST_STEPS = 1000  # then the session restarts
LOOK = 0.02  # period of the checks of buttons, falls and steps [s]
LYING = 3.0  # time between a fall and the restart [s]
PRINTS = 20  # footprints kept per foot


def endless(scenario: Scenario) -> Scenario:
    """Returns the scenario without pushes, its `num_steps` MOST_STEPS."""
    gait = scenario.gait
    steps = MOST_STEPS if gait.num_steps else 0
    return replace(scenario, pushes=[], gait=replace(gait, num_steps=steps))


class LiveSession:
    """Runs a diagram with LiveControls and buttons of its own.

    The buttons are Pause, Reset and Stop; a slider sets the largest speed over
    real time.  The robot begins with its first swing; after a fall, or its last
    step, again, with the same mechanisms on.  Logs are cleared.
    """

    def __init__(
        self, diagram: ClosedLoop, meshcat: Meshcat, tell: Callable, speed=1.0
    ):
        """Sends each event's line to `tell`; `speed` is 1 in real time."""
        self._diagram, self._meshcat, self._tell = diagram, meshcat, tell
        self._clicks = dict.fromkeys((PAUSE, RESET, STOP), 0)
        for name, key in (PAUSE, "Space"), (RESET, "KeyR"), (STOP, ""):
            meshcat.AddButton(name, key)
        meshcat.AddSlider(SPEED, 0.05, 10.0, 0.05, speed)
        self.paused = self.stopped = False
        self._begin(None)

    def run(self, show: Callable[[list[str]], None]) -> bool:
        """Runs until Stop, or Ctrl-C (True); `show` gets each tick's status."""
        with simulation.until_ctrl_c() as pressed:
            while not (pressed() or self.stopped):
                self.tick()
                show(self.status())
            return pressed()

    @property
    def context(self) -> Context:
        """The present Context of the diagram."""
        return self._simulator.get_context()

    def status(self) -> list[str]:
        """Time, phase, ICP error, last push, result and real-time factor."""
        walks, story = self._phase != "standing", self._story
        lines = [
            f"t = {self.context.get_time():.2f} s, {self._phase}",
            f"ICP error {self._error:.3f} m",
            *([f"last {story.last_push}"] if story.last_push else []),
            story.result or ("walks" if walks else "stands"),
        ]
        if self.paused:
            return [*lines, "PAUSED"]
        ticks, walls = max(len(self._walls) - 1, 0), self._walls
        factor = LOOK * ticks / (walls[-1] - walls[0]) if ticks else 0.0
        return [*lines, f"real-time factor {factor:.2f}"]

    def tick(self) -> None:
        """Handles the buttons, then simulates for LOOK [s] or waits."""
        self.stopped = self._clicked(STOP)
        if self._clicked(RESET):
            self._tell_now("reset")
            self._begin(self.context)
        if self._clicked(PAUSE):
            self.paused = not self.paused
            self._walls.clear()
        if self.paused:
            time.sleep(LOOK)
        elif self._fell is None:
            self._advance()
            self._keep_pace()
        elif time.monotonic() > self._fell + LYING:
            self._begin(self.context)
        else:
            time.sleep(LOOK)

    def _begin(self, old: Context | None) -> None:
        """Starts the simulation; keeps the mechanisms of Context `old`."""
        if old is None:
            self._first = self._first_swing()
        self._simulator = Simulator(self._diagram, self._first.Clone())
        if old is not None:
            controls = self._diagram.GetSubsystemByName(CONTROLS)
            controls.keep_mechanisms(old, self._simulator.get_mutable_context())
        self._simulator.Initialize()
        self._story = LiveStory(self._diagram.scenario.calm_steps)
        self._looks = round(self.context.get_time() / LOOK)
        self._steps, self._fell = 0, None
        self._walls: deque[float] = deque(maxlen=50)
        self._look()

    def _first_swing(self) -> Context:
        """The Context in which the first swing begins, or of the start.

        Before that swing, a push moves no foothold.
        """
        simulator = simulation.start(self._diagram)
        context, gait = simulator.get_context(), self._diagram.scenario.gait
        start, looks = context.Clone(), 0
        latest = gait.standing_duration + gait.initial_transfer_duration + 1.0
        # An error comes again as the session begins, and is told there.
        with contextlib.suppress(RuntimeError, ValueError):
            port = self._diagram.GetOutputPort("walking_state")
            while looks * LOOK < latest:
                if port.Eval(context).schedule.phase is Phase.SWING:
                    return context
                looks += 1
                simulator.AdvanceTo(looks * LOOK)
        return start

    def _advance(self) -> None:
        self._looks += 1
        try:
            self._simulator.AdvanceTo(self._looks * LOOK)
            reason = self._diagram.fall_reason(self.context)
        except (RuntimeError, ValueError) as error:  # such as NaN at an input
            reason = " ".join(str(error).split())
        if reason:
            self._fell = time.monotonic()
            self._tell_now(self._story.fell(reason))
        else:
            self._look()
        self._diagram.forget_logs(self._simulator.get_mutable_context())

    def _look(self) -> None:
        context, diagram = self.context, self._diagram
        state = diagram.GetOutputPort("walking_state").Eval(context)
        _, self._error = simulation.gait_and_error(diagram, context)
        port = diagram.controller.GetOutputPort("walking_signal")
        walking = WalkingSignal(read(port, context))
        self._phase = moment_words(walking)
        push = simulation.push_signal(diagram, context)
        now = context.get_time()
        for line in self._story.look(now, walking, push, self._error):
            self._tell_now(line)
        if state.steps_taken > self._steps:
            self._steps = state.steps_taken
            self._go_along(state)

    def _go_along(self, state: WalkingState) -> None:
        """Moves the floor, deletes old prints; restarts after the last step."""
        schedule = state.schedule
        move_floor(self._meshcat, schedule.feet[schedule.support_side].p_WF)
        old = self._steps - PRINTS
        for side in Side:
            self._meshcat.Delete(f"{FOOTPRINTS}/{side.value}_{old}")
        if not schedule.footsteps and schedule.phase is not Phase.SWING:
            self._tell_now("walked all its steps: begins anew")
            self._fell = time.monotonic()

    def _keep_pace(self) -> None:
        """Waits until the next tick is due; lost time is not made up for."""
        now = time.monotonic()
        last = self._walls[-1] if self._walls else now
        due = last + LOOK / self._meshcat.GetSliderValue(SPEED)
        time.sleep(max(due - now, 0.0))
        self._walls.append(max(due, now))

    def _clicked(self, button: str) -> bool:
        clicks = self._meshcat.GetButtonClicks(button)
        changed = clicks > self._clicks[button]
        self._clicks[button] = clicks
        return changed

    def _tell_now(self, line: str) -> None:
        self._tell(f"t={self.context.get_time():.2f} s  {line}")
