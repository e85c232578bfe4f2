"""The story of a run, finished or live: one line for each event."""

import itertools
import math

import numpy as np

import nadia_balance.results.log as logs
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import Mode, Phase
from nadia_balance.results.log import Log, pushes, signal, support_side
from nadia_balance.results.measurements import (
    SETTLED,
    CalmSteps,
    StandsWatch,
    is_square,
    recovered_at,
)
from nadia_balance.systems.signals import PHASES, WalkingSignal

# Smaller changes of a foothold [m] and of a duration [s] are not reported.
TOLD_MOVE, TOLD_TIME = 0.02, 0.05
# More changes of the velocity command are not reported.
TOLD_COMMANDS = 12
_ORDINALS = {1: "first", 2: "second", 3: "third", 4: "fourth", 5: "fifth"}


def telling_lines(log: Log, summary: dict) -> list[str]:
    """Returns the story as lines for a terminal."""
    return [f"t={time:.2f} s  {text}" for time, text in telling(log, summary)]


def telling(log: Log, summary: dict) -> list[tuple[float, str]]:
    """Returns times [s] and lines of pushes, changed steps and the result.

    So are the changes of the velocity command, and when a robot that stood has
    to step, and stands again.
    """
    told = [(push.start, _tell_push(log, push)) for push in pushes(log)]
    told += _tell_steps(log)
    told.sort(key=lambda entry: entry[0])
    end = _end_time(log, summary)
    if summary["fell_at"] is None and told:
        end = max(end, told[-1][0])
    outcome = _tell_outcome(log, summary, end)
    told += [*tell_commands(log), *_tell_modes(log)]
    told.sort(key=lambda entry: entry[0])
    if summary["fell_at"] is None and told:
        end = max(end, told[-1][0])  # the result is the last line
    figures = _figures(
        summary,
        ("max ICP error {:.3f} m", "max_icp_error_m", 1.0),
        ("max torque {:.0f} %", "max_torque_ratio", 100.0),
        ("QP violation {:.0e}", "max_qp_violation", 1.0),
        ("real-time factor {:.1f}", "real_time_factor", 1.0),
    )
    line = "   ".join([outcome, *figures])
    return [*told, (end, line.replace("e-0", "e-"))]


def chapter_words(summary: dict) -> str:
    """Returns the line of a chapter of a longer run."""
    error = "{:.3f} m of ICP error", "max_icp_error_m", 1.0
    torque = "{:.0f} % of torque", "max_torque_ratio", 100.0
    failures = "{:.0f} QP failures", "qp_failures", 1.0
    return f"walks on: {', '.join(_figures(summary, error, torque, failures))}"


def _figures(summary: dict, *texts: tuple[str, str, float]) -> list[str]:
    """Texts with known entries of the `summary`, by their names, scaled."""
    known = [(t, summary[n], k) for t, n, k in texts if summary[n] is not None]
    return [text.format(scale * value) for text, value, scale in known]


class LiveStory:
    """Tells pushes, recoveries and falls while they happen.

    `last_push` and `result` are the line of the last push and its result.
    """

    def __init__(self, calm_steps: int):
        """A recovery is `calm_steps` full steps of small ICP error.

        Or it is to stand for SETTLED, with square feet (see StandsWatch).
        """
        self._required = calm_steps
        self.last_push = self.result = ""
        self._number = 0.0  # number of the push at the last call of look()
        # Steps taken before the push; None: no push, or recovered.
        self._pushed_after: int | None = None
        self._calm, self._stands = CalmSteps(), StandsWatch()

    def look(self, time: float, walking, push, error: float) -> list[str]:
        """Returns lines on what is new at `time` [s]; `error` [m]: ICP's.

        `walking` and `push` are the WalkingSignal and the PushSignal.
        """
        taken, told = int(walking.steps_taken), []
        if push.number not in (0.0, self._number):
            newtons = float(np.linalg.norm(push.force))
            what = push_words(walking, push.force, push.delta_v)
            self.last_push = f"{what}  F = {newtons:.0f} N"
            self._pushed_after, self.result = taken, "pushed"
            told.append(self.last_push)
        self._number = float(push.number)
        pushed = push.number > 0.0
        calm = self._calm.look(time, taken, error, pushed)
        stood = self._stands.look(time, walking, error, pushed)
        if self._pushed_after is None:
            return told
        if stood >= SETTLED:
            count = taken
        elif calm >= self._required:
            count = self._calm.taken
        else:
            return told
        self.result = recovery_words(count - self._pushed_after)
        self._pushed_after = None
        return [*told, self.result]

    def fell(self, reason: str) -> str:
        """Records a fall and returns the line that reports it."""
        self._pushed_after, self.result = None, f"FELL: {reason}"
        return self.result


def moment_words(walking: WalkingSignal) -> str:
    """The point of the gait in the syntax of --at: `right swing 25 %`."""
    phase = PHASES[int(walking.phase)]
    if phase is Phase.STANDING:
        return "standing"
    share = walking.time_in_phase / walking.duration
    swing = support_side(walking).other
    return f"{swing.value} {phase.value} {100.0 * share:.0f} %"


def push_words(walking, force: Array, delta_v: float) -> str:
    """Describes a push, as it begins: size, direction, point of the gait."""
    told = f"push {delta_v:.2f} m/s {direction_words(walking, force)}"
    return told if walking is None else f"{told}, {moment_words(walking)}"


def direction_words(walking: WalkingSignal | None, force: Array) -> str:
    """The direction of a force (3,) in the support foot's frame, or in W."""
    angle = logs.push_direction(walking, force)
    words = {"forward": 0.0, "backward": 180.0, "left": 90.0, "right": -90.0}
    if walking is not None and PHASES[int(walking.phase)] is Phase.SWING:
        inward = 90.0 * support_side(walking).sign
        words = {"inward": inward, "outward": -inward, **words}
    for word, degrees in words.items():
        if abs((angle - degrees + 180.0) % 360.0 - 180.0) < 0.5:
            return word
    return f"at {(angle + 180.0) % 360.0 - 180.0:.0f} deg"


def move_words(step: logs.Step) -> str:
    """Describes the shift of a foothold in the commanded one's frame."""
    forward, left = step.commanded.rotation.T @ step.adjustment
    out, parts = left * step.side.sign, []
    if abs(forward) > TOLD_MOVE:
        word = "forward" if forward > 0 else "back"
        parts.append(f"{word} {abs(forward):.2f} m")
    if abs(out) > TOLD_MOVE:
        parts.append(f"{'out' if out > 0 else 'in'} {abs(out):.2f} m")
    return " and ".join(parts)


def command_words(command: Array) -> str:
    """Describes a velocity command (3,): `forward 0.30 m/s`, or `to stand`."""
    words = []
    for value, ahead, back, unit in zip(
        command.tolist(),
        ("forward", "left", "turn left"),
        ("backward", "right", "turn right"),
        ("m/s", "m/s", "rad/s"),
        strict=True,
    ):
        if value:
            words.append(f"{ahead if value > 0.0 else back} {abs(value):.2f}")
            words[-1] += f" {unit}"
    return f"commanded {', '.join(words) or 'to stand'}"


def recovery_words(count: int) -> str:
    """Describes a recovery that took `count` steps."""
    plural = "" if count == 1 else "s"
    how = f"in {count} step{plural}" if count else "without a step"
    return f"RECOVERED {how}"


def _tell_push(log: Log, push: logs.PushSpan) -> str:
    walking = logs.walking_at(log, push.first)
    what = push_words(walking, push.force, push.delta_v)
    newtons = float(np.linalg.norm(push.force))
    sizes = np.linalg.norm(signal(log, "push_signal", push.rows).force, axis=0)
    sign = "=" if np.min(sizes) > 0.999 * newtons else "<="
    seconds = push.end - push.start
    return f"{what:<44}  F {sign} {newtons:.0f} N for {seconds:.2f} s"


def _tell_steps(log: Log) -> list[tuple[float, str]]:
    """Times and lines of steps whose foothold or durations were changed."""
    pushed = pushes(log)
    begin = pushed[0].start if pushed else -math.inf
    later = [step for step in logs.steps(log) if step.swing.end > begin]
    told = []
    for number, step in enumerate(later, start=1):
        changes = [move_words(step)]
        if step.transfer is not None and step.transfer.end > begin:
            changes.append(_tell_time("transfer", step.transfer))
        changes.append(_tell_time("swing", step.swing))
        if text := ", ".join(filter(None, changes)):
            which = f"{_ORDINALS.get(number, f'{number}th')} step"
            told.append((step.swing.end, f"{which} ({step.side.value}) {text}"))
    return told


def tell_commands(log: Log) -> list[tuple[float, str]]:
    """Returns times [s] and lines of the commands; none if they are many."""
    changes = logs.velocity_commands(log)
    if len(changes) > TOLD_COMMANDS:
        return []
    return [(time, command_words(command)) for time, command in changes]


def _tell_modes(log: Log) -> list[tuple[float, str]]:
    """Times and lines of a robot that stood, has to step, and stands again.

    One that has come to the end of its gait has not stood before.
    """
    told, modes, phases = [], logs.mode_spans(log), logs.phase_spans(log)
    for before, span in itertools.pairwise(modes):
        changes = before.mode, span.mode
        if changes == (Mode.STANDING, Mode.RECOVERING):
            told.append((span.start, "steps, to recover"))
    taken = math.inf  # steps, when it last stood
    if modes and modes[0].mode is Mode.STANDING:
        taken = signal(log, "walking_signal", 0).steps_taken
    for span in phases:
        walking = signal(log, "walking_signal", span.first)
        if span.phase is not Phase.STANDING or not span.first:
            continue
        square = "ground" in log or is_square(walking)
        if square and walking.steps_taken > taken:
            told.append((span.start, "stands"))
        taken = walking.steps_taken
    return told


def _tell_time(name: str, span: logs.PhaseSpan) -> str:
    if abs(span.duration - span.planned) < TOLD_TIME:
        return ""
    return f"{name} {span.planned:.2f} -> {span.duration:.2f} s"


def _end_time(log: Log, summary: dict) -> float:
    """The time [s] of the fall, of the recovery, or of the end of the run."""
    if summary["fell_at"] is not None:
        return float(summary["fell_at"])
    pushed = pushes(log)
    if not pushed or not summary["recovered"] or "icp" not in log:
        return float(log["t"][-1]) if len(log["t"]) else 0.0
    return recovered_at(log, pushed[-1])


def _tell_outcome(log: Log, summary: dict, end: float) -> str:
    pushed, reason = pushes(log), summary["reason"]
    if summary["outcome"] == "undecided":
        return f"UNDECIDED: {reason}"
    if not summary["recovered"]:
        verb, _, why = reason.partition(": ")
        return f"{verb.upper()}: {why}" if why else verb.upper()
    count = summary["steps_taken"]
    if "icp" not in log:
        told = f"WALKED {count} steps" if count else "STOOD"
        return f"{told}, upright" + ", after the push" * bool(pushed)
    if pushed:
        taken = signal(log, "walking_signal").steps_taken
        row = min(np.searchsorted(log["t"], end), len(taken) - 1)
        return recovery_words(int(taken[row] - taken[pushed[-1].first]))
    return f"WALKED {count} steps" if count else "STOOD"
