"""The parameters of whole-body control."""

from dataclasses import dataclass, field

from nadia_balance.core.math.arrays import Array
from nadia_balance.parameters.bounds import bounded


@dataclass(kw_only=True)
class CrossingTurnParams:
    """Pelvis yaw when the feet come close, and cross."""

    # Lateral distance of the soles below which the pelvis turns.
    width: float = bounded(0.25, least=0.0, unit="m")
    # Turn per squared closeness and step length.
    gain: float = bounded(20.0, least=0.0, unit="rad/m^3")
    # Asymptotic bound of the turn.
    max_turn_deg: float = bounded(30.0, above=0.0, most=60.0, unit="deg")


@dataclass(kw_only=True)
class SlipParams:
    """Slip detection and the reaction to it."""

    # Sole speed of a slip, above noise and the motion of a tilting foot.
    speed: float = bounded(0.2, above=0.0, unit="m/s")
    # Time after touchdown in which sliding is no slip.
    settling_time: float = bounded(0.03, least=0.0, unit="s")
    # Lower bound of the estimate; slips at less friction are ignored.
    least_friction: float = bounded(0.3, above=0.0)
    # Rate at which the estimate returns, as the next ground may be better.
    recovery: float = bounded(0.05, least=0.0, unit="1/s")


@dataclass(kw_only=True)
class CollisionAvoidanceParams:
    """Avoidance of self-collisions.

    Links closer than `attention` are kept `clearance` apart, as a hard limit:
    their distance d decreases no faster than with the dynamics
    (d/dt + rate)^2 (d - clearance) = 0.
    """

    attention: float = bounded(0.08, above=0.0, unit="m")
    # Upper body links closer than this brake early, by a soft task: late
    # braking saturates the arm torques and disturbs the legs.
    arm_attention: float = bounded(0.4, above=0.0, unit="m")
    arm_weight: float = bounded(3.0, least=0.0)
    clearance: float = bounded(0.02, least=0.0, unit="m")
    rate: float = bounded(25.0, above=0.0, unit="1/s")

    def braking(self, distances: Array, rates: Array) -> Array:
        """Returns the least accelerations (k,) [m/s^2] of link distances.

        They solve (d/dt + rate)^2 (d - clearance) = 0 for the `distances` d
        (k,) [m] of links and their `rates` (k,) [m/s].
        """
        room = self.rate * (distances - self.clearance)
        return -self.rate * (2.0 * rates + room)


@dataclass(kw_only=True)
class WholeBodyQpParams:
    """Parameters of the whole-body QP.

    Weights multiply squared accelerations of the CoM [m/s^2], of bodies
    [rad/s^2], [m/s^2] and of joints [rad/s^2].  Forces and moments are per
    unit of the robot's mass, [m/s^2] and [m^2/s^2], so that the same weights
    suit robots of any mass.  Gains are kp [1/s^2].
    """

    # Soft tasks: direction of the force, vertical momentum / mass, angular
    # momentum about the CoM / mass, orientation of pelvis and torso.
    momentum_weight: float = bounded(1e3, least=0.0)
    height_weight: float = bounded(600.0, least=0.0)
    angular_momentum_weight: float = bounded(0.1, least=0.0, unit="1/m^2")
    angular_momentum_damping: float = bounded(5.0, least=0.0, unit="1/s")
    pelvis_weight: float = bounded(0.5, least=0.0, unit="m^2")
    torso_weight: float = bounded(0.5, least=0.0, unit="m^2")
    orientation_gain: float = bounded(80.0, least=0.0, unit="1/s^2")
    swing_position_weight: float = bounded(100.0, least=0.0)
    swing_height_weight: float = bounded(1e3, least=0.0)
    swing_position_gain: float = bounded(300.0, least=0.0, unit="1/s^2")
    swing_orientation_weight: float = bounded(10.0, least=0.0, unit="m^2")
    # Share of that weight until the last part of a swing, and that part.
    swing_early_share: float = bounded(0.1, above=0.0, most=1.0)
    swing_flat_time: float = bounded(0.15, above=0.0, unit="s")
    swing_orientation_gain: float = bounded(200.0, least=0.0, unit="1/s^2")
    # Posture of arms and spine: low, so that they assist balance, yet return.
    posture_weight: float = bounded(0.1, above=0.0, unit="m^2")
    # Posture of the legs, which resolves redundancy only: pelvis and feet
    # determine the leg joints.
    leg_posture_weight: float = bounded(1e-4, above=0.0, unit="m^2")
    posture_gain: float = bounded(80.0, least=0.0, unit="1/s^2")
    # Damping ratio of the above tasks: kd = 2 ratio sqrt(kp).
    damping_ratio: float = bounded(1.0, least=0.0)
    # Largest tilt of torso and pelvis, and the horizon within which they stop
    # there.  Below it the trunk is free to help: its weight is low.
    max_trunk_tilt_deg: float = bounded(
        29.0, above=0.0, most=180.0, unit="deg", of=""
    )
    trunk_tilt_horizon: float = bounded(0.15, above=0.0, unit="s")
    # Regularisation of sole moments, horizontal and normal forces / mass: the
    # load is shared with small moments; the normal weight biases the height.
    moment_weight: float = bounded(1e-2, above=0.0, unit="1/m^2")
    tangential_weight: float = bounded(1e-3, above=0.0)
    normal_weight: float = bounded(1e-6, above=0.0)
    # All generalized accelerations, which makes the QP strictly convex.
    acceleration_weight: float = bounded(1e-4, above=0.0, unit="m^2")
    # Soles in contact: damping of the sole's velocity, and gain of its tilt.
    stance_damping: float = bounded(30.0, least=0.0, unit="1/s")
    stance_tilt_gain: float = bounded(100.0, least=0.0, unit="1/s^2")
    # Step length above which the trailing foot may roll over toes or heel.
    rolling_step: float = bounded(0.6, least=0.0, finite=False, unit="m")
    friction: float = bounded(0.6, above=0.0)  # of the pyramid, mu
    slip: SlipParams = bounded(SlipParams)
    # Margin of the CoP to the sole's edge.
    sole_margin: float = bounded(0.005, least=0.0, unit="m", of="sole_width")
    # Lower bound on the normal force of a foot in contact.
    min_normal_force: float = bounded(2.0, least=0.0, unit="N")
    # Last share of a transfer in which the trailing foot is unloaded, and the
    # force bound at its end.
    unloading_fraction: float = bounded(0.2, least=0.0, most=1.0)
    unloaded_force: float = bounded(50.0, least=0.0, unit="N")
    # Velocity at which a landed sole that measures no force sinks.
    sinking_velocity: float = bounded(0.3, least=0.0, unit="m/s")
    # Time of contact in which the force bound of a landed foot rises to the
    # weight: full load while it bounces causes impacts.
    loading_time: float = bounded(0.01, least=0.0, unit="s")
    # Joint limits [rad] by name, tighter than those of the URDF.
    joint_lower_limits: dict[str, float] = field(default_factory=dict)
    joint_upper_limits: dict[str, float] = field(default_factory=dict)
    # Horizons of the joint position and speed limits, and the acceleration to
    # which they are clipped.
    joint_limit_horizon: float = bounded(0.1, above=0.0, unit="s")
    speed_limit_horizon: float = bounded(0.02, above=0.0, unit="s")
    max_joint_acceleration: float = bounded(500.0, above=0.0, unit="rad/s^2")
    # Avoidance of self-collisions; null: none.
    avoidance: CollisionAvoidanceParams | None = bounded(
        CollisionAvoidanceParams
    )
    # Damping of the joints while the QP has no solution.
    failure_damping: float = bounded(30.0, least=0.0, unit="1/s")
    # Share of the speed limits; the reserve is for what the model misses.
    max_speed_ratio: float = bounded(0.95, above=0.0, most=1.0)
    crossing_turn: CrossingTurnParams = bounded(CrossingTurnParams)

    def validate_more(self) -> None:
        """Raises ValueError if the unloaded force is below the minimum."""
        if not self.unloaded_force > self.min_normal_force:
            raise ValueError(
                f"unloaded_force = {self.unloaded_force}: must be > "
                f"min_normal_force = {self.min_normal_force} N"
            )
