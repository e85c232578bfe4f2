"""A plant: its ground; its joints, drives and bodies."""

import numpy as np
from pydrake.geometry import Convex, RoleAssign
from pydrake.math import RigidTransform
from pydrake.multibody import plant as mbp
from pydrake.multibody import tree
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from nadia_balance import palette
from nadia_balance.core.body.ground import Ground
from nadia_balance.core.math.arrays import Array
from nadia_balance.robot.params import MODELS

_ROUGH = mbp.CoulombFriction(0.8, 0.8)  # as in flat.urdf
_DEPTH = 0.5  # depth of the ground below its lowest point [m]
_PITCH = 0.75  # least |y| of a pitch axis; also of slanted hips [-]


def joints(plant: MultibodyPlant) -> list[tree.Joint]:
    """All joints, also welds and those of floating bodies."""
    return [plant.get_joint(i) for i in plant.GetJointIndices()]


def actuators(plant: MultibodyPlant) -> list[tree.JointActuator]:
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


def joints_above(plant: MultibodyPlant, body: str) -> list[tree.Joint]:
    """The moving joints from a body up to the floating base."""
    above = {joint.child_body().name(): joint for joint in joints(plant)}
    found, link = [], body
    while (joint := above.get(link)) and joint.num_velocities() < 2:
        found += [joint] if joint.num_velocities() else []
        link = joint.parent_body().name()
    return found


def is_pitch(joint: tree.Joint, context: Context) -> bool:
    """True if a revolute joint turns about y of W, or nearly so."""
    R_WJ = joint.frame_on_child().CalcPoseInWorld(context).rotation()
    return abs((R_WJ @ joint.revolute_axis())[1]) > _PITCH


def body_poses(plant: MultibodyPlant, context: Context, bodies) -> Array:
    """Poses [R, p] (n, 3, 4) in W of the `bodies` of `plant`."""
    poses = [plant.EvalBodyPoseInWorld(context, body) for body in bodies]
    return np.array([X_WB.GetAsMatrix34() for X_WB in poses])


def add_ground(plant: MultibodyPlant, ground: Ground | None = None) -> None:
    """Adds the ground to a `plant` that is not finalized yet.

    The ground is flat, z = 0, unless `ground` is uneven: then each of its
    regions is the visible top of a rigid prism with the same friction.
    """
    if ground is None or ground.is_level:
        Parser(plant).AddModels(str(MODELS / "terrain" / "flat.urdf"))
        return
    tops = [np.c_[r.polygon, r.heights(r.polygon)] for r in ground.regions]
    bottom = min(top[:, 2].min() for top in tops) - _DEPTH
    for i, top in enumerate(tops):
        below = top * [1.0, 1.0, 0.0] + [0.0, 0.0, bottom]
        shape = Convex(np.vstack([top, below]).T, name := f"region {i}")
        where = plant.world_body(), RigidTransform(), shape, name
        plant.RegisterCollisionGeometry(*where, _ROUGH)
        plant.RegisterVisualGeometry(*where, palette.rgba(palette.GROUND).rgba)


def scale_friction(plant: MultibodyPlant, scene_graph, ratio: float) -> None:
    """Multiplies all friction coefficients in a finalized `plant`."""
    inspector, source = scene_graph.model_inspector(), plant.get_source_id()
    replaces = RoleAssign.kReplace
    for i in range(plant.num_bodies()):
        body = plant.get_body(tree.BodyIndex(i))
        for shape in plant.GetCollisionGeometriesForBody(body):
            properties = inspector.GetProximityProperties(shape)
            mu = properties.GetProperty("material", "coulomb_friction")
            values = ratio * mu.static_friction(), ratio * mu.dynamic_friction()
            mu = mbp.CoulombFriction(*values)
            properties.UpdateProperty("material", "coulomb_friction", mu)
            scene_graph.AssignRole(source, shape, properties, replaces)


def improper_contacts(
    plant: MultibodyPlant, results, robot: tree.ModelInstanceIndex, feet
) -> set[str]:
    """Returns the pairs of bodies in contact that are not foot and ground.

    Pairs are named, such as "LEFT_SHIN_LINK - RIGHT_SHIN_LINK" or "PELVIS_LINK
    - ground".  The `feet`, by name, may touch what is not of the `robot`.
    """
    improper = set()
    points = range(results.num_point_pair_contacts())
    infos = map(results.point_pair_contact_info, points)
    for pair in {(int(i.bodyA_index()), int(i.bodyB_index())) for i in infos}:
        bodies = [plant.get_body(tree.BodyIndex(body)) for body in pair]
        own = {b.name() for b in bodies if b.model_instance() == robot}
        # Two robots may have bodies of the same name.
        others = {
            "ground"
            if b.index() == tree.world_index()
            else str(b.scoped_name())
            for b in bodies
            if b.model_instance() != robot
        }
        if own and not (others and own <= feet):
            improper.add(" - ".join([*sorted(own), *others]))
    return improper
