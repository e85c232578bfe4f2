"""Results of a run; here its log: named arrays, and what happened in them.

`t` (n,) [s] are the control ticks.  Row t of every signal (n, size) is its
value at that instant; a signal has the name of its port, and `signal` returns
its parts by name.  `foot_poses` (n, 8) are MeasuredFeet, `trunk_tilt` (n, 2) is
a TrunkTilt.  Arrays without a row per tick contain the other data that the
evaluation and all plots need: `sole` (4, 2) [m]; `weight` () [N]; of the
actuators, all (nu,), `actuator_names`, `effort_limits` [N m],
`joint_speed_limits` [rad/s] and `joint_speed_columns` of `state`;
`region_base`, `region_forward` and `region_backward` (n, 2) [m], the
reachability regions (see core.body.reachability); and, on a ground of regions,
`ground` (n, 3), the number of the region and x, y [m] of each corner.

`actuation` are the commanded torques, `torques` those of the drives.
`mechanisms` (see Mechanisms) may be switched in Meshcat during a run.  The log
of a point mass lacks joints, torques, `state`, `foot_poses`, `trunk_tilt`,
`weight` and `foot_wrenches`, that of a controller of the user's what it has no
port for; readers of a log must handle this.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from nadia_balance.core.walking.state import FootPose, Mode, Phase, Side
from nadia_balance.systems import signals
from nadia_balance.systems.push_source import BOUNCE, LOADED

Log = Mapping[str, np.ndarray]

QP_STATUS = ("momentum_qp_status", "whole_body_qp_status")

# Rows from the tick in which a push begins to its first row in the signal.
_FELT = 1

_VIEWS = {
    "com_state": signals.ComState,
    "ecmp_command": signals.EcmpCommand,
    "foot_forces": signals.FootForces,
    "foot_poses": signals.MeasuredFeet,
    "icp_reference": signals.IcpReference,
    "push_signal": signals.PushSignal,
    "trunk_tilt": signals.TrunkTilt,
    "velocity_command": signals.VelocityCommand,
    "walking_signal": signals.WalkingSignal,
    **dict.fromkeys(QP_STATUS, signals.QpStatus),
}


def signal(log: Log, name: str, rows: int | slice = slice(None)) -> Any:
    """Returns the view of a signal of _VIEWS, at these rows of the log.

    Its entries are arrays (n,), its parts (size, n): the ICP reference is
    `x, y = signal(log, "icp_reference").icp`.
    """
    return _VIEWS[name](log[name][rows].T)


@dataclass(frozen=True)
class PhaseSpan:
    """One phase of the run."""

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
        """Actual duration [s]."""
        return self.end - self.start

    @property
    def swing_side(self) -> Side:
        """The swing foot of this phase, or of the next one."""
        return self.support.other

    def carries(self, side: Side) -> bool:
        """True if the foot of `side` is in contact by the plan."""
        return self.phase is not Phase.SWING or side is self.support


def phase_spans(log: Log) -> list[PhaseSpan]:
    """Returns the phases of the run, in order; none if they are not logged."""
    if "walking_signal" not in log or not len(log["t"]):
        return []
    t, walking = log["t"], signal(log, "walking_signal")
    last = len(t) - 1
    what = walking.phase, walking.support_side, walking.steps_taken
    changed = np.any(np.diff(np.stack(what)) != 0.0, axis=0)
    # A transfer may follow another one: to stand, and then to a step.
    changed |= np.diff(walking.time_in_phase) < 0.0
    edges = [0, *(np.flatnonzero(changed) + 1).tolist(), len(t)]
    return [
        PhaseSpan(
            phase=signals.PHASES[int(walking.phase[first])],
            support=support_side(signal(log, "walking_signal", first)),
            first=first,
            last=end - 1,
            start=float(t[first]),
            end=float(t[min(end, last)]),
            planned=float(walking.duration[first]),
            complete=end <= last,
        )
        for first, end in itertools.pairwise(edges)
    ]


@dataclass(frozen=True)
class ModeSpan:
    """A time in which the mode stays the same."""

    mode: Mode
    first: int  # row in the log
    start: float  # [s]
    end: float  # [s]


def mode_spans(log: Log) -> list[ModeSpan]:
    """Returns the modes of the run, in order; none if they are not logged."""
    if "walking_signal" not in log or not len(log["t"]):
        return []
    t, mode = log["t"], signal(log, "walking_signal").mode
    edges = [0, *(np.flatnonzero(np.diff(mode)) + 1).tolist(), len(t) - 1]
    return [
        ModeSpan(
            mode=signals.MODES[int(mode[first])],
            first=first,
            start=float(t[first]),
            end=float(t[last]),
        )
        for first, last in itertools.pairwise(edges)
    ]


def velocity_commands(log: Log) -> list[tuple[float, np.ndarray]]:
    """Returns the times [s] of changes of the velocity command, and it (3,).

    The first one is the command at the start, if it is not to stand.
    """
    if "velocity_command" not in log:
        return []
    told = log["velocity_command"]
    before = np.vstack([np.zeros(3), told[:-1]])[: len(told)]
    rows = np.flatnonzero(np.any(told != before, axis=1))
    return [(float(log["t"][row]), told[row]) for row in rows]


@dataclass(frozen=True)
class Step:
    """One foothold: commanded, adjusted, achieved."""

    side: Side
    commanded: FootPose  # after the landing of the previous step
    adjusted: FootPose  # just before it landed
    achieved: FootPose  # just after it landed
    swing: PhaseSpan
    transfer: PhaseSpan | None  # before the swing
    number: int  # counted from 1

    @property
    def error(self) -> float:
        """Horizontal distance [m] between achieved and adjusted foothold."""
        offset = self.achieved.p_WF - self.adjusted.p_WF
        return float(np.linalg.norm(offset[:2]))

    @property
    def adjustment(self) -> np.ndarray:
        """Shift (2,) [m] of the adjusted from the commanded foothold, in W."""
        return (self.adjusted.p_WF - self.commanded.p_WF)[:2]


def steps(log: Log) -> list[Step]:
    """Returns the steps that have landed, in order."""
    spans = phase_spans(log)
    found = []
    for i, swing in enumerate(spans):
        if swing.phase is not Phase.SWING or not swing.complete:
            continue
        before, landed = spans[i - 1] if i else None, swing.last + 1
        found.append(
            Step(
                side=swing.swing_side,
                commanded=_scheduled(log, (before or swing).first, "target"),
                adjusted=_scheduled(log, swing.last, "target"),
                achieved=sole_pose(log, landed, swing.swing_side),
                swing=swing,
                transfer=before,
                number=int(signal(log, "walking_signal", landed).steps_taken),
            )
        )
    return found


def contacts(log: Log, side: Side) -> list[tuple[float, float]]:
    """Measured contacts of the foot of `side`: (start, duration) [s]."""
    t, forces = log["t"], signal(log, "foot_forces")
    weight = np.median(forces.left + forces.right)
    loaded = getattr(forces, side.value) > LOADED * weight
    edges = np.flatnonzero(np.diff(np.concatenate([[0], loaded, [0]])))
    return [
        (float(t[a]), float(t[min(b, len(t) - 1)] - t[a]))
        for a, b in edges.reshape(-1, 2)
    ]


def landings(log: Log) -> list[float]:
    """Returns the times [s] of all landings: of its steps, or as measured.

    A foot that was in the air for less than BOUNCE has not been lifted.
    """
    if "walking_signal" in log or "foot_forces" not in log:
        return [step.swing.end for step in steps(log)]
    found = []
    for spans in (contacts(log, side) for side in Side):
        ends = [start + duration for start, duration in spans]
        starts = [start for start, _ in spans[1:]]
        flights = zip(ends, starts, strict=False)
        found += [end for start, end in flights if end - start > BOUNCE]
    return sorted(found)


def ground_regions(log: Log) -> list[np.ndarray]:
    """Returns the regions of the ground (n, 2) [m]; none if it is flat."""
    if "ground" not in log:
        return []
    number, *corners = log["ground"].T
    ends = np.flatnonzero(np.diff(number)) + 1
    return np.split(np.column_stack(corners), ends)


def sole_pose(log: Log, row: int, side: Side) -> FootPose:
    """The pose of a sole in the schedule at this row, on the ground."""
    return _scheduled(log, row, side.value)


def _scheduled(log: Log, row: int, what: str) -> FootPose:
    """The pose of `left` or `right`, or the `target`, NaN if there is none."""
    x, y, yaw = getattr(signal(log, "walking_signal", row), what)
    return FootPose(np.array([x, y, 0.0]), float(yaw))


def walking_at(log: Log, row: int) -> signals.WalkingSignal | None:
    """The walking signal at this row, None if it is not logged."""
    name = "walking_signal"
    return signal(log, name, row) if name in log else None


def support_side(walking: signals.WalkingSignal) -> Side:
    """The foot that carries, or that receives the weight, in one row."""
    return Side.LEFT if walking.support_side > 0 else Side.RIGHT


def push_direction(walking, force: np.ndarray) -> float:
    """Direction [0, 360) [deg] of `force` (3,) to the support foot, or in W."""
    yaw = 0.0
    if walking is not None:
        yaw = getattr(walking, support_side(walking).value)[2]
    angle = math.atan2(force[1], force[0]) - yaw
    return round(math.degrees(angle), 6) % 360.0


def icp_error(log: Log) -> np.ndarray:
    """Distance (n,) [m] of the ICP from its reference."""
    reference = signal(log, "icp_reference").icp
    return np.linalg.norm(log["icp"].T - reference, axis=0)


@dataclass(frozen=True)
class PushSpan:
    """One push, from the row in which it begins."""

    first: int  # row in the log
    start: float  # [s]
    end: float  # [s]
    force: np.ndarray  # peak (3,) [N], in its initial direction, in W
    delta_v: float  # [m/s]
    direction_deg: float  # relative to the support foot, in [0, 360) [deg]
    rows: np.ndarray  # rows of the log in which it acts


def pushes(log: Log) -> list[PushSpan]:
    """Returns the pushes of the run, in the order in which they began.

    If pushes overlap, the signal shows only the one that began last.
    """
    if "push_signal" not in log:
        return []
    push = signal(log, "push_signal")
    t, spans = log["t"], []
    for number in dict.fromkeys(push.number[np.any(push.force, axis=0)]):
        rows = np.flatnonzero(push.number == number)
        first = max(int(rows[0]) - _FELT, 0)
        sizes = np.linalg.norm(push.force[:, rows], axis=0)
        begins = push.force[:, rows[0]] / max(sizes[0], 1e-9)
        spans.append(
            PushSpan(
                first=first,
                start=float(t[first]),
                end=float(t[rows[-1] + 1 - _FELT]),
                force=begins * np.max(sizes),
                delta_v=float(push.delta_v[rows[0]]),
                direction_deg=push_direction(walking_at(log, first), begins),
                rows=rows,
            )
        )
    return spans
