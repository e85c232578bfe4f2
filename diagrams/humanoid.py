"""The multibody robot and its controller in closed loop."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from pydrake.geometry import GeometryId, Meshcat
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    OutputPort,
    System,
)
from pydrake.systems.primitives import LogVectorOutput

from nadia_balance.balance_controller import BalanceController
from nadia_balance.core.estimation.sensors import SensorParams
from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.mechanisms import NAMED
from nadia_balance.core.walking.state import FootPoses
from nadia_balance.diagrams.closed_loop import (
    ClosedLoop,
    Logs,
    MeasuredPoses,
    block_labels,
    sampled,
)
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.diagrams.terrain import check_start, foot_beside
from nadia_balance.diagrams.touchdowns import TouchdownRecord
from nadia_balance.engines.plants import add_mujoco_plant
from nadia_balance.parameters.bounds import check_type, require
from nadia_balance.results.estimation import ESTIMATE, nees
from nadia_balance.results.summary import SPEED_MARGIN
from nadia_balance.robot.fall import fall_of, upright
from nadia_balance.robot.params import load_sensors
from nadia_balance.robot.plants import actuated_velocities, scale_friction
from nadia_balance.systems.contact_clock import ContactClock
from nadia_balance.systems.estimation import Imu, JointEncoders, StateEstimator
from nadia_balance.systems.foot_forces import FootForceEstimator
from nadia_balance.systems.hardware import (
    FootForceSensor,
    JointDrives,
    StateSensor,
)
from nadia_balance.systems.push_source import PushSource
from nadia_balance.systems.signals import read
from nadia_balance.systems.wiring import connect
from nadia_balance.view.scene import (
    add_ghost,
    add_mechanisms,
    add_mouse,
    add_robot_view,
    connect_forces,
    move_floor,
)

FALLEN_TORSO_TILT = math.radians(70.0)  # tilt of the torso [rad]


class HumanoidDiagram(ClosedLoop):
    """Closes the loop of BalanceController and a MultibodyPlant.

    For level regions the plant's ground is flat, and a foot that lands beside
    them counts as a fall.  Uneven regions are the plant's ground themselves.
    """

    def __init__(
        self,
        scenario: Scenario,
        meshcat: Meshcat | None = None,
        controller: System | None = None,
        sources: Mapping[str, System] | None = None,
        **blocks: Any,
    ):
        """Builds the diagram.

        Args:
            scenario: what is simulated.
            meshcat: where it is drawn, if given.
            controller: replaces the BalanceController: it has the input
                `estimated_state` and the output `actuation` of one.  Its inputs
                `foot_forces`, `mechanisms` and `velocity_command` are connected
                if it has them, its outputs logged and drawn, too.  Without a
                `walking_state`, a ContactClock times the pushes, in directions
                relative to W.
            sources: systems whose output of that name is connected to the
                controller's input; by default `velocity_command` is the
                scenario's, or the user's if there is Meshcat and the scenario
                has no commands.  That of `joint_command` stands between
                controller and drives (see GivenJoints).
            **blocks: those of the BalanceController, or its `tasks`.

        Raises:
            ValueError: the robot cannot stand with the step width of the gait
                or on the terrain, or a block or the `controller` lacks a port.
        """
        super().__init__(scenario)
        period = scenario.controller.control_period
        model = scenario.point_mass(self.robot)
        start = scenario.start(model)
        # The controller's friction coefficient: a margin below the ground's.
        check_start(
            self._ground,
            start.schedule.feet,
            min(scenario.imperfections.friction_ratio, 1.0)
            * scenario.controller.whole_body.friction,
        )
        self._poses = MeasuredPoses(self.robot)
        self._standing = self.robot.standing_positions(
            scenario.gait.step_width, scenario.place.pose
        )
        self._sensors = (
            None
            if scenario.sensors == "perfect"
            else load_sensors(scenario.sensors)
        )
        builder = DiagramBuilder()
        self._add_plant(builder)
        # How long torques are held: those of another's block perhaps not.
        self._hold = (
            period
            if controller is None
            and "whole_body_inverse_dynamics" not in blocks
            else 0.0
        )
        if controller is None:
            controller = BalanceController(
                scenario.controller,
                self.robot,
                start=start,
                ground=model.ground,
                delay=scenario.delay,
                sensors=self._sensors,
                **blocks,
            )
            self.replaced = block_labels(blocks)
        else:
            self._check_controller(controller, blocks)
            self.replaced = block_labels({"controller": controller})
        self.controller = builder.AddNamedSystem(
            "balance_controller", controller
        )
        self.push = PushSource(
            scenario.pushes,
            mass=self.robot.mass,
            period=period,
            plant=self.plant,
            base_body=self.robot.pelvis_body,
        )
        builder.AddNamedSystem("push_source", self.push)
        self.sensor = builder.AddNamedSystem(
            "foot_force_sensor",
            FootForceSensor(
                self.plant,
                self.robot,
                period=period,
                engine=self.engine,
                sensors=self._sensors,
                seed=scenario.seed,
            ),
        )
        self._close_loop(builder, meshcat, sources or {})
        if meshcat is not None:
            self._draw(builder, meshcat)
        self._touchdowns = TouchdownRecord(self.robot, scenario.time_step)
        self._states = LogVectorOutput(
            self.engine.GetOutputPort("state"),
            builder,
            publish_period=scenario.time_step,
        )
        self._states.set_name("step_log")
        self._finish(
            builder,
            meshcat,
            period,
            [self.engine, self.sensor, self.push, controller],
            mechanisms=self._mechanisms,
            torques=self._torques,
            step_forces=self.sensor.GetOutputPort("step_forces"),
            **self._command,
            **self._measured,
        )

    def _draw(self, builder: DiagramBuilder, meshcat: Meshcat) -> None:
        add_robot_view(builder, self.scene_graph, meshcat)
        move_floor(meshcat, self.scenario.place.pose.p_WF)
        estimate = self._measured.get("estimated_state")
        if estimate is not None:
            self._ghost = add_ghost(builder, self.robot, estimate, meshcat)

    def _check_controller(
        self, controller: System, blocks: Mapping[str, Any]
    ) -> None:
        """Raises ValueError if the `controller` does not fit the plant."""
        check_type("controller", controller, System)
        named = f"controller = {type(controller).__name__}"
        require(
            not blocks,
            f"{named}: must not come with blocks: {', '.join(blocks)}",
        )
        states = self.plant.num_multibody_states()
        actuators = self.plant.num_actuated_dofs()
        require(
            controller.HasInputPort("estimated_state")
            and controller.GetInputPort("estimated_state").size() == states,
            f"{named}: must have a port 'estimated_state' of size {states}",
        )
        require(
            controller.HasOutputPort("actuation")
            and controller.GetOutputPort("actuation").size() == actuators,
            f"{named}: must have a port 'actuation' of size {actuators}",
        )

    def _add_plant(self, builder: DiagramBuilder) -> None:
        """Adds the engine: the plant itself, or a MujocoPlant."""
        step = self.scenario.time_step
        self.engine: Any
        if self.scenario.engine == "mujoco":
            self.engine, self.plant, self.scene_graph = add_mujoco_plant(
                builder, self.robot, step, self._ground
            )
            return
        self.plant, self.scene_graph = self.robot.add_plant_to(
            builder, step, self._ground
        )
        self.engine = self.plant
        ratio = self.scenario.imperfections.friction_ratio
        if ratio != 1.0:
            scale_friction(self.plant, self.scene_graph, ratio)
        self._parts = self._shapes()

    def _shapes(self) -> dict[GeometryId, int]:
        """The robot's shapes: 1 for each of its feet, 2 for all others."""
        feet = set(self.robot.foot_bodies.values())
        pelvis = self.plant.GetBodyByName(self.robot.pelvis_body)
        links = self.plant.GetBodyIndices(pelvis.model_instance())
        return {
            shape: 1 if body.name() in feet else 2
            for body in map(self.plant.get_body, links)
            for shape in self.plant.GetCollisionGeometriesForBody(body)
        }

    def _close_loop(
        self,
        builder: DiagramBuilder,
        meshcat: Meshcat | None,
        sources: Mapping[str, System],
    ) -> None:
        engine, controller = self.engine, self.controller
        connect(builder, engine, self.sensor, "contact_results")
        if self.push.HasInputPort("state"):
            connect(builder, engine, self.push, "state")
        sources = dict(sources)
        self._drive(builder, sources.pop("joint_command", None))
        self._sense(builder)
        clock = controller
        if not controller.HasOutputPort("walking_state"):
            clock = builder.AddNamedSystem(
                "contact_clock",
                ContactClock(self.robot.mass * GRAVITY, self.push.period),
            )
            connect(builder, self.sensor, clock, "foot_forces")
        connect(builder, clock, self.push, "walking_state")
        self.timing = clock.GetOutputPort("walking_state")
        mouse = None
        if meshcat is not None and engine is self.plant:
            mouse = add_mouse(builder, self.plant, self.scene_graph, meshcat)
        connect_forces(
            builder, engine, self.push.GetOutputPort("spatial_forces"), mouse
        )
        self._mechanisms = add_mechanisms(
            builder,
            NAMED[self.scenario.mechanisms],
            self.push,
            meshcat,
            limits=self.velocity_limits,
            has_switches=controller.HasInputPort("mechanisms"),
        )
        if controller.HasInputPort("mechanisms"):
            builder.Connect(
                self._mechanisms, controller.GetInputPort("mechanisms")
            )
        self._command = self._connect_sources(builder, controller, sources)

    def _drive(self, builder: DiagramBuilder, others: System | None) -> None:
        """Connects the commanded torques to the engine, through its drives.

        Between them are the `others`, who command some joints.
        """
        self._torques = self.controller.GetOutputPort("actuation")
        self._drives = None
        commander = self.controller
        if others is not None:
            builder.AddNamedSystem("given_joints", others)
            connect(builder, commander, others, "joint_command")
            commander = others
        if self.robot.drives is not None:
            self._drives = JointDrives(self.plant, self.robot, self._hold)
            builder.AddNamedSystem("joint_drives", self._drives)
            has_gains = commander.HasOutputPort("joint_command")
            command = "joint_command" if has_gains else "actuation"
            connect(builder, commander, self._drives, command)
            connect(builder, self.engine, self._drives, "state")
            self._torques = self._drives.GetOutputPort("torques")
        builder.Connect(self._torques, self.engine.GetInputPort("actuation"))

    def _sense(self, builder: DiagramBuilder) -> None:
        """Connects the controller's inputs to the measured signals."""
        scenario, controller = self.scenario, self.controller
        state = self.engine.GetOutputPort("state")
        feet: System = self.sensor
        self._measured: dict[str, OutputPort] = {}
        if self._sensors is not None:
            feet = self._estimate(builder)
            state = self._measured["estimated_state"]
        forces = feet.GetOutputPort("foot_forces")
        if scenario.imperfections.has_noise or scenario.delay:
            sensor = builder.AddNamedSystem(
                "state_sensor",
                StateSensor(
                    self.plant,
                    replace(scenario.imperfections, delay=scenario.delay),
                    period=self.push.period,
                    seed=scenario.seed,
                ),
            )
            builder.Connect(state, sensor.GetInputPort("state"))
            connect(builder, feet, sensor, "foot_forces")
            state = sensor.GetOutputPort("measured_state")
            forces = sensor.GetOutputPort("measured_foot_forces")
        builder.Connect(state, controller.GetInputPort("estimated_state"))
        if controller.HasInputPort("foot_forces"):
            builder.Connect(forces, controller.GetInputPort("foot_forces"))

    def _estimate(self, builder: DiagramBuilder) -> System:
        """Adds sensors, and the estimators that read them.

        Returns the system that tells the foot forces.
        """
        seed, period = self.scenario.seed, self.push.period
        assert self._sensors is not None
        level = self._ground is None or self._ground.is_level
        estimator = builder.AddNamedSystem(
            "state_estimator",
            StateEstimator(
                self.robot,
                self._sensors,
                period=period,
                q=StateEstimator.with_start_error(self._standing, seed),
                height=0.0 if level and self.scenario.terrain.seen else None,
                kind=self.scenario.estimator,
            ),
        )
        for name, kind, signal in (
            ("imu", Imu, "imu"),
            ("joint_encoders", JointEncoders, "joints"),
        ):
            sensor = builder.AddNamedSystem(
                name, kind(self.robot, self._sensors, period, seed)
            )
            self._measured[signal] = sensor.GetOutputPort(signal)
            connect(builder, self.engine, sensor, "state")
            connect(builder, sensor, estimator, signal)
        feet = self._add_foot_forces(builder, self._sensors)
        connect(builder, feet, estimator, "foot_forces")
        for name in ("estimated_state", "estimate_covariance"):
            self._measured[name] = estimator.GetOutputPort(name)
        return feet

    def _add_foot_forces(
        self, builder: DiagramBuilder, sensors: SensorParams
    ) -> System:
        """The sensor of the foot forces, or else their estimator."""
        if sensors.foot_forces == "measured":
            return self.sensor
        feet = builder.AddNamedSystem(
            "foot_force_estimator",
            FootForceEstimator(self.robot, sensors, self.push.period),
        )
        for name in ("imu", "joints"):
            builder.Connect(self._measured[name], feet.GetInputPort(name))
        builder.Connect(self._torques, feet.GetInputPort("torques"))
        self._measured["estimated_foot_forces"] = feet.GetOutputPort(
            "foot_forces"
        )
        return feet

    def set_initial_state(self, context: Context) -> None:
        """Lets the robot stand, shifted at random by the scenario's seed.

        Args:
            context: that of this diagram, which is changed.
        """
        q = self._standing.copy()
        if self.scenario.seed:
            rng = np.random.default_rng(self.scenario.seed)
            q[4:6] += rng.uniform(-1e-5, 1e-5, 2)
        engine_context = self.engine.GetMyMutableContextFromRoot(context)
        self.engine.SetPositions(engine_context, q)
        ratio = self.scenario.imperfections.torso_mass_ratio
        if ratio != 1.0:  # scales its inertia, too
            torso = self.plant.GetRigidBodyByName(self.robot.torso_body)
            inertia = torso.CalcSpatialInertiaInBodyFrame(engine_context)
            torso.SetSpatialInertiaInBodyFrame(
                engine_context,
                SpatialInertia(
                    ratio * inertia.get_mass(),
                    inertia.get_com(),
                    inertia.get_unit_inertia(),
                ),
            )
        if self._drives is not None:  # initial torques are the commanded ones
            drives_context = self._drives.GetMyMutableContextFromRoot(context)
            torques: Any = self._drives.command(drives_context)[2]
            drives_context.SetDiscreteState(0, torques)

    def fall_reason(self, context: Context) -> str:
        """Returns the criterion by which the robot has fallen.

        Args:
            context: that of this diagram.

        Returns:
            A few words; empty if it has not fallen.
        """
        state = read(self.engine.GetOutputPort("state"), context)
        ground = self._ground
        is_uneven = ground is not None and not ground.is_level
        # The pelvis is the floating base: quaternion and position come first.
        height, schedule = state[6], None
        if self.HasOutputPort("walking_state"):
            schedule = read(self.signals["walking_state"], context).schedule
            if is_uneven:
                height -= schedule.feet[schedule.support_side].p_WF[2]
        reason = fall_of(upright(state[:4]), height, self._standing[6])
        if reason:
            return reason
        torso, _ = self._poses.trunk_tilt(state)
        if torso > FALLEN_TORSO_TILT:
            return "torso tilted"
        if is_uneven or schedule is None:
            return ""
        return foot_beside(ground, schedule)

    def com(self, context: Context) -> Array:
        """Returns the centre of mass.

        Args:
            context: that of this diagram.

        Returns:
            Its place (3,) in W [m], as the controller knows it, if it does.
        """
        if "com_state" in self.signals:
            return super().com(context)
        return self._poses.com(read(self.signals["state"], context))

    def feet(self, context: Context) -> FootPoses:
        """Returns where the feet stand.

        Args:
            context: that of this diagram.

        Returns:
            The soles in W; of a foot in the air, its last pose on the ground,
            or without a walking state the present one.
        """
        if "walking_state" in self.signals:
            return super().feet(context)
        return self._poses.feet(read(self.signals["state"], context))

    def nees(self, context: Context) -> float:
        """Returns the NEES e' P^-1 e [-] of the estimate.

        Args:
            context: that of this diagram.

        Returns:
            The normalised error; 0 with perfect sensors.
        """
        if self._sensors is None:
            return 0.0
        ports = self._measured | {"state": self.engine.GetOutputPort("state")}
        row = {name: read(ports[name], context)[None] for name in ESTIMATE}
        return float(nees(row)[0])

    def improper_contacts(self, context: Context) -> set[str]:
        """Returns all contacts except those of a foot and the ground.

        Args:
            context: that of this diagram.

        Returns:
            The names of what touches.
        """
        if self.engine is self.plant and self._only_feet_touch(context):
            return set()
        return self.robot.improper_contacts(
            self.plant,
            read(self.engine.GetOutputPort("contact_results"), context),
        )

    def _only_feet_touch(self, context: Context) -> bool:
        """True if the robot touches nothing, or by its feet what is no robot.

        The shapes tell it.  The contact forces would be those of a whole step
        of the plant, which is solved again after the controller's update.
        """
        query = read(self.scene_graph.get_query_output_port(), context)
        return all(
            self._parts.get(pair.id_A, 0) + self._parts.get(pair.id_B, 0) < 2
            for pair in query.ComputePointPairPenetration()
        )

    def passed_limit(self, context: Context) -> bool:
        """Returns whether a joint's speed or the torso's tilt is too large.

        Args:
            context: that of this diagram.

        Returns:
            True if one is above its limit; ideal robots have none.
        """
        if self.scenario.fidelity == "ideal":
            return False
        state = read(self.engine.GetOutputPort("state"), context)
        torso, _ = self._poses.trunk_tilt(state)
        speeds = np.abs(state[self.plant.num_positions() + 6 :])
        limits = (1.0 + SPEED_MARGIN) * self.robot.max_joint_speeds
        return bool(
            torso > math.radians(self.scenario.max_torso_tilt_deg)
            or (speeds > limits).any()
        )

    def fastest_joint(self, context: Context) -> tuple[str, float]:
        """Returns the joint closest to its speed limit.

        Args:
            context: that of this diagram.

        Returns:
            Its name, and its speed per limit [-]; ideal robots have no limit.
        """
        if self.scenario.fidelity == "ideal":
            return "", 0.0
        first = self.plant.num_positions() + 6  # of the joints, in [q, v]
        state = read(self.engine.GetOutputPort("state"), context)
        ratios = np.abs(state[first:]) / self.robot.max_joint_speeds
        i = int(np.argmax(ratios))
        name = self.plant.GetStateNames(False)[first + i]
        return name.removesuffix("_w").removesuffix("_v"), float(ratios[i])

    def read_logs(self, context: Context) -> Logs:
        """Returns all logged signals (see results.log).

        Args:
            context: that of this diagram.

        Returns:
            The arrays of a log, by name.
        """
        logs = super().read_logs(context)
        velocities = actuated_velocities(self.plant)
        return {
            **logs,
            **self._poses.along(logs["state"]),
            "touchdowns": self._find_touchdowns(context, logs),
            "weight": np.array(self.robot.mass * GRAVITY),
            "actuator_names": np.array(self.plant.GetActuatorNames()),
            "effort_limits": self.plant.GetEffortUpperLimits(),
            "joint_speed_limits": self.robot.max_joint_speeds[velocities - 6],
            "joint_speed_columns": self.plant.num_positions() + velocities,
        }

    def _find_touchdowns(self, context: Context, logs: Logs) -> Array:
        """The touchdowns (k, 8) of the run, one in each row."""
        times, states = sampled(self._states.FindLog(context))
        # The forces in the steps from one tick to the next, in order of time.
        forces = logs["step_forces"][1:]
        steps = forces.shape[1] // 2
        forces = forces.reshape(-1, steps, 2)[:, ::-1].reshape(-1, 2)
        return self._touchdowns.touchdowns(
            times[: len(forces)], states[: len(forces)], forces
        )

    def forget_logs(self, context: Context) -> None:
        """Clears the logs, which otherwise grow without bound.

        Args:
            context: that of this diagram, which is changed.
        """
        super().forget_logs(context)
        self._states.FindMutableLog(context).Clear()
