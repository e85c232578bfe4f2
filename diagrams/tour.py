"""The tour of the G1 league, with our controller.

The task of teleop-walking-benchmark (September 2026), whose random streams are
those of the wheel `gaitkeeper`: its run n is run n here.  Waypoints of 5 s
each; the arms belong to somebody else, who holds or moves them; every 5 s a
punch at a random link.  A crane holds the robot before; it has fallen when its
pelvis is below 0.2 m.
"""

import importlib
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.plan.footstep_plan import velocity_limits
from nadia_balance.core.plan.waypoints import Waypoint
from nadia_balance.core.walking.push import Push
from nadia_balance.core.walking.state import FootPose
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.diagrams.simulation import advance, start
from nadia_balance.parameters.bounds import require
from nadia_balance.results.measurements import positive_power
from nadia_balance.robot.model import RobotModel, load_robot
from nadia_balance.robot.plants import actuated_velocities, actuators
from nadia_balance.systems.given_joints import GivenJoints, GivenMotion
from nadia_balance.systems.signals import read
from nadia_balance.systems.waypoints import WaypointFollower

WHEEL = "gaitkeeper"
# The holding servo of the benchmark: kp = I w^2, kd = 2 ratio I w, with the
# reflected inertia I of the motor.
SERVO_SPEED = 2.0 * math.pi * 10.0  # w [rad/s]
SERVO_RATIO = 2.0
SAGS = 200  # of the links in the crane, until they rest
SCORED = 0.02  # period of the score, as in the benchmark [s]
# Boxes of Unitree's rubber hands, in the frame of the last link of the arm: of
# the mesh itself, as the benchmark takes it.  For the left hand; mirrored in y.
HAND_BOX = np.array([[0.0, -0.04791, -0.04303], [0.13183, 0.01865, 0.06345]])
HEAD_BOTTOM = 0.28080  # of its mesh, above the frame of the torso [m]
HANDS = "left_wrist_yaw_link", "right_wrist_yaw_link"


class Stage(NamedTuple):
    """What the tour adds to the waypoints.

    Args:
        arms_move: at random; or else they are held.
        is_punched: the robot is punched, too.
    """

    arms_move: bool
    is_punched: bool


STAGES = {
    "held": Stage(arms_move=False, is_punched=False),
    "walked": Stage(arms_move=True, is_punched=False),
    "punched": Stage(arms_move=True, is_punched=True),
}


def wheel() -> Any:
    """The module that draws the tour.

    Returns:
        gaitkeeper.tour.

    Raises:
        ValueError: it is not installed.
    """
    try:
        return importlib.import_module(f"{WHEEL}.tour")
    except ModuleNotFoundError as error:
        raise ValueError(
            f"tour: must have the packages of its extra, {error.name} is "
            "missing: pip install nadia_balance[tour]"
        ) from None


def tour_scenario(scenario: Scenario, stage: str, seed: int) -> Scenario:
    """The scenario of a run.

    Args:
        scenario: a robot that stands.
        stage: one of STAGES.
        seed: the number of the run.

    Returns:
        Another scenario, with the arms given and with the punches.

    Raises:
        ValueError: the robot has not the joints of the G1, there is no such
            stage, or the scenario has pushes or commands.
    """
    require(
        stage in STAGES,
        f"stage = {stage!r}: must be one of {', '.join(STAGES)}",
    )
    for name, value in (
        ("pushes", scenario.pushes),
        ("commands", scenario.commands),
    ):
        require(not value, f"{name} = {value}: must be absent, it is drawn")
    drawn = wheel()
    robot = load_robot(scenario.robot, scenario.fidelity)
    require(
        robot.drives is not None,
        f"fidelity = {scenario.fidelity!r}: must be realistic, as the arms "
        "have drives",
    )
    plant = robot.control_plant()
    for name in drawn.BENCH_MOTORS:
        require(
            plant.HasJointNamed(name),
            f"robot = {scenario.robot!r}: must have the joint {name}",
        )
    punches = STAGES[stage].is_punched
    return scenario.changed(
        seed=seed,
        duration=drawn.BENCH_WAYPOINTS * drawn.BENCH_POINT_S,
        pushes=punches_of(seed, plant) if punches else [],
        controller=replace(
            scenario.controller,
            whole_body=replace(
                scenario.controller.whole_body,
                given_joints=list(drawn.BENCH_ARMS),
            ),
        ),
    )


def punches_of(seed: int, plant: MultibodyPlant) -> list[Push]:
    """The punches of a run: at the joint of a random link, in its frame.

    Args:
        seed: the number of the run.
        plant: that of the robot.

    Returns:
        One for each waypoint.
    """
    drawn = wheel()
    links = [
        (
            joint.child_body().name(),
            joint.parent_body().name(),
            joint.frame_on_child().GetFixedPoseInBodyFrame().translation(),
        )
        for joint in map(plant.GetJointByName, drawn.BENCH_MOTORS)
    ]
    punches = []
    for punch in drawn.bench_punches(seed, links):
        x, y, z = punch.vector
        punches.append(
            Push(
                body=punch.body,
                point=list(punch.point),
                force=math.hypot(x, y, z),
                direction_deg=math.degrees(math.atan2(y, x)),
                elevation_deg=math.degrees(math.atan2(z, math.hypot(x, y))),
                frame=punch.frame,
                duration=punch.duration,
                at=f"{punch.t:.3f} s",
            )
        )
    return punches


def servo(robot: RobotModel) -> dict[str, tuple[float, float]]:
    """The gains of the benchmark's servo.

    Args:
        robot: whose motors have reflected inertias.

    Returns:
        Stiffness [N m/rad] and damping [N m s/rad] by joint.
    """
    inertias = {
        actuator.joint().name(): actuator.default_reflected_inertia()
        for actuator in actuators(robot.control_plant())
    }
    damping = 2.0 * SERVO_RATIO * SERVO_SPEED
    return {
        name: (inertia * SERVO_SPEED**2, inertia * damping)
        for name, inertia in inertias.items()
    }


def arm_motions(
    robot: RobotModel, seed: int, arms_move: bool
) -> dict[str, GivenMotion]:
    """What the arms are told.

    Args:
        robot: whose arms they are.
        seed: the number of the run.
        arms_move: at random; or else they hold still.

    Returns:
        The motions, by joint.
    """
    drawn, plant, gains = wheel(), robot.control_plant(), servo(robot)
    stance = dict(zip(drawn.BENCH_MOTORS, drawn.BENCH_STANCE, strict=True))
    paths = {name: [(0.0, stance[name])] for name in drawn.BENCH_ARMS}
    if arms_move:
        limits = {
            joint.name(): (
                joint.position_lower_limits()[0],
                joint.position_upper_limits()[0],
            )
            for joint in map(plant.GetJointByName, drawn.BENCH_ARMS)
        }
        paths = drawn.bench_arm_walk(
            seed,
            drawn.BENCH_WAYPOINTS * drawn.BENCH_POINT_S,
            limits,
            hands_clear(robot, stance),
        )
    return {
        name: GivenMotion._make((*np.array(path).T, *gains[name]))
        for name, path in paths.items()
    }


def hands_clear(
    robot: RobotModel, stance: Mapping[str, float]
) -> Callable[[Array], bool]:
    """The benchmark's check of a drawn pose of the arms.

    No hand may be farther back than in the stance, nor above the bottom of the
    head, seen from the torso.

    Args:
        robot: whose arms they are.
        stance: positions by joint [rad].

    Returns:
        Whether the pose (7,) of the left arm, which the right one mirrors, is
        taken.
    """
    drawn, plant = wheel(), robot.control_plant()
    context = plant.CreateDefaultContext()
    torso = plant.GetBodyByName(robot.torso_body).body_frame()
    corners = np.stack(np.meshgrid(*HAND_BOX.T), axis=-1).reshape(-1, 3)
    mirror = np.array([1.0, -1.0, 1.0])
    q: Any = plant.GetPositions(context).copy()
    columns = [
        plant.GetJointByName(name).position_start() for name in drawn.BENCH_ARMS
    ]
    hands = [
        (plant.GetFrameByName(HANDS[0]), corners),
        (plant.GetFrameByName(HANDS[1]), corners * mirror),
    ]

    def reach(left: Array) -> tuple[float, float]:
        right = np.multiply(drawn.BENCH_ARM_MIRROR, left)
        q[columns] = np.concatenate((left, right))
        plant.SetPositions(context, q)
        points = np.concatenate(
            [
                plant.CalcRelativeTransform(context, torso, hand) @ box.T
                for hand, box in hands
            ],
            axis=1,
        )
        return points[0].min(), points[2].max()

    front, _ = reach(np.array([stance[name] for name in drawn.BENCH_ARM_LEFT]))

    def takes(left: Array) -> bool:
        back, top = reach(left)
        return back >= front and top <= HEAD_BOTTOM

    return takes


def hung(robot: RobotModel, base: Array) -> tuple[Array, Array]:
    """Where the joints hang at rest in the crane: kp (q_d - q) = -tau_g(q).

    The base is held level; servos hold the benchmark's stance, in which the
    links sag.  The sag is the fixed point of q = q_d + tau_g(q) / kp, to which
    each of SAGS comes closer.

    Args:
        robot: that hangs.
        base: its quaternion and place (7,) in W [-], [m].

    Returns:
        Positions (nq,), and torques (nu,) [N m].
    """
    drawn, plant, gains = wheel(), robot.control_plant(), servo(robot)
    context = plant.CreateDefaultContext()
    n = plant.num_velocities() - 6
    pose, kp = np.zeros(n), np.zeros(n)
    for name, angle in zip(drawn.BENCH_MOTORS, drawn.BENCH_STANCE, strict=True):
        i = plant.GetJointByName(name).velocity_start() - 6
        pose[i], (kp[i], _) = angle, gains[name]
    lower = plant.GetPositionLowerLimits()[7:]
    upper = plant.GetPositionUpperLimits()[7:]
    q: Any = np.concatenate((base, pose))
    for _ in range(SAGS):
        plant.SetPositions(context, q)
        tau_g = plant.CalcGravityGeneralizedForces(context)[6:]
        q[7:] = np.clip(pose + tau_g / kp, lower, upper)
    torques = kp * (pose - q[7:])
    return q, torques[actuated_velocities(plant) - 6]


class TourDiagram(HumanoidDiagram):
    """Closes the loop of a run of the tour."""

    def __init__(self, scenario: Scenario, stage: str, seed: int):
        """Builds the diagram.

        Args:
            scenario: a robot that stands.
            stage: one of STAGES.
            seed: the number of the run.

        Raises:
            ValueError: as tour_scenario.
        """
        scenario = tour_scenario(scenario, stage, seed)
        robot = load_robot(scenario.robot, scenario.fidelity)
        drawn, place = wheel(), scenario.place.pose
        standing = robot.standing_positions(scenario.gait.step_width, place)
        anchor = FootPose(standing[4:7], place.yaw)
        goals = [
            anchor.displaced(x, y, yaw)
            for x, y, yaw in drawn.bench_waypoints(seed)
        ]
        waypoints = [
            Waypoint(
                time=i * drawn.BENCH_POINT_S,
                x=goal.p_WF[0],
                y=goal.p_WF[1],
                yaw=goal.yaw,
            )
            for i, goal in enumerate(goals)
        ]
        limits = velocity_limits(
            scenario.controller.footstep_planner, robot.point_mass
        )
        arms = arm_motions(robot, seed, STAGES[stage].arms_move)
        super().__init__(
            scenario,
            sources={
                "velocity_command": WaypointFollower(waypoints, robot, limits),
                "joint_command": GivenJoints(arms, robot.control_plant()),
            },
        )
        self._fallen_below = drawn.BENCH_FALL_PELVIS_Z

    def set_initial_state(self, context: Context) -> None:
        """Lets the crane go.

        Args:
            context: that of this diagram, which is changed.
        """
        super().set_initial_state(context)
        base = self._standing[:7].copy()
        base[6] = wheel().BENCH_CRANE_HEIGHT_M
        q, torques = hung(self.robot, base)
        self.engine.SetPositions(
            self.engine.GetMyMutableContextFromRoot(context), q
        )
        drives: Any = self._drives
        drives.GetMyMutableContextFromRoot(context).SetDiscreteState(0, torques)

    def pelvis(self, context: Context) -> Array:
        """Returns the pose of the pelvis.

        Args:
            context: that of this diagram.

        Returns:
            Its place and quaternion (7,) in W [m], as MuJoCo orders them.
        """
        state = read(self.engine.GetOutputPort("state"), context)
        return np.concatenate((state[4:7], state[:4]))

    def fall_reason(self, context: Context) -> str:
        """Returns the criterion of the benchmark by which it has fallen.

        Args:
            context: that of this diagram.

        Returns:
            A few words; empty if it has not fallen.
        """
        low = self.pelvis(context)[2] < self._fallen_below
        return "pelvis too low" if low else ""


class Score:
    """Scores a run, as the benchmark does, while it is simulated.

    Attributes:
        tour: the benchmark's own score.
        upright_until: when the robot has fallen by our criterion [s].
        reason: a few words on that.
    """

    def __init__(self, diagram: TourDiagram, seed: int):
        """Begins at the start.

        Args:
            diagram: what is simulated.
            seed: the number of the run.
        """
        drawn = wheel()
        self._diagram, self._next = diagram, 0.0
        self.tour = drawn.WaypointTour(list(drawn.bench_waypoints(seed)))
        self.upright_until: float | None = None
        self.reason = ""

    def __call__(self, context: Context) -> bool:
        """Looks once in SCORED; False, as only the end of a run decides."""
        now = context.get_time()
        if now < self._next:
            return False
        self._next = now + SCORED - 1e-6
        self.tour(now, self._diagram.pelvis(context))
        if self.upright_until is None:
            self.reason = HumanoidDiagram.fall_reason(self._diagram, context)
            if self.reason:
                self.upright_until = now
        return False


def run_tour(scenario: Scenario, stage: str, seed: int) -> dict[str, Any]:
    """Simulates a run of the tour.

    Args:
        scenario: a robot that stands.
        stage: one of STAGES.
        seed: the number of the run.

    Returns:
        Its outcome and its score: `survival_s` as the benchmark judges,
        `upright_s` until the robot has fallen by our own criterion, with its
        `reason`; the errors are means over the finished waypoints.

    Raises:
        ValueError: as tour_scenario.
        RuntimeError: it was interrupted.
    """
    diagram = TourDiagram(scenario, stage, seed)
    score = Score(diagram, seed)
    run = advance(start(diagram), diagram.scenario.duration, until=score)
    if run.interrupted:
        raise RuntimeError(f"{stage}, seed {seed}: interrupted")
    outcome = "error" if run.error else "complete"
    fell_at = run.simulated_time if run.error else run.fell_at
    if run.fell_at is not None:
        outcome = "fell"
    report = score.tour.report(fell_at)
    errors = {
        "position_error_cm": report["pos_err_cm"],
        "yaw_error_deg": report["yaw_err_deg"],
    }
    return {
        "outcome": outcome,
        "survival_s": run.simulated_time,
        "upright_s": (
            run.simulated_time
            if score.upright_until is None
            else score.upright_until
        ),
        "reason": run.error or score.reason,
        "waypoints": report["targets"],
        **(errors if report["targets"] else dict.fromkeys(errors)),
        "power_w": float(positive_power(run.logs).mean()),
    }
