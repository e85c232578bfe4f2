"""The multibody robot and its controller in closed loop."""

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import Context, DiagramBuilder, System

from nadia_balance.balance_controller import BalanceController
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.mechanisms import NAMED
from nadia_balance.diagrams.closed_loop import ClosedLoop, MeasuredPoses
from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.diagrams.terrain import check_start, foot_beside
from nadia_balance.engines.plants import add_mujoco_plant
from nadia_balance.results.measurements import ESTIMATE, nees
from nadia_balance.results.summary import SPEED_MARGIN
from nadia_balance.robot.params import load_sensors
from nadia_balance.robot.plants import actuated_velocities, scale_friction
from nadia_balance.systems import hardware, push_source
from nadia_balance.systems.estimation import Imu, JointEncoders, StateEstimator
from nadia_balance.systems.signals import connect, read
from nadia_balance.view import scene

FALLEN_HEIGHT = 0.6  # pelvis height, as a fraction of that at the start
FALLEN_TILT = 1.0  # tilt of the pelvis against the vertical [rad]
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
        **blocks: System | None,
    ):
        """Builds the diagram of `scenario`; draws if `meshcat` is given.

        `controller` replaces the BalanceController: it has the input
        `estimated_state` and the output `actuation` of one.  Its inputs
        `foot_forces`, `mechanisms` and `velocity_command` are connected if it
        has them, its outputs logged and drawn, too.  `sources` are systems
        whose output of that name is connected to the controller's input; by
        default `velocity_command` is the scenario's, or the user's if there is
        Meshcat and the scenario has no commands.  Without a `walking_state`, a
        ContactClock times the pushes, in directions relative to W.  `blocks`
        are those of the BalanceController, or its `tasks`.

        Raises ValueError: the robot cannot stand with the step width of the
        gait or on the terrain, or a block or the `controller` lacks a port.
        """
        super().__init__(scenario)
        params = scenario.controller
        period = params.control_period
        model = scenario.point_mass(self.robot)
        start = scenario.start(model)
        # The controller's friction coefficient: a margin below the ground's.
        slip = min(scenario.imperfections.friction_ratio, 1.0)
        friction = slip * params.whole_body.friction
        check_start(self._ground, start.schedule.feet, friction)
        self._poses = MeasuredPoses(self.robot)
        stance = scenario.gait.step_width, scenario.place.pose
        self._standing = self.robot.standing_positions(*stance)
        builder = DiagramBuilder()
        self._add_plant(builder)
        if controller is None:
            given = {"start": start, "ground": model.ground}
            given["delay"] = scenario.delay
            known = params, self.robot
            controller = BalanceController(*known, **given, **blocks)
        else:
            self._check_controller(controller, blocks)
        self.controller = controller
        builder.AddNamedSystem("balance_controller", controller)
        known = self.robot.mass, period, self.plant, self.robot.pelvis_body
        push = push_source.PushSource(scenario.pushes, *known)
        self.push = builder.AddNamedSystem("push_source", push)
        kind = scenario.sensors
        self._sensors = None if kind == "perfect" else load_sensors(kind)
        noise = self._sensors, scenario.seed
        known = self.plant, self.robot, period, self.engine
        sensor = hardware.FootForceSensor(*known, *noise)
        self.sensor = builder.AddNamedSystem("foot_force_sensor", sensor)
        self._close_loop(builder, meshcat, sources or {})
        if meshcat is not None:
            scene.add_robot_view(builder, self.scene_graph, meshcat)
            scene.move_floor(meshcat, scenario.place.pose.p_WF)
            if told := self._measured.get("estimated_state"):
                ghost = builder, self.robot, told, meshcat
                self._ghost = scene.add_ghost(*ghost)
        systems = self.engine, self.sensor, self.push, controller
        logged = {"mechanisms": self._mechanisms, "torques": self._torques}
        logged |= self._command
        logged |= self._measured
        self._finish(builder, meshcat, period, systems, **logged)

    def _check_controller(self, controller: System, blocks: dict) -> None:
        """Raises ValueError if the `controller` does not fit the plant."""
        what = f"controller = {type(controller).__name__}: must"
        if names := ", ".join(blocks):
            raise ValueError(f"{what} not come with blocks: {names}")
        plant = self.plant
        for way, name, size in (
            ("Input", "estimated_state", plant.num_multibody_states()),
            ("Output", "actuation", plant.num_actuated_dofs()),
        ):
            has = getattr(controller, f"Has{way}Port")
            get = getattr(controller, f"Get{way}Port")
            if not has(name) or get(name).size() != size:
                raise ValueError(f"{what} have a port {name!r} of size {size}")

    def _add_plant(self, builder: DiagramBuilder) -> None:
        """Adds the engine: the plant itself, or a MujocoPlant."""
        step = self.scenario.time_step
        if self.scenario.engine == "mujoco":
            made = add_mujoco_plant(builder, self.robot, step, self._ground)
            self.engine, self.plant, self.scene_graph = made
            return
        made = self.robot.add_plant_to(builder, step, self._ground)
        self.engine, self.scene_graph = self.plant, _ = made
        ratio = self.scenario.imperfections.friction_ratio
        if ratio != 1.0:
            scale_friction(self.plant, self.scene_graph, ratio)

    def _close_loop(
        self,
        builder: DiagramBuilder,
        meshcat: Meshcat | None,
        sources: Mapping[str, System],
    ) -> None:
        engine, controller = self.engine, self.controller
        connect(builder, engine, self.sensor, "contact_results")
        self._sense(builder)
        clock = controller
        if not controller.HasOutputPort("walking_state"):
            weight = self.robot.mass * GRAVITY
            clock = push_source.ContactClock(weight, self.push.period)
            builder.AddNamedSystem("contact_clock", clock)
            connect(builder, self.sensor, clock, "foot_forces")
        connect(builder, clock, self.push, "walking_state")
        self._torques = controller.GetOutputPort("actuation")
        self._drives = None
        if self.robot.drives is not None:
            drives = hardware.JointDrives(self.plant, self.robot)
            self._drives = builder.AddNamedSystem("joint_drives", drives)
            connect(builder, controller, self._drives, "actuation")
            connect(builder, engine, self._drives, "state")
            self._torques = self._drives.GetOutputPort("torques")
        builder.Connect(self._torques, engine.GetInputPort("actuation"))
        mouse = None
        if meshcat is not None and engine is self.plant:
            where = self.plant, self.scene_graph, meshcat
            mouse = scene.add_mouse(builder, *where)
        pushes = self.push.GetOutputPort("spatial_forces")
        scene.connect_forces(builder, engine, pushes, mouse)
        on = NAMED[self.scenario.mechanisms]
        limits = self.velocity_limits
        self._mechanisms = scene.add_mechanisms(
            builder, on, self.push, meshcat, limits
        )
        if controller.HasInputPort("mechanisms"):
            port = controller.GetInputPort("mechanisms")
            builder.Connect(self._mechanisms, port)
        self._command = self._connect_sources(builder, controller, sources)

    def _sense(self, builder: DiagramBuilder) -> None:
        """Connects the controller's inputs to the measured signals."""
        state = self.engine.GetOutputPort("state")
        forces = self.sensor.GetOutputPort("foot_forces")
        self._measured = {}
        scenario, controller = self.scenario, self.controller
        if self._sensors is not None:
            self._estimate(builder)
            state = self._measured["estimated_state"]
        if scenario.imperfections.has_noise or scenario.delay:
            errors = replace(scenario.imperfections, delay=scenario.delay)
            known = self.plant, errors, self.push.period, scenario.seed
            sensor = hardware.StateSensor(*known)
            builder.AddNamedSystem("state_sensor", sensor)
            builder.Connect(state, sensor.GetInputPort("state"))
            connect(builder, self.sensor, sensor, "foot_forces")
            state = sensor.GetOutputPort("measured_state")
            forces = sensor.GetOutputPort("measured_foot_forces")
        builder.Connect(state, controller.GetInputPort("estimated_state"))
        if controller.HasInputPort("foot_forces"):
            builder.Connect(forces, controller.GetInputPort("foot_forces"))

    def _estimate(self, builder: DiagramBuilder) -> None:
        """Adds sensors, and the estimator that reads them."""
        seed, period = self.scenario.seed, self.push.period
        common, ground = (self.robot, self._sensors, period), self._ground
        level = ground is None or ground.is_level
        height = 0.0 if level and self.scenario.terrain.seen else None
        told = StateEstimator.told(self._standing, seed)
        kind = self.scenario.estimator
        estimator = StateEstimator(*common, told, height, kind)
        builder.AddNamedSystem("state_estimator", estimator)
        for name, sensor, signal in (
            ("imu", Imu(*common, seed), "imu"),
            ("joint_encoders", JointEncoders(*common, seed), "joints"),
        ):
            builder.AddNamedSystem(name, sensor)
            self._measured[signal] = sensor.GetOutputPort(signal)
            connect(builder, self.engine, sensor, "state")
            connect(builder, sensor, estimator, signal)
        connect(builder, self.sensor, estimator, "foot_forces")
        for name in ("estimated_state", "estimate_covariance"):
            self._measured[name] = estimator.GetOutputPort(name)

    def set_initial_state(self, context: Context) -> None:
        """Lets the robot stand, shifted at random by the scenario's seed."""
        q = self._standing.copy()
        if self.scenario.seed:
            rng = np.random.default_rng(self.scenario.seed)
            q[4:6] += rng.uniform(-1e-5, 1e-5, 2)
        own = self.engine.GetMyMutableContextFromRoot(context)
        self.engine.SetPositions(own, q)
        ratio = self.scenario.imperfections.torso_mass_ratio
        if ratio != 1.0:  # scales its inertia, too
            torso = self.plant.GetRigidBodyByName(self.robot.torso_body)
            known = torso.CalcSpatialInertiaInBodyFrame(own)
            mass, shape = ratio * known.get_mass(), known.get_unit_inertia()
            heavier = SpatialInertia(mass, known.get_com(), shape)
            torso.SetSpatialInertiaInBodyFrame(own, heavier)
        if self._drives is not None:  # initial torques are the commanded ones
            own = self._drives.GetMyMutableContextFromRoot(context)
            commanded = self._drives.GetInputPort("actuation").Eval(own)
            own.SetDiscreteState(commanded)

    def fall_reason(self, context: Context) -> str:
        """The criterion by which the robot has fallen; empty if it has not."""
        state = read(self.engine.GetOutputPort("state"), context)
        ground = self._ground
        is_uneven = ground is not None and not ground.is_level
        # The pelvis is the floating base: quaternion and position come first.
        height, schedule = state[6], None
        if self.HasOutputPort("walking_state"):
            walking = self.GetOutputPort("walking_state").Eval(context)
            schedule = walking.schedule
            if is_uneven:
                height -= schedule.feet[schedule.support_side].p_WF[2]
        if height < FALLEN_HEIGHT * self._standing[6]:
            return "pelvis too low"
        torso, pelvis = self._poses.trunk_tilt(state)
        if pelvis > FALLEN_TILT:
            return "pelvis tilted"
        if torso > FALLEN_TORSO_TILT:
            return "torso tilted"
        if is_uneven or schedule is None:
            return ""
        return foot_beside(ground, schedule)

    def nees(self, context: Context) -> float:
        """The NEES e' P^-1 e [-] of the estimate; 0 with perfect sensors."""
        if self._sensors is None:
            return 0.0
        ports = self._measured | {"state": self.engine.GetOutputPort("state")}
        now = {n: read(ports[n], context)[None] for n in ESTIMATE.split()}
        return float(nees(now)[0])

    def improper_contacts(self, context: Context) -> set[str]:
        """Names of all contacts except those of a foot and the ground."""
        results = read(self.engine.GetOutputPort("contact_results"), context)
        return self.robot.improper_contacts(self.plant, results)

    def passed_limit(self, context: Context) -> bool:
        """True if a joint speed or the torso's tilt is above its limit."""
        if self.scenario.fidelity == "ideal":
            return False
        state = read(self.engine.GetOutputPort("state"), context)
        torso, _ = self._poses.trunk_tilt(state)
        speeds = np.abs(state[self.plant.num_positions() + 6 :])
        limits = (1.0 + SPEED_MARGIN) * self.robot.max_joint_speeds
        tilts = torso > math.radians(self.scenario.max_torso_tilt_deg)
        return bool(tilts or (speeds > limits).any())

    def fastest_joint(self, context: Context) -> tuple[str, float]:
        """The joint closest to its speed limit: its name, speed per limit."""
        if self.scenario.fidelity == "ideal":
            return "", 0.0
        state = read(self.engine.GetOutputPort("state"), context)
        speeds = np.abs(state[self.plant.num_positions() + 6 :])
        ratios = speeds / self.robot.max_joint_speeds
        i = int(np.argmax(ratios))
        velocity = self.plant.num_positions() + 6 + i
        name = self.plant.GetStateNames(False)[velocity]
        return name.removesuffix("_w").removesuffix("_v"), float(ratios[i])

    def read_logs(self, context: Context) -> dict[str, np.ndarray]:
        """All logged signals (see nadia_balance.results)."""
        logs = super().read_logs(context)
        velocities = actuated_velocities(self.plant)
        return {
            **logs,
            **self._poses.along(logs["state"]),
            "weight": np.array(self.robot.mass * GRAVITY),
            "actuator_names": np.array(self.plant.GetActuatorNames()),
            "effort_limits": self.plant.GetEffortUpperLimits(),
            "joint_speed_limits": self.robot.max_joint_speeds[velocities - 6],
            "joint_speed_columns": self.plant.num_positions() + velocities,
        }
