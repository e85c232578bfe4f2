"""What the joints of the legs can do: to stand, in the air, at the ankle."""

from collections.abc import Mapping

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint
from pydrake.systems.framework import Context

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.vocabulary import Side
from nadia_balance.robot import plants
from nadia_balance.robot.urdf import require

Feet = Mapping[Side, str]
Soles = Mapping[Side, RigidTransform]

_WAYS = np.eye(6)[:, 3:5]  # [w, v] of a foot that moves along x, along y
# Peak over mean speed of a quintic from rest to rest [-], and share of the
# joints' speed for the way over the ground: the rest lifts the foot.
_PEAK, _SHARE = 1.875, 0.7
_DIGITS = 4  # of lengths [m], more than any drive is known to


def check_standing(
    plant: MultibodyPlant, q: Array, feet: Feet, X_FootSole: Soles
) -> None:
    """Raises ValueError if a joint is too weak for the robot to stand.

    The robot of `plant` stands at `q` (nq,), with half of its weight at the
    centre of either sole.
    """
    shares = dict.fromkeys(feet, 0.5)
    torques = standing_torques(plant, q, feet, X_FootSole, shares)
    for drive in plants.actuators(plant):
        joint, limit = drive.joint(), drive.effort_limit()
        needed = abs(torques[joint.velocity_start()])
        require(
            needed <= limit,
            f"effort limit of {joint.name()} = {limit:g}: must be >= "
            f"{needed:.0f} N m, for the robot to stand",
        )


def standing_torques(
    plant: MultibodyPlant,
    q: Array,
    feet: Feet,
    X_FootSole: Soles,
    shares: Mapping[Side, float],
) -> Array:
    """Returns the torques (nv,) [N m] that hold the robot at `q` (nq,).

    `shares` of its weight are at the centres of the soles.
    """
    context = plants.context_at(plant, q)
    gravity = plant.gravity_field().gravity_vector()
    weight = -plant.CalcTotalMass(context) * gravity
    torques = -plant.CalcGravityGeneralizedForces(context)
    for side, share in shares.items():
        p_FS = X_FootSole[side].translation()
        J = plants.sole_jacobian(plant, context, feet[side], p_FS)
        torques -= share * weight @ J[3:]
    return torques


def foot_limits(
    plant: MultibodyPlant, q: Array, feet: Feet, soles: Soles, speeds: Array
) -> tuple[float, float]:
    """Returns acceleration [m/s^2] and mean speed [m/s] that a foot can have.

    They are the least over both feet and all horizontal directions d, with the
    pelvis at rest and the sole level.  The acceleration a is that at which the
    first joint's torque is at its limit: J qdd = d a, tau = M qdd + gravity.
    The speed follows in the same way from the joints' limits `speeds` (nj,)
    [rad/s].  The robot stands at `q` (nq,); `soles` are X_FootSole.
    """
    context, effort = plants.context_at(plant, q), plants.effort_limits(plant)
    M = plant.CalcMassMatrix(context)
    room = effort - np.abs(plant.CalcGravityGeneralizedForces(context))
    fastest = np.append(np.zeros(6), speeds)
    found = []
    for side, foot in feet.items():
        J = plants.sole_jacobian(
            plant, context, foot, soles[side].translation()
        )
        leg = [
            joint.velocity_start() for joint in plants.joints_above(plant, foot)
        ]
        motion = np.linalg.lstsq(J[:, leg], _WAYS, rcond=None)[0]
        # The largest of x cos(s) + y sin(s) over all directions s.
        speed = np.hypot(*motion.T)
        torque = np.hypot(*(M[np.ix_(leg, leg)] @ motion).T)
        with np.errstate(divide="ignore"):
            a = np.maximum(room[leg], 0.0) / torque
            v = fastest[leg] / speed
        found.append((a.min(), v.min() * _SHARE / _PEAK))
    acceleration, speed = np.min(found, axis=0)
    return round(float(acceleration), 1), round(float(speed), 2)


def cop_area(
    plant: MultibodyPlant, q: Array, feet: Feet, soles: Soles, sole: Array
) -> Array:
    """Returns the part (4, 2) [m] of the `sole` where the ankle holds the CoP.

    It is the rectangle, in the sole frame, at whose edges the first ankle joint
    reaches its torque limit under the robot's whole weight.  Ankle joints are
    those between the foot and the knee, which is the second pitch axis above
    the foot; with other legs, the part is the `sole` (4, 2).

    Raises ValueError: an ankle cannot carry the robot at any point of the sole.
    """
    context, effort = plants.context_at(plant, q), plants.effort_limits(plant)
    weight = plant.CalcTotalMass(context) * GRAVITY
    low, high = sole.min(axis=0), sole.max(axis=0)
    for side, foot in feet.items():
        p_FS = soles[side].translation()
        at = plants.sole_jacobian(plant, context, foot, p_FS)
        for joint in _ankle(plant, context, foot):
            i = joint.velocity_start()
            # Torque per unit of vertical force at the sole's centre, and its
            # change along x and across y of the level sole.
            change = np.array([-at[1, i], at[0, i]])
            axis = int(np.abs(change).argmax())
            slope, bias = change[axis], at[5, i]
            ends = (np.array([-1.0, 1.0]) * effort[i] / weight - bias) / slope
            near, far = sorted(ends.round(_DIGITS).tolist())
            low[axis] = max(low[axis], near)
            high[axis] = min(high[axis], far)
            if not low[axis] < high[axis]:
                raise ValueError(
                    f"effort limit of {joint.name()} = {effort[i]:g}: must "
                    f"hold the weight of {weight:.0f} N somewhere on the sole"
                )
    low[1] = max(low[1], -high[1])  # alike for both feet
    high[1] = -low[1]
    return sole.clip(low, high)


def _ankle(plant: MultibodyPlant, context: Context, foot: str) -> list[Joint]:
    """The joints between foot and knee; none if there is no such knee."""
    ankle: list[Joint] = []
    pitches = 0
    for joint in plants.joints_above(plant, foot):
        pitches += plants.is_pitch(joint, context)
        if pitches == 2:
            return ankle
        ankle.append(joint)
    return []
