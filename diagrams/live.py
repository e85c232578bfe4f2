"""Live session: the robot stands and listens; the user walks and pushes it."""

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from nadia_balance.core.plan.gait import middle
from nadia_balance.core.walking.state import Phase, Side, WalkingState
from nadia_balance.diagrams.closed_loop import ClosedLoop
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.diagrams.simulation import start, until_ctrl_c
from nadia_balance.diagrams.verdict import gait_and_error, push_signal
from nadia_balance.parameters.yaml_reader import error_text
from nadia_balance.results.live_watches import (
    FallWatch,
    VelocityWatch,
    clipped_words,
    velocity_lines,
)
from nadia_balance.results.story import LiveStory, moment_words
from nadia_balance.systems.plan import walking_signal
from nadia_balance.systems.signals import WalkingSignal, read
from nadia_balance.view.aims import Aims
from nadia_balance.view.balance_visualizer import FOOTPRINTS
from nadia_balance.view.live_controls import LiveControls
from nadia_balance.view.scene import CONTROLS, move_floor

PAUSE, RESET, STOP, SPEED = "Pause", "Reset", "Stop", "speed"
LOOK = 0.02  # period of the checks of buttons, falls and steps [s]
LYING = 3.0  # time between a fall and the restart [s]
PRINTS = 20  # footprints kept per foot
CALM_STEPS = 2  # that a recovery requires where the scenario does not say
AIMS_PERIOD = 1.0 / 16.0  # of the user's arrows, in real time [s]


def endless(scenario: Scenario) -> Scenario:
    """Returns a scenario without steps, pushes and commands of its own.

    The robot stands until it is told to walk, or must step.

    Args:
        scenario: that of the flags.

    Returns:
        Another scenario.
    """
    return replace(
        scenario,
        pushes=[],
        commands=[],
        gait=replace(scenario.gait, num_steps=0, steps=[], footholds=[]),
    )


class LiveSession:
    """Runs a diagram with LiveControls and buttons of its own.

    The buttons are Pause, Reset and Stop; a slider sets the largest speed over
    real time.  The robot begins to stand; after a fall, again, with the same
    mechanisms on and the same sliders.  Logs are cleared.
    """

    def __init__(
        self,
        diagram: ClosedLoop,
        meshcat: Meshcat,
        tell: Callable[[str], None],
        speed: float = 1.0,
    ):
        """Begins to stand.

        Args:
            diagram: with LiveControls.
            meshcat: where the buttons are.
            tell: takes each event's line.
            speed: the largest one over real time [-].
        """
        self._diagram, self._meshcat, self._tell = diagram, meshcat, tell
        self._controls = cast(
            LiveControls, diagram.GetSubsystemByName(CONTROLS)
        )
        self._limits = diagram.velocity_limits
        # A policy clips each part of a command by itself.
        self._is_planned = diagram.controller.HasOutputPort("footsteps")
        self._clicks = dict.fromkeys((PAUSE, RESET, STOP), 0)
        for name, key in (PAUSE, "Space"), (RESET, "KeyR"), (STOP, ""):
            meshcat.AddButton(name, key)
        meshcat.AddSlider(SPEED, 0.05, 10.0, 0.05, speed)
        self._aims, self._drawn = Aims(meshcat), -math.inf
        self._start = start(diagram).get_context().Clone()
        self.paused = self.stopped = False
        self._begin(None)

    def run(self, show: Callable[[list[str]], None]) -> bool:
        """Runs until Stop, or Ctrl-C.

        Args:
            show: takes each tick's status.

        Returns:
            True after Ctrl-C.
        """
        with until_ctrl_c() as pressed:
            while not (pressed() or self.stopped):
                self.tick()
                show(self.status())
            return pressed()

    @property
    def context(self) -> Context:
        """The present Context of the diagram."""
        return self._simulator.get_context()

    def status(self) -> list[str]:
        """Returns what the page shows, line by line.

        Time, mode and phase; the velocity commanded and walked; ICP error, if
        the controller has one, last push and its result; real-time factor.

        Returns:
            The lines.
        """
        mode, moment = self._mode, self._moment
        during = f" ({moment})" if moment != mode else ""
        lines = [
            f"t = {self.context.get_time():.2f} s, {mode}{during}",
            *velocity_lines(self._commanded, self._walked),
        ]
        too_much = clipped_words(self._commanded, self._limits)
        if too_much and self._is_planned:
            lines.append(too_much)
        if self._error is not None:
            lines.append(f"ICP error {self._error:.3f} m")
        if self._story.last_push:
            lines.append(f"last {self._story.last_push}")
        if self._story.result:
            lines.append(self._story.result)
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
            self._draw_aims()  # as the sliders may move
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
        self._simulator = Simulator(self._diagram, self._start.Clone())
        if old is not None:
            self._controls.keep_mechanisms(
                old, self._simulator.get_mutable_context()
            )
        self._simulator.Initialize()
        scenario = self._diagram.scenario
        self._story = LiveStory(scenario.calm_steps or CALM_STEPS)
        params = scenario.controller.footstep_planner
        self._velocity = VelocityWatch(
            window=2.0 * (params.swing_duration + params.transfer_duration)
        )
        self._fall = FallWatch()
        self._looks, self._steps = 0, 0
        self._fell: float | None = None
        self._walls: deque[float] = deque(maxlen=50)
        self._look()

    def _advance(self) -> None:
        self._looks += 1
        try:
            self._simulator.AdvanceTo(self._looks * LOOK)
            reason = self._diagram.fall_reason(self.context)
        except Exception as error:  # of any block, such as NaN at an input
            reason = error_text(error)
        else:
            self._look()
            if reason and (cause := self._fall.reason()):
                reason = f"{reason}: {cause}"
        if reason:
            self._fell = time.monotonic()
            self._tell_now(self._story.fell(reason))
        self._diagram.forget_logs(self._simulator.get_mutable_context())

    def _look(self) -> None:
        context, diagram = self.context, self._diagram
        state = read(diagram.timing, context)
        walking = WalkingSignal(np.array(walking_signal(state)))
        self._mode, self._moment = state.mode.value, moment_words(walking)
        self._error: float | None = None
        if "icp_reference" in diagram.signals:
            _, self._error = gait_and_error(diagram, context)
        else:  # nor steps to come
            self._mode = self._moment
        lacks = diagram.signals.get("no_foothold")
        self._measure(state)
        for line in self._story.update(
            context.get_time(),
            walking,
            push_signal(diagram, context),
            self._error,
            no_foothold=lacks is not None and bool(read(lacks, context)[0]),
        ):
            self._tell_now(line)
        self._draw_aims()
        if state.steps_taken > self._steps:
            self._steps = state.steps_taken
            self._go_along(state)

    def _measure(self, state: WalkingState) -> None:
        """Measures the velocity, and what may end in a fall."""
        context, diagram = self.context, self._diagram
        now = context.get_time()
        self._commanded = np.array(
            read(self._controls.GetOutputPort("velocity_command"), context)
        )
        self._walked = self._velocity.update(
            now, diagram.com(context)[:2], middle(diagram.feet(context)).yaw
        )
        regions = None
        port = diagram.signals.get("capture_regions")
        if port is not None and state.schedule.phase is Phase.SWING:
            regions = read(port, context)
        joint, speed_ratio = diagram.fastest_joint(context)
        self._fall.update(now, regions, self._error, joint, speed_ratio)

    def _draw_aims(self) -> None:
        """Draws the push that a click would make, and the command."""
        if time.monotonic() < self._drawn + AIMS_PERIOD:
            return
        self._drawn = time.monotonic()
        context, diagram = self.context, self._diagram
        schedule, com = (
            read(diagram.timing, context).schedule,
            diagram.com(context),
        )
        delta_v, direction_deg, _ = self._controls.aimed_push()
        yaw = schedule.feet[schedule.support_side].yaw
        self._aims.draw_push(com, yaw + math.radians(direction_deg), delta_v)
        self._aims.draw_command(
            self._controls.command(), com, diagram.feet(context)
        )

    def _go_along(self, state: WalkingState) -> None:
        """Moves the floor along, and deletes old prints."""
        feet = self._diagram.feet(self.context)
        move_floor(self._meshcat, feet[state.schedule.support_side].p_WF)
        for side in Side:
            self._meshcat.Delete(
                f"{FOOTPRINTS}/{side.value}_{self._steps - PRINTS}"
            )

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
