"""Buttons, sliders and a gamepad in Meshcat, for the user of a live session."""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, LeafSystem

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.plan.footstep_plan import within_limits
from nadia_balance.core.walking.mechanisms import LABELS, Mechanisms

PUSH, PUSH_KEY = "Push", "KeyP"
SIZE = "size [m/s]"
DIRECTION = "direction [deg]"
LENGTH = "length [s]"
# Sliders: minimum, maximum, step and initial value of each.
SLIDERS = {
    SIZE: (0.0, 1.5, 0.01, 0.3),
    DIRECTION: (0.0, 355.0, 5.0, 90.0),
    LENGTH: (0.02, 1.0, 0.02, 0.1),
}
FORWARD = "forward [m/s]"
LEFT = "left [m/s]"
TURN = "turn [rad/s]"
# Sliders of the velocity command: the keys that lower and raise each.
COMMANDS = {
    FORWARD: ("KeyS", "KeyW"),
    LEFT: ("KeyE", "KeyQ"),
    TURN: ("KeyD", "KeyA"),
}
HALT, HALT_KEY = "Stop walking", "KeyX"  # all commands to 0
# The largest of these has at least LEAST_STEPS up to a slider's limit.
STEPS = (0.1, 0.05, 0.02, 0.01, 0.005)  # [m/s], [rad/s]
LEAST_STEPS = 3
DEAD_ZONE = 0.15  # share of a stick's way that counts as at rest [-]


class LiveControls(LeafSystem):
    """Turns buttons, sliders and a gamepad in Meshcat into signals.

    `live_push` is [clicks on Push, delta_v [m/s], direction [deg], length [s]];
    0 deg is forward, 90 left, seen from the support foot.  `mechanisms` is 1 or
    0 for each of Mechanisms; each has a toggle button, if the controller has
    them.  `velocity_command` is forward, left [m/s] and turn [rad/s]: that of
    the gamepad while one of its sticks is held, else that of the sliders.  The
    outputs are the discrete state.

    .. pydrake_system::

        name: LiveControls
        input_ports: []
        output_ports: [live_push, mechanisms, velocity_command]
    """

    def __init__(
        self,
        meshcat: Meshcat,
        on: Mechanisms,
        limits: Array,
        period: float = 0.02,
        has_switches: bool = True,
    ):
        """Adds the controls, and begins to stand.

        Args:
            meshcat: where they are.
            on: the mechanisms that are on at first.
            limits: least and most of a velocity command, (2, 3), see
                `core.plan.footstep_plan.velocity_limits`.
            period: from one look at the controls to the next [s].
            has_switches: whether there are buttons of the mechanisms.
        """
        super().__init__()
        self._meshcat = meshcat
        self._has_switches = has_switches
        self._limits = np.array(limits, dtype=float)
        meshcat.AddButton(PUSH, PUSH_KEY)
        for name, (low, high, step, value) in SLIDERS.items():
            if name not in meshcat.GetSliderNames():
                meshcat.AddSlider(
                    name, min=low, max=high, step=step, value=value
                )
            meshcat.SetSliderValue(name, value)
        self._add_commands()
        self._show_mechanisms(on.as_vector())
        self._push: Any = self.DeclareDiscreteState(
            cast(Any, [0.0, *self.aimed_push()])
        )
        self._on: Any = self.DeclareDiscreteState(cast(Any, on.as_vector()))
        self._command: Any = self.DeclareDiscreteState(len(COMMANDS))
        # Clicks on PUSH before this run, and those on HALT that were heard.
        self._clicks: Any = self.DeclareDiscreteState(2)
        self.DeclareStateOutputPort("live_push", self._push)
        self.DeclareStateOutputPort("mechanisms", self._on)
        self.DeclareStateOutputPort("velocity_command", self._command)
        self.DeclareInitializationDiscreteUpdateEvent(self._begin)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._poll)

    def keep_mechanisms(self, old: Context, new: Context) -> None:
        """Copies the mechanisms that are on from one run to the next.

        Args:
            old: Context of the whole diagram, of the run before.
            new: Context of the whole diagram, changed.
        """
        self.GetMyMutableContextFromRoot(new).SetDiscreteState(
            self._on,
            self.GetMyContextFromRoot(old).get_discrete_state(self._on).value(),
        )

    def aimed_push(self) -> list[float]:
        """Returns the push that a click would make.

        Returns:
            delta_v [m/s], direction [deg] and length [s].
        """
        return [self._meshcat.GetSliderValue(name) for name in SLIDERS]

    def command(self) -> Array:
        """Returns the velocity command of the gamepad, or of the sliders.

        Returns:
            Forward, left [m/s] and turn [rad/s], (3,).
        """
        pad = self._meshcat.GetGamepad()
        if pad.index is not None:
            held = stick_command(pad.axes, self._limits)
            if held.any():
                return held
        return np.array([self._meshcat.GetSliderValue(c) for c in COMMANDS])

    def _add_commands(self) -> None:
        self._meshcat.AddButton(HALT, HALT_KEY)
        for (name, (lower, higher)), (low, high) in zip(
            COMMANDS.items(), self._limits.T, strict=True
        ):
            step = slider_step(min(-low, high))
            # Whole steps from 0, so that 0 is one of the slider's values.
            self._meshcat.DeleteSlider(name, strict=False)
            self._meshcat.AddSlider(
                name,
                min=-step * max(int(-low / step + 1e-9), 1),
                max=step * max(int(high / step + 1e-9), 1),
                step=step,
                value=0.0,
                decrement_keycode=lower,
                increment_keycode=higher,
            )

    def _show_mechanisms(self, on: Any) -> None:
        """Replaces all toggle buttons, which resets their clicks."""
        if not self._has_switches:
            return
        # All are replaced: a single new label would change their order.
        for name in LABELS:
            for label in _label(name, False), _label(name, True):
                self._meshcat.DeleteButton(label, strict=False)
        for name, is_on in zip(LABELS, on, strict=True):
            self._meshcat.AddButton(_label(name, is_on))

    def _begin(self, context: Any, state: Any) -> None:
        """Shows what is on, and forgets the clicks before, for a new run."""
        # A button that is added again comes last, and hears its key twice.
        state.set_value(
            self._clicks,
            [self._meshcat.GetButtonClicks(name) for name in (PUSH, HALT)],
        )
        self._show_mechanisms(context.get_discrete_state(self._on).value())
        state.get_mutable_vector(self._push)[0] = 0.0

    def _poll(self, context: Any, state: Any) -> None:
        before, heard = context.get_discrete_state(self._clicks).value()
        state.set_value(
            self._push,
            [self._meshcat.GetButtonClicks(PUSH) - before, *self.aimed_push()],
        )
        halts = self._meshcat.GetButtonClicks(HALT)
        if halts > heard:
            for name in COMMANDS:
                self._meshcat.SetSliderValue(name, 0.0)
            state.set_value(self._clicks, [before, halts])
        state.set_value(self._command, self.command())
        if not self._has_switches:
            return
        on = context.get_discrete_state(self._on).value()
        clicks = [
            self._meshcat.GetButtonClicks(_label(name, is_on))
            for name, is_on in zip(LABELS, on, strict=True)
        ]
        if any(clicks):
            state.set_value(self._on, (on + clicks) % 2.0)
            self._show_mechanisms((on + clicks) % 2.0)


def stick_command(axes: Sequence[float], limits: Array) -> Array:
    """Returns the velocity command (3,) of a gamepad's sticks.

    Args:
        axes: left stick to the right, left stick down, right stick to the
            right, ..., each in [-1, 1]; missing ones are at rest.
        limits: least and most of the command, (2, 3).  A stick that is pushed
            all the way commands them, both as much as can be walked at once;
            the left one forward and aside, the right one turns.

    Returns:
        Forward, left [m/s] and turn [rad/s], (3,); 0 in the DEAD_ZONE.
    """
    right, down, clockwise, *_ = [*axes, 0.0, 0.0, 0.0]
    pushed = -np.array([down, right, clockwise])
    beyond = np.maximum(np.abs(pushed) - DEAD_ZONE, 0.0) / (1.0 - DEAD_ZONE)
    least, greatest = limits
    return within_limits(
        beyond * np.where(pushed > 0.0, greatest, least), limits
    )


def slider_step(limit: float) -> float:
    """Returns the step of a slider.

    Args:
        limit: up to which it goes [m/s], [rad/s].

    Returns:
        The largest of STEPS of which the limit has LEAST_STEPS, or the
        smallest.
    """
    return max(
        (step for step in STEPS if LEAST_STEPS * step <= limit + 1e-9),
        default=STEPS[-1],
    )


def _label(name: str, on: float) -> str:
    return f"{LABELS[name]}: {'on' if on else 'off'}"
