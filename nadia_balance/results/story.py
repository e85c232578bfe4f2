"""The story of a run: one line for each event."""

import math

import numpy as np

from nadia_balance.core.walking import Array, FootPose, Phase, Side
from nadia_balance.results.log import (
    Log,
    PhaseSpan,
    PushSpan,
    pushes,
    signal,
    span_at,
    steps,
    switches,
)
from nadia_balance.results.summary import recovered_at

# Smaller changes of a foothold [m] and of a duration [s] are not reported.
TOLD_MOVE, TOLD_TIME = 0.02, 0.05
_ORDINALS = {1: "first", 2: "second", 3: "third", 4: "fourth", 5: "fifth"}


def telling_lines(log: Log, summary: dict) -> list[str]:
    """Returns the story as lines for a terminal."""
    return [f"t={time:.2f} s  {text}" for time, text in telling(log, summary)]


def telling(log: Log, summary: dict) -> list[tuple[float, str]]:
    """Returns times [s] and lines of pushes, changed steps and the result.

    The entries are sorted by time.
    """
    told = [(push.start, _tell_push(log, push)) for push in pushes(log)]
    told += _tell_steps(log)
    for time, on in switches(log):
        names = ", ".join(on) or "nothing"
        told.append((time, f"switched in Meshcat, now on: {names}"))
    told.sort(key=lambda entry: entry[0])
    end = _end_time(log, summary)
    if summary["fell_at"] is None and told:
        end = max(end, told[-1][0])  # the result is the last line
    return [*told, (end, _tell_end(log, summary, end))]


def _tell_push(log: Log, push: PushSpan) -> str:
    what = (
        f"push {push.delta_v:.2f} m/s {direction(log, push)}, "
        f"{moment(log, push.first)}"
    )
    newtons = float(np.linalg.norm(push.force))
    sizes = np.linalg.norm(signal(log, "push_signal", push.rows).force, axis=0)
    sign = "=" if np.min(sizes) > 0.999 * newtons else "<="
    seconds = push.end - push.start
    return f"{what:<44}  F {sign} {newtons:.0f} N for {seconds:.2f} s"


def direction(log: Log, push: PushSpan) -> str:
    """The direction of a push in the support foot's frame, in words."""
    span, angle = span_at(log, push.first), push.direction_deg
    inward = 90.0 * span.support.sign
    words = {"forward": 0.0, "backward": 180.0, "left": 90.0, "right": -90.0}
    if span.phase is Phase.SWING:
        words = {"inward": inward, "outward": -inward, **words}
    for word, degrees in words.items():
        if abs((angle - degrees + 180.0) % 360.0 - 180.0) < 0.5:
            return word
    return f"at {(angle + 180.0) % 360.0 - 180.0:.0f} deg"


def moment(log: Log, row: int) -> str:
    """The point of the gait in the syntax of --at: `right swing 25 %`."""
    span = span_at(log, row)
    if span.phase is Phase.STANDING:
        return "standing"
    share = signal(log, "walking_signal", row).time_in_phase / span.planned
    return f"{span.swing_side.value} {span.phase.value} {100 * share:.0f} %"


def _tell_steps(log: Log) -> list[tuple[float, str]]:
    """Times and lines of steps whose foothold or durations were changed."""
    pushed = pushes(log)
    begin = pushed[0].start if pushed else -math.inf
    later = [step for step in steps(log) if step.swing.end > begin]
    told = []
    for number, step in enumerate(later, start=1):
        changes = [told_move(step.side, step.commanded, step.adjustment)]
        if step.transfer is not None and step.transfer.end > begin:
            changes.append(_tell_time("transfer", step.transfer))
        changes.append(_tell_time("swing", step.swing))
        if text := ", ".join(filter(None, changes)):
            name = _ORDINALS.get(number, f"{number}th")
            told.append(
                (step.swing.end, f"{name} step ({step.side.value}) {text}")
            )
    return told


def told_move(side: Side, commanded: FootPose, move: Array) -> str:
    """Describes the shift `move` (2,) [m] in W of a foothold, in its frame."""
    forward, left = commanded.rotation.T @ move
    out = left * side.sign
    parts = []
    if abs(forward) > TOLD_MOVE:
        word = "forward" if forward > 0 else "back"
        parts.append(f"{word} {abs(forward):.2f} m")
    if abs(out) > TOLD_MOVE:
        parts.append(f"{'out' if out > 0 else 'in'} {abs(out):.2f} m")
    return " and ".join(parts)


def _tell_time(name: str, span: PhaseSpan) -> str:
    if abs(span.duration - span.planned) < TOLD_TIME:
        return ""
    return f"{name} {span.planned:.2f} -> {span.duration:.2f} s"


def _end_time(log: Log, summary: dict) -> float:
    """The time [s] of the fall, of the recovery, or of the end of the run."""
    if summary["fell_at"] is not None:
        return float(summary["fell_at"])
    pushed = pushes(log)
    if not pushed or not summary["recovered"]:
        return float(log["t"][-1]) if len(log["t"]) else 0.0
    return recovered_at(log, pushed[-1])


def _tell_end(log: Log, summary: dict, end: float) -> str:
    figures = [_tell_outcome(log, summary, end)]
    for text, name, scale in (
        ("max ICP error {:.3f} m", "max_icp_error_m", 1.0),
        ("max torque {:.0f} %", "max_torque_ratio", 100.0),
        ("QP violation {:.0e}", "max_qp_violation", 1.0),
        ("real-time factor {:.1f}", "real_time_factor", 1.0),
    ):
        if summary[name] is not None:
            figures.append(text.format(scale * summary[name]))
    return "   ".join(figures).replace("e-0", "e-")


def _tell_outcome(log: Log, summary: dict, end: float) -> str:
    pushed = pushes(log)
    reason = summary["reason"]
    if summary["outcome"] == "undecided":
        return f"UNDECIDED: {reason}"
    if not summary["recovered"]:
        verb, _, why = reason.partition(": ")
        return f"{verb.upper()}: {why}" if why else verb.upper()
    if pushed:
        taken = signal(log, "walking_signal").steps_taken
        row = min(np.searchsorted(log["t"], end), len(taken) - 1)
        count = int(taken[row] - taken[pushed[-1].first])
        plural = "" if count == 1 else "s"
        how = f"in {count} step{plural}" if count else "without a step"
        return f"RECOVERED {how}"
    count = summary["steps_taken"]
    return f"WALKED {count} steps" if count else "STOOD"
