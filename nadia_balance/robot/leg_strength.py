"""What the joints of the legs can do: to stand, in the air, at the ankle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike
from pydrake.multibody.inverse_kinematics import (
    ComPositionConstraint,
    InverseKinematics,
)
from pydrake.multibody.tree import JacobianWrtVariable, Joint
from pydrake.solvers import SnoptSolver

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.state import Side
from nadia_balance.parameters.bounds import require
from nadia_balance.robot.plants import (
    actuators,
    effort_limits,
    joints_above,
    knee_among,
)

if TYPE_CHECKING:
    from nadia_balance.robot.model import RobotModel

_HORIZONTAL = np.eye(6)[:, 3:5]  # [w, v] of a foot that moves along x, along y
# Peak over mean speed of a quintic from rest to rest [-], and share of the
# joints' speed for the path over the ground: the rest lifts the foot.
_PEAK, _SHARE = 1.875, 0.7
_DIGITS = 4  # of lengths [m], more than any drive is known to


class FootLimits(NamedTuple):
    """What the joints of the legs leave to a foot, and which joints these are.

    Args:
        acceleration: largest, horizontal [m/s^2].
        speed: largest, horizontal, mean of a swing [m/s].
        weakest: joint that limits the acceleration.
        slowest: joint that limits the speed.
    """

    acceleration: float
    speed: float
    weakest: str
    slowest: str


class StandingLegs:
    """The legs of a robot that stands at rest.

    Args:
        robot: a RobotModel.
        q: its positions (nq,).
    """

    def __init__(self, robot: RobotModel, q: Array) -> None:
        self.robot = robot
        self.plant = robot.control_plant()
        self.context = self.plant.CreateDefaultContext()
        self.plant.SetPositions(self.context, cast(Any, q))

    def check_standing(self) -> None:
        """Checks that the robot can stand on both feet.

        Half of its weight is at the centre of either sole.

        Raises:
            ValueError: a joint is too weak.
        """
        torques = self.standing_torques(dict.fromkeys(Side, 0.5))
        for drive in actuators(self.plant):
            needed = abs(torques[drive.joint().velocity_start()])
            require(
                needed <= drive.effort_limit(),
                f"effort limit of {drive.joint().name()} = "
                f"{drive.effort_limit():g}: must be >= {needed:.0f} N m, for "
                "the robot to stand",
            )

    def standing_torques(self, shares: Mapping[Side, float]) -> Array:
        """Torques that hold the robot: tau = -tau_g - sum_i J_i' F_i.

        Args:
            shares: of the weight that act at the centres of these soles.

        Returns:
            Torques (nv,) [N m], in the order of v.
        """
        plant = self.plant
        weight = -plant.CalcTotalMass(self.context) * np.asarray(
            plant.gravity_field().gravity_vector()
        )
        torques = -np.asarray(plant.CalcGravityGeneralizedForces(self.context))
        for side, share in shares.items():
            torques -= share * weight @ self._jacobian(side)[3:]
        return torques

    def foot_limits(self, speeds: Array) -> FootLimits:
        """The largest acceleration and mean speed of a foot: J qdd = d a.

        They are those of the worse foot in the worst horizontal direction d,
        with the pelvis at rest and the sole level.  The acceleration a is that
        at which the first joint's torque, tau = M qdd + gravity, is at its
        limit; the speed follows in the same way from the joints' speeds.

        Args:
            speeds: speed limits (nj,) [rad/s] of the joints.

        Returns:
            The limits.
        """
        plant = self.plant
        M = plant.CalcMassMatrix(self.context)
        room = effort_limits(plant) - np.abs(
            plant.CalcGravityGeneralizedForces(self.context)
        )
        speed_limits = np.append(np.zeros(6), speeds)
        accelerations: dict[str, float] = {}
        foot_speeds: dict[str, float] = {}
        for side, foot in self.robot.foot_bodies.items():
            joints = joints_above(plant, foot)
            names = [joint.name() for joint in joints]
            leg = [joint.velocity_start() for joint in joints]
            motion = np.linalg.lstsq(
                self._jacobian(side)[:, leg], _HORIZONTAL, rcond=None
            )[0]
            # The largest of x cos(s) + y sin(s) over all directions s.
            torques = np.hypot(*(M[np.ix_(leg, leg)] @ motion).T)
            with np.errstate(divide="ignore"):
                largest = np.maximum(room[leg], 0.0) / torques
                fastest = speed_limits[leg] / np.hypot(*motion.T)
            accelerations |= dict(zip(names, largest.tolist(), strict=True))
            foot_speeds |= dict(zip(names, fastest.tolist(), strict=True))
        weakest = min(accelerations, key=accelerations.__getitem__)
        slowest = min(foot_speeds, key=foot_speeds.__getitem__)
        return FootLimits(
            acceleration=round(accelerations[weakest], 1),
            speed=round(foot_speeds[slowest] * _SHARE / _PEAK, 2),
            weakest=weakest,
            slowest=slowest,
        )

    def cop_area(self, sole: Array) -> Array:
        """The part of the sole where the ankles hold the CoP.

        It is the rectangle at whose edges the first ankle joint reaches its
        torque limit under the robot's whole weight.  Ankle joints are those
        between the foot and the knee, which is the second pitch axis above the
        foot; other legs hold the whole sole.

        Args:
            sole: corners (4, 2) [m] of the sole, in its frame.

        Returns:
            Corners (4, 2) [m] in the frame of the sole.

        Raises:
            ValueError: an ankle cannot carry the robot anywhere on the sole.
        """
        effort = effort_limits(self.plant)
        weight = self.plant.CalcTotalMass(self.context) * GRAVITY
        low, high = sole.min(axis=0), sole.max(axis=0)
        for side, foot in self.robot.foot_bodies.items():
            J = self._jacobian(side)
            for joint in self._ankle(foot):
                i = joint.velocity_start()
                # Torque per unit of vertical force at the sole's centre, J[5],
                # and its change along x and across y of the level sole.
                change = np.array([-J[1, i], J[0, i]])
                axis = int(np.abs(change).argmax())
                lever = effort[i] / weight
                ends = (np.array([-lever, lever]) - J[5, i]) / change[axis]
                near, far = sorted(ends.round(_DIGITS).tolist())
                low[axis] = max(low[axis], near)
                high[axis] = min(high[axis], far)
                require(
                    low[axis] < high[axis],
                    f"effort limit of {joint.name()} = {effort[i]:g}: must "
                    f"hold the weight of {weight:.0f} N somewhere on the sole",
                )
        low[1] = max(low[1], -high[1])  # alike for both feet
        high[1] = -low[1]
        return sole.clip(low, high)

    def _jacobian(self, side: Side) -> Array:
        """Jacobian (6, nv) [w, v] of the centre of a sole, in W."""
        return np.asarray(
            self.plant.CalcJacobianSpatialVelocity(
                context=self.context,
                with_respect_to=JacobianWrtVariable.kV,
                frame_B=self.plant.GetFrameByName(self.robot.foot_bodies[side]),
                p_BoBp_B=self.robot.X_FootSole[side].translation(),
                frame_A=self.plant.world_frame(),
                frame_E=self.plant.world_frame(),
            )
        )

    def _ankle(self, foot: str) -> list[Joint]:
        """The joints between foot and knee; none if there is no such knee."""
        above = joints_above(self.plant, foot)
        knee = knee_among(above, self.context)
        return above[: above.index(knee)] if knee else []


class StandingKinematics(InverseKinematics):
    """Inverse kinematics with level soles and a bounded centre of mass.

    Both soles are on the plane z = 0 of W, with x forward.

    Args:
        robot: a RobotModel, alone in the `plant`.
        places: positions (2, 2) [m] of the left and the right sole centre.
        com: least and largest position (3,) [m] of the CoM in W.
    """

    def __init__(
        self, robot: RobotModel, places: Array, com: tuple[ArrayLike, ArrayLike]
    ) -> None:
        self.plant = robot.control_plant()
        super().__init__(self.plant)
        free = np.inf
        for side, (x, y) in zip(Side, places, strict=True):
            # Three points with 3 + 2 + 1 fixed coordinates fix the sole.
            points: Any = (
                ([0.0, 0.0, 0.0], [x, y, 0.0], [x, y, 0.0]),
                ([0.1, 0.0, 0.0], [-free, y, 0.0], [free, y, 0.0]),
                ([0.0, 0.1, 0.0], [-free, -free, 0.0], [free, free, 0.0]),
            )
            for p_SQ, lower, upper in points:
                self.AddPositionConstraint(
                    frameB=self.plant.GetFrameByName(robot.foot_bodies[side]),
                    p_BQ=robot.X_FootSole[side].translation() + p_SQ,
                    frameA=self.plant.world_frame(),
                    p_AQ_lower=lower,
                    p_AQ_upper=upper,
                )
        # MathematicalProgram takes more than its stubs say.
        self._program = cast(Any, self.prog())
        self._com = self._program.NewContinuousVariables(3, "com")
        self._program.AddBoundingBoxConstraint(*com, self._com)
        self._program.AddConstraint(
            ComPositionConstraint(
                plant=self.plant,
                model_instances=None,
                expressed_frame=self.plant.world_frame(),
                plant_context=self.get_mutable_context(),
            ),
            [*self.q(), *self._com],
        )

    def nearest(
        self, q: Array, com: ArrayLike, weight: float = 1.0
    ) -> Array | None:
        """Minimises weight |q - q_0|^2 subject to these constraints.

        Args:
            q: desired positions q_0 (nq,), where the search begins.
            com: CoM (3,) [m] in W where the search begins.
            weight: of the cost; the solution may depend on it by rounding.

        Returns:
            The positions (nq,); None if there are none.
        """
        self._program.AddQuadraticErrorCost(
            weight * np.eye(len(q)), q, self.q()
        )
        self._program.SetInitialGuess(self.q(), q)
        self._program.SetInitialGuess(self._com, com)
        result = SnoptSolver().Solve(self._program)
        positions = np.asarray(result.GetSolution(self.q()))
        return positions if result.is_success() else None
