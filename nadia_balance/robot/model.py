"""The robot: one robot.yaml, parsed alike for the plant and the controller."""

import copy
import functools
import math
from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import CollisionFilterDeclaration, GeometrySet, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody import plant as mbp
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex
from pydrake.systems.framework import Diagram, DiagramBuilder

from nadia_balance.core.body.ground import Ground
from nadia_balance.core.body.model import PointMassModel
from nadia_balance.core.math.arrays import rectangle
from nadia_balance.core.walking.state import ORIGIN, FootPose, Side
from nadia_balance.parameters.bounds import check
from nadia_balance.parameters.scaling import scaled
from nadia_balance.parameters.yaml_reader import load_tree, load_typed
from nadia_balance.robot import params as robot_params
from nadia_balance.robot import plants
from nadia_balance.robot import urdf as robot_urdf
from nadia_balance.robot.leg_strength import StandingKinematics, StandingLegs
from nadia_balance.robot.params import MODELS, RobotParams
from nadia_balance.robot.urdf import add_urdf, naming

# realistic: limits of a real robot.  ideal: full torque at any joint speed, any
# foot speed, and no collisions between arms and legs.
FIDELITIES = ("realistic", "ideal")


class RobotModel:
    """A humanoid with two flat feet, as robot.yaml and its URDF describe it.

    `drives` are JointDriveParams; None if the robot is ideal (see `idealised`).
    `remarks` are warnings about legal but suspicious settings.
    """

    def __init__(self, params: RobotParams, urdf: Path):
        """Takes `params` and `urdf` of `load_robot_params`.

        Raises ValueError: the robot cannot stand with these parameters; names
        the field, its value and what is allowed.
        """
        self.params, self.urdf, self.name = params, urdf, params.name
        self.com_height, self.posture = params.com_height, params.posture
        self.drives = params.drives
        self.pelvis_body = params.pelvis_body
        self.torso_body = params.torso_body
        feet = params.left_foot_body, params.right_foot_body
        self.foot_bodies = dict(zip(Side, feet, strict=True))
        sole = params.sole
        self.sole_length = sole.x_max - sole.x_min
        self.sole_width = 2.0 * sole.half_width
        self.sole = rectangle(self.sole_length, self.sole_width)
        centre = [0.5 * (sole.x_min + sole.x_max), 0.0, sole.z]
        self.X_FootSole = {side: RigidTransform(centre) for side in Side}
        _, plant, _ = self.control_diagram()
        self.remarks = robot_urdf.remarks_on(plant, set(feet))
        with naming(f"urdf = {urdf}"):
            StandingLegs(self, self.standing_positions()).check_standing()

    @cached_property
    def mass(self) -> float:
        """Total mass of the robot [kg]."""
        plant = self.control_plant()
        return plant.CalcTotalMass(plant.CreateDefaultContext())

    @cached_property
    def max_joint_speeds(self) -> np.ndarray:
        """Speed limits (nj,) [rad/s] of the joints, in the order of v.

        Ideal drives have none: inf.
        """
        speeds = self.control_plant().GetVelocityUpperLimits()[6:]
        if self.drives is None:
            return np.full(speeds.size, np.inf)
        known = np.isfinite(speeds)
        return np.where(known, speeds, self.params.max_joint_speed)

    @cached_property
    def point_mass(self) -> PointMassModel:
        """The robot's model for capture-point control."""
        legs = StandingLegs(self, self.standing_positions())
        a, v = legs.foot_limits(self.max_joint_speeds)
        own = self.params.swing_detour
        most = {"max_acceleration": min(a, own.max_acceleration)}
        detour = replace(own, max_speed=min(v, own.max_speed), **most)
        reach, apart = self.params.reachability, 0.0
        if avoidance := self.params.whole_body.avoidance:
            _, shaped, scene_graph = self.control_diagram()
            seen, feet = scene_graph.model_inspector(), self.foot_bodies
            width = robot_urdf.foot_width(shaped, seen, feet.values())
            width = max(width, self.sole_width)
            apart = width + avoidance.clearance
            beside = max(detour.beside, apart + 0.5 * avoidance.clearance)
            detour = replace(detour, beside=beside)
            reach = replace(reach, width_min=max(reach.width_min, apart))
        return PointMassModel(
            mass=self.mass,
            com_height=self.com_height,
            step_width=self.params.step_width,
            sole=self.sole,
            held=legs.cop_area(self.sole),
            legs=self.params.legs,
            reach=reach,
            sole_clearance=max(apart - self.sole_width, 0.0),
            detour=detour,
        )

    def add_to(self, plant: MultibodyPlant) -> ModelInstanceIndex:
        """Adds the robot to a `plant` that is not finalized yet.

        Raises ValueError: the URDF is malformed (see `add_urdf`), or a torque
        limit is of an unknown joint.
        """
        instance = add_urdf(plant, self.urdf)
        limits = dict(self.drives.max_torque) if self.drives else {}
        for actuator in plants.actuators(plant):
            if actuator.model_instance() == instance:
                own = actuator.joint().name(), actuator.effort_limit()
                actuator.set_effort_limit(limits.pop(*own))
        for joint in limits:
            why = f"must be of an actuated joint of {self.name}"
            raise ValueError(f"drives.max_torque.{joint}: {why}")
        return instance

    def add_plant_to(
        self,
        builder: DiagramBuilder,
        time_step: float = 0.001,
        ground: Ground | None = None,
    ) -> tuple[MultibodyPlant, SceneGraph]:
        """Adds a plant, finalized, in which the robot stands on the `ground`.

        It has point contacts and this `time_step` [s], by default the longest
        that is accurate enough; see `add_ground`.
        """
        config = mbp.MultibodyPlantConfig(
            time_step=time_step,
            contact_model="point",
            discrete_contact_approximation="sap",
            use_sampled_output_ports=False,
        )
        plant, scene_graph = mbp.AddMultibodyPlant(config, builder)
        self.stand_in(plant, scene_graph, ground)
        return plant, scene_graph

    def stand_in(self, plant: MultibodyPlant, scene_graph, ground=None) -> None:
        """Puts robot and `ground` into an empty `plant`; finalizes it."""
        self.add_to(plant)
        plants.add_ground(plant, ground)
        plant.Finalize()
        if not self.params.self_collisions:
            self._let_pass(plant, scene_graph)
        plant.SetDefaultPositions(self.standing_positions())

    def _let_pass(self, plant: MultibodyPlant, scene_graph: SceneGraph) -> None:
        """Excludes self-collisions but between the legs, without the feet."""
        pelvis = plant.GetBodyByName(self.pelvis_body)
        own = set(plant.GetBodyIndices(pelvis.model_instance()))
        feet = self.foot_bodies.values()
        hips = [plants.joints_above(plant, foot)[-1].index() for foot in feet]
        moved = plant.GetBodiesKinematicallyAffectedBy
        left, right = (set(moved([hip])) for hip in hips)

        def shapes(links: Iterable[BodyIndex]) -> GeometrySet:
            bodies = [plant.get_body(link) for link in links]
            return plant.CollectRegisteredGeometries(bodies)

        others = shapes(own - left - right)
        soles = shapes(plant.GetBodyByName(foot).index() for foot in feet)
        scene_graph.collision_filter_manager().Apply(
            CollisionFilterDeclaration()
            .ExcludeWithin(shapes(left))
            .ExcludeWithin(shapes(right))
            .ExcludeWithin(soles)
            .ExcludeWithin(others)
            .ExcludeBetween(others, shapes(left | right))
        )

    def control_plant(self) -> MultibodyPlant:
        """A plant of the robot alone, without geometry, finalized."""
        plant = MultibodyPlant(0.001)
        self.add_to(plant)
        plant.Finalize()
        return plant

    def control_diagram(self) -> tuple[Diagram, MultibodyPlant, SceneGraph]:
        """A diagram of a plant of the robot alone and its SceneGraph."""
        return _shaped(self.urdf)

    def improper_contacts(self, plant: MultibodyPlant, results) -> set[str]:
        """Calls plants.improper_contacts for this robot in `plant`."""
        robot = plant.GetBodyByName(self.pelvis_body).model_instance()
        feet = set(self.foot_bodies.values())
        return plants.improper_contacts(plant, results, robot, feet)

    def standing_positions(
        self, step_width: float | None = None, place: FootPose = ORIGIN
    ) -> np.ndarray:
        """Returns q (nq,) of the robot, standing about the `place` in W.

        Both soles are level on z = 0, `step_width` [m] apart, the pelvis is
        upright, the CoM over the place at `com_height`, the joints as near
        to the posture as that allows.

        Raises ValueError: no posture fulfils this.
        """
        width = self.params.step_width if step_width is None else step_width
        if not 0.0 < width < np.inf:
            raise ValueError(f"step_width = {width}: must be > 0 m")
        com = [0.0, 0.0, self.com_height]
        places = np.array([[0.0, 0.5 * width], [0.0, -0.5 * width]])
        found = StandingKinematics(self, places, (com, com))
        upright = [1.0, 0.0, 0.0, 0.0]
        found.prog().AddBoundingBoxConstraint(upright, upright, found.q()[:4])
        nominal = np.zeros(found.plant.num_positions())
        nominal[0], nominal[6] = 1.0, self.com_height
        for joint, angle in self.posture.items():
            i = found.plant.GetJointByName(joint).position_start()
            nominal[i] = angle
        if (q := found.nearest(nominal, com)) is not None:
            half = 0.5 * place.yaw
            turn = Quaternion(math.cos(half), 0, 0, math.sin(half))
            q[:4] = turn.multiply(Quaternion(q[:4])).wxyz()
            q[4:6] = place.to_world(q[None, 4:6])[0]
            return q
        legs = self.params.legs
        highest = legs.length + legs.ankle_height + legs.com_above_hip
        what = f"step_width = {width}, com_height = {self.com_height}"
        must = f"must be within reach of the legs of {self.name}, in m"
        why = f"with straight ones, the CoM is {highest:.3f} m high"
        raise ValueError(f"{what}: {must}; {why}")


def _shaped(urdf: Path) -> tuple[Diagram, MultibodyPlant, SceneGraph]:
    """A diagram of a plant of the robot in `urdf` alone and its SceneGraph."""
    builder = DiagramBuilder()
    plant, scene_graph = mbp.AddMultibodyPlantSceneGraph(builder, 0.001)
    add_urdf(plant, urdf)
    with naming(f"urdf = {urdf}"):
        plant.Finalize()
    return builder.Build(), plant, scene_graph


def robot_names() -> list[str]:
    """The names of the robots of the package."""
    return sorted(path.parent.name for path in MODELS.glob("*/robot.yaml"))


def load_robot(name: str, fidelity: str = "realistic") -> RobotModel:
    """Returns the robot `name` of the package, or of the robot.yaml `name`.

    Raises ValueError: unknown name, fidelity or field, malformed YAML or URDF,
    a value out of range; one line that names it; FileNotFoundError: the
    robot.yaml or its URDF does not exist.
    """
    if fidelity not in FIDELITIES:
        which = f"must be one of {', '.join(FIDELITIES)}"
        raise ValueError(f"fidelity = {fidelity!r}: {which}")
    params, urdf = load_robot_params(name)
    if fidelity == "ideal":
        params = robot_params.idealised(params)
    return RobotModel(params, urdf)


def load_robot_params(name: str) -> tuple[RobotParams, Path]:
    """Returns the parameters of a robot.yaml, and the path of its URDF.

    Lengths that it does not give are those of the URDF, other parameters are
    Nadia's, scaled to its `size`.

    Args:
        name: of a robot of the package, or the path of a robot.yaml.

    Raises:
        ValueError: as load_robot.
        FileNotFoundError: as load_robot.
    """
    path = _robot_file(name)
    if name not in robot_names():
        return _read_params(name, path)
    files = sorted(path.parent.iterdir())
    changed = tuple(file.stat().st_mtime_ns for file in files)
    params, urdf = _params_of_package(name, changed)
    return copy.deepcopy(params), urdf


def whole_body_tree(name: str) -> dict[str, object]:
    """Returns the fields of `whole_body` that a robot.yaml gives.

    They are a layer of the controller's parameters (see parameters.layers).

    Args:
        name: of a robot of the package, or the path of a robot.yaml.
    """
    tree = load_tree(_robot_file(name).read_text(encoding="utf-8"))
    fields: dict[str, object] = tree.get("whole_body", {})
    return fields


def _robot_file(name: str) -> Path:
    if name in robot_names():
        return MODELS / name / "robot.yaml"
    path = Path(name)
    if path.suffix not in (".yaml", ".yml"):
        raise ValueError(
            f"robot = {name!r}: must be one of {', '.join(robot_names())}, or "
            "a path to a robot.yaml"
        )
    if not path.is_file():
        raise FileNotFoundError(f"robot = {name}: no such file")
    return path


@functools.lru_cache(maxsize=16)
def _params_of_package(name: str, changed: tuple) -> tuple[RobotParams, Path]:
    """Reads a robot once, and again when one of its files has `changed`."""
    return _read_params(name, MODELS / name / "robot.yaml")


def _read_params(name: str, path: Path) -> tuple[RobotParams, Path]:
    what = f"robot = {name}"
    params = load_typed(RobotParams, what, filename=path)
    given = load_tree(path.read_text(encoding="utf-8"))
    urdf = path.parent / params.urdf
    with naming(what):
        params.validate_more()
    if not urdf.is_file():
        raise FileNotFoundError(f"urdf = {urdf}: no such file")
    with naming(f"urdf = {urdf}"):
        robot_urdf.check_urdf(urdf)
    _, plant, scene_graph = _shaped(urdf)
    robot_urdf.check_plant(plant, params)
    with naming(f"urdf = {urdf}"):
        inspector = scene_graph.model_inspector()
        params = robot_urdf.with_lengths(params, given, plant, inspector)
    with naming(what):
        check(params)
    return scaled(params, params.size, given), urdf
