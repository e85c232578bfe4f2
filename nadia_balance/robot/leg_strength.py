"""What the joints of the legs can do: to stand, in the air, at the ankle."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike
from pydrake.multibody import inverse_kinematics as ik
from pydrake.multibody.tree import JacobianWrtVariable, Joint
from pydrake.solvers import SnoptSolver

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.state import Side
from nadia_balance.robot import plants
from nadia_balance.robot.urdf import require

_WAYS = np.eye(6)[:, 3:5]  # [w, v] of a foot that moves along x, along y
# Peak over mean speed of a quintic from rest to rest [-], and share of the
# joints' speed for the way over the ground: the rest lifts the foot.
_PEAK, _SHARE = 1.875, 0.7
_DIGITS = 4  # of lengths [m], more than any drive is known to


class StandingLegs:
    """The legs of a RobotModel that stands at `q` (nq,), at rest."""

    def __init__(self, robot, q: Array):
        self.robot, self.plant = robot, robot.control_plant()
        self.context = self.plant.CreateDefaultContext()
        self.plant.SetPositions(self.context, q)

    def check_standing(self) -> None:
        """Raises ValueError if a joint is too weak for the robot to stand.

        Half of its weight is at the centre of either sole.
        """
        torques = self.standing_torques(dict.fromkeys(Side, 0.5))
        for drive in plants.actuators(self.plant):
            joint, limit = drive.joint(), drive.effort_limit()
            needed = abs(torques[joint.velocity_start()])
            what = f"effort limit of {joint.name()} = {limit:g}"
            must = f"must be >= {needed:.0f} N m, for the robot to stand"
            require(needed <= limit, f"{what}: {must}")

    def standing_torques(self, shares: Mapping[Side, float]) -> Array:
        """Torques (nv,) [N m] for `shares` of the weight at sole centres."""
        plant, context = self.plant, self.context
        gravity = plant.gravity_field().gravity_vector()
        weight = -plant.CalcTotalMass(context) * gravity
        torques = -plant.CalcGravityGeneralizedForces(context)
        for side, share in shares.items():
            torques -= share * weight @ self._jacobian(side)[3:]
        return torques

    def foot_limits(self, speeds: Array) -> tuple[float, float]:
        """Returns the acceleration [m/s^2] and mean speed [m/s] of the feet.

        They are the largest possible ones of the worse foot in the worst
        horizontal direction d, with the pelvis at rest and the sole level.  The
        acceleration a is that at which the first joint's torque is at its
        limit: J qdd = d a, tau = M qdd + gravity.  The speed follows in the
        same way from the joints' limits `speeds` (nj,) [rad/s].
        """
        plant, context = self.plant, self.context
        M, effort = plant.CalcMassMatrix(context), plants.effort_limits(plant)
        room = effort - np.abs(plant.CalcGravityGeneralizedForces(context))
        fastest = np.append(np.zeros(6), speeds)
        found = []
        for side, foot in self.robot.foot_bodies.items():
            joints = plants.joints_above(plant, foot)
            leg = [joint.velocity_start() for joint in joints]
            J = self._jacobian(side)[:, leg]
            motion = np.linalg.lstsq(J, _WAYS, rcond=None)[0]
            # The largest of x cos(s) + y sin(s) over all directions s.
            speed = np.hypot(*motion.T)
            torque = np.hypot(*(M[np.ix_(leg, leg)] @ motion).T)
            with np.errstate(divide="ignore"):
                a = np.maximum(room[leg], 0.0) / torque
                v = fastest[leg] / speed
            found.append((a.min(), v.min() * _SHARE / _PEAK))
        acceleration, speed = np.min(found, axis=0)
        return round(float(acceleration), 1), round(float(speed), 2)

    def cop_area(self, sole: Array) -> Array:
        """Returns the part (4, 2) [m] of the `sole` where ankles hold the CoP.

        It is the rectangle, in the sole frame, at whose edges the first ankle
        joint reaches its torque limit under the robot's whole weight.  Ankle
        joints are those between the foot and the knee, which is the second
        pitch axis above the foot; other legs hold the whole `sole` (4, 2).

        Raises ValueError: an ankle cannot carry the robot anywhere on the sole.
        """
        effort = plants.effort_limits(self.plant)
        weight = self.plant.CalcTotalMass(self.context) * GRAVITY
        low, high = sole.min(axis=0), sole.max(axis=0)
        for side, foot in self.robot.foot_bodies.items():
            at = self._jacobian(side)
            for joint in self._ankle(foot):
                i = joint.velocity_start()
                # Torque per unit of vertical force at the sole's centre, and
                # its change along x and across y of the level sole.
                change = np.array([-at[1, i], at[0, i]])
                axis = int(np.abs(change).argmax())
                slope, bias = change[axis], at[5, i]
                most = effort[i] / weight
                ends = (np.array([-most, most]) - bias) / slope
                near, far = sorted(ends.round(_DIGITS).tolist())
                low[axis] = max(low[axis], near)
                high[axis] = min(high[axis], far)
                if not low[axis] < high[axis]:
                    what = f"effort limit of {joint.name()} = {effort[i]:g}"
                    why = f"must hold the weight of {weight:.0f} N somewhere"
                    raise ValueError(f"{what}: {why} on the sole")
        low[1] = max(low[1], -high[1])  # alike for both feet
        high[1] = -low[1]
        return sole.clip(low, high)

    def _jacobian(self, side: Side) -> Array:
        """Jacobian (6, nv) [w, v] of the centre of a sole, in W."""
        foot = self.plant.GetFrameByName(self.robot.foot_bodies[side])
        point = foot, self.robot.X_FootSole[side].translation()
        frames = 2 * [self.plant.world_frame()]
        return self.plant.CalcJacobianSpatialVelocity(
            self.context, JacobianWrtVariable.kV, *point, *frames
        )

    def _ankle(self, foot: str) -> list[Joint]:
        """The joints between foot and knee; none if there is no such knee."""
        above = plants.joints_above(self.plant, foot)
        is_pitch = [plants.is_pitch(joint, self.context) for joint in above]
        pitches = np.flatnonzero(is_pitch)
        return above[: pitches[1]] if len(pitches) > 1 else []


class StandingKinematics(ik.InverseKinematics):
    """Inverse kinematics with level soles and a bounded centre of mass."""

    def __init__(self, robot, places: Array, com: tuple[ArrayLike, ArrayLike]):
        """Constrains a RobotModel, alone in the `plant`.

        `places` (2, 2) [m] are left and right sole centre on the plane z = 0 of
        W, `com` the least and the largest position (3,) [m] of the CoM in W.
        """
        self.plant = plant = robot.control_plant()
        super().__init__(plant)
        world, free = plant.world_frame(), np.inf
        for side, (x, y) in zip(Side, places, strict=True):
            foot = plant.GetFrameByName(robot.foot_bodies[side])
            p_FS = robot.X_FootSole[side].translation()
            # Three points with 3 + 2 + 1 fixed coordinates fix the sole.
            for p_S, low, high in (
                ([0.0, 0.0, 0.0], [x, y, 0.0], [x, y, 0.0]),
                ([0.1, 0.0, 0.0], [-free, y, 0.0], [free, y, 0.0]),
                ([0.0, 0.1, 0.0], [-free, -free, 0.0], [free, free, 0.0]),
            ):
                self.AddPositionConstraint(foot, p_FS + p_S, world, low, high)
        prog = self.prog()
        self._com = prog.NewContinuousVariables(3, "com")
        prog.AddBoundingBoxConstraint(*com, self._com)
        context = self.get_mutable_context()
        at_com = ik.ComPositionConstraint(plant, None, world, context)
        prog.AddConstraint(at_com, [*self.q(), *self._com])

    def nearest(self, q: Array, com: ArrayLike, weight=1.0) -> Array | None:
        """Returns the positions (nq,) nearest to `q`; None if there are none.

        The search begins at `q` (nq,) and the CoM `com` (3,) [m].
        """
        prog = self.prog()
        prog.AddQuadraticErrorCost(weight * np.eye(len(q)), q, self.q())
        prog.SetInitialGuess(self.q(), q)
        prog.SetInitialGuess(self._com, com)
        result = SnoptSolver().Solve(prog)
        return result.GetSolution(self.q()) if result.is_success() else None
