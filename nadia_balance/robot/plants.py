"""A plant: its ground; its joints, drives and bodies."""

from collections.abc import Iterable, Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Convex, RoleAssign, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    Joint,
    JointActuator,
    ModelInstanceIndex,
    RevoluteJoint,
    RigidBody,
    world_index,
)
from pydrake.systems.framework import Context

from nadia_balance import palette
from nadia_balance.core.body.ground import Ground
from nadia_balance.core.math.arrays import Array
from nadia_balance.robot.params import MODELS

_ROUGH = CoulombFriction(0.8, 0.8)  # as in flat.urdf
_DEPTH = 0.5  # depth of the ground below its lowest point [m]
_PITCH = 0.75  # least |y| of a pitch axis; also of slanted hips [-]


def joints(plant: MultibodyPlant) -> list[Joint]:
    """All joints, also welds and those of floating bodies.

    Args:
        plant: of any robots.

    Returns:
        The joints, by index.
    """
    return [plant.get_joint(i) for i in plant.GetJointIndices()]


def actuators(plant: MultibodyPlant) -> list[JointActuator]:
    """All actuators.

    Args:
        plant: of any robots.

    Returns:
        The actuators, by index.
    """
    return [
        plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices()
    ]


def actuated_velocities(plant: MultibodyPlant) -> NDArray[np.intp]:
    """Where the actuators' joints are in the velocities.

    Args:
        plant: finalized.

    Returns:
        Index (nu,) in v of each actuator's joint.
    """
    return np.array([a.joint().velocity_start() for a in actuators(plant)])


def effort_limits(plant: MultibodyPlant) -> Array:
    """Effort limits in the order of v.

    Args:
        plant: finalized.

    Returns:
        Limits (nv,) [N m]; 0 where nothing drives.
    """
    effort = np.zeros(plant.num_velocities())
    effort[actuated_velocities(plant)] = plant.GetEffortUpperLimits()
    return effort


def joints_above(plant: MultibodyPlant, body: str) -> list[Joint]:
    """The moving joints from a body up to the floating base.

    Args:
        plant: of the robot.
        body: name of the body.

    Returns:
        The joints, that next to the body first.
    """
    inboard = {joint.child_body().name(): joint for joint in joints(plant)}
    above = []
    joint = inboard.get(body)
    while joint is not None and joint.num_velocities() < 2:
        above.append(joint)
        joint = inboard.get(joint.parent_body().name())
    return [joint for joint in above if joint.num_velocities() == 1]


def is_pitch(joint: Joint, context: Context) -> bool:
    """Whether a joint's axis is y of W, or nearly so.

    Args:
        joint: a revolute one.
        context: of its plant.

    Returns:
        True for the axes of hip pitch, knee and ankle pitch.
    """
    R_WJ = joint.frame_on_child().CalcPoseInWorld(context).rotation()
    axis = R_WJ @ cast(RevoluteJoint, joint).revolute_axis()
    return bool(abs(axis[1]) > _PITCH)


def knee_among(leg: Sequence[Joint], context: Context) -> Joint | None:
    """The knee of a leg: its second pitch axis above the foot.

    Args:
        leg: its joints, that next to the foot first (see joints_above).
        context: of their plant.

    Returns:
        The knee; None if there is no such joint.
    """
    pitches = [joint for joint in leg if is_pitch(joint, context)]
    return pitches[1] if len(pitches) > 1 else None


def body_poses(
    plant: MultibodyPlant, context: Context, bodies: Iterable[RigidBody]
) -> Array:
    """Poses of bodies in W.

    Args:
        plant: of the bodies.
        context: of the plant.
        bodies: n of them.

    Returns:
        Poses [R, p] (n, 3, 4); p in [m].
    """
    return np.array(
        [
            plant.EvalBodyPoseInWorld(context, body).GetAsMatrix34()
            for body in bodies
        ]
    )


def add_ground(plant: MultibodyPlant, ground: Ground | None = None) -> None:
    """Adds the ground: flat, z = 0, or rigid prisms below its regions.

    Args:
        plant: not finalized yet.
        ground: regions, each the visible top of a prism with the friction of
            flat ground; None, or level: flat.
    """
    if ground is None or ground.is_level:
        Parser(plant).AddModels(MODELS / "terrain" / "flat.urdf")
        return
    tops = [np.c_[r.polygon, r.heights(r.polygon)] for r in ground.regions]
    bottom = min(top[:, 2].min() for top in tops) - _DEPTH
    for i, top in enumerate(tops):
        name = f"region {i}"
        below = top * [1.0, 1.0, 0.0] + [0.0, 0.0, bottom]
        shape = Convex(cast(Any, np.vstack([top, below]).T), name)
        plant.RegisterCollisionGeometry(
            body=plant.world_body(),
            X_BG=RigidTransform(),
            shape=shape,
            name=name,
            coulomb_friction=_ROUGH,
        )
        plant.RegisterVisualGeometry(
            body=plant.world_body(),
            X_BG=RigidTransform(),
            shape=shape,
            name=name,
            diffuse_color=palette.rgba(palette.GROUND).rgba,
        )


def scale_friction(
    plant: MultibodyPlant, scene_graph: SceneGraph, ratio: float
) -> None:
    """Multiplies all friction coefficients.

    Args:
        plant: finalized.
        scene_graph: with its shapes.
        ratio: factor on static and dynamic friction [-].
    """
    inspector = scene_graph.model_inspector()
    for i in range(plant.num_bodies()):
        for shape in plant.GetCollisionGeometriesForBody(
            plant.get_body(BodyIndex(i))
        ):
            properties: Any = inspector.GetProximityProperties(shape)
            mu = properties.GetProperty("material", "coulomb_friction")
            properties.UpdateProperty(
                "material",
                "coulomb_friction",
                CoulombFriction(
                    ratio * mu.static_friction(), ratio * mu.dynamic_friction()
                ),
            )
            scene_graph.AssignRole(
                source_id=cast(Any, plant.get_source_id()),
                geometry_id=shape,
                properties=properties,
                assign=RoleAssign.kReplace,
            )


def improper_contacts(
    plant: MultibodyPlant,
    results: Any,
    robot: ModelInstanceIndex,
    feet: set[str],
) -> set[str]:
    """The pairs of bodies in contact that are not foot and ground.

    Args:
        plant: of the robot and what is around it.
        results: ContactResults of the plant, or PointContacts.
        robot: its model instance.
        feet: names of its bodies that may touch what is not of the robot.

    Returns:
        The pairs, such as "LEFT_SHIN_LINK - RIGHT_SHIN_LINK" or "PELVIS_LINK -
        ground".
    """
    improper = set()
    infos = map(
        results.point_pair_contact_info,
        range(results.num_point_pair_contacts()),
    )
    for pair in {(int(i.bodyA_index()), int(i.bodyB_index())) for i in infos}:
        bodies = [plant.get_body(BodyIndex(body)) for body in pair]
        links = {b.name() for b in bodies if b.model_instance() == robot}
        # Two robots may have bodies of the same name.
        others = {
            "ground" if b.index() == world_index() else str(b.scoped_name())
            for b in bodies
            if b.model_instance() != robot
        }
        if links and not (others and links <= feet):
            improper.add(" - ".join([*sorted(links), *others]))
    return improper
