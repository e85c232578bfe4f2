"""Joints, drives and bodies of a plant."""

from collections.abc import Iterable

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import (
    JacobianWrtVariable,
    Joint,
    JointActuator,
    RigidBody,
)
from pydrake.systems.framework import Context

from nadia_balance.core.math.arrays import Array

_PITCH = 0.75  # least |y| of a pitch axis; also of slanted hips [-]


def joints(plant: MultibodyPlant) -> list[Joint]:
    """All joints, also welds and those of floating bodies."""
    return [plant.get_joint(i) for i in plant.GetJointIndices()]


def actuators(plant: MultibodyPlant) -> list[JointActuator]:
    """All actuators, by index."""
    indices = plant.GetJointActuatorIndices()
    return [plant.get_joint_actuator(i) for i in indices]


def actuated_velocities(plant: MultibodyPlant) -> np.ndarray:
    """Index (nu,) in v of `plant` of each actuator's joint."""
    return np.array([a.joint().velocity_start() for a in actuators(plant)])


def effort_limits(plant: MultibodyPlant) -> Array:
    """Effort limits (nv,) [N m] in the order of v; 0 where nothing drives."""
    effort = np.zeros(plant.num_velocities())
    effort[actuated_velocities(plant)] = plant.GetEffortUpperLimits()
    return effort


def context_at(plant: MultibodyPlant, q: Array) -> Context:
    """A context of `plant` at the positions `q` (nq,), at rest."""
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    return context


def joints_above(plant: MultibodyPlant, body: str) -> list[Joint]:
    """The moving joints from a body up to the floating base."""
    above = {joint.child_body().name(): joint for joint in joints(plant)}
    found, link = [], body
    while (joint := above.get(link)) and joint.num_velocities() < 2:
        found += [joint] if joint.num_velocities() else []
        link = joint.parent_body().name()
    return found


def is_pitch(joint: Joint, context: Context) -> bool:
    """True if a revolute joint turns about y of W, or nearly so."""
    R_WJ = joint.frame_on_child().CalcPoseInWorld(context).rotation()
    return abs((R_WJ @ joint.revolute_axis())[1]) > _PITCH


def sole_jacobian(
    plant: MultibodyPlant, context: Context, foot: str, p_FS: Array
) -> Array:
    """Jacobian (6, nv) [w, v] of the point `p_FS` (3,) of a foot, in W."""
    frame, world = plant.GetFrameByName(foot), plant.world_frame()
    return plant.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, frame, p_FS, world, world
    )


def body_poses(
    plant: MultibodyPlant, context: Context, bodies: Iterable[RigidBody]
) -> np.ndarray:
    """Poses [R, p] (n, 3, 4) in W of the `bodies` of `plant`."""
    poses = [plant.EvalBodyPoseInWorld(context, body) for body in bodies]
    return np.array([X_WB.GetAsMatrix34() for X_WB in poses])
