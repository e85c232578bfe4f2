"""What the page of a replay shows beside the scene: words, marks and strips.

All of it is data, which replay.html draws: the story and the phase at each
time, marks to jump to, and curves over time with their limits.
"""

import re
from typing import Any

import numpy as np

from nadia_balance import palette
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import Phase, Side
from nadia_balance.results.log import (
    Log,
    PhaseSpan,
    icp_error,
    mode_spans,
    phase_spans,
    pushes,
    steps,
    velocity_commands,
)
from nadia_balance.results.measurements import (
    ICP_BACK,
    joint_speed_ratio,
    torque_ratio,
)
from nadia_balance.results.story import command_words, tell_commands, telling

LEAD = 1.0  # time before the first push at which the film begins [s]
_POINTS = 500  # largest number of points of a curve
_DIGITS = 3  # of a curve's values
# Tops of axes, by powers of ten.
_TOPS = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
_MARGIN = 1.2  # least ratio of an axis' top to its limit [-]


def film(log: Log, summary: dict[str, Any]) -> dict[str, Any]:
    """Returns what the page of a replay shows.

    Each line of the story appears at its time, but for the commands, as the
    present one is told beside the mode; the last one, the result of the run, is
    shortened to its first part.

    Args:
        log: log of a run.
        summary: summary of the run.

    Returns:
        `title`; `phases` and `story`, texts with their times; `marks`, times,
        names and colours; `strips`; `begin` and `end` of the film [s].
    """
    pushed = pushes(log)
    return {
        "title": "  ·  ".join(
            str(summary[name])
            for name in ("scenario", "robot", "plant", "mechanisms")
            if name in summary
        ),
        "phases": _moments(log),
        "story": _story(log, summary),
        "marks": _marks(log),
        "strips": _strips(log),
        "begin": max(pushed[0].start - LEAD, 0.0) if pushed else 0.0,
        "end": float(log["t"][-1]),
    }


def _story(log: Log, summary: dict[str, Any]) -> list[tuple[float, str, str]]:
    """Times, lines and kinds of the story: good, bad, or none."""
    commands = tell_commands(log)
    *lines, (end, result) = (
        line for line in telling(log, summary) if line not in commands
    )
    kind = "good" if summary["recovered"] else "bad"
    return [
        *((time, re.sub(r"\s{2,}", ", ", text), "") for time, text in lines),
        (end, result.split("   ")[0], kind),
    ]


def _marks(log: Log) -> list[tuple[float, str, str]]:
    """Times, names and colours of the marks: pushes, commands, steps."""
    return [
        *((push.start, "push", palette.PUSH) for push in pushes(log)),
        *((time, text, palette.COMMAND) for time, text in tell_commands(log)),
        *(
            (
                step.swing.start,
                f"step {step.number}",
                palette.foot_color(step.side),
            )
            for step in steps(log)
        ),
    ]


def _moments(log: Log) -> list[tuple[float, str]]:
    """Times, and what the status says from then on: mode, phase, command.

    Such as `recovering (left swing)`, or `standing`.
    """
    modes = [(span.start, span.mode.value) for span in mode_spans(log)]
    phases = [(span.start, _phase_words(span)) for span in phase_spans(log)]
    commands = [
        (time, command_words(command))
        for time, command in velocity_commands(log)
    ]
    texts = []
    for time in sorted({time for time, _ in (*modes, *phases, *commands)}):
        moment, phase = _last(modes, time), _last(phases, time)
        if moment != phase:
            moment = f"{moment} ({phase})" if moment else phase
        words = filter(None, (moment, _last(commands, time)))
        texts.append((time, ", ".join(words)))
    return texts


def _phase_words(span: PhaseSpan) -> str:
    if span.phase is Phase.STANDING:
        return str(span.phase.value)
    return f"{span.swing_side.value} {span.phase.value}"


def _last(texts: list[tuple[float, str]], time: float) -> str:
    """The last one of timed texts that is not later than `time` [s]."""
    return next((text for t, text in reversed(texts) if t <= time), "")


def _strips(log: Log) -> list[dict[str, Any]]:
    """The strips that the log has the data for."""
    strips = []
    if "icp_reference" in log:
        strips.append(
            _strip(
                "ICP error",
                unit="cm",
                limit=100.0 * ICP_BACK,
                curves=[("", palette.ICP, 100.0 * icp_error(log))],
            )
        )
    if "weight" in log:
        forces = log["foot_forces"] / log["weight"]
        strips.append(
            _strip(
                "Foot forces over weight",
                unit="",
                limit=1.0,
                curves=[
                    (side.value, palette.foot_color(side), forces[:, column])
                    for column, side in enumerate(Side)
                ],
            )
        )
    loads = [
        (name, color, 100.0 * np.max(ratio, axis=1))
        for name, color, ratio in (
            ("torque", palette.SUPPORT, torque_ratio(log)),
            ("speed", palette.ECMP, joint_speed_ratio(log)),
        )
        if ratio.size
    ]
    if loads:
        strips.append(
            _strip("Most loaded joint", unit="%", limit=100.0, curves=loads)
        )
    return strips


def _strip(
    label: str, unit: str, limit: float, curves: list[tuple[str, str, Array]]
) -> dict[str, Any]:
    """A strip with a limit; `curves`: name, colour, values (n,)."""
    peaks = [_peaks(values) for _, _, values in curves]
    largest = max(map(max, peaks))
    return {
        "label": label,
        "unit": unit,
        "limit": limit,
        "top": axis_top(max(largest, _MARGIN * limit)),
        "lines": [
            {"name": name, "color": color, "values": values}
            for (name, color, _), values in zip(curves, peaks, strict=True)
        ],
    }


def _peaks(values: Array) -> list[float]:
    """At most _POINTS points (n,): each is the largest of its share, or 0."""
    values = np.nan_to_num(values)  # JSON has no NaN
    edges = np.linspace(0, len(values) - 1, _POINTS).astype(int)
    peaks = np.maximum.reduceat(values, np.unique(edges))
    return [float(f"{peak:.{_DIGITS}g}") for peak in peaks]


def axis_top(largest: float) -> float:
    """Returns the end of an axis that begins at 0.

    Args:
        largest: largest value > 0.

    Returns:
        The least round number that is not smaller.
    """
    power = 10.0 ** np.floor(np.log10(largest))
    return float(next(top for top in _TOPS if top * power >= largest) * power)
