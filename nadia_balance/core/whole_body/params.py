"""The parameters of whole-body control."""

from nadia_balance.core.math.arrays import Array
from nadia_balance.parameters.bounds import bounded, parameters, require


@parameters
class CrossingTurnParams:
    """Pelvis yaw when the feet come close, and cross."""

    width: float = bounded(
        0.25,
        doc="lateral distance of the soles below which the pelvis turns",
        least=0.0,
        unit="m",
    )
    gain: float = bounded(
        20.0,
        doc="turn per squared closeness and step length",
        least=0.0,
        unit="rad/m^3",
    )
    max_turn_deg: float = bounded(
        30.0,
        doc="asymptotic bound of the turn",
        above=0.0,
        most=60.0,
        unit="deg",
    )


@parameters
class SlipParams:
    """Slip detection and the reaction to it."""

    speed: float = bounded(
        0.2,
        doc="sole speed of a slip, above noise and the motion of a tilting "
        "foot",
        above=0.0,
        unit="m/s",
    )
    settling_time: float = bounded(
        0.03,
        doc="time after touchdown in which sliding is no slip",
        least=0.0,
        unit="s",
    )
    least_friction: float = bounded(
        0.3,
        doc="lower bound of the estimate; slips at less friction are ignored",
        above=0.0,
    )
    recovery: float = bounded(
        0.05,
        doc="rate at which the estimate returns, as the next ground may be "
        "better",
        least=0.0,
        unit="1/s",
    )


@parameters
class CollisionAvoidanceParams:
    """Avoidance of self-collisions.

    Links closer than `attention` are kept `clearance` apart, as a hard limit:
    their distance d decreases no faster than with the dynamics
    (d/dt + rate)^2 (d - clearance) = 0.
    """

    attention: float = bounded(
        0.08,
        doc="distance of links below which they are kept apart",
        above=0.0,
        unit="m",
    )
    arm_attention: float = bounded(
        0.4,
        doc="upper body links closer than this brake early, by a soft task: "
        "late braking saturates the arm torques and disturbs the legs",
        above=0.0,
        unit="m",
    )
    arm_weight: float = bounded(
        3.0, doc="weight of the early braking", least=0.0
    )
    clearance: float = bounded(
        0.02, doc="least distance of links", least=0.0, unit="m"
    )
    rate: float = bounded(
        25.0, doc="pole of the distance dynamics", above=0.0, unit="1/s"
    )

    def braking(self, distances: Array, rates: Array) -> Array:
        """The least accelerations of link distances d.

        They solve (d/dt + rate)^2 (d - clearance) = 0.

        Args:
            distances: d (k,) [m].
            rates: their time derivatives (k,) [m/s].

        Returns:
            The accelerations (k,) [m/s^2].
        """
        return -self.rate * (
            2.0 * rates + self.rate * (distances - self.clearance)
        )


@parameters
class WholeBodyQpParams:
    """Parameters of the whole-body QP.

    Weights multiply squared accelerations of the CoM [m/s^2], of bodies
    [rad/s^2], [m/s^2] and of joints [rad/s^2].  Forces and moments are per
    unit of the robot's mass, [m/s^2] and [m^2/s^2], so that the same weights
    suit robots of any mass.  Gains are kp [1/s^2].
    """

    momentum_weight: float = bounded(
        1e3, doc="weight of the direction of the force", least=0.0
    )
    height_weight: float = bounded(
        600.0, doc="weight of the vertical momentum / mass", least=0.0
    )
    angular_momentum_weight: float = bounded(
        0.1,
        doc="weight of the angular momentum about the CoM / mass",
        least=0.0,
        unit="1/m^2",
    )
    angular_momentum_damping: float = bounded(
        5.0,
        doc="rate at which the angular momentum decays",
        least=0.0,
        unit="1/s",
    )
    pelvis_weight: float = bounded(
        0.5, doc="weight of the pelvis' orientation", least=0.0, unit="m^2"
    )
    torso_weight: float = bounded(
        0.5, doc="weight of the torso's orientation", least=0.0, unit="m^2"
    )
    orientation_gain: float = bounded(
        80.0, doc="kp of pelvis and torso", least=0.0, unit="1/s^2"
    )
    swing_position_weight: float = bounded(
        100.0, doc="weight of the swing ankle's horizontal position", least=0.0
    )
    swing_height_weight: float = bounded(
        1e3, doc="weight of the swing ankle's height", least=0.0
    )
    swing_position_gain: float = bounded(
        300.0, doc="kp of the swing ankle's position", least=0.0, unit="1/s^2"
    )
    swing_orientation_weight: float = bounded(
        40.0,
        doc="weight of the swing sole's orientation",
        least=0.0,
        unit="m^2",
    )
    swing_early_share: float = bounded(
        0.1,
        doc="share of swing_orientation_weight until the last part of a swing",
        above=0.0,
        most=1.0,
    )
    swing_flat_time: float = bounded(
        0.15,
        doc="last part of a swing, in which the early share rises to 1",
        above=0.0,
        unit="s",
    )
    swing_orientation_gain: float = bounded(
        200.0, doc="kp of the swing sole's orientation", least=0.0, unit="1/s^2"
    )
    posture_weight: float = bounded(
        0.1,
        doc="weight of the posture of arms and spine: low, so that they "
        "assist balance, yet return",
        above=0.0,
        unit="m^2",
    )
    leg_posture_weight: float = bounded(
        1e-4,
        doc="weight of the posture of the legs, which resolves redundancy "
        "only: pelvis and feet determine the leg joints",
        above=0.0,
        unit="m^2",
    )
    posture_gain: float = bounded(
        80.0, doc="kp of the posture", least=0.0, unit="1/s^2"
    )
    damping_ratio: float = bounded(
        1.0,
        doc="damping ratio of all PD laws: kd = 2 ratio sqrt(kp)",
        least=0.0,
    )
    max_trunk_tilt_deg: float = bounded(
        39.0,
        doc="largest tilt of torso and pelvis",
        above=0.0,
        most=180.0,
        unit="deg",
        of="",
    )
    trunk_tilt_margin_deg: float = bounded(
        10.0,
        doc="part of it that costs: below, the trunk is free to help, as its "
        "weight is low",
        least=0.0,
        most=180.0,
        unit="deg",
        of="",
    )
    trunk_tilt_horizon: float = bounded(
        0.15,
        doc="horizon within which the trunk stops at its largest tilt",
        above=0.0,
        unit="s",
    )
    moment_weight: float = bounded(
        1e-2,
        doc="regularisation of sole moments / mass: the load is shared with "
        "small moments",
        above=0.0,
        unit="1/m^2",
    )
    tangential_weight: float = bounded(
        1e-3, doc="regularisation of horizontal forces / mass", above=0.0
    )
    normal_weight: float = bounded(
        1e-6,
        doc="regularisation of normal forces / mass, which biases the height",
        above=0.0,
    )
    acceleration_weight: float = bounded(
        1e-4,
        doc="weight of all generalised accelerations, which makes the QP "
        "strictly convex",
        above=0.0,
        unit="m^2",
    )
    stance_damping: float = bounded(
        30.0,
        doc="damping of the velocity of soles in contact",
        least=0.0,
        unit="1/s",
    )
    stance_tilt_gain: float = bounded(
        100.0,
        doc="gain of the tilt of soles in contact",
        least=0.0,
        unit="1/s^2",
    )
    rolling_step: float = bounded(
        0.6,
        doc="step length above which the trailing foot may roll over toes or "
        "heel",
        least=0.0,
        finite=False,
        unit="m",
    )
    friction: float = bounded(
        0.6, doc="mu: coefficient of the friction pyramid", above=0.0
    )
    slip: SlipParams = bounded(
        SlipParams, doc="slip detection and the reaction to it"
    )
    sole_margin: float = bounded(
        0.005,
        doc="margin of the CoP to the sole's edge",
        least=0.0,
        unit="m",
        of="sole_width",
    )
    min_normal_force: float = bounded(
        2.0,
        doc="lower bound on the normal force of a foot in contact",
        least=0.0,
        unit="N",
    )
    unloading_fraction: float = bounded(
        0.2,
        doc="last share of a transfer in which the trailing foot is unloaded",
        least=0.0,
        most=1.0,
    )
    unloaded_force: float = bounded(
        50.0,
        doc="force bound of the trailing foot at lift-off",
        least=0.0,
        unit="N",
    )
    sinking_velocity: float = bounded(
        0.3,
        doc="velocity at which a landed sole that measures no force sinks",
        least=0.0,
        unit="m/s",
    )
    loading_time: float = bounded(
        0.01,
        doc="time of contact in which the force bound of a landed foot rises "
        "to the weight: full load while it bounces causes impacts",
        least=0.0,
        unit="s",
    )
    joint_lower_limits: dict[str, float] = bounded(
        dict,
        doc="lower limits by joint, in radians, tighter than those of the URDF",
    )
    joint_upper_limits: dict[str, float] = bounded(
        dict,
        doc="upper limits by joint, in radians, tighter than those of the URDF",
    )
    given_joints: list[str] = bounded(
        list,
        doc="joints that belong to somebody else: the QP expects them to move "
        "on at the speed that they have, at any torque",
    )
    joint_limit_horizon: float = bounded(
        0.07, doc="horizon of the joint position limits", above=0.0, unit="s"
    )
    knee_limit_horizon: float = bounded(
        0.13,
        doc="that of the knees: one that is nearly straight has to bend too "
        "fast when the leg lands",
        above=0.0,
        unit="s",
    )
    speed_limit_horizon: float = bounded(
        0.02, doc="horizon of the joint speed limits", above=0.0, unit="s"
    )
    max_joint_acceleration: float = bounded(
        500.0,
        doc="acceleration to which joint limits are clipped",
        above=0.0,
        unit="rad/s^2",
    )
    avoidance: CollisionAvoidanceParams | None = bounded(
        CollisionAvoidanceParams, doc="avoidance of self-collisions; null: none"
    )
    failure_damping: float = bounded(
        30.0,
        doc="damping of the joints while the QP has no solution",
        least=0.0,
        unit="1/s",
    )
    max_speed_ratio: float = bounded(
        0.95,
        doc="share of the speed limits; the reserve is for what the model "
        "misses",
        above=0.0,
        most=1.0,
    )
    crossing_turn: CrossingTurnParams = bounded(
        CrossingTurnParams, doc="pelvis yaw when the feet come close, and cross"
    )

    def validate_more(self) -> None:
        """Checks the unloaded force.

        Raises:
            ValueError: it is not above the least normal force.
        """
        require(
            self.unloaded_force > self.min_normal_force,
            f"unloaded_force = {self.unloaded_force}: must be > "
            f"min_normal_force = {self.min_normal_force} N",
        )
