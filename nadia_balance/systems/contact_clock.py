"""The phases of a gait, by the forces on the feet alone."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from pydrake.systems.framework import Context, State

from nadia_balance.core.walking.state import (
    ORIGIN,
    ContactSchedule,
    FootPoses,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
)
from nadia_balance.systems.ports import (
    Block,
    declare_output,
    declare_update,
    input_port,
)

STOOD = 2.0  # a transfer of as many times its last duration is standing [-]
LOADED = 0.05  # share of the weight above which a foot is in contact [-]
BOUNCE = 0.06  # in the air for less, a foot has not been lifted [s]


class ContactClock(Block):
    """Computes the phase of any controller's gait from the forces on the feet.

    A foot swings while only the other one has more than LOADED of the weight.
    Between two swings is a transfer to the foot that has landed; if that is off
    the ground again within BOUNCE, it bounces.  A phase lasts as long as
    the last one of its kind and side; before there was one, and after STOOD of
    a transfer, the robot stands.  Of the `walking_state`, phase, support side,
    duration, time in the phase and steps are known; both feet are at the origin
    of W.  The state is [1 in a swing, else 0; side that swings, now or next (+1
    left); time in the phase [s]; steps; last durations [s] of right transfer,
    right swing, left transfer and left swing].

    Args:
        weight: weight of the robot [N].
        period: time between two looks at its feet [s].

    .. pydrake_system::

        name: ContactClock
        input_ports: [foot_forces]
        output_ports: [walking_state]
    """

    def __init__(self, weight: float, period: float) -> None:
        super().__init__()
        self._least_force, self._period = LOADED * weight, period
        self._forces = input_port(self, "foot_forces")
        self._state: Any = self.DeclareDiscreteState(8)
        declare_output(
            self,
            "walking_state",
            self._calc_walking,
            needs=[self.discrete_state_ticket(self._state)],
        )
        declare_update(self, period, self._update)
        self._standing = ContactSchedule(
            phase=Phase.STANDING,
            support_side=Side.LEFT,
            duration=math.inf,
            feet=FootPoses(ORIGIN, ORIGIN),
            footsteps=(),
            start=ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2)),
        )

    def _update(self, context: Context, state: State) -> None:
        memory: Any = state.get_mutable_discrete_state(self._state)
        swings, side, time, steps, *lasted = memory.value().tolist()
        left, right = self._forces(context) > self._least_force
        lifted = float(right) - float(left)  # +1: only the left foot
        bounces = not swings and lifted == -side and time < BOUNCE
        if not (left or right) or lifted == swings * side or bounces:
            memory[2] = time + self._period
        else:
            if side:
                lasted[int(side + 1.0 + swings)] = time + self._period
            side = lifted or -side
            memory.set_value([abs(lifted), side, 0.0, steps + swings, *lasted])

    def _calc_walking(self, context: Context) -> WalkingState:
        swings, side, time, steps, *lasted = (
            context.get_discrete_state(self._state).value().tolist()
        )
        schedule = self._standing
        duration = lasted[int(side + 1.0 + swings)]
        if duration and (swings or time < STOOD * duration):
            schedule = replace(
                schedule,
                phase=Phase.SWING if swings else Phase.TRANSFER,
                support_side=Side.of_sign(side).other,
                duration=duration,
            )
        return WalkingState(schedule, time, steps_taken=int(steps))
