"""Base of the closed diagrams: what they log, draw and export.

Drake publishes at t before the updates of t, so row t of the log contains the
state, the references and the torques of t, all from the same x-.  The updates
reuse the outputs that the log has evaluated from the cache.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems import framework
from pydrake.systems.primitives import LogVectorOutput, Multiplexer

from nadia_balance.core.body.reachability import step_regions
from nadia_balance.core.plan.footstep_plan import velocity_limits
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.robot.model import RobotModel, load_robot
from nadia_balance.systems.plan import VelocityCommands
from nadia_balance.systems.push_source import PushSource
from nadia_balance.systems.signals import connect
from nadia_balance.view.balance_visualizer import BalanceVisualizer
from nadia_balance.view.scene import CONTROLS

# Signals that are logged, drawn and exported, of those that there are.
LOGGED = """com_state icp icp_reference ecmp_command momentum_rate
    momentum_qp_status whole_body_qp_status foot_wrenches swing_foot_reference
    walking_signal actuation push_signal foot_forces state""".split()
DRAWN = """walking_state com_state icp icp_reference ecmp_command
    capture_regions push_force""".split()
COMMAND = "velocity_command"
# Inputs of a controller that a diagram connects itself.
WIRED = (
    "estimated_state foot_poses foot_forces icp com_state mechanisms".split()
)
EXPORTED = "walking_state icp icp_reference swing_foot_reference".split()


class ClosedLoop(framework.Diagram):
    """A Diagram that can be simulated here.

    Each `context` is that of the whole diagram.  RecoveryWatch requires output
    ports walking_state, icp and icp_reference, sweeps swing_foot_reference, a
    LiveSession the controller's port walking_signal.
    """

    PLANT = "humanoid"  # or lipm
    push: PushSource  # one of its systems
    controller: framework.System  # one of its systems

    def __init__(self, scenario: Scenario):
        """Loads the robot and the true ground (None: flat) of `scenario`."""
        super().__init__()
        self.scenario = scenario
        self.robot = robot = load_robot(scenario.robot, scenario.fidelity)
        self._ground = scenario.terrain.ground(robot.sole, robot.params.size)
        self.signals: dict[str, framework.OutputPort] = {}

    @property
    def velocity_limits(self) -> np.ndarray:
        """Least and most of a velocity command, (2, 3): [m/s], [rad/s]."""
        params = self.scenario.controller.footstep_planner
        return velocity_limits(params, self.robot.point_mass)

    def remarks(self) -> list[str]:
        """What a user should know of the robot, and of its commands."""
        told = list(self.robot.remarks)
        params = self.scenario.controller.footstep_planner
        least, most = velocity_limits(params, self.robot.point_mass)
        for i, row in enumerate(self.scenario.commands):
            wanted = np.array([row.forward, row.left, row.turn])
            if np.array_equal(can := np.clip(wanted, least, most), wanted):
                continue
            told.append(
                f"commands[{i}] = {wanted.round(3).tolist()}: is more than it "
                f"can walk, {can.round(3).tolist()} is taken"
            )
        return told

    def _connect_sources(
        self,
        builder: framework.DiagramBuilder,
        controller: framework.System,
        sources: Mapping[str, framework.System],
    ) -> dict[str, framework.OutputPort]:
        """Connects the sources of the controller's inputs, by their names.

        Their own inputs are the controller's outputs of the same names.
        Returns the port of the velocity command, to log it, if there is one.

        Raises ValueError: no such input or output.
        """
        sources = dict(sources)
        if controller.HasInputPort(COMMAND) and COMMAND not in sources:
            sources[COMMAND] = self._commands(builder)
        for name, source in sources.items():
            what = f"sources[{name!r}] = {type(source).__name__}: must"
            if name in WIRED or not controller.HasInputPort(name):
                free = "velocity_command, or one that a missing block leaves"
                raise ValueError(f"{what} be of an open input: {free}")
            if not source.HasOutputPort(name):
                raise ValueError(f"{what} have an output {name!r}")
            if source.get_name() in ("", "_"):
                source.set_name(f"{name}_source")
            if not builder.HasSubsystemNamed(source.get_name()):
                builder.AddSystem(source)
            connect(builder, source, controller, name)
            ports = map(source.get_input_port, range(source.num_input_ports()))
            for port in ports:
                if controller.HasOutputPort(port.get_name()):
                    connect(builder, controller, source, port.get_name())
        known = sources.get(COMMAND)
        return {COMMAND: known.GetOutputPort(COMMAND)} if known else {}

    def _commands(self, builder: framework.DiagramBuilder) -> framework.System:
        """The source of the velocity command, by default.

        That is the user, if there is a Meshcat and the scenario has no commands
        of its own.
        """
        commands = self.scenario.commands
        if not commands and builder.HasSubsystemNamed(CONTROLS):
            return builder.GetSubsystemByName(CONTROLS)
        rows = [(row.time, row.forward, row.left, row.turn) for row in commands]
        return VelocityCommands(rows)

    def _finish(
        self,
        builder: framework.DiagramBuilder,
        meshcat: Meshcat | None,
        period: float,
        systems: Sequence[framework.System],
        **ports: framework.OutputPort,
    ) -> None:
        """Draws, logs and exports the signals of `systems`; builds the diagram.

        Where several have a signal, it is that of the first.  `ports` are
        logged, too, every `period` [s].
        """
        of, names = self.signals, (*LOGGED, *DRAWN, *EXPORTED)
        for system in reversed(systems):
            known = filter(system.HasOutputPort, names)
            of.update({name: system.GetOutputPort(name) for name in known})
        if meshcat is not None and "walking_state" in of:
            view = BalanceVisualizer(meshcat, self.robot.sole, self._ground)
            builder.AddNamedSystem("balance_visualizer", view)
            for name in filter(of.get, DRAWN):
                builder.Connect(of[name], view.GetInputPort(name))
        logged = {name: of[name] for name in LOGGED if name in of} | ports
        self._sizes = {name: port.size() for name, port in logged.items()}
        multiplexer = Multiplexer(list(self._sizes.values()))
        builder.AddNamedSystem("log_multiplexer", multiplexer)
        for i, port in enumerate(logged.values()):
            builder.Connect(port, multiplexer.get_input_port(i))
        port = multiplexer.get_output_port()
        self._log = LogVectorOutput(port, builder, publish_period=period)
        self._log.set_name("log")
        for name in filter(of.get, EXPORTED):
            builder.ExportOutput(of[name], name)
        builder.BuildInto(self)

    def set_initial_state(self, context: framework.Context) -> None:
        """Sets the robot's initial state."""

    def fall_reason(self, context: framework.Context) -> str:
        """The criterion by which the robot has fallen; empty if it has not."""
        return ""

    def nees(self, context: framework.Context) -> float:
        """The NEES e' P^-1 e [-] of the estimate; 0 with perfect sensors."""
        return 0.0

    def improper_contacts(self, context: framework.Context) -> set[str]:
        """Names of all contacts except those of a foot and the ground."""
        return set()

    def passed_limit(self, context: framework.Context) -> bool:
        """True if a limit is exceeded that a recovery must not exceed."""
        return False

    def fastest_joint(self, context: framework.Context) -> tuple[str, float]:
        """The joint closest to its speed limit: its name, speed per limit."""
        return "", 0.0

    def read_logs(self, context: framework.Context) -> dict[str, np.ndarray]:
        """All logged signals, and `t` [s] (see nadia_balance.results)."""
        log = self._log.FindLog(context)
        t, data = log.sample_times().copy(), log.data().T
        # A simulation from a cloned Context logs its first row a second time.
        last = np.diff(t, append=np.inf) > 0.0
        if not np.all(last):
            t, data = t[last], data[last]
        ends = np.cumsum(list(self._sizes.values()))[:-1]
        columns = np.split(data, ends, axis=1)
        logs = {"t": t, **dict(zip(self._sizes, columns, strict=True))}
        # Regions of all footholds: legs may be let cross during a run.
        regions = step_regions(self.robot.point_mass.reach, cross_over=True)
        logs |= {f"region_{name}": region for name, region in regions.items()}
        logs["sole"] = self.robot.sole
        if self._ground is not None:
            regions = enumerate(self._ground.regions)
            steppable = [(i, r.polygon) for i, r in regions if not r.obstacle]
            corners = [np.insert(p, 0, i, axis=1) for i, p in steppable]
            logs["ground"] = np.concatenate(corners)
        return logs

    def forget_logs(self, context: framework.Context) -> None:
        """Clears the log, which otherwise grows without bound."""
        self._log.FindMutableLog(context).Clear()


class MeasuredPoses:
    """Forward kinematics of one robot, from its [q, v]."""

    def __init__(self, robot: RobotModel):
        self._plant = plant = robot.control_plant()
        self._context = plant.CreateDefaultContext()
        feet, body = robot.foot_bodies.items(), plant.GetBodyByName
        self._soles = [(body(name), robot.X_FootSole[of]) for of, name in feet]
        self._trunk = [body(robot.torso_body), body(robot.pelvis_body)]

    def along(self, states: np.ndarray) -> dict[str, np.ndarray]:
        """Signals `foot_poses`, `trunk_tilt` of the `states` (n, nq + nv)."""
        feet, tilts = np.empty((len(states), 2, 4)), np.empty((len(states), 2))
        for row, state in enumerate(states):
            tilts[row] = self.trunk_tilt(state)
            for foot, (body, X_FootSole) in enumerate(self._soles):
                X_WF = self._pose(body) @ X_FootSole
                feet[row, foot, :3] = X_WF.translation()
                feet[row, foot, 3] = RollPitchYaw(X_WF.rotation()).yaw_angle()
        return {"foot_poses": feet.reshape(-1, 8), "trunk_tilt": tilts}

    def trunk_tilt(self, state: np.ndarray) -> np.ndarray:
        """Angles (2,) [rad] of torso and pelvis against the vertical."""
        self._plant.SetPositionsAndVelocities(self._context, state)
        # The z axis of W, in the body's frame.
        z = [self._pose(body).rotation().matrix()[2] for body in self._trunk]
        return np.array([np.arctan2(np.hypot(x, y), up) for x, y, up in z])

    def _pose(self, body) -> RigidTransform:
        return self._plant.EvalBodyPoseInWorld(self._context, body)
