"""CoM height: the nominal one, limited by the reach of bent legs."""

import math
from dataclasses import dataclass

from nadia_balance.core.body.model import LegGeometry, PointMassModel
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.state import ContactSchedule, FootPose, Phase
from nadia_balance.parameters.bounds import bounded, parameters, require


@parameters
class ComHeightParams:
    """Gains of the vertical motion, and limits of the leg length."""

    position_gain: float = bounded(
        50.0, above=0.0, unit="1/s^2", doc="k_p, of the height"
    )
    damping_ratio: float = bounded(
        0.9, above=0.0, doc="zeta, of the closed loop"
    )
    max_acceleration: float = bounded(
        4.9,
        above=0,
        below=GRAVITY,
        unit="m/s^2",
        doc="largest command; half of gravity, so that the feet keep their "
        "load",
    )
    max_velocity: float = bounded(
        0.7,
        above=0.0,
        unit="m/s",
        doc="bound on the commanded vertical velocity",
    )
    max_stretch: float = bounded(
        0.97,
        above=0.0,
        most=1.0,
        doc="largest distance from hip to ankle, as a share of the straight "
        "leg",
    )
    reach_ratio: float = bounded(
        0.65,
        above=0.0,
        most=1.0,
        doc="largest horizontal distance from hip to ankle while both feet "
        "carry, as a share of the distance of the feet: 0.5 if the hips are "
        "half-way",
    )
    min_height_ratio: float = bounded(
        0.8,
        above=0.0,
        most=1.0,
        doc="lowest height, as a share of the nominal one",
    )
    sink_distance: float = bounded(
        0.2,
        above=0.0,
        unit="m",
        doc="of the ICP from the eCMP, beyond which the CoM sinks in a swing",
    )
    sink_gain: float = bounded(1.8, least=0.0, doc="k_s, of the sinking")


def leg_reach(
    legs: LegGeometry, com_height: float, lean: float
) -> tuple[float, float]:
    """Length and width_max of the base region of these legs.

    It is ComHeight.height_limit solved for the step, with flat soles and the
    hips half-way, at the lowest CoM of the height plan, with legs of the
    largest length or an outward angle.  Nadia's are those of Sec. VII to 1 %.

    Args:
        legs: dimensions of the legs.
        com_height: of the CoM above the soles when standing [m].
        lean: outward angle of the leg [rad].

    Returns:
        Length [m] and width_max [m].

    Raises:
        ValueError: legs are straight at the lowest CoM, or hips too low.
    """
    params = ComHeightParams()
    above_ankle = legs.com_above_hip + legs.ankle_height
    hip = params.min_height_ratio * com_height - above_ankle
    longest = params.max_stretch * legs.length
    require(
        0.0 < hip < longest,
        f"com_height = {com_height:g}: must leave the legs bent in a "
        f"crouch: in ({above_ankle / params.min_height_ratio:.3f}, "
        f"{(above_ankle + longest) / params.min_height_ratio:.3f}) m",
    )
    length = 2.0 * math.sqrt(longest**2 - hip**2)
    return length, legs.hip_width + min(2.0 * hip * math.tan(lean), length)


@dataclass(frozen=True)
class ComHeightPlan:
    """Desired CoM height [m] in W during one phase of `duration` [s]."""

    start: float
    end: float
    duration: float

    def at(self, t: float) -> tuple[float, float]:
        """The desired height at a time.

        A rise is a cubic, at rest at both ends and beyond.  A descent has a
        constant acceleration, so that the CoM falls at the touchdown (see
        `ComHeight.sinking`).

        Args:
            t: time since the phase began [s].

        Returns:
            Height in W [m] and its rate [m/s].
        """
        rise = self.end - self.start
        if t >= self.duration:
            return self.start + rise, 0.0
        s = max(t / self.duration, 0.0)
        if rise < 0.0:
            return self.start + rise * s * s, 2.0 * rise * s / self.duration
        return (
            self.start + rise * s * s * (3.0 - 2.0 * s),
            rise * 6.0 * s * (1.0 - s) / self.duration,
        )


@dataclass(frozen=True, eq=False)
class ComHeight:
    """The CoM height of a robot, nominal but for bent legs, and its control."""

    params: ComHeightParams
    model: PointMassModel

    def height_limit(self, stance: FootPose, other: FootPose) -> float:
        """The largest CoM height with bent legs.

        It follows from Pythagoras for a leg of `max_stretch` times its length
        and a horizontal distance of `reach_ratio` times that of the feet, less
        `hip_width` sideways, as seen from the foot for which it is longer.

        Args:
            stance: pose of a sole in W.
            other: pose of the other sole in W.

        Returns:
            Height above the soles [m], between `min_height_ratio` and 1 times
            the nominal one.
        """
        params, legs = self.params, self.model.legs
        reach = 0.0
        for foot, to in (stance, other), (other, stance):
            x, y = foot.to_sole(to.p_WF[None, :2])[0]
            aside = max(abs(y) - legs.hip_width, 0.0)
            reach = max(reach, params.reach_ratio * math.hypot(x, aside))
        squared = (params.max_stretch * legs.length) ** 2 - reach**2
        leg, nominal = math.sqrt(max(squared, 0.0)), self.model.com_height
        limit = legs.ankle_height + leg + legs.com_above_hip
        return min(max(limit, params.min_height_ratio * nominal), nominal)

    def plan(self, schedule: ContactSchedule) -> ComHeightPlan:
        """The desired CoM height during the present phase.

        It is the `height_limit` above the support sole (on uneven ground above
        the lower sole).  It changes only during a swing, from the limit at
        lift-off to that at the next foothold.

        Args:
            schedule: feet and phase.

        Returns:
            The height over the time in the phase.
        """
        stance = schedule.feet[schedule.support_side]

        def height(other: FootPose) -> float:
            ground = float(stance.p_WF[2])
            if self.model.is_uneven:
                ground = min(ground, float(other.p_WF[2]))
            return ground + self.height_limit(stance, other)

        start = end = height(schedule.feet[schedule.support_side.other])
        if schedule.phase is Phase.SWING and schedule.footsteps:
            end = height(schedule.footsteps[0].pose)
        return ComHeightPlan(start, end, schedule.duration)

    def stance_limit(
        self, com: Array, velocity: Array, schedule: ContactSchedule
    ) -> tuple[float, float]:
        """The CoM height that the stance leg allows.

        The hip is `hip_width` / 2 beside the CoM, and `hip_ahead` of the ankle
        when the CoM is over the sole's centre; it is at most `max_stretch`
        times the leg's length from the ankle (Pythagoras).

        Args:
            com: CoM (2,) in W [m].
            velocity: its velocity (2,) in W [m/s].
            schedule: feet and phase.

        Returns:
            Height in W [m], not below `min_height_ratio`, where it has no rate,
            and its rate [m/s].
        """
        side, params, legs = schedule.support_side, self.params, self.model.legs
        stance = schedule.feet[side]
        x, y = stance.to_sole(com).tolist()
        x += legs.hip_ahead
        y += 0.5 * side.sign * legs.hip_width
        vx, vy = (stance.rotation.T @ velocity).tolist()
        lowest = params.min_height_ratio * self.model.com_height
        above = lowest - legs.ankle_height - legs.com_above_hip
        squared = (params.max_stretch * legs.length) ** 2 - x * x - y * y
        lowest += float(stance.p_WF[2])
        if squared <= max(above, 0.0) ** 2:
            return lowest, 0.0
        height = math.sqrt(squared)
        return lowest - above + height, -(x * vx + y * vy) / height

    def acceleration(
        self,
        height: float,
        velocity: float,
        desired: float,
        rate: float,
        sinking: float = 0.0,
    ) -> float:
        """The vertical acceleration k_d (v - velocity) - sinking of the CoM.

        The velocity command is v = rate + k_p / k_d (desired - height), within
        `max_velocity`, the gain k_d = 2 zeta sqrt(k_p); the acceleration is
        within `max_acceleration`, and lets no CoM fall faster than
        `max_velocity`.

        Args:
            height: of the CoM in W [m].
            velocity: its rate [m/s].
            desired: desired height in W [m].
            rate: its rate [m/s].
            sinking: downward acceleration beside this law [m/s^2].

        Returns:
            Desired acceleration, upward [m/s^2].
        """
        k_p, limit = self.params.position_gain, self.params.max_acceleration
        k_d = 2.0 * self.params.damping_ratio * math.sqrt(k_p)
        fastest = self.params.max_velocity
        command = rate + k_p / k_d * (desired - height)
        command = min(max(command, -fastest), fastest)
        upward = min(max(k_d * (command - velocity), -limit), limit)
        upward = max(upward - sinking, k_d * (-fastest - velocity))
        return min(max(upward, -limit), limit)

    def sinking(
        self, com: Array, icp: Array, ecmp: Array, above: float
    ) -> float:
        """The acceleration by which the CoM sinks in a swing.

        It is k_s omega^2 (|icp - ecmp| - sink_distance) while the CoM is ahead
        of the eCMP and above `min_height_ratio`.  The ICP leaves an eCMP, to
        first order, as the exponential of

            omega t + omega / (2 g) (z_dot(t) - z_dot(0)
                                     + omega^2 integral (z(0) - z) dt):

        a CoM that falls at the touchdown has gained on it, one that has been
        low for long has lost, as a lower pendulum diverges faster.

        Args:
            com: CoM (2,) in W [m].
            icp: ICP (2,) in W [m].
            ecmp: eCMP (2,) in W [m].
            above: height of the CoM over the support sole [m].

        Returns:
            Downward acceleration [m/s^2].
        """
        away, params = icp - ecmp, self.params
        far = math.hypot(*away)
        if (
            above <= params.min_height_ratio * self.model.com_height
            or far <= params.sink_distance
            or away @ (com - ecmp) <= 0.0
        ):
            return 0.0
        return (
            params.sink_gain
            * self.model.omega**2
            * (far - params.sink_distance)
        )
