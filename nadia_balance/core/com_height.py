"""The height of the CoM: as high as the legs allow without locking a knee."""

import math
from dataclasses import dataclass

from nadia_balance.core.walking import ContactSchedule, FootPose, Phase


@dataclass(kw_only=True)
class ComHeightParams:
    """Gains of the vertical motion, and how far the legs may stretch."""

    position_gain: float = 50.0  # k_p [1/s^2]
    damping_ratio: float = 0.9  # zeta [-]
    max_acceleration: float = 4.9  # half of gravity [m/s^2]
    max_velocity: float = 1.0  # at which the height is approached [m/s]
    max_stretch: float = 0.97  # hip to ankle, of the straight leg [-]
    # Largest horizontal distance from hip to ankle while both feet carry, of
    # the distance of the feet: 0.5 if the hips are half-way between them.
    reach_ratio: float = 0.65  # [-]
    min_height_ratio: float = 0.8  # never lower than so much of nominal [-]

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        for name, value in vars(self).items():
            if not 0.0 < value < math.inf:
                raise ValueError(f"{name} = {value}: must be finite and > 0")
        for name in ("max_stretch", "reach_ratio", "min_height_ratio"):
            if not getattr(self, name) <= 1.0:
                raise ValueError(
                    f"{name} = {getattr(self, name)}: must be <= 1"
                )
        if not self.max_acceleration < 9.81:
            raise ValueError(
                f"max_acceleration = {self.max_acceleration}: "
                "must be < 9.81 m/s^2"
            )


@dataclass(kw_only=True)
class LegGeometry:
    """What the legs allow, a property of the robot; all in [m]."""

    length: float = 0.0  # hip pitch axis to ankle, the knee straight
    ankle_height: float = 0.0  # of the ankle above the sole
    com_above_hip: float = 0.0  # vertical, in the nominal posture
    hip_width: float = 0.0  # lateral, between the hip pitch axes

    def validate(self) -> None:
        """Raises ValueError if a field is out of range."""
        for name, value in vars(self).items():
            if not math.isfinite(value):
                raise ValueError(f"legs.{name} = {value}: must be finite")
        for name in ("length", "ankle_height", "hip_width"):
            value = getattr(self, name)
            if not value > 0.0:
                raise ValueError(f"legs.{name} = {value}: must be > 0 m")


def height_limit(
    stance: FootPose,
    other: FootPose,
    legs: LegGeometry,
    params: ComHeightParams,
) -> float:
    """Returns the CoM height [m] above the soles at which both legs reach.

    Pythagoras on the leg from hip to ankle, stretched to `max_stretch`, over
    `reach_ratio` of the distance of the feet; sideways the hips are already
    `hip_width` apart.  Zero if no height would do.
    """
    x, y = stance.to_sole(other.p_WF[None, :2])[0]
    reach = params.reach_ratio * math.hypot(
        x, max(abs(y) - legs.hip_width, 0.0)
    )
    squared = (params.max_stretch * legs.length) ** 2 - reach**2
    if squared <= 0.0:
        return 0.0
    return legs.ankle_height + math.sqrt(squared) + legs.com_above_hip


@dataclass(frozen=True)
class ComHeightPlan:
    """Desired CoM height [m] in W during one phase of `duration` [s]."""

    start: float
    end: float
    duration: float

    def at(self, t: float) -> tuple[float, float]:
        """Returns the height [m] and its rate [m/s] at the time `t` [s].

        A cubic from start to end that is at rest at both, and beyond.
        """
        rise, s = self.end - self.start, min(max(t / self.duration, 0.0), 1.0)
        return (
            self.start + rise * s * s * (3.0 - 2.0 * s),
            rise * 6.0 * s * (1.0 - s) / self.duration,
        )


def plan_com_height(
    schedule: ContactSchedule,
    nominal: float,
    legs: LegGeometry,
    params: ComHeightParams,
) -> ComHeightPlan:
    """Returns the desired CoM height during the present phase.

    It is `nominal` [m] above the support sole, or less if the feet are far
    apart.  It changes during a swing only, from what the place of lift-off
    allows to what the next foothold allows.
    """
    side = schedule.support_side
    stance = schedule.feet[side]
    lowest = params.min_height_ratio * nominal

    def height(other: FootPose) -> float:
        limit = height_limit(stance, other, legs, params)
        return float(stance.p_WF[2]) + min(max(limit, lowest), nominal)

    start = end = height(schedule.feet[side.other])
    if schedule.phase is Phase.SWING and schedule.footsteps:
        end = height(schedule.footsteps[0].pose)
    return ComHeightPlan(start, end, schedule.duration)


def vertical_acceleration(
    height: float,
    velocity: float,
    desired: float,
    desired_rate: float,
    params: ComHeightParams,
) -> float:
    """Returns the desired vertical acceleration of the CoM [m/s^2].

    A PD law whose velocity command is limited to `max_velocity`, and its
    result to `max_acceleration`: the feet keep pushing on the ground
    (heights [m], velocities [m/s], all in W).
    """
    k_p = params.position_gain
    k_d = 2.0 * params.damping_ratio * math.sqrt(k_p)
    command = desired_rate + k_p / k_d * (desired - height)
    limit = params.max_velocity
    command = min(max(command, -limit), limit)
    limit = params.max_acceleration
    return min(max(k_d * (command - velocity), -limit), limit)
