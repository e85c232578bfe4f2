"""The robot: one robot.yaml, parsed alike for the plant and the controller."""

import contextlib
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path

import numpy as np
from pydrake.geometry import (
    CollisionFilterDeclaration,
    Convex,
    GeometrySet,
    RoleAssign,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import (
    ComPositionConstraint,
    InverseKinematics,
)
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlant,
    AddMultibodyPlantSceneGraph,
    ContactResults,
    CoulombFriction,
    MultibodyPlant,
    MultibodyPlantConfig,
)
from pydrake.multibody.tree import BodyIndex, ModelInstanceIndex
from pydrake.solvers import SnoptSolver
from pydrake.systems.framework import Diagram, DiagramBuilder

import nadia_balance
from nadia_balance import palette
from nadia_balance.core.bounds import check
from nadia_balance.core.ground import Ground
from nadia_balance.core.model import PointMassModel
from nadia_balance.core.size import scaled
from nadia_balance.core.walking import Side, rectangle
from nadia_balance.robot_checks import (
    check_plant,
    check_sizes,
    check_standing,
    check_urdf,
    effort_limits,
    improper_contacts,
    remarks_on,
)
from nadia_balance.robot_params import RobotParams, idealised
from nadia_balance.typed_yaml import load_tree, load_typed

# The folder `models` of a checkout or an installation.  `import models` would
# also find a user's folder of that name.
MODELS = next(
    folder
    for path in nadia_balance.__path__
    if (folder := Path(path) / "models").is_dir()
)


_ROUGH = CoulombFriction(0.8, 0.8)  # as in flat.urdf
_DEPTH = 0.5  # depth of the ground below its lowest point [m]

# realistic: limits of a real robot.  ideal: any torque at any joint speed, any
# foot speed, and no collisions between arms and legs.
FIDELITIES = ("realistic", "ideal")


class RobotModel:
    """A humanoid with two flat feet, as robot.yaml and its URDF describe it.

    `drives` are JointDriveParams; None if the robot is ideal (see `idealised`).
    `remarks` are warnings about legal but suspicious settings.
    """

    def __init__(self, params: RobotParams, urdf: Path):
        """Checks `params` against `urdf`.

        Raises:
            ValueError: `urdf` lacks a part, or the robot cannot stand with
                these parameters; names the field, its value and what is
                allowed.
        """
        self.params, self.urdf, self.name = params, urdf, params.name
        self.com_height, self.posture = params.com_height, params.posture
        self.whole_body = params.whole_body
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
        with self._naming_the_urdf():
            check_urdf(urdf)
        # A plant with shapes; the controller's plant has none.
        _, shaped, scene_graph = self.control_diagram()
        plant = self.control_plant()
        check_plant(plant, params)
        with self._naming_the_urdf():
            self.remarks = remarks_on(shaped, set(feet))
        check_sizes(shaped, scene_graph.model_inspector(), params)
        standing = self.standing_positions()
        with self._naming_the_urdf():
            check_standing(plant, standing, self.foot_bodies, self.X_FootSole)

    @cached_property
    def mass(self) -> float:
        """Total mass of the robot [kg]."""
        plant = self.control_plant()
        return plant.CalcTotalMass(plant.CreateDefaultContext())

    @cached_property
    def max_joint_speeds(self) -> np.ndarray:
        """Speed limits (nj,) [rad/s] of the joints, in the order of v."""
        speeds = self.control_plant().GetVelocityUpperLimits()[6:]
        return np.where(
            np.isfinite(speeds), speeds, self.params.max_joint_speed
        )

    @cached_property
    def point_mass(self) -> PointMassModel:
        """The robot's model for capture-point control."""
        return PointMassModel(
            mass=self.mass,
            com_height=self.com_height,
            step_width=self.params.step_width,
            sole=self.sole,
            legs=self.params.legs,
            reach=self.params.reachability,
            detour=self.params.swing_detour,
        )

    def add_to(self, plant: MultibodyPlant) -> ModelInstanceIndex:
        """Adds the robot to a `plant` that is not finalized yet.

        Raises:
            ValueError: the URDF is malformed; Drake's warnings count as
                errors, because Drake then substitutes values of its own.
        """
        parser = Parser(plant)
        parser.SetStrictParsing()
        with self._naming_the_urdf():
            instance = parser.AddModels(str(self.urdf))[0]
            _add_actuators(plant, instance, effort_limits(self.urdf))
        return instance

    def add_plant_to(
        self,
        builder: DiagramBuilder,
        config: MultibodyPlantConfig | None = None,
        ground: Ground | None = None,
    ) -> tuple[MultibodyPlant, SceneGraph]:
        """Adds a plant, finalized, in which the robot stands on the `ground`.

        `config` is by default `default_plant_config()`; see `add_ground`.
        """
        plant, scene_graph = AddMultibodyPlant(
            config or default_plant_config(), builder
        )
        self.stand_in(plant, scene_graph, ground)
        return plant, scene_graph

    def stand_in(
        self,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        ground: Ground | None = None,
    ) -> None:
        """Puts robot and `ground` into an empty `plant`; finalizes it."""
        self.add_to(plant)
        add_ground(plant, ground)
        plant.Finalize()
        if self.drives is None:
            self._let_pass(plant, scene_graph)
        plant.SetDefaultPositions(self.standing_positions())

    def _let_pass(self, plant: MultibodyPlant, scene_graph: SceneGraph) -> None:
        """Excludes the robot's self-collisions except those between its legs.

        The feet do not collide with each other either.
        """
        joints = map(plant.get_joint, plant.GetJointIndices())
        parent = {j.child_body().name(): j.parent_body().name() for j in joints}
        legs = []
        for link in self.foot_bodies.values():
            legs.append([])
            while link != self.pelvis_body:
                legs[-1].append(link)
                link = parent[link]
        pelvis = plant.GetBodyByName(self.pelvis_body)
        own = plant.GetBodyIndices(pelvis.model_instance())
        names = {plant.get_body(body).name() for body in own}

        def shapes(links: Iterable[str]) -> GeometrySet:
            return plant.CollectRegisteredGeometries(
                [plant.GetBodyByName(link) for link in links]
            )

        left, right = map(set, legs)
        others = shapes(names - left - right)
        scene_graph.collision_filter_manager().Apply(
            CollisionFilterDeclaration()
            .ExcludeWithin(shapes(left))
            .ExcludeWithin(shapes(right))
            .ExcludeWithin(shapes(self.foot_bodies.values()))
            .ExcludeWithin(others)
            .ExcludeBetween(others, shapes(left | right))
        )

    def control_plant(self) -> MultibodyPlant:
        """A plant of the robot alone, without geometry, finalized."""
        plant = MultibodyPlant(0.001)
        self.add_to(plant)
        with self._naming_the_urdf():
            plant.Finalize()
        return plant

    def control_diagram(self) -> tuple[Diagram, MultibodyPlant, SceneGraph]:
        """A diagram of a plant of the robot alone and its SceneGraph."""
        builder = DiagramBuilder()
        plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
        self.add_to(plant)
        with self._naming_the_urdf():
            plant.Finalize()
        return builder.Build(), plant, scene_graph

    def improper_contacts(
        self, plant: MultibodyPlant, contact_results: ContactResults
    ) -> set[str]:
        """Calls improper_contacts of robot_checks for this robot in `plant`."""
        robot = plant.GetBodyByName(self.pelvis_body).model_instance()
        feet = set(self.foot_bodies.values())
        return improper_contacts(plant, contact_results, robot, feet)

    def standing_positions(self, step_width: float | None = None) -> np.ndarray:
        """Returns q (nq,) of the robot, standing about the origin of W.

        Both soles are level on z = 0, `step_width` [m] apart, the pelvis is
        upright, the CoM over the origin at `com_height`, the joints as near
        to the posture as that allows.

        Raises:
            ValueError: no posture fulfils this.
        """
        width = self.params.step_width if step_width is None else step_width
        if not 0.0 < width < np.inf:
            raise ValueError(f"step_width = {width}: must be > 0 m")
        plant = self.control_plant()
        ik = InverseKinematics(plant)
        prog, q, world = ik.prog(), ik.q(), plant.world_frame()
        free = np.inf
        for side in Side:
            foot = plant.GetFrameByName(self.foot_bodies[side])
            y = 0.5 * side.sign * width
            # Three points with 3 + 2 + 1 fixed coordinates fix the sole.
            for p_S, low, high in (
                ([0.0, 0.0, 0.0], [0.0, y, 0.0], [0.0, y, 0.0]),
                ([0.1, 0.0, 0.0], [-free, y, 0.0], [free, y, 0.0]),
                ([0.0, 0.1, 0.0], [-free, -free, 0.0], [free, free, 0.0]),
            ):
                p_F = self.X_FootSole[side] @ p_S
                ik.AddPositionConstraint(foot, p_F, world, low, high)
        upright, over_origin = [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, self.com_height]
        prog.AddBoundingBoxConstraint(upright, upright, q[:4])
        com = prog.NewContinuousVariables(3, "com")
        prog.AddBoundingBoxConstraint(over_origin, over_origin, com)
        prog.AddConstraint(
            ComPositionConstraint(plant, None, world, ik.get_mutable_context()),
            [*q, *com],
        )
        nominal = np.zeros(plant.num_positions())
        nominal[0], nominal[6] = 1.0, self.com_height
        for joint, angle in self.posture.items():
            nominal[plant.GetJointByName(joint).position_start()] = angle
        prog.AddQuadraticErrorCost(np.eye(len(q)), nominal, q)
        prog.SetInitialGuess(q, nominal)
        prog.SetInitialGuess(com, over_origin)
        result = SnoptSolver().Solve(prog)
        if not result.is_success():
            legs = self.params.legs
            highest = legs.length + legs.ankle_height + legs.com_above_hip
            raise ValueError(
                f"step_width = {width}, com_height = {self.com_height}: must "
                f"be within reach of the legs of {self.name}, in m; with "
                f"straight ones, the CoM is {highest:.3f} m high"
            )
        return result.GetSolution(q)

    @contextlib.contextmanager
    def _naming_the_urdf(self) -> Iterator[None]:
        """Turns errors of its block into a ValueError that names the URDF."""
        try:
            yield
        # SystemExit is how pydrake reports a condition of Drake's own code.
        except (RuntimeError, ValueError, SyntaxError, SystemExit) as error:
            reason = " ".join(str(error).split())
            raise ValueError(f"urdf = {self.urdf}: {reason}") from error


def _add_actuators(
    plant: MultibodyPlant,
    instance: ModelInstanceIndex,
    effort_limits: dict[str, float],
) -> None:
    """Adds actuators to joints for which the URDF has no <transmission>."""
    # All actuators: those of an instance are known only once it is finalized.
    actuators = map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
    driven = [actuator.joint().index() for actuator in actuators]
    if len(set(driven)) < len(driven):
        raise ValueError("a joint must not have two <transmission>s")
    for joint in map(plant.get_joint, plant.GetJointIndices(instance)):
        limit = effort_limits.get(joint.name())
        if limit and joint.num_positions() and joint.index() not in driven:
            plant.AddJointActuator(joint.name(), joint, limit)


def robot_names() -> list[str]:
    """The names of the robots of the package."""
    return sorted(path.parent.name for path in MODELS.glob("*/robot.yaml"))


def load_robot(name: str, fidelity: str = "realistic") -> RobotModel:
    """Returns the robot `name` of the package, or of the robot.yaml `name`.

    Raises:
        ValueError: unknown name, fidelity or field, malformed YAML or URDF, a
            value out of range; one line that names it.
        FileNotFoundError: the robot.yaml or its URDF does not exist.
    """
    if fidelity not in FIDELITIES:
        raise ValueError(
            f"fidelity = {fidelity!r}: must be one of {', '.join(FIDELITIES)}"
        )
    params, urdf = load_robot_params(name)
    if fidelity == "ideal":
        params = idealised(params)
    return RobotModel(params, urdf)


def load_robot_params(name: str) -> tuple[RobotParams, Path]:
    """Returns the parameters of a robot.yaml, and the path of its URDF.

    Parameters that it does not give are Nadia's, scaled to its `size`.

    Raises:
        ValueError, FileNotFoundError: as load_robot, but the URDF is not read.
    """
    what, path = f"robot = {name}", Path(name)
    if name in robot_names():
        path = MODELS / name / "robot.yaml"
    elif path.suffix not in (".yaml", ".yml"):
        raise ValueError(
            f"robot = {name!r}: must be one of {', '.join(robot_names())}, "
            "or a path to a robot.yaml"
        )
    if not path.is_file():
        raise FileNotFoundError(f"{what}: no such file")
    params = load_typed(RobotParams, what, filename=path)
    try:
        check(params)
    except ValueError as error:
        raise ValueError(f"{what}: {error}") from None
    urdf = path.parent / params.urdf
    if not urdf.is_file():
        raise FileNotFoundError(f"urdf = {urdf}: no such file")
    given = load_tree(path.read_text(encoding="utf-8"))
    return scaled(params, params.size, given), urdf


def actuated_velocities(plant: MultibodyPlant) -> np.ndarray:
    """Index (nu,) in v of `plant` of each actuator's joint."""
    actuators = map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
    return np.array([a.joint().velocity_start() for a in actuators])


def default_plant_config() -> MultibodyPlantConfig:
    """Point contact at 1 kHz: the fastest that is accurate enough."""
    return MultibodyPlantConfig(
        time_step=0.001,
        contact_model="point",
        discrete_contact_approximation="sap",
        use_sampled_output_ports=False,
    )


def add_ground(plant: MultibodyPlant, ground: Ground | None = None) -> None:
    """Adds the ground to a `plant` that is not finalized yet.

    The ground is flat, z = 0, unless `ground` is uneven: then each of its
    regions is the visible top of a rigid prism with the same friction.
    """
    if ground is None or ground.is_level:
        Parser(plant).AddModels(str(MODELS / "terrain" / "flat.urdf"))
        return
    tops = [
        np.column_stack([r.polygon, r.heights(r.polygon)])
        for r in ground.regions
    ]
    bottom = min(top[:, 2].min() for top in tops) - _DEPTH
    for i, top in enumerate(tops):
        below = top * [1.0, 1.0, 0.0] + [0.0, 0.0, bottom]
        shape = Convex(np.vstack([top, below]).T, name := f"region {i}")
        where = plant.world_body(), RigidTransform(), shape, name
        plant.RegisterCollisionGeometry(*where, _ROUGH)
        plant.RegisterVisualGeometry(*where, palette.rgba(palette.GROUND).rgba)


def scale_friction(
    plant: MultibodyPlant, scene_graph: SceneGraph, ratio: float
) -> None:
    """Multiplies all friction coefficients in a finalized `plant`."""
    inspector = scene_graph.model_inspector()
    for i in range(plant.num_bodies()):
        body = plant.get_body(BodyIndex(i))
        for shape in plant.GetCollisionGeometriesForBody(body):
            properties = inspector.GetProximityProperties(shape)
            mu = properties.GetProperty("material", "coulomb_friction")
            scaled_mu = CoulombFriction(
                ratio * mu.static_friction(), ratio * mu.dynamic_friction()
            )
            properties.UpdateProperty("material", "coulomb_friction", scaled_mu)
            scene_graph.AssignRole(
                plant.get_source_id(), shape, properties, RoleAssign.kReplace
            )
