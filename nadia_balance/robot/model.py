"""The robot: one robot.yaml, parsed alike for the plant and the controller."""

import copy
import math
from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import CollisionFilterDeclaration, GeometrySet, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    AddMultibodyPlantSceneGraph,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.arrays import Array, rectangle
from nadia_balance.core.walking.state import ORIGIN, FootPose, Side
from nadia_balance.parameters.bounds import check, check_number, require
from nadia_balance.parameters.scaling import scaled
from nadia_balance.parameters.yaml_reader import load_tree, load_typed, naming
from nadia_balance.robot.leg_strength import (
    FootLimits,
    StandingKinematics,
    StandingLegs,
)
from nadia_balance.robot.params import MODELS, REQUIRED, RobotParams, idealised
from nadia_balance.robot.plants import (
    actuators,
    add_ground,
    improper_contacts,
    joints_above,
)
from nadia_balance.robot.urdf import (
    add_urdf,
    check_plant,
    check_urdf,
    foot_width,
    remarks_on,
    with_lengths,
)

# realistic: limits of a real robot.  ideal: full torque at any joint speed, any
# foot speed, and no collisions between arms and legs.
FIDELITIES = ("realistic", "ideal")


class RobotModel:
    """A humanoid with two flat feet, as robot.yaml and its URDF describe it.

    `drives` are JointDriveParams; None if the robot is ideal (see `idealised`).
    `remarks` are warnings about legal but suspicious settings.
    """

    def __init__(self, params: RobotParams, urdf: Path) -> None:
        """Makes the model of a robot that can stand.

        Args:
            params: of `load_robot_params`.
            urdf: path of the URDF, of the same function.

        Raises:
            ValueError: the robot cannot stand with these parameters; names the
                field, its value and what is allowed.
        """
        self.params = params
        self.urdf = urdf
        self.name = params.name
        self.com_height = params.com_height
        self.posture = params.posture
        self.drives = params.drives
        self.motors = {
            joint: motor
            for motor in (
                params.drives.motors.values() if params.drives else ()
            )
            for joint in motor.joints
        }
        self.pelvis_body = params.pelvis_body
        self.torso_body = params.torso_body
        self.foot_bodies = {
            Side.LEFT: params.left_foot_body,
            Side.RIGHT: params.right_foot_body,
        }
        sole = params.sole
        self.sole_length = sole.x_max - sole.x_min
        self.sole_width = 2.0 * sole.half_width
        self.sole = rectangle(self.sole_length, self.sole_width)
        centre: Any = [0.5 * (sole.x_min + sole.x_max), 0.0, sole.z]
        self.X_FootSole = {side: RigidTransform(centre) for side in Side}
        self.remarks = remarks_on(
            self.control_diagram()[1], set(self.foot_bodies.values())
        )
        with naming(f"urdf = {urdf}"):
            self._legs.check_standing()

    @cached_property
    def mass(self) -> float:
        """Total mass of the robot [kg]."""
        plant = self.control_plant()
        return plant.CalcTotalMass(plant.CreateDefaultContext())

    @cached_property
    def max_joint_speeds(self) -> Array:
        """Speed limits (nj,) [rad/s] of the joints, in the order of v.

        Ideal drives have none: inf.
        """
        speeds = np.asarray(self.control_plant().GetVelocityUpperLimits()[6:])
        if self.drives is None:
            return np.full(speeds.size, np.inf)
        return np.where(
            np.isfinite(speeds), speeds, self.params.max_joint_speed
        )

    @cached_property
    def corner_speeds(self) -> Array:
        """Shares (nj,) of the speed limits with the full torque [-].

        Ideal drives have it at any speed: 1.
        """
        others = 1.0 if self.drives is None else self.drives.corner_speed
        corners = np.full(self.max_joint_speeds.size, others)
        for drive in actuators(self.control_plant()):
            motor = self.motors.get(drive.joint().name())
            if motor is not None and motor.corner_speed is not None:
                corners[drive.joint().velocity_start() - 6] = motor.corner_speed
        return corners

    @cached_property
    def foot_limits(self) -> FootLimits:
        """What the joints of the standing robot's legs leave to a foot."""
        return self._legs.foot_limits(self.max_joint_speeds)

    @cached_property
    def _legs(self) -> StandingLegs:
        """The legs as they stand."""
        return StandingLegs(self, self.standing_positions())

    @cached_property
    def point_mass(self) -> PointMassModel:
        """The robot's model for capture-point control."""
        detour = self.params.swing_detour
        detour = replace(
            detour,
            max_speed=min(self.foot_limits.speed, detour.max_speed),
            max_acceleration=min(
                self.foot_limits.acceleration, detour.max_acceleration
            ),
        )
        reach = self.params.reachability
        sole_clearance = 0.0
        avoidance = self.params.whole_body.avoidance
        if avoidance is not None:
            _, plant, scene_graph = self.control_diagram()
            width = foot_width(
                plant, scene_graph.model_inspector(), self.foot_bodies.values()
            )
            apart = max(width, self.sole_width) + avoidance.clearance
            sole_clearance = max(apart - self.sole_width, 0.0)
            detour = replace(
                detour,
                beside=max(detour.beside, apart + 0.5 * avoidance.clearance),
            )
            reach = replace(reach, width_min=max(reach.width_min, apart))
        return PointMassModel(
            mass=self.mass,
            com_height=self.com_height,
            step_width=self.params.step_width,
            sole=self.sole,
            held=self._legs.cop_area(self.sole),
            legs=self.params.legs,
            reach=reach,
            sole_clearance=sole_clearance,
            detour=detour,
        )

    def add_to(self, plant: MultibodyPlant) -> ModelInstanceIndex:
        """Adds the robot to a plant.

        Args:
            plant: not finalized yet.

        Returns:
            The robot's model instance.

        Raises:
            ValueError: the URDF is malformed (see `add_urdf`).
        """
        instance = add_urdf(plant, self.urdf)
        for actuator in actuators(plant):
            motor = self.motors.get(actuator.joint().name())
            if motor is None or actuator.model_instance() != instance:
                continue
            if motor.max_torque is not None:
                actuator.set_effort_limit(motor.max_torque)
            if motor.max_speed is not None:
                limit: Any = np.array([motor.max_speed])
                actuator.joint().set_velocity_limits(-limit, limit)
        return instance

    def add_plant_to(
        self,
        builder: DiagramBuilder,
        time_step: float = 0.001,
        ground: Ground | None = None,
    ) -> tuple[MultibodyPlant, SceneGraph]:
        """Adds a plant with point contacts, in which the robot stands.

        Args:
            builder: of the diagram.
            time_step: of the plant [s], by default the longest that is
                accurate enough.
            ground: see `add_ground`.

        Returns:
            The plant, finalized, and its SceneGraph.

        Raises:
            ValueError: the time step is out of range.
        """
        check_number("time_step", time_step, least=1e-5, most=0.1, unit="s")
        plant, scene_graph = AddMultibodyPlant(
            MultibodyPlantConfig(
                time_step=time_step,
                contact_model="point",
                discrete_contact_approximation="sap",
                use_sampled_output_ports=False,
            ),
            builder,
        )
        self.stand_in(plant, scene_graph, ground)
        return plant, scene_graph

    def stand_in(
        self,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        ground: Ground | None = None,
    ) -> None:
        """Puts robot and ground into a plant, and finalizes it.

        Args:
            plant: empty.
            scene_graph: for its shapes.
            ground: see `add_ground`.
        """
        self.add_to(plant)
        add_ground(plant, ground)
        plant.Finalize()
        if not self.params.self_collisions:
            self._let_pass(plant, scene_graph)
        plant.SetDefaultPositions(cast(Any, self.standing_positions()))

    def _let_pass(self, plant: MultibodyPlant, scene_graph: SceneGraph) -> None:
        """Excludes self-collisions but between the legs, without the feet."""
        instance = plant.GetBodyByName(self.pelvis_body).model_instance()
        left, right = (
            set(
                plant.GetBodiesKinematicallyAffectedBy(
                    [joints_above(plant, foot)[-1].index()]
                )
            )
            for foot in self.foot_bodies.values()
        )

        def shapes(links: Iterable[BodyIndex]) -> GeometrySet:
            return plant.CollectRegisteredGeometries(
                [plant.get_body(link) for link in links]
            )

        others = shapes(set(plant.GetBodyIndices(instance)) - left - right)
        feet = {
            plant.GetBodyByName(name).index()
            for name in self.foot_bodies.values()
        }
        scene_graph.collision_filter_manager().Apply(
            CollisionFilterDeclaration()
            .ExcludeWithin(shapes(left))
            .ExcludeWithin(shapes(right))
            .ExcludeWithin(shapes(feet))
            .ExcludeWithin(others)
            .ExcludeBetween(others, shapes(left | right))
        )

    def control_plant(self) -> MultibodyPlant:
        """A plant of the robot alone, without geometry.

        Returns:
            The plant, finalized.
        """
        plant = MultibodyPlant(0.001)
        self.add_to(plant)
        plant.Finalize()
        return plant

    def control_diagram(self) -> tuple[Diagram, MultibodyPlant, SceneGraph]:
        """A diagram of a plant of the robot alone, with its shapes.

        Torque and speed limits are the URDF's, not those of the `motors`.

        Returns:
            The diagram, its plant and its SceneGraph.
        """
        return _shaped(self.urdf)

    def improper_contacts(
        self, plant: MultibodyPlant, results: Any
    ) -> set[str]:
        """The pairs of bodies in contact that are not foot and ground.

        Args:
            plant: of this robot and what is around it.
            results: ContactResults of the plant, or PointContacts.

        Returns:
            The pairs (see `plants.improper_contacts`).
        """
        return improper_contacts(
            plant=plant,
            results=results,
            robot=plant.GetBodyByName(self.pelvis_body).model_instance(),
            feet=set(self.foot_bodies.values()),
        )

    def standing_positions(
        self, step_width: float | None = None, place: FootPose = ORIGIN
    ) -> Array:
        """Positions of the standing robot, the nearest to its posture.

        Minimise |q - q_0|^2, with the posture q_0, subject to level soles on
        z = 0, an upright pelvis, and the CoM over the place at `com_height`.

        Args:
            step_width: distance of the soles [m]; None: that of the parameters.
            place: pose in W of the point between the soles.

        Returns:
            Positions q (nq,).

        Raises:
            ValueError: no posture fulfils this.
        """
        width = self.params.step_width if step_width is None else step_width
        require(0.0 < width < np.inf, f"step_width = {width}: must be > 0 m")
        q = self._stance(width)
        if q is None:
            legs = self.params.legs
            highest = legs.length + legs.ankle_height + legs.com_above_hip
            raise ValueError(
                f"step_width = {width}, com_height = {self.com_height}: must "
                f"be within reach of the legs of {self.name}, in m; with "
                f"straight ones, the CoM is {highest:.3f} m high"
            )
        half = 0.5 * place.yaw
        turn = Quaternion(math.cos(half), 0, 0, math.sin(half))
        q[:4] = turn.multiply(Quaternion(cast(Any, q[:4]))).wxyz()
        q[4:6] = place.to_world(q[None, 4:6])[0]
        return q

    def _stance(self, width: float) -> Array | None:
        """Positions (nq,), standing at the origin; None if there are none."""
        com = [0.0, 0.0, self.com_height]
        ik = StandingKinematics(
            self,
            places=np.array([[0.0, 0.5 * width], [0.0, -0.5 * width]]),
            com=(com, com),
        )
        upright: Any = [1.0, 0.0, 0.0, 0.0]
        ik.prog().AddBoundingBoxConstraint(upright, upright, ik.q()[:4])
        q = np.zeros(ik.plant.num_positions())
        q[0] = 1.0
        q[6] = self.com_height
        for joint, angle in self.posture.items():
            q[ik.plant.GetJointByName(joint).position_start()] = angle
        return ik.nearest(q, com)


def _shaped(urdf: Path) -> tuple[Diagram, MultibodyPlant, SceneGraph]:
    """A diagram of a plant of the robot in `urdf` alone and its SceneGraph."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
    add_urdf(plant, urdf)
    with naming(f"urdf = {urdf}"):
        plant.Finalize()
    return builder.Build(), plant, scene_graph


def robot_names() -> list[str]:
    """The robots of the package.

    Returns:
        Their names, sorted.
    """
    return sorted(path.parent.name for path in MODELS.glob("*/robot.yaml"))


def load_robot(name: str, fidelity: str = "realistic") -> RobotModel:
    """Makes the model of a robot.

    Args:
        name: of a robot of the package, or the path of a robot.yaml.
        fidelity: one of FIDELITIES.

    Returns:
        The model.

    Raises:
        ValueError: unknown name, fidelity or field, malformed YAML or URDF, a
            value out of range; one line that names it.
        FileNotFoundError: the robot.yaml or its URDF does not exist.
    """
    require(
        fidelity in FIDELITIES,
        f"fidelity = {fidelity!r}: must be one of {', '.join(FIDELITIES)}",
    )
    params, urdf = load_robot_params(name)
    if fidelity == "ideal":
        params = idealised(params)
    return RobotModel(params, urdf)


def load_robot_params(name: str) -> tuple[RobotParams, Path]:
    """Reads the parameters of a robot.

    Lengths that its robot.yaml does not give are those of the URDF, other
    parameters are Nadia's, scaled to its `size`.

    Args:
        name: of a robot of the package, or the path of a robot.yaml.

    Returns:
        The parameters, and the path of the URDF.

    Raises:
        ValueError: as load_robot.
        FileNotFoundError: as load_robot.
    """
    path = _robot_file(name)
    if name not in robot_names():
        return _read_params(name, path)
    params, urdf = _params_of_package(
        name,
        tuple(
            file.stat().st_mtime_ns for file in sorted(path.parent.iterdir())
        ),
    )
    return copy.deepcopy(params), urdf


def whole_body_tree(name: str) -> dict[str, object]:
    """Reads the fields of `whole_body` that a robot.yaml gives.

    They are a layer of the controller's parameters (see parameters.layers).

    Args:
        name: of a robot of the package, or the path of a robot.yaml.

    Returns:
        The tree of these fields.

    Raises:
        ValueError: there is no such robot, or its file is malformed.
    """
    path = _robot_file(name)
    with naming(f"robot = {name}"):
        tree = load_tree(path.read_text(encoding="utf-8"))
    return cast(dict[str, object], tree.get("whole_body", {}))


def _robot_file(name: str) -> Path:
    if name in robot_names():
        return MODELS / name / "robot.yaml"
    path = Path(name)
    require(
        path.suffix in (".yaml", ".yml"),
        f"robot = {name!r}: must be one of {', '.join(robot_names())}, or a "
        "path to a robot.yaml",
    )
    if not path.is_file():
        raise FileNotFoundError(f"robot = {name}: no such file")
    return path


@lru_cache(maxsize=16)
def _params_of_package(
    name: str, changed: tuple[int, ...]
) -> tuple[RobotParams, Path]:
    """Reads a robot once, and again when one of its files has `changed`."""
    return _read_params(name, MODELS / name / "robot.yaml")


def _read_params(name: str, path: Path) -> tuple[RobotParams, Path]:
    source = f"robot = {name}"
    params = load_typed(RobotParams, source, filename=path)
    given = load_tree(path.read_text(encoding="utf-8"))
    urdf = path.parent / params.urdf
    with naming(source):
        for field in REQUIRED:
            require(field in given, f"{field}: must be given")
        params.validate_more()
    if not urdf.is_file():
        raise FileNotFoundError(f"urdf = {urdf}: no such file")
    with naming(f"urdf = {urdf}"):
        check_urdf(urdf)
    _, plant, scene_graph = _shaped(urdf)
    check_plant(plant, params)
    with naming(f"urdf = {urdf}"):
        params = with_lengths(
            params=params,
            given=given,
            plant=plant,
            inspector=scene_graph.model_inspector(),
        )
    with naming(source):
        check(params)
    return scaled(params, params.size, given), urdf
