"""The log of a run: named arrays with one row for each control tick.

`t` (n,) [s] and the signals (n, size) of the ports of the same name;
`walking_signal` is documented at WalkingStateMachine.  `foot_poses` (n, 6) [m]
are the measured sole centres [left, right].  Without a row for each tick are
`sole` (4, 2) [m], `effort_limits` (nu,) [N m], `joint_speed_limit` () [rad/s],
`actuator_names` (nu,), `num_positions` (), and `region_base`, `region_forward`
and `region_backward` (n, 2) [m], the regions that a step can be put into (see
nadia_balance.core.reachability): what else it takes to judge the run, and to
draw all plots, from the log alone.
A run in a tab has `mechanisms` (n, 4), 1 or 0 as in Mechanisms: they may be
switched there.
A point mass has no `state`, `actuation`, `foot_wrenches` nor
`whole_body_qp_status`; whoever reads a log copes without them.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from nadia_balance.core.mechanisms import Mechanisms
from nadia_balance.core.walking import FootPose, Phase, Side

Log = Mapping[str, np.ndarray]

# Columns of walking_signal.
PHASE, SUPPORT, TIME_IN_PHASE, DURATION, WAITING, STEPS_TAKEN = range(6)
SOLES = {Side.LEFT: slice(6, 9), Side.RIGHT: slice(9, 12)}
TARGET, TARGET_SIDE = slice(12, 15), 15
PHASES = (Phase.STANDING, Phase.TRANSFER, Phase.SWING)

# Columns of the QP status.
SOLVED, FALLBACK, ITERATIONS, VIOLATION, FAILURES = range(5)
QP_STATUS = ("momentum_qp_status", "whole_body_qp_status")


@dataclass(frozen=True)
class PhaseSpan:
    """One phase as it really was."""

    phase: Phase
    support: Side  # stance foot, or the one that receives the weight
    first: int  # row in the log
    last: int  # row in the log
    start: float  # [s]
    end: float  # [s]
    planned: float  # duration when it began [s]
    complete: bool  # it ended before the log did

    @property
    def duration(self) -> float:
        """How long it lasted [s]."""
        return self.end - self.start

    @property
    def swing_side(self) -> Side:
        """The foot in the air, or the one that will be."""
        return self.support.other

    def carries(self, side: Side) -> bool:
        """True if the foot of `side` was meant to carry weight."""
        return self.phase is not Phase.SWING or side is self.support


def phase_spans(log: Log) -> list[PhaseSpan]:
    """Returns the phases of the run, in order."""
    t, signal = log["t"], log["walking_signal"]
    if len(t) == 0:
        return []
    key = signal[:, [PHASE, SUPPORT, STEPS_TAKEN]]
    changes = np.flatnonzero(np.any(np.diff(key, axis=0) != 0.0, axis=1)) + 1
    firsts = [0, *changes]
    lasts = [*(changes - 1), len(t) - 1]
    return [
        PhaseSpan(
            phase=PHASES[int(signal[first, PHASE])],
            support=Side.LEFT if signal[first, SUPPORT] > 0 else Side.RIGHT,
            first=int(first),
            last=int(last),
            start=float(t[first]),
            end=float(t[min(last + 1, len(t) - 1)]),
            planned=float(signal[first, DURATION]),
            complete=last < len(t) - 1,
        )
        for first, last in zip(firsts, lasts, strict=True)
    ]


@dataclass(frozen=True)
class Step:
    """One foothold: commanded, adjusted, achieved."""

    side: Side
    commanded: FootPose  # when the step before had landed
    adjusted: FootPose  # just before it landed
    achieved: FootPose  # just after it landed
    swing: PhaseSpan
    transfer: PhaseSpan | None  # before the swing
    number: int  # counted from 1

    @property
    def error(self) -> float:
        """Horizontal distance [m] from where it was to land."""
        offset = self.achieved.p_WF - self.adjusted.p_WF
        return float(np.linalg.norm(offset[:2]))

    @property
    def adjustment(self) -> np.ndarray:
        """Move (2,) [m] of the foothold since it was commanded, in W."""
        return (self.adjusted.p_WF - self.commanded.p_WF)[:2]


def steps(log: Log) -> list[Step]:
    """Returns the steps that have landed, in order."""
    signal = log["walking_signal"]
    spans = phase_spans(log)
    found = []
    for i, swing in enumerate(spans):
        if swing.phase is not Phase.SWING or not swing.complete:
            continue
        before = spans[i - 1] if i else None
        begin = before.first if before else swing.first
        found.append(
            Step(
                side=swing.swing_side,
                commanded=_pose(signal[begin, TARGET]),
                adjusted=_pose(signal[swing.last, TARGET]),
                achieved=_pose(signal[swing.last + 1, SOLES[swing.swing_side]]),
                swing=swing,
                transfer=before,
                number=int(signal[swing.last + 1, STEPS_TAKEN]),
            )
        )
    return found


def _pose(xy_yaw: np.ndarray) -> FootPose:
    x, y, yaw = xy_yaw
    return FootPose(np.array([x, y, 0.0]), float(yaw))


def sole_pose(log: Log, row: int, side: Side) -> FootPose:
    """The pose of a sole in the schedule at this row, on the ground."""
    return _pose(log["walking_signal"][row, SOLES[side]])


def icp_error(log: Log) -> np.ndarray:
    """Distance (n,) [m] of the ICP from its reference."""
    return np.linalg.norm(log["icp"] - log["icp_reference"][:, :2], axis=1)


@dataclass(frozen=True)
class PushSpan:
    """One push, as it was felt."""

    first: int  # row in the log
    start: float  # [s]
    end: float  # [s]
    force: np.ndarray  # (3,) at its start [N], in W


def pushes(log: Log) -> list[PushSpan]:
    """Returns the pushes of the run, in order."""
    if "push_force" not in log or len(log["t"]) < 2:
        return []
    t, force = log["t"], log["push_force"]
    acts = np.linalg.norm(force, axis=1) > 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], acts, [0]])))
    period = t[1] - t[0]
    return [
        PushSpan(int(a), float(t[a]), float(t[b - 1] + period), force[a])
        for a, b in edges.reshape(-1, 2)
    ]


def switches(log: Log) -> list[tuple[float, Mechanisms]]:
    """Returns when [s] mechanisms were switched in the tab, and what was on."""
    if "mechanisms" not in log:
        return []
    signal = log["mechanisms"] > 0.5
    rows = np.flatnonzero(np.any(signal[1:] != signal[:-1], axis=1)) + 1
    return [
        (float(log["t"][row]), Mechanisms(*signal[row].tolist()))
        for row in rows
    ]
