"""What a policy is told in a tick: terms of an observation, and their history.

A term is a vector x that is measured.  The network is given clip(x) * scale of
this tick and of those before, the oldest first.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from nadia_balance.core.math.arrays import Array


class Measured(NamedTuple):
    """What the terms are made of; joints in the order of the policy.

    Attributes:
        velocity: of the pelvis, in its frame (3,) [m/s].
        spin: angular velocity of the pelvis, in its frame (3,) [rad/s].
        gravity: its direction in the frame of the pelvis (3,) [-].
        command: velocity forward, left [m/s] and yaw rate [rad/s] (3,).
        angles: of the joints, less the default ones (n,) [rad].
        speeds: of the joints (n,) [rad/s].
        action: last output of the network (n,) [-].
        phases: of the left and the right foot (2,) [rad].
        clock: phase since the start, that never stands [rad].
    """

    velocity: Array
    spin: Array
    gravity: Array
    command: Array
    angles: Array
    speeds: Array
    action: Array
    phases: Array
    clock: float


# By name, as in Isaac Lab; holosoma's besides.
TERMS: dict[str, Callable[[Measured], Array]] = {
    "base_lin_vel": lambda now: now.velocity,
    "base_ang_vel": lambda now: now.spin,
    "projected_gravity": lambda now: now.gravity,
    "velocity_commands": lambda now: now.command,
    "command_lin_vel": lambda now: now.command[:2],
    "command_ang_vel": lambda now: now.command[2:],
    "joint_pos_rel": lambda now: now.angles,
    "joint_vel_rel": lambda now: now.speeds,
    "last_action": lambda now: now.action,
    "gait_phase": lambda now: np.array(
        [math.sin(now.clock), math.cos(now.clock)]
    ),
    "sin_phase": lambda now: np.sin(now.phases),
    "cos_phase": lambda now: np.cos(now.phases),
}
_NOTHING = Measured(
    velocity=np.zeros(3),
    spin=np.zeros(3),
    gravity=np.zeros(3),
    command=np.zeros(3),
    angles=np.zeros(0),
    speeds=np.zeros(0),
    action=np.zeros(0),
    phases=np.zeros(2),
    clock=0.0,
)


def term_size(name: str, joints: int) -> int:
    """The number of entries of a term.

    Args:
        name: one of TERMS.
        joints: n, the number of joints.

    Returns:
        That of one tick.
    """
    return len(TERMS[name](_NOTHING)) or joints


class Term(Protocol):
    """A term as a contract has it (see params.ObservationTerm)."""

    name: str
    scale: list[float]
    clip: list[float]
    history: int


class Observation:
    """The layout of an observation.

    Terms stand one after another, each with its history, the oldest first;
    or, `by_tick`, the ticks stand one after another, each with all terms.

    Attributes:
        size: m, that of the observation.
        past_size: of what is remembered from tick to tick.
    """

    def __init__(
        self, terms: Sequence[Term], joints: int, by_tick: bool = False
    ) -> None:
        """Lays the terms out.

        Args:
            terms: in their order; `by_tick` all of one history.
            joints: n, the number of joints.
            by_tick: whether the ticks stand one after another.
        """
        self._terms, self._by_tick = list(terms), by_tick
        self._sizes = [term_size(term.name, joints) for term in self._terms]
        counts = [term.history for term in self._terms]
        self.size = int(np.dot(self._sizes, counts))
        self.past_size = self.size - sum(self._sizes)

    def ticks(self, now: Measured, past: Array) -> list[Array]:
        """Each term's history with the present tick.

        Args:
            now: what is measured.
            past: of the ticks before (past_size,); NaN before the first one,
                which then stands for them.

        Returns:
            A matrix (history, size) for each term, the oldest tick first.
        """
        stacks, start = [], 0
        for term, size in zip(self._terms, self._sizes, strict=True):
            frame = TERMS[term.name](now)
            if term.clip:
                frame = np.clip(frame, term.clip[0], term.clip[1])
            frame = frame * term.scale
            end = start + size * (term.history - 1)
            before = past[start:end].reshape(-1, size)
            before = np.where(np.isnan(before), frame, before)
            stacks.append(np.vstack([before, frame]))
            start = end
        return stacks

    def vector(self, ticks: list[Array]) -> Array:
        """What the network is given.

        Args:
            ticks: those of `ticks`.

        Returns:
            The observation (size,).
        """
        if self._by_tick:
            return np.hstack(ticks).ravel()
        return np.concatenate([stack.ravel() for stack in ticks])

    def past(self, ticks: list[Array]) -> Array:
        """What the next tick has to remember.

        Args:
            ticks: those of `ticks`.

        Returns:
            The terms of all ticks but the oldest (past_size,).
        """
        return np.concatenate([stack[1:].ravel() for stack in ticks])
