"""The log of a run: named arrays, and what happened in them.

`t` (n,) [s] are the control ticks.  Row t of every signal (n, size) is its
value at that instant; a signal has the name of its port, and `signal_view`
returns its parts by name.  `foot_poses` (n, 8) are MeasuredFeet, `trunk_tilt`
(n, 2) is a TrunkTilt.  Arrays without a row per tick contain the other data
that the evaluation and all plots need: `sole` (4, 2) [m]; `weight` () [N]; of
the actuators, all (nu,), `actuator_names`, `effort_limits` [N m],
`joint_speed_limits` [rad/s] and `joint_speed_columns` of `state`;
`region_base`, `region_forward` and `region_backward` (n, 2) [m], the
reachability regions (see core.body.reachability); `capture_regions` (k, 4), of
a run with Meshcat, the corners of C_1 and C_N 16 times a second of a swing:
time [s], n of C_n, x and y [m]; with commands of a user's source,
`velocity_limits` (2, 3) [m/s], [rad/s]; and, on a ground of regions, `ground`
(n, 3), the number of the region and x, y [m] of each corner.

`actuation` are the commanded torques, `torques` those of the drives.
`touchdowns` (k, 8) has a Touchdown in each row, by their times; `step_forces`
(n, 2 m) are the vertical forces on the (left, right) foot [N] in the m steps of
the plant since the last tick, the latest first.
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

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import FootPose, Mode, Phase, Side
from nadia_balance.parameters.bounds import require
from nadia_balance.systems.contact_clock import BOUNCE, LOADED
from nadia_balance.systems.signals import (
    MODES,
    PHASES,
    ComState,
    EcmpCommand,
    FootForces,
    IcpReference,
    MeasuredFeet,
    PushSignal,
    QpStatus,
    Touchdown,
    TrunkTilt,
    VelocityCommand,
    WalkingSignal,
)

Log = Mapping[str, np.ndarray]

QP_STATUS = ("momentum_qp_status", "whole_body_qp_status")

# Rows from the tick in which a push begins to its first row in the signal.
_FELT = 1

VIEWS = {
    "com_state": ComState,
    "ecmp_command": EcmpCommand,
    "foot_forces": FootForces,
    "foot_poses": MeasuredFeet,
    "icp_reference": IcpReference,
    "push_signal": PushSignal,
    "touchdowns": Touchdown,
    "trunk_tilt": TrunkTilt,
    "velocity_command": VelocityCommand,
    "walking_signal": WalkingSignal,
    "momentum_qp_status": QpStatus,
    "whole_body_qp_status": QpStatus,
}


def signal_view(
    log: Log, name: str, rows: int | slice | np.ndarray = slice(None)
) -> Any:
    """Returns a signal whose parts have names.

    The ICP reference, for example, is
    `x, y = signal_view(log, "icp_reference").icp`.

    Args:
        log: log of a run.
        name: name of a signal, one of VIEWS.
        rows: rows of the log, by default all.

    Returns:
        The namedview of the signal: its entries are arrays (n,), its parts
        (size, n); of one row they are numbers, and (size,).

    Raises:
        ValueError: the log is of another version of this package.
    """
    view, columns = VIEWS[name], log[name].shape[-1]
    size = len(view.get_fields())
    require(columns == size, f"{name} = {columns} columns: must be {size}")
    return view(log[name][rows].T)


def foot_part(view: Any, side: Side) -> Any:
    """Returns what a view has of one foot.

    Args:
        view: a namedview with `left` and `right`.
        side: side of the foot.

    Returns:
        Its `left` or its `right`.
    """
    return view.left if side is Side.LEFT else view.right


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
        """Tells whether a foot is in contact by the plan.

        Args:
            side: side of the foot.

        Returns:
            True if it is.
        """
        return self.phase is not Phase.SWING or side is self.support


def phase_spans(log: Log) -> list[PhaseSpan]:
    """Returns the phases of a run.

    Args:
        log: log of a run.

    Returns:
        The phases in order; none if they are not logged.
    """
    if "walking_signal" not in log or not len(log["t"]):
        return []
    t, walking = log["t"], signal_view(log, "walking_signal")
    last = len(t) - 1
    changed = np.any(
        np.diff([walking.phase, walking.support_side, walking.steps_taken]),
        axis=0,
    )
    # A transfer may follow another one: to stand, and then to a step.
    changed |= np.diff(walking.time_in_phase) < 0.0
    return [
        PhaseSpan(
            phase=PHASES[int(walking.phase[first])],
            support=support_side(signal_view(log, "walking_signal", first)),
            first=first,
            last=end - 1,
            start=float(t[first]),
            end=float(t[min(end, last)]),
            planned=float(walking.duration[first]),
            complete=end <= last,
        )
        for first, end in itertools.pairwise(
            [0, *(np.flatnonzero(changed) + 1).tolist(), len(t)]
        )
    ]


@dataclass(frozen=True)
class ModeSpan:
    """A time in which the mode stays the same."""

    mode: Mode
    start: float  # [s]
    end: float  # [s]


def mode_spans(log: Log) -> list[ModeSpan]:
    """Returns the modes of a run.

    Args:
        log: log of a run.

    Returns:
        The modes in order; none if they are not logged.
    """
    if "walking_signal" not in log or not len(log["t"]):
        return []
    t, mode = log["t"], signal_view(log, "walking_signal").mode
    return [
        ModeSpan(
            mode=MODES[int(mode[first])],
            start=float(t[first]),
            end=float(t[last]),
        )
        for first, last in itertools.pairwise(
            [0, *(np.flatnonzero(np.diff(mode)) + 1).tolist(), len(t) - 1]
        )
    ]


def velocity_commands(log: Log) -> list[tuple[float, Array]]:
    """Returns the changes of the velocity command.

    The first one is the command at the start, if it is not to stand.

    Args:
        log: log of a run.

    Returns:
        Times [s], and the commands from then on: forward, left [m/s] and turn
        [rad/s], (3,).
    """
    if "velocity_command" not in log:
        return []
    commands = log["velocity_command"]
    before = np.vstack([np.zeros(3), commands[:-1]])[: len(commands)]
    return [
        (float(log["t"][row]), commands[row])
        for row in np.flatnonzero(np.any(commands != before, axis=1))
    ]


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
        return float(
            np.linalg.norm((self.achieved.p_WF - self.adjusted.p_WF)[:2])
        )

    @property
    def adjustment(self) -> Array:
        """Shift (2,) [m] of the adjusted from the commanded foothold, in W."""
        return (self.adjusted.p_WF - self.commanded.p_WF)[:2]


def steps(log: Log) -> list[Step]:
    """Returns the steps that have landed.

    Args:
        log: log of a run.

    Returns:
        The steps in order.
    """
    spans = phase_spans(log)
    taken = []
    for i, swing in enumerate(spans):
        if swing.phase is not Phase.SWING or not swing.complete:
            continue
        transfer = spans[i - 1] if i else None
        first, landed = (transfer or swing).first, swing.last + 1
        if np.isnan(signal_view(log, "walking_signal", first).target[0]):
            first = swing.first  # the transfer was to stand, at first
        taken.append(
            Step(
                side=swing.swing_side,
                commanded=_level_pose(
                    signal_view(log, "walking_signal", first).target
                ),
                adjusted=_level_pose(
                    signal_view(log, "walking_signal", swing.last).target
                ),
                achieved=sole_pose(log, landed, swing.swing_side),
                swing=swing,
                transfer=transfer,
                number=int(
                    signal_view(log, "walking_signal", landed).steps_taken
                ),
            )
        )
    return taken


def contacts(log: Log, side: Side) -> list[tuple[float, float]]:
    """Returns the measured contacts of a foot.

    Args:
        log: log of a run.
        side: side of the foot.

    Returns:
        Start and duration [s] of each contact.
    """
    t, forces = log["t"], signal_view(log, "foot_forces")
    loaded = foot_part(forces, side) > LOADED * np.median(
        forces.left + forces.right
    )
    edges = np.flatnonzero(np.diff(np.concatenate([[0], loaded, [0]])))
    return [
        (float(t[a]), float(t[min(b, len(t) - 1)] - t[a]))
        for a, b in edges.reshape(-1, 2)
    ]


def landings(log: Log) -> list[float]:
    """Returns when the feet have landed: of its steps, or as measured.

    A foot that was in the air for less than BOUNCE has not been lifted.

    Args:
        log: log of a run.

    Returns:
        Times [s] of all landings, in order.
    """
    return (
        [step.swing.end for step in steps(log)]
        if "walking_signal" in log or "foot_forces" not in log
        else sorted(
            landing
            for side in Side
            for (start, duration), (landing, _) in itertools.pairwise(
                contacts(log, side)
            )
            if landing - (start + duration) > BOUNCE
        )
    )


def ground_regions(log: Log) -> list[Array]:
    """Returns the regions of the ground.

    Args:
        log: log of a run.

    Returns:
        Polygons (n, 2) [m] in W; none if the ground is flat.
    """
    if "ground" not in log:
        return []
    number, *corners = log["ground"].T
    return np.split(
        np.column_stack(corners), np.flatnonzero(np.diff(number)) + 1
    )


def sole_pose(log: Log, row: int, side: Side) -> FootPose:
    """Returns the pose of a sole in the schedule, on the ground.

    Args:
        log: log of a run.
        row: row of the log.
        side: side of the foot.

    Returns:
        The pose in W, of height 0.
    """
    return _level_pose(foot_part(signal_view(log, "walking_signal", row), side))


def _level_pose(entries: Array) -> FootPose:
    """The pose of x, y [m] and yaw [rad], (3,), on the ground."""
    x, y, yaw = entries
    return FootPose(np.array([x, y, 0.0]), float(yaw))


def walking_at(log: Log, row: int) -> WalkingSignal | None:
    """Returns the walking signal at a row.

    Args:
        log: log of a run.
        row: row of the log.

    Returns:
        The signal, None if it is not logged.
    """
    return (
        WalkingSignal(log["walking_signal"][row])
        if "walking_signal" in log
        else None
    )


def support_side(walking: WalkingSignal) -> Side:
    """Returns the foot that carries, or that receives the weight.

    Args:
        walking: walking signal in one row.

    Returns:
        The side of the foot.
    """
    return Side.of_sign(walking.support_side)


def push_direction(walking: WalkingSignal | None, force: Array) -> float:
    """Returns the direction of a push to the support foot, or in W.

    Args:
        walking: walking signal in the row of the push, if logged.
        force: force (3,) in W [N].

    Returns:
        The angle, in [0, 360) [deg].
    """
    heading = (
        0.0 if walking is None else foot_part(walking, support_side(walking))[2]
    )
    angle = math.atan2(force[1], force[0]) - heading
    return round(math.degrees(angle), 6) % 360.0


def icp_error(log: Log) -> Array:
    """Returns the distance of the ICP from its reference.

    Args:
        log: log of a run.

    Returns:
        |icp - icp_reference| (n,) [m].
    """
    return np.asarray(
        np.linalg.norm(
            log["icp"].T - signal_view(log, "icp_reference").icp, axis=0
        )
    )


@dataclass(frozen=True)
class PushSpan:
    """One push, from the row in which it begins."""

    first: int  # row in the log
    start: float  # [s]
    end: float  # [s]
    force: Array  # peak (3,) [N], in its initial direction, in W
    delta_v: float  # [m/s]
    direction_deg: float  # relative to the support foot, in [0, 360) [deg]
    rows: np.ndarray  # rows of the log in which it acts


def pushes(log: Log) -> list[PushSpan]:
    """Returns the pushes of a run.

    If pushes overlap, the signal shows only the one that began last.

    Args:
        log: log of a run.

    Returns:
        The pushes, in the order in which they began.
    """
    if "push_signal" not in log:
        return []
    push = signal_view(log, "push_signal")
    t, spans = log["t"], []
    for number in dict.fromkeys(push.number[np.any(push.force, axis=0)]):
        rows = np.flatnonzero(push.number == number)
        first = max(int(rows[0]) - _FELT, 0)
        sizes = np.linalg.norm(push.force[:, rows], axis=0)
        direction = push.force[:, rows[0]] / max(sizes[0], 1e-9)
        spans.append(
            PushSpan(
                first=first,
                start=float(t[first]),
                end=float(t[rows[-1] + 1 - _FELT]),
                force=direction * np.max(sizes),
                delta_v=float(push.delta_v[rows[0]]),
                direction_deg=push_direction(walking_at(log, first), direction),
                rows=rows,
            )
        )
    return spans
