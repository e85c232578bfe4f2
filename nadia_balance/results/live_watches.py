"""What a live session tells of a walk: its velocity, and why it fell.

Pure: each watch is told what is measured, tick by tick.
"""

import math
from collections import deque

import numpy as np

from nadia_balance.core.body.reachability import distance_between
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.polygon import project
from nadia_balance.core.plan.footstep_plan import within_limits
from nadia_balance.core.steps.foothold_adjustment import CaptureRegions

REMEMBERED = 1.0  # time before a fall that may say why [s]
MISSED = 0.01  # distances that count as outside of a region [m]
# Names and units of the parts of a velocity command.
_UNITS = (("forward", "m/s"), ("left", "m/s"), ("turn", "rad/s"))


class VelocityWatch:
    """Measures the mean velocity over the last `window` [s]."""

    def __init__(self, window: float):
        """Nothing has been measured.

        Args:
            window: time of the mean [s]; two steps are a good one, as the body
                sways with each.
        """
        self._window = window
        # Time [s], x, y [m] and heading [rad], which does not jump.
        self._looks: deque[tuple[float, float, float, float]] = deque()

    def update(self, time: float, place: Array, heading: float) -> Array:
        """Returns the mean velocity.

        It is that of the displacement, seen from the heading in the middle of
        the window: v = R(-(psi_0 + psi_1) / 2) (p_1 - p_0) / (t_1 - t_0).

        Args:
            time: now [s].
            place: of the robot now, (2,) in W [m].
            heading: of the robot now [rad].

        Returns:
            Forward, left [m/s] and turn [rad/s], (3,).
        """
        if self._looks:
            last = self._looks[-1][3]
            heading = last + math.remainder(heading - last, math.tau)
        x, y = float(place[0]), float(place[1])
        self._looks.append((time, x, y, heading))
        while time - self._looks[0][0] > self._window + 1e-9:
            self._looks.popleft()
        then, x_then, y_then, heading_then = self._looks[0]
        if time <= then:
            return np.zeros(3)
        middle = 0.5 * (heading + heading_then)
        c, s = math.cos(middle), math.sin(middle)
        dx, dy = x - x_then, y - y_then
        return np.array(
            [c * dx + s * dy, c * dy - s * dx, heading - heading_then]
        ) / (time - then)


def clipped_words(command: Array, limits: Array) -> str:
    """Says that a velocity command is beyond what the robot can walk.

    Args:
        command: forward, left [m/s], turn [rad/s], (3,).
        limits: least and most of it, (2, 3).

    Returns:
        Such as `more than it can walk: 0.85 of 0.90 m/s forward is taken`; ""
        for a command within the limits.
    """
    taken = within_limits(command, limits)
    parts = [
        f"{_signed(least)} of {_signed(asked)} {unit} {name}"
        for (name, unit), asked, least in zip(
            _UNITS, command, taken, strict=True
        )
        if asked != least
    ]
    if not parts:
        return ""
    return f"more than it can walk: {', '.join(parts)} is taken"


def velocity_lines(commanded: Array, walked: Array) -> list[str]:
    """Returns a line for forward, and for each of the others if commanded.

    Args:
        commanded: forward, left [m/s], turn [rad/s], (3,).
        walked: the same, as measured.

    Returns:
        Lines such as `commanded 0.30, walks 0.29 m/s`.
    """
    lines = []
    for (name, unit), command, mean in zip(
        _UNITS, commanded, walked, strict=True
    ):
        line = f"commanded {_signed(command)}, walks {_signed(mean)} {unit}"
        if name == "forward":
            lines.append(line)
        elif command:
            lines.append(f"{name}: {line}")
    return lines


def _signed(value: float) -> str:
    """Two digits, without the sign of -0.00."""
    return f"{round(float(value), 2) + 0.0:.2f}"


class FallWatch:
    """Remembers, tick by tick, what may make the robot fall.

    That is a foothold that does not capture the ICP, at its landing, or of the
    foot in the air; and a joint that is faster than it can be.
    """

    def __init__(self) -> None:
        """Nothing has been seen."""
        # Times [s] and words of steps that have missed.
        self._landed: deque[tuple[float, str]] = deque()
        self._in_air = ""  # the same of the step in the air
        self._since = math.inf  # [s]
        # Times [s], names and shares of joints that were too fast.
        self._fast: deque[tuple[float, str, float]] = deque()
        self._errors: deque[tuple[float, float]] = deque()  # of the ICP [m]

    def update(
        self,
        time: float,
        regions: CaptureRegions | None,
        icp_error: float | None,
        joint: str = "",
        speed_ratio: float = 0.0,
    ) -> None:
        """Remembers what is measured.

        Args:
            time: now [s].
            regions: the capture regions; without any outside of a swing.
            icp_error: distance of the ICP from its reference [m]; None: the
                controller has none.
            joint: the joint that is closest to its speed limit.
            speed_ratio: its speed per limit [-].
        """
        words = missed_words(regions) if regions is not None else ""
        if self._in_air and (regions is None or not regions.regions):
            self._landed.append((self._since, self._in_air))
        if not words or not self._in_air:
            self._since = time
        self._in_air = words
        if speed_ratio > 1.0:
            self._fast.append((time, joint, speed_ratio))
        if icp_error is not None:
            self._errors.append((time, icp_error))
        for queue in self._landed, self._fast, self._errors:
            while queue and time - queue[0][0] > REMEMBERED + 1e-9:
                queue.popleft()

    def reason(self) -> str:
        """Returns what was seen in the last second.

        Returns:
            The causes, the first of them first; without any, the largest ICP
            error; "" without one, as before the first look.
        """
        causes: list[tuple[float, str]] = []
        if self._in_air:
            causes.append((self._since, self._in_air))
        if self._landed:
            causes = [self._landed[0]]  # what came after it was too late
        if self._fast:
            _, joint, ratio = max(self._fast, key=lambda seen: seen[2])
            causes.append(
                (
                    self._fast[0][0],
                    f"{joint} at {100.0 * ratio:.0f} % of its speed",
                )
            )
        if not causes and self._errors:
            return f"ICP error {max(e for _, e in self._errors):.2f} m"
        return ", ".join(words for _, words in sorted(causes))


def missed_words(regions: CaptureRegions) -> str:
    """Says how the adjusted foothold misses the capture region C_N.

    Args:
        regions: capture regions of a swing.

    Returns:
        Such as `foothold outside the capture region by 0.21 m`; "" if it does
        not miss it, or outside of a swing.
    """
    captures = regions.regions[-1] if regions.regions else np.empty((0, 2))
    if regions.adjusted is None or not len(captures):
        return ""
    p_W = regions.adjusted.p_WF[:2]
    outside = math.dist(p_W, project(p_W, captures))
    if outside <= MISSED:
        return ""
    if len(regions.reach):
        gap = distance_between(regions.reach, captures)
        if gap > MISSED:
            return f"capture region out of reach by {gap:.2f} m"
    return f"foothold outside the capture region by {outside:.2f} m"
