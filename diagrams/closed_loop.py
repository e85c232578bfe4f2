"""Base of the closed diagrams: what they log, draw and export.

Drake publishes at t before the updates of t, so row t of the log contains the
state, the references and the torques of t, all from the same x-.  The updates
reuse the outputs that the log has evaluated from the cache.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import (
    Context,
    Diagram,
    DiagramBuilder,
    OutputPort,
    System,
)
from pydrake.systems.primitives import (
    LogVectorOutput,
    Multiplexer,
    VectorLog,
    VectorLogSink,
)

from nadia_balance.core.body.reachability import step_regions
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.plan.footstep_plan import velocity_limits, within_limits
from nadia_balance.core.walking.state import FootPose, FootPoses
from nadia_balance.diagrams.region_log import add_region_log, region_rows
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.parameters.bounds import check, check_type, require
from nadia_balance.robot.model import RobotModel, load_robot
from nadia_balance.systems.plan import VelocityCommands
from nadia_balance.systems.push_source import PushSource
from nadia_balance.systems.signals import ComState, read
from nadia_balance.systems.wiring import connect
from nadia_balance.view.balance_visualizer import BalanceVisualizer
from nadia_balance.view.scene import CONTROLS

# Signals that are logged, drawn and exported, of those that there are.
LOGGED = (
    "com_state",
    "icp",
    "icp_reference",
    "ecmp_command",
    "momentum_rate",
    "momentum_qp_status",
    "whole_body_qp_status",
    "foot_wrenches",
    "swing_foot_reference",
    "walking_signal",
    "no_foothold",
    "actuation",
    "push_signal",
    "foot_forces",
    "state",
)
DRAWN = (
    "walking_state",
    "com_state",
    "icp",
    "icp_reference",
    "ecmp_command",
    "capture_regions",
    "push_force",
)
EXPORTED = ("walking_state", "icp", "icp_reference", "swing_foot_reference")
COMMAND = "velocity_command"
# Inputs of a controller that a diagram connects itself.
WIRED = (
    "estimated_state",
    "foot_poses",
    "foot_forces",
    "icp",
    "com_state",
    "mechanisms",
)
Logs = dict[str, np.ndarray[Any, Any]]


class ClosedLoop(Diagram):
    """A Diagram that can be simulated here.

    Each `context` is that of the whole diagram.  RecoveryWatch requires output
    ports walking_state, icp and icp_reference, sweeps swing_foot_reference.
    """

    PLANT = "humanoid"  # or lipm
    push: PushSource  # one of its systems
    controller: System  # one of its systems
    timing: OutputPort  # the walking_state by which pushes are timed
    replaced: Sequence[str] = ()  # the user's blocks, role=Class

    def __init__(self, scenario: Scenario):
        """Loads the robot and the true ground.

        Args:
            scenario: what is simulated.

        Raises:
            ValueError: the scenario is none, or not valid.
        """
        super().__init__()
        check_type("scenario", scenario, Scenario)
        check(scenario)
        for name in "random_delta_v", "random_commands":
            value = getattr(scenario, name)
            require(
                value == 0.0,
                f"{name} = {value}: must be drawn by load_scenario",
            )
        self.scenario = scenario
        self.robot: RobotModel = load_robot(scenario.robot, scenario.fidelity)
        self._regions: VectorLogSink | None = None
        # The true one; None: flat.
        self._ground = scenario.terrain.ground(
            self.robot.sole, self.robot.params.size
        )

    @property
    def velocity_limits(self) -> np.ndarray[Any, Any]:
        """Least and most of a velocity command, (2, 3): [m/s], [rad/s].

        Those of the controller, if it has any; by default the planner's.
        """
        limits = getattr(self.controller, "velocity_limits", None)
        if limits is None:
            planner = self.scenario.controller.footstep_planner
            limits = velocity_limits(planner, self.robot.point_mass)
        return np.asarray(limits)

    def remarks(self) -> list[str]:
        """Returns what a user should know of the robot, and of its commands.

        Returns:
            A line for each.
        """
        remarks = list(self.robot.remarks)
        if not self.controller.HasOutputPort("footsteps"):
            return remarks  # a policy takes every command
        remarks += self._late_steps()
        for i, row in enumerate(self.scenario.commands):
            asked = np.array([row.forward, row.left, row.turn])
            taken = within_limits(asked, self.velocity_limits)
            if not np.array_equal(taken, asked):
                remarks.append(
                    f"commands[{i}] = {asked.round(3).tolist()}: is more than "
                    f"it can walk, {taken.round(3).tolist()} is taken"
                )
        return remarks

    def _late_steps(self) -> list[str]:
        """Says which planned step is the first that the legs cannot make."""
        model, limits = self.robot.point_mass, self.robot.foot_limits
        schedule = self.scenario.start(model).schedule
        feet = schedule.feet
        for i, step in enumerate(schedule.footsteps, 1):
            start, goal = feet[step.side].p_WF[:2], step.pose.p_WF[:2]
            needed = model.detour.time_of_way(
                start=start,
                goal=goal,
                stance=feet[step.side.other],
                swing=step.side,
            )
            if needed > step.swing_duration:
                return [
                    f"step {i}: its foot needs {needed:.2f} s for "
                    f"{math.dist(start, goal):.2f} m, the swing takes "
                    f"{step.swing_duration:.2f} s; the legs' joints leave it "
                    f"{limits.speed} m/s ({limits.slowest}) and "
                    f"{limits.acceleration} m/s^2 ({limits.weakest})"
                ]
            feet = feet.with_foot(step.side, step.pose)
        return []

    def com(self, context: Context) -> Array:
        """Returns the centre of mass.

        Args:
            context: that of this diagram.

        Returns:
            Its place (3,) in W [m].
        """
        com = ComState(read(self.signals["com_state"], context))
        return np.asarray(com.position)

    def feet(self, context: Context) -> FootPoses:
        """Returns where the feet stand.

        Args:
            context: that of this diagram.

        Returns:
            The soles in W; of a foot in the air, its last pose on the ground.
        """
        feet: FootPoses = read(self.timing, context).schedule.feet
        return feet

    def _connect_sources(
        self,
        builder: DiagramBuilder,
        controller: System,
        sources: Mapping[str, System],
    ) -> dict[str, OutputPort]:
        """Connects the sources of the controller's inputs, by their names.

        Their own inputs are the controller's outputs of the same names.
        Returns the port of the velocity command, to log it, if there is one.

        Raises ValueError: no such input or output.
        """
        sources = dict(sources)
        self._has_source = COMMAND in sources  # of the user's
        if controller.HasInputPort(COMMAND) and COMMAND not in sources:
            sources[COMMAND] = self._commands(builder)
        for name, source in sources.items():
            check_type(f"sources[{name!r}]", source, System)
            named = f"sources[{name!r}] = {type(source).__name__}"
            require(
                name not in WIRED and controller.HasInputPort(name),
                f"{named}: must be of an open input: velocity_command, or "
                "one that a missing block leaves",
            )
            require(
                source.HasOutputPort(name),
                f"{named}: must have an output {name!r}",
            )
            if source.get_name() in ("", "_"):
                source.set_name(f"{name}_source")
            if not builder.HasSubsystemNamed(source.get_name()):
                builder.AddSystem(source)
            connect(builder, source, controller, name)
            for i in range(source.num_input_ports()):
                port = source.get_input_port(i).get_name()
                if controller.HasOutputPort(port):
                    connect(builder, controller, source, port)
        if COMMAND not in sources:
            return {}
        return {COMMAND: sources[COMMAND].GetOutputPort(COMMAND)}

    def _commands(self, builder: DiagramBuilder) -> System:
        """The source of the velocity command, by default.

        That is the user, if there is a Meshcat and the scenario has no commands
        of its own.
        """
        commands = self.scenario.commands
        if not commands and builder.HasSubsystemNamed(CONTROLS):
            return builder.GetSubsystemByName(CONTROLS)
        return VelocityCommands(
            [(row.time, row.forward, row.left, row.turn) for row in commands]
        )

    def _finish(
        self,
        builder: DiagramBuilder,
        meshcat: Meshcat | None,
        period: float,
        systems: Sequence[System],
        **ports: OutputPort,
    ) -> None:
        """Draws, logs and exports the signals of `systems`; builds the diagram.

        Where several have a signal, it is that of the first.  `ports` are
        logged, too, every `period` [s].
        """
        self.signals: dict[str, OutputPort] = {
            name: system.GetOutputPort(name)
            for system in reversed(systems)
            for name in (*LOGGED, *DRAWN, *EXPORTED)
            if system.HasOutputPort(name)
        }
        if meshcat is not None and "walking_state" in self.signals:
            view = builder.AddNamedSystem(
                "balance_visualizer",
                BalanceVisualizer(meshcat, self.robot.sole, self._ground),
            )
            for name in filter(self.signals.get, DRAWN):
                builder.Connect(self.signals[name], view.GetInputPort(name))
            if "capture_regions" in self.signals:
                self._regions = add_region_log(
                    builder, self.signals["capture_regions"]
                )
        logged = {
            name: self.signals[name] for name in LOGGED if name in self.signals
        } | ports
        self._sizes = {name: port.size() for name, port in logged.items()}
        multiplexer = builder.AddNamedSystem(
            "log_multiplexer", Multiplexer(list(self._sizes.values()))
        )
        for i, port in enumerate(logged.values()):
            builder.Connect(port, multiplexer.get_input_port(i))
        self._log = LogVectorOutput(
            multiplexer.get_output_port(), builder, publish_period=period
        )
        self._log.set_name("log")
        for name in filter(self.signals.get, EXPORTED):
            builder.ExportOutput(self.signals[name], name)
        builder.BuildInto(self)

    def set_initial_state(self, context: Context) -> None:
        """Sets the robot's initial state.

        Args:
            context: that of this diagram, which is changed.
        """

    def fall_reason(self, context: Context) -> str:
        """Returns the criterion by which the robot has fallen.

        Args:
            context: that of this diagram.

        Returns:
            A few words; empty if it has not fallen.
        """
        return ""

    def nees(self, context: Context) -> float:
        """Returns the NEES e' P^-1 e [-] of the estimate.

        Args:
            context: that of this diagram.

        Returns:
            The normalised error; 0 with perfect sensors.
        """
        return 0.0

    def improper_contacts(self, context: Context) -> set[str]:
        """Returns all contacts except those of a foot and the ground.

        Args:
            context: that of this diagram.

        Returns:
            The names of what touches.
        """
        return set()

    def passed_limit(self, context: Context) -> bool:
        """Returns whether a limit is exceeded that a recovery must not exceed.

        Args:
            context: that of this diagram.

        Returns:
            True if a joint is too fast, or the torso leans too far.
        """
        return False

    def fastest_joint(self, context: Context) -> tuple[str, float]:
        """Returns the joint closest to its speed limit.

        Args:
            context: that of this diagram.

        Returns:
            Its name, and its speed per limit [-].
        """
        return "", 0.0

    def read_logs(self, context: Context) -> Logs:
        """Returns all logged signals, and `t` [s] (see results.log).

        Args:
            context: that of this diagram.

        Returns:
            The arrays of a log, by name.
        """
        t, data = sampled(self._log.FindLog(context))
        ends = np.cumsum(list(self._sizes.values()))[:-1]
        # Regions of all footholds: legs may be let cross during a run.
        regions = step_regions(self.robot.point_mass.reach, cross_over=True)
        logs: Logs = {
            "t": t,
            **dict(zip(self._sizes, np.split(data, ends, axis=1), strict=True)),
            **{f"region_{name}": region for name, region in regions.items()},
            "sole": self.robot.sole,
        }
        if self._has_source and self.controller.HasOutputPort("footsteps"):
            logs["velocity_limits"] = self.velocity_limits
        if self._regions is not None:
            times, rows = sampled(self._regions.FindLog(context))
            logs["capture_regions"] = region_rows(times, rows)
        if self._ground is not None:
            logs["ground"] = np.concatenate(
                [
                    np.insert(region.polygon, 0, i, axis=1)
                    for i, region in enumerate(self._ground.regions)
                    if not region.obstacle
                ]
            )
        return logs

    def forget_logs(self, context: Context) -> None:
        """Clears the log, which otherwise grows without bound.

        Args:
            context: that of this diagram, which is changed.
        """
        self._log.FindMutableLog(context).Clear()
        if self._regions is not None:
            self._regions.FindMutableLog(context).Clear()


def block_labels(blocks: Mapping[str, object]) -> list[str]:
    """Says which blocks are the user's.

    Args:
        blocks: by role; None leaves one out.

    Returns:
        Texts role=Class.
    """
    return [
        f"{role}={type(block).__name__ if block else None}"
        for role, block in blocks.items()
    ]


def sampled(log: VectorLog) -> tuple[Array, Array]:
    """Returns what Drake has logged, each time once.

    A simulation from a cloned Context logs its first row a second time.

    Args:
        log: of a vector of m entries.

    Returns:
        Times (n,) [s], and values (n, m).
    """
    t: Array = np.array(log.sample_times())
    data: Array = np.asarray(log.data()).T
    is_last = np.diff(t, append=np.inf) > 0.0
    return (t, data) if np.all(is_last) else (t[is_last], data[is_last])


class MeasuredPoses:
    """Forward kinematics of one robot, from its [q, v]."""

    def __init__(self, robot: RobotModel):
        """Makes a plant of its own.

        Args:
            robot: the robot.
        """
        self._plant = robot.control_plant()
        self._context = self._plant.CreateDefaultContext()
        self._soles = [
            (self._plant.GetBodyByName(name), robot.X_FootSole[side])
            for side, name in robot.foot_bodies.items()
        ]
        self._trunk = [
            self._plant.GetBodyByName(robot.torso_body),
            self._plant.GetBodyByName(robot.pelvis_body),
        ]

    def com(self, state: np.ndarray[Any, Any]) -> Array:
        """Returns the centre of mass.

        Args:
            state: [q, v], (nq + nv,).

        Returns:
            Its place (3,) in W [m].
        """
        self._plant.SetPositionsAndVelocities(self._context, state)
        return np.asarray(
            self._plant.CalcCenterOfMassPositionInWorld(self._context)
        )

    def feet(self, state: np.ndarray[Any, Any]) -> FootPoses:
        """Returns the soles.

        Args:
            state: [q, v], (nq + nv,).

        Returns:
            Their poses in W, level.
        """
        left, right = self.along(state[None])["foot_poses"].reshape(2, 4)
        return FootPoses(
            FootPose(left[:3], float(left[3])),
            FootPose(right[:3], float(right[3])),
        )

    def along(self, states: np.ndarray[Any, Any]) -> Logs:
        """Returns the signals of soles and trunk.

        Args:
            states: [q, v] of each tick, (n, nq + nv).

        Returns:
            The signals `foot_poses` (n, 8) and `trunk_tilt` (n, 2).
        """
        feet = np.empty((len(states), 2, 4))
        tilts = np.empty((len(states), 2))
        for row, state in enumerate(states):
            tilts[row] = self.trunk_tilt(state)
            for foot, (body, X_FootSole) in enumerate(self._soles):
                X_WF = self._pose(body) @ X_FootSole
                feet[row, foot, :3] = X_WF.translation()
                feet[row, foot, 3] = RollPitchYaw(X_WF.rotation()).yaw_angle()
        return {"foot_poses": feet.reshape(-1, 8), "trunk_tilt": tilts}

    def trunk_tilt(self, state: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        """Returns the angles of torso and pelvis against the vertical.

        Args:
            state: [q, v], (nq + nv,).

        Returns:
            The tilts (2,) [rad].
        """
        self._plant.SetPositionsAndVelocities(self._context, state)
        # The z axis of W, in the body's frame.
        z = [self._pose(body).rotation().matrix()[2] for body in self._trunk]
        return np.array([np.arctan2(np.hypot(x, y), up) for x, y, up in z])

    def _pose(self, body: RigidBody) -> RigidTransform:
        return self._plant.EvalBodyPoseInWorld(self._context, body)
