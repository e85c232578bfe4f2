"""The robot: one robot.yaml, parsed alike for the plant and the controller."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import models
import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.inverse_kinematics import (
    ComPositionConstraint,
    InverseKinematics,
)
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.solvers import SnoptSolver

from nadia_balance.core.com_height import LegGeometry
from nadia_balance.core.lipm import natural_frequency
from nadia_balance.core.walking import Side, rectangle
from nadia_balance.core.whole_body_params import WholeBodyQpParams
from nadia_balance.typed_yaml import load_typed

MODELS = Path(next(iter(models.__path__)))


@dataclass(kw_only=True)
class SoleParams:
    """The rectangle of either sole in the frame of its foot body."""

    x_min: float = 0.0  # heel [m]
    x_max: float = 0.0  # toe [m]
    half_width: float = 0.0  # [m]
    z: float = 0.0  # [m]


@dataclass(kw_only=True)
class RobotParams:
    """The fields of robot.yaml."""

    name: str = ""
    urdf: str = ""  # relative to robot.yaml
    pelvis_body: str = ""  # the floating base
    torso_body: str = ""
    left_foot_body: str = ""
    right_foot_body: str = ""
    sole: SoleParams = field(default_factory=SoleParams)
    com_height: float = 0.0  # of the CoM above the soles, standing [m]
    step_width: float = 0.0  # between the sole centres, standing [m]
    posture: dict[str, float] = field(default_factory=dict)  # [rad]
    legs: LegGeometry = field(default_factory=LegGeometry)
    max_joint_speed: float = 20.0  # runs are checked against it [rad/s]
    whole_body: WholeBodyQpParams = field(default_factory=WholeBodyQpParams)

    def validate(self) -> None:
        """Raises ValueError naming the field, its value, what is allowed."""
        for name in ("com_height", "step_width", "max_joint_speed"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise ValueError(f"{name} = {value}: must be > 0")
        for name, value in {
            "sole.x_max - sole.x_min": self.sole.x_max - self.sole.x_min,
            "sole.half_width": self.sole.half_width,
        }.items():
            if not 0.0 < value < math.inf:
                raise ValueError(f"{name} = {value}: must be > 0 m")
        for joint, angle in self.posture.items():
            if not math.isfinite(angle):
                raise ValueError(f"posture.{joint} = {angle}: must be finite")
        self.legs.validate()
        self.whole_body.validate()


class RobotModel:
    """A humanoid with two flat feet, as robot.yaml and its URDF describe it."""

    def __init__(self, params: RobotParams, urdf: Path):
        """Checks that `urdf` has all that the `params` name.

        Raises:
            ValueError: it has not; the message names what is missing.
        """
        params.validate()
        self.params, self.urdf, self.name = params, urdf, params.name
        self.com_height, self.posture = params.com_height, params.posture
        self.omega = natural_frequency(params.com_height)
        self.legs, self.whole_body = params.legs, params.whole_body
        self.pelvis_body, self.torso_body = params.pelvis_body, params.torso_body
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
        self._check(self.control_plant())

    def _check(self, plant: MultibodyPlant) -> None:
        where = f"robot {self.name!r}"
        bodies = [self.pelvis_body, self.torso_body, *self.foot_bodies.values()]
        for body in bodies:
            if not plant.HasBodyNamed(body):
                raise ValueError(f"{where}: no body {body!r} in {self.urdf}")
        for joint in self.posture:
            if not plant.HasJointNamed(joint):
                raise ValueError(f"{where}: no joint {joint!r} in {self.urdf}")
        joints = plant.num_velocities() - 6
        if not plant.num_actuators() == joints > 0:
            raise ValueError(
                f"{where}: {plant.num_actuators()} actuators for {joints} "
                f"joints in {self.urdf}: every joint needs a <transmission>"
            )
        if not self.mass > 0.0:
            raise ValueError(f"{where}: mass = {self.mass}: must be > 0 kg")

    @cached_property
    def mass(self) -> float:
        """Of the whole robot [kg]."""
        plant = self.control_plant()
        return plant.CalcTotalMass(plant.CreateDefaultContext())

    def add_to(self, plant: MultibodyPlant) -> ModelInstanceIndex:
        """Adds the robot to a `plant` that is not finalized yet.

        Raises:
            ValueError: the URDF is malformed.
        """
        try:
            return Parser(plant).AddModels(str(self.urdf))[0]
        except RuntimeError as error:
            raise ValueError(f"urdf = {self.urdf}: {error}") from error

    def control_plant(self) -> MultibodyPlant:
        """A plant of the robot alone, without geometry, finalized."""
        plant = MultibodyPlant(0.001)
        self.add_to(plant)
        plant.Finalize()
        return plant

    def standing_positions(self, step_width: float | None = None) -> np.ndarray:
        """Returns the robot's q (nq,): stands about the origin of W.

        Both soles are level on z = 0, `step_width` [m] apart, the pelvis is
        upright, the CoM over the origin at `com_height`, the joints as near
        to the posture as that allows.

        Raises:
            ValueError: there is no such posture.
        """
        width = self.params.step_width if step_width is None else step_width
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
                f"robot {self.name!r}: cannot stand with com_height = "
                f"{self.com_height} m and step_width = {width} m"
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
            of range; the message names it.
        FileNotFoundError: there is no such file.
    """
    if name in robot_names():
        path = MODELS / name / "robot.yaml"
    elif name.endswith(".yaml"):
        path = Path(name)
    else:
        raise ValueError(
            f"robot = {name!r}: must be one of {', '.join(robot_names())}, "
            "or a path to a robot.yaml"
        )
    if not path.is_file():
        raise FileNotFoundError(f"robot = {name}: no such file")
    params = load_typed(RobotParams, "robot", filename=str(path))
    urdf = path.parent / params.urdf
    if not urdf.is_file():
        raise FileNotFoundError(f"urdf = {urdf}: no such file")
    return RobotModel(params, urdf)


def terrain_file() -> Path:
    """The flat ground."""
    return MODELS / "terrain" / "flat.urdf"
