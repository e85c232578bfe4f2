"""The story of a run, finished or live: one line for each event."""

import itertools
import math
from typing import Any

import numpy as np

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import Mode, Phase
from nadia_balance.results.live_watches import clipped_words
from nadia_balance.results.log import (
    Log,
    PhaseSpan,
    PushSpan,
    Step,
    mode_spans,
    phase_spans,
    push_direction,
    pushes,
    signal_view,
    steps,
    support_side,
    velocity_commands,
    walking_at,
)
from nadia_balance.results.measurements import (
    SETTLED,
    CalmSteps,
    StandsWatch,
    is_square,
    recovered_at,
)
from nadia_balance.results.summary import STEADY
from nadia_balance.systems.signals import PHASES, PushSignal, WalkingSignal

# Smaller changes of a foothold [m] and of a duration [s] are not reported.
TOLD_MOVE, TOLD_TIME = 0.02, 0.05
# More changes of the velocity command are not reported.
TOLD_COMMANDS = 12
NO_GROUND = "no ground in reach where it has to step"
_ORDINALS = {1: "first", 2: "second", 3: "third", 4: "fourth", 5: "fifth"}


def telling_lines(log: Log, summary: dict[str, Any]) -> list[str]:
    """Returns the story as lines for a terminal.

    Args:
        log: log of a run.
        summary: summary of the run.

    Returns:
        Lines that begin with the time.
    """
    return [f"t={time:.2f} s  {text}" for time, text in telling(log, summary)]


def telling(log: Log, summary: dict[str, Any]) -> list[tuple[float, str]]:
    """Returns the story: pushes, changed steps and the result.

    It also has the changes of the velocity command, and when a robot that
    stood has to step, finds no ground, and stands again.

    Args:
        log: log of a run.
        summary: summary of the run.

    Returns:
        Times [s] and lines, in order; the last one is the result.
    """
    events = [
        *((push.start, _tell_push(log, push)) for push in pushes(log)),
        *_tell_steps(log),
    ]
    end = _end_time(log, summary)
    if summary["fell_at"] is None:
        end = max([end, *(time for time, _ in events)])
    outcome = _tell_outcome(log, summary, end)
    story = sorted(
        [
            *events,
            *tell_commands(log),
            *_tell_clipped(log),
            *_tell_modes(log),
            *_tell_no_ground(log),
        ],
        key=lambda event: event[0],
    )
    if summary["fell_at"] is None and story:
        end = max(end, story[-1][0])  # the result is the last line
    figures = _figures(
        summary,
        ("max ICP error {:.3f} m", "max_icp_error_m", 1.0),
        ("max torque {:.0f} %", "max_torque_ratio", 100.0),
        ("QP violation {:.0e}", "max_qp_violation", 1.0),
        ("real-time factor {:.1f}", "real_time_factor", 1.0),
    )
    result = "   ".join([outcome, *figures]).replace("e-0", "e-")
    return [*story, (end, result)]


def chapter_words(summary: dict[str, Any]) -> str:
    """Returns the line of a chapter of a longer run.

    Args:
        summary: summary of the chapter.

    Returns:
        Such as `walks on: 0.020 m of ICP error, 60 % of torque`.
    """
    figures = _figures(
        summary,
        ("{:.3f} m of ICP error", "max_icp_error_m", 1.0),
        ("{:.0f} % of torque", "max_torque_ratio", 100.0),
        ("{:.0f} QP failures", "qp_failures", 1.0),
    )
    return f"walks on: {', '.join(figures)}"


def _figures(
    summary: dict[str, Any], *texts: tuple[str, str, float]
) -> list[str]:
    """Texts with the entries of the `summary`, by their names, scaled.

    Without those that are None.
    """
    return [
        text.format(scale * summary[name])
        for text, name, scale in texts
        if summary[name] is not None
    ]


class LiveStory:
    """Tells pushes, recoveries and falls while they happen.

    `last_push` and `result` are the line of the last push and its result.
    """

    def __init__(self, calm_steps: int):
        """Begins without a push.

        Args:
            calm_steps: full steps of small ICP error that are a recovery; it
                is also one to stand for SETTLED, feet square (see StandsWatch).
        """
        self._required = calm_steps
        self.last_push = self.result = ""
        self._number = 0.0  # number of the push at the last call of look()
        self._pushed_at = -math.inf  # when the last push acted [s]
        self._lacked_ground = False  # since the last push
        # Steps taken before the push; None: no push, or recovered.
        self._pushed_after: int | None = None
        self._calm, self._stands = CalmSteps(), StandsWatch()

    def update(
        self,
        time: float,
        walking: WalkingSignal,
        push: PushSignal,
        error: float | None,
        no_foothold: bool = False,
    ) -> list[str]:
        """Returns what is new.

        Args:
            time: now [s].
            walking: walking signal now.
            push: push signal now.
            error: ICP error [m]; None: the controller has none, and a robot
                that is upright STEADY after a push has recovered.
            no_foothold: no ground in reach is where it has to step.

        Returns:
            Lines on a push that has begun, on ground that lacks, and on a
            recovery.
        """
        taken, news = int(walking.steps_taken), []
        if push.number not in (0.0, self._number):
            self.last_push = (
                f"{push_words(walking, push.force, push.delta_v)}  "
                f"F = {np.linalg.norm(push.force):.0f} N"
            )
            self._pushed_after, self.result = taken, "pushed"
            self._lacked_ground = False
            news.append(self.last_push)
        self._number = float(push.number)
        if no_foothold and not self._lacked_ground:
            self._lacked_ground = True
            news.append(NO_GROUND)
        result = self._recovery(time, walking, error, push.number > 0.0)
        if self._pushed_after is None or not result:
            return news
        self.result, self._pushed_after = result, None
        return [*news, self.result]

    def _recovery(
        self,
        time: float,
        walking: WalkingSignal,
        error: float | None,
        pushed: bool,
    ) -> str:
        """The words on the recovery from the last push; "" before it."""
        if pushed:
            self._pushed_at = time
        if error is None:
            upright = time - self._pushed_at >= STEADY
            return f"UPRIGHT {STEADY:g} s after the push" if upright else ""
        taken, before = int(walking.steps_taken), self._pushed_after or 0
        calm = self._calm.update(taken, error, pushed)
        if self._stands.update(time, walking, error, pushed) >= SETTLED:
            return recovery_words(taken - before)
        if calm >= self._required:
            return recovery_words(self._calm.taken - before)
        return ""

    def fell(self, reason: str) -> str:
        """Records a fall.

        Args:
            reason: why, in words.

        Returns:
            The line that reports it.
        """
        self._pushed_after, self.result = None, f"FELL: {reason}"
        return self.result


def moment_words(walking: WalkingSignal) -> str:
    """Returns the point of the gait in the syntax of --at.

    Args:
        walking: walking signal in one row.

    Returns:
        Such as `right swing 25 %`, or `standing`.
    """
    phase = PHASES[int(walking.phase)]
    if phase is Phase.STANDING:
        return "standing"
    # A policy's may last longer than the one before it.
    share = min(walking.time_in_phase / walking.duration, 1.0)
    return (
        f"{support_side(walking).other.value} {phase.value} "
        f"{100.0 * share:.0f} %"
    )


def push_words(
    walking: WalkingSignal | None, force: Array, delta_v: float
) -> str:
    """Describes a push, as it begins: size, direction, point of the gait.

    Args:
        walking: walking signal then, if logged.
        force: force (3,) in W [N].
        delta_v: size of the push [m/s].

    Returns:
        Such as `push 0.60 m/s outward, left swing 25 %`.
    """
    words = f"push {delta_v:.2f} m/s {direction_words(walking, force)}"
    return words if walking is None else f"{words}, {moment_words(walking)}"


def direction_words(walking: WalkingSignal | None, force: Array) -> str:
    """Describes the direction of a force in the support foot's frame, or in W.

    Args:
        walking: walking signal then, if logged.
        force: force (3,) in W [N].

    Returns:
        Such as `forward`, in a swing also `inward`, or `at 30 deg`.
    """
    angle = push_direction(walking, force)
    words = {"forward": 0.0, "backward": 180.0, "left": 90.0, "right": -90.0}
    if walking is not None and PHASES[int(walking.phase)] is Phase.SWING:
        inward = 90.0 * support_side(walking).sign
        words = {"inward": inward, "outward": -inward, **words}
    return next(
        (
            word
            for word, degrees in words.items()
            if abs((angle - degrees + 180.0) % 360.0 - 180.0) < 0.5
        ),
        f"at {(angle + 180.0) % 360.0 - 180.0:.0f} deg",
    )


def move_words(step: Step) -> str:
    """Describes the shift of a foothold in the commanded one's frame.

    Args:
        step: a step that has landed.

    Returns:
        Such as `forward 0.12 m and out 0.20 m`; "" for less than TOLD_MOVE.
    """
    forward, left = step.commanded.rotation.T @ step.adjustment
    out, parts = left * step.side.sign, []
    if abs(forward) > TOLD_MOVE:
        parts.append(
            f"{'forward' if forward > 0 else 'back'} {abs(forward):.2f} m"
        )
    if abs(out) > TOLD_MOVE:
        parts.append(f"{'out' if out > 0 else 'in'} {abs(out):.2f} m")
    return " and ".join(parts)


def command_words(command: Array) -> str:
    """Describes a velocity command.

    Args:
        command: forward, left [m/s] and turn [rad/s], (3,).

    Returns:
        Such as `commanded forward 0.30 m/s`, or `commanded to stand`.
    """
    words = [
        f"{positive if value > 0.0 else negative} {abs(value):.2f} {unit}"
        for value, positive, negative, unit in zip(
            command.tolist(),
            ("forward", "left", "turn left"),
            ("backward", "right", "turn right"),
            ("m/s", "m/s", "rad/s"),
            strict=True,
        )
        if value
    ]
    return f"commanded {', '.join(words) or 'to stand'}"


def recovery_words(count: int) -> str:
    """Describes a recovery.

    Args:
        count: number of its steps.

    Returns:
        Such as `RECOVERED in 2 steps`, or `RECOVERED without a step`.
    """
    return (
        f"RECOVERED in {count} step{'' if count == 1 else 's'}"
        if count
        else "RECOVERED without a step"
    )


def _tell_push(log: Log, push: PushSpan) -> str:
    words = push_words(walking_at(log, push.first), push.force, push.delta_v)
    newtons = float(np.linalg.norm(push.force))
    forces = signal_view(log, "push_signal", push.rows).force
    is_constant = np.min(np.linalg.norm(forces, axis=0)) > 0.999 * newtons
    return (
        f"{words:<44}  F {'=' if is_constant else '<='} {newtons:.0f} N "
        f"for {push.end - push.start:.2f} s"
    )


def _tell_steps(log: Log) -> list[tuple[float, str]]:
    """Times and lines of steps whose foothold or durations were changed."""
    begin = min((push.start for push in pushes(log)), default=-math.inf)
    later = [step for step in steps(log) if step.swing.end > begin]
    lines = []
    for number, step in enumerate(later, start=1):
        changes = [move_words(step)]
        if step.transfer is not None and step.transfer.end > begin:
            changes.append(_tell_time("transfer", step.transfer))
        changes.append(_tell_time("swing", step.swing))
        text = ", ".join(filter(None, changes))
        if text:
            ordinal = _ORDINALS.get(number, f"{number}th")
            lines.append(
                (step.swing.end, f"{ordinal} step ({step.side.value}) {text}")
            )
    return lines


def tell_commands(log: Log) -> list[tuple[float, str]]:
    """Returns the changes of the velocity command.

    Args:
        log: log of a run.

    Returns:
        Times [s] and lines; none if they are more than TOLD_COMMANDS.
    """
    changes = velocity_commands(log)
    few = changes if len(changes) <= TOLD_COMMANDS else []
    return [(time, command_words(command)) for time, command in few]


def _tell_clipped(log: Log) -> list[tuple[float, str]]:
    """The first command of a user's source that the robot cannot walk."""
    limits = log.get("velocity_limits")
    if limits is None:
        return []
    events = (
        (time, clipped_words(command, limits))
        for time, command in velocity_commands(log)
    )
    return [event for event in events if event[1]][:1]


def _tell_no_ground(log: Log) -> list[tuple[float, str]]:
    """When a step had no ground where it had to go, once for each push."""
    if "no_foothold" not in log:
        return []
    times = log["t"][np.flatnonzero(log["no_foothold"])]
    begins = [push.start for push in pushes(log)]
    _, first = np.unique(np.searchsorted(begins, times), return_index=True)
    return [(float(time), NO_GROUND) for time in times[first]]


def _tell_modes(log: Log) -> list[tuple[float, str]]:
    """Times and lines of a robot that stood, has to step, and stands again.

    One that has come to the end of its gait has not stood before.
    """
    modes = mode_spans(log)
    lines = [
        (after.start, "steps, to recover")
        for before, after in itertools.pairwise(modes)
        if (before.mode, after.mode) == (Mode.STANDING, Mode.RECOVERING)
    ]
    # Steps, when it last stood.
    taken = (
        signal_view(log, "walking_signal", 0).steps_taken
        if modes and modes[0].mode is Mode.STANDING
        else math.inf
    )
    for span in phase_spans(log):
        walking = signal_view(log, "walking_signal", span.first)
        if span.phase is not Phase.STANDING or not span.first:
            continue
        if walking.steps_taken > taken and (
            "ground" in log or is_square(walking)
        ):
            lines.append((span.start, "stands"))
        taken = walking.steps_taken
    return lines


def _tell_time(name: str, span: PhaseSpan) -> str:
    return (
        ""
        if abs(span.duration - span.planned) < TOLD_TIME
        else f"{name} {span.planned:.2f} -> {span.duration:.2f} s"
    )


def _end_time(log: Log, summary: dict[str, Any]) -> float:
    """The time [s] of the fall, of the recovery, or of the end of the run."""
    if summary["fell_at"] is not None:
        return float(summary["fell_at"])
    pushed = pushes(log)
    if not pushed or not summary["recovered"] or "icp" not in log:
        return float(log["t"][-1]) if len(log["t"]) else 0.0
    return recovered_at(log, pushed[-1])


def _tell_outcome(log: Log, summary: dict[str, Any], end: float) -> str:
    pushed, reason = pushes(log), summary["reason"]
    if summary["outcome"] == "undecided":
        return f"UNDECIDED: {reason}"
    if not summary["recovered"]:
        verb, colon, cause = reason.partition(": ")
        return f"{verb.upper()}{colon}{cause}"
    if pushed and "icp" in log:
        taken = signal_view(log, "walking_signal").steps_taken
        row = min(np.searchsorted(log["t"], end), len(taken) - 1)
        return recovery_words(int(taken[row] - taken[pushed[-1].first]))
    count = summary["steps_taken"]
    words = f"WALKED {count} steps" if count else "STOOD"
    upright = ", upright" + ", after the push" * bool(pushed)
    return words if "icp" in log else words + upright
