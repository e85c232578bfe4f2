"""The robot: one robot.yaml, parsed alike for the plant and the controller."""

import contextlib
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

import numpy as np
from pydrake.geometry import SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import (
    ComPositionConstraint,
    InverseKinematics,
)
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import ContactResults, MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.solvers import SnoptSolver

from nadia_balance.core.lipm import natural_frequency
from nadia_balance.core.robot_params import RobotParams
from nadia_balance.core.walking import Side, rectangle
from nadia_balance.robot_checks import (
    check_plant,
    check_urdf,
    improper_contacts,
)
from nadia_balance.typed_yaml import load_typed

# Beside the package in a checkout as well as in an installation.  Not found
# by `import models`: a user may have a folder of that name.
MODELS = Path(__file__).resolve().parents[1] / "models"


class RobotModel:
    """A humanoid with two flat feet, as robot.yaml and its URDF describe it."""

    def __init__(self, params: RobotParams, urdf: Path):
        """Checks that `urdf` has all that the `params` name.

        Raises:
            ValueError: it has not, or the robot cannot stand as they say; the
                message names the field, its value and what is allowed.
        """
        params.validate()
        self.params, self.urdf, self.name = params, urdf, params.name
        self.com_height, self.posture = params.com_height, params.posture
        self.omega = natural_frequency(params.com_height)
        self.legs, self.whole_body = params.legs, params.whole_body
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
        centre = [0.5 * (sole.x_min + sole.x_max), 0.0, sole.z]
        self.X_FootSole = {side: RigidTransform(centre) for side in Side}
        self._check()

    @cached_property
    def mass(self) -> float:
        """Of the whole robot [kg]."""
        plant = self.control_plant()
        return plant.CalcTotalMass(plant.CreateDefaultContext())

    def add_to(self, plant: MultibodyPlant) -> ModelInstanceIndex:
        """Adds the robot to a `plant` that is not finalized yet.

        Raises:
            ValueError: the URDF is malformed; what Drake would only warn of
                counts as such, because it then invents figures of its own.
        """
        parser = Parser(plant)
        parser.SetStrictParsing()
        with self._naming_the_urdf():
            return parser.AddModels(str(self.urdf))[0]

    def control_plant(self) -> MultibodyPlant:
        """A plant of the robot alone, without geometry, finalized."""
        plant = MultibodyPlant(0.001)
        self.add_to(plant)
        with self._naming_the_urdf():
            plant.Finalize()
        return plant

    def improper_contacts(
        self, plant: MultibodyPlant, contact_results: ContactResults
    ) -> set[str]:
        """Returns the pairs of bodies in contact that are not foot and ground.

        By name, such as "LEFT_SHIN_LINK - RIGHT_SHIN_LINK" or "PELVIS_LINK -
        ground", in the `contact_results` of a `plant` with this robot.
        """
        pelvis = plant.GetBodyByName(self.pelvis_body)
        return improper_contacts(
            plant,
            contact_results,
            pelvis.model_instance(),
            set(self.foot_bodies.values()),
        )

    def standing_positions(self, step_width: float | None = None) -> np.ndarray:
        """Returns the robot's q (nq,): stands about the origin of W.

        Both soles are level on z = 0, `step_width` [m] apart, the pelvis is
        upright, the CoM over the origin at `com_height`, the joints as near
        to the posture as that allows.

        Raises:
            ValueError: there is no such posture.
        """
        width = self.params.step_width if step_width is None else step_width
        if not 0.0 < width < np.inf:
            raise ValueError(f"step_width = {width}: must be > 0 m")
        plant = self.control_plant()
        ik = InverseKinematics(plant)
        prog, q = ik.prog(), ik.q()
        for side in Side:
            self._plant_sole(ik, plant, side, 0.5 * side.sign * width)
        upright = np.array([1.0, 0.0, 0.0, 0.0])
        prog.AddBoundingBoxConstraint(upright, upright, q[:4])
        com = prog.NewContinuousVariables(3, "com")
        over_origin = np.array([0.0, 0.0, self.com_height])
        prog.AddBoundingBoxConstraint(over_origin, over_origin, com)
        prog.AddConstraint(
            ComPositionConstraint(
                plant, None, plant.world_frame(), ik.get_mutable_context()
            ),
            np.concatenate([q, com]),
        )
        nominal = self._nominal_positions(plant)
        prog.AddQuadraticErrorCost(np.eye(len(q)), nominal, q)
        prog.SetInitialGuess(q, nominal)
        prog.SetInitialGuess(com, over_origin)
        result = SnoptSolver().Solve(prog)
        if not result.is_success():
            raise ValueError(
                f"step_width = {width}, com_height = {self.com_height}: must "
                f"be within reach of the legs of {self.name}, in m"
            )
        return result.GetSolution(q)

    def _plant_sole(
        self,
        ik: InverseKinematics,
        plant: MultibodyPlant,
        side: Side,
        y: float,
    ) -> None:
        """Constrains a sole's centre to (0, y, 0), level, pointing ahead."""
        foot = plant.GetFrameByName(self.foot_bodies[side])
        X_FS = self.X_FootSole[side]
        free = np.inf
        # Three points with 3 + 2 + 1 fixed coordinates fix the pose.
        for p_S, low, high in (
            ([0.0, 0.0, 0.0], [0.0, y, 0.0], [0.0, y, 0.0]),
            ([0.1, 0.0, 0.0], [-free, y, 0.0], [free, y, 0.0]),
            ([0.0, 0.1, 0.0], [-free, -free, 0.0], [free, free, 0.0]),
        ):
            ik.AddPositionConstraint(
                foot, X_FS @ p_S, plant.world_frame(), low, high
            )

    def _check(self) -> None:
        with self._naming_the_urdf():
            check_urdf(self.urdf)
        # Once with all shapes: the plant of the controller reads none.
        plant, scene_graph = MultibodyPlant(0.001), SceneGraph()
        plant.RegisterAsSourceForSceneGraph(scene_graph)
        self.add_to(plant)
        check_plant(self.control_plant(), self.params)
        self.standing_positions()

    @contextlib.contextmanager
    def _naming_the_urdf(self) -> Iterator[None]:
        """Turns all errors within into a ValueError that names the URDF."""
        try:
            yield
        # SystemExit is how pydrake reports a condition of Drake's own code.
        except (RuntimeError, ValueError, SyntaxError, SystemExit) as error:
            reason = " ".join(str(error).split())
            raise ValueError(f"urdf = {self.urdf}: {reason}") from error

    def _nominal_positions(self, plant: MultibodyPlant) -> np.ndarray:
        q = np.zeros(plant.num_positions())
        q[0], q[6] = 1.0, self.com_height
        for joint, angle in self.posture.items():
            q[plant.GetJointByName(joint).position_start()] = angle
        return q


def robot_names() -> list[str]:
    """The robots that come with the package."""
    return sorted(path.parent.name for path in MODELS.glob("*/robot.yaml"))


def load_robot(name: str) -> RobotModel:
    """Returns the robot `name` of the package, or of the robot.yaml `name`.

    Raises:
        ValueError: unknown name or field, malformed YAML or URDF, a value out
            of range; one line that names it.
        FileNotFoundError: there is no such file.
    """
    params = load_robot_params(name)
    urdf = _robot_yaml(name).parent / params.urdf
    if not urdf.is_file():
        raise FileNotFoundError(f"urdf = {urdf}: no such file")
    return RobotModel(params, urdf)


def load_robot_params(name: str) -> RobotParams:
    """Returns what its robot.yaml says of the robot `name`.

    Raises as `load_robot`, but for what is wrong with the URDF.
    """
    path = _robot_yaml(name)
    params = load_typed(RobotParams, f"robot = {name}", filename=str(path))
    for field in ("name", "urdf"):
        if not getattr(params, field):
            raise ValueError(f"robot = {name}: {field} = '': must not be empty")
    params.validate()
    return params


def _robot_yaml(name: str) -> Path:
    if name in robot_names():
        path = MODELS / name / "robot.yaml"
    elif name.endswith((".yaml", ".yml")):
        path = Path(name)
    else:
        raise ValueError(
            f"robot = {name!r}: must be one of {', '.join(robot_names())}, "
            "or a path to a robot.yaml"
        )
    if not path.is_file():
        raise FileNotFoundError(f"robot = {name}: no such file")
    return path


def terrain_file() -> Path:
    """The flat ground."""
    return MODELS / "terrain" / "flat.urdf"
