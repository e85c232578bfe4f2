"""Reader of MJCF and SDF by Drake's parser into a Tree."""

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import trimesh
from pydrake.geometry import (
    GeometryId,
    Mesh,
    Role,
    SceneGraph,
    SceneGraphInspector,
)
from pydrake.geometry import Shape as DrakeShape
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    MultibodyPlant,
)
from pydrake.multibody.tree import BodyIndex, RigidBody
from pydrake.multibody.tree import Joint as DrakeJoint
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.new_robot.notes import Notes
from nadia_balance.new_robot.primitives import primitive_mesh
from nadia_balance.new_robot.tree import Joint, Link, Shape, Tree

_SIZES = {
    "Box": ("size",),
    "Sphere": ("radius",),
    "Cylinder": ("radius", "length"),
    "Capsule": ("radius", "length"),
    "Ellipsoid": ("a", "b", "c"),
}


def read_with_drake(file: Path, roots: Sequence[Path], notes: Notes) -> Tree:
    """Returns the robot of a file that Drake can parse.

    Raises:
        ValueError: Drake cannot parse it, or it has a closed loop, or not
            exactly one floating base.
        OSError: the file does not exist.
    """
    if not file.is_file():
        raise FileNotFoundError(f"{file}: no such file")
    _refuse_several_joints(file)
    plant, scene_graph, name = _parsed(file, roots)
    bases = [plant.get_body(i).name() for i in plant.GetFloatingBaseBodies()]
    if len(bases) != 1:
        raise ValueError(
            f"floating bases: must be one; these are: {', '.join(bases)}"
        )
    if plant.num_constraints():
        raise ValueError("constraints: must not be there: closed loops, mimics")
    inspector = scene_graph.model_inspector()
    bodies = [
        plant.get_body(BodyIndex(i)) for i in range(1, plant.num_bodies())
    ]
    links = {body.name(): _link(plant, inspector, body) for body in bodies}
    if len(links) < len(bodies):
        raise ValueError("links: must have names of their own")
    drives = map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
    drives = {drive.joint().name(): drive for drive in drives}
    tree = Tree(name, bases[0], links, {})
    for joint in map(plant.get_joint, plant.GetJointIndices()):
        if joint.child_body().name() != bases[0]:
            tree.joints[joint.name()] = _joint(joint, drives.get(joint.name()))
    _move_to_joints(plant, tree)
    notes.changed.append("read by Drake, which leaves out what it cannot show")
    return tree


def _parsed(
    file: Path, roots: Sequence[Path]
) -> tuple[MultibodyPlant, SceneGraph, str]:
    """Returns the finalized plant of `file`, its SceneGraph and its name."""
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    parser = Parser(plant)
    for package in (p for root in roots for p in root.iterdir()):
        if package.is_dir():
            parser.package_map().Add(package.name, str(package.resolve()))
    # SystemExit is how pydrake reports a condition of Drake's own code.
    try:
        models = parser.AddModels(str(file))
        plant.Finalize()
    except (RuntimeError, SystemExit) as error:
        raise ValueError(f"Drake cannot read it: {error}") from None
    return plant, scene_graph, plant.GetModelInstanceName(models[0])


def _refuse_several_joints(file: Path) -> None:
    """Raises ValueError for an MJCF body with several joints.

    Drake 1.51 misplaces all of them but the last: the first axis of a hip with
    three joints was at its parent's origin.
    """
    try:
        bodies = ElementTree.parse(file).getroot().iter("body")
    except ElementTree.ParseError as error:
        raise ValueError(f"malformed XML: {error}") from None
    for body in bodies:
        if len(body.findall("joint")) > 1:
            raise ValueError(
                f"body {body.get('name')}: must have one joint: of several, "
                "Drake misplaces all but the last"
            )


def _joint(joint: DrakeJoint, drive) -> Joint:
    kind = {"weld": "fixed"}.get(joint.type_name(), joint.type_name())
    found = Joint(
        name=joint.name(),
        type=kind,
        parent=joint.parent_body().name(),
        child=joint.child_body().name(),
        X_PC=joint.frame_on_parent().GetFixedPoseInBodyFrame(),
        axis=np.array([1.0, 0.0, 0.0]),
    )
    if kind == "revolute":
        found.axis = joint.revolute_axis()
        found.lower = max(joint.position_lower_limit(), -np.pi)
        found.upper = min(joint.position_upper_limit(), np.pi)
        found.damping = joint.default_damping()
        speed = joint.velocity_upper_limit()
        found.speed = speed if np.isfinite(speed) else 0.0
    if kind == "revolute" and drive and np.isfinite(drive.effort_limit()):
        found.effort = drive.effort_limit()
        found.rotor_inertia = drive.default_reflected_inertia()
    return found


def _move_to_joints(plant: MultibodyPlant, tree: Tree) -> None:
    """Moves the frame of each link to that of its joint."""
    moved = {}
    for joint in map(plant.get_joint, plant.GetJointIndices()):
        if joint.name() in tree.joints:
            X_BM = joint.frame_on_child().GetFixedPoseInBodyFrame()
            moved[joint.child_body().name()] = X_BM
    for link, X_BM in moved.items():
        tree.links[link].move(X_BM.inverse())
    for joint in tree.joints.values():
        X_BM = moved.get(joint.parent, RigidTransform())
        joint.X_PC = X_BM.inverse() @ joint.X_PC


def _link(
    plant: MultibodyPlant, inspector: SceneGraphInspector, body: RigidBody
) -> Link:
    inertia = body.default_spatial_inertia()
    link = Link(body.name(), inertia if inertia.get_mass() > 0.0 else None)
    frame = plant.GetBodyFrameIdOrThrow(body.index())
    for role, shapes in (
        (Role.kIllustration, link.visuals),
        (Role.kProximity, link.collisions),
    ):
        for geometry in inspector.GetGeometries(frame, role):
            if shape := _shape(inspector, geometry, link):
                shapes.append(shape)
    return link


def _shape(
    inspector: SceneGraphInspector, geometry: GeometryId, link: Link
) -> Shape | None:
    shape, X_LG = (
        inspector.GetShape(geometry),
        inspector.GetPoseInFrame(geometry),
    )
    kind, size = type(shape).__name__, {}
    if isinstance(shape, Mesh) or kind == "Convex":
        path = shape.source().path()
        mesh = trimesh.load(path, force="mesh", skip_materials=True)
        mesh.apply_scale(shape.scale3())
    else:
        size = _size(kind, shape)
        mesh = primitive_mesh(kind.lower(), size, f"link {link.name}")
    if mesh is None:
        return None
    properties = inspector.GetIllustrationProperties(geometry)
    colour = ""
    if properties and properties.HasProperty("phong", "diffuse"):
        rgba = properties.GetProperty("phong", "diffuse").rgba
        colour = " ".join(f"{value:.3g}" for value in rgba)
    kind = kind.lower() if size else "mesh"
    return Shape(kind, size, X_LG, mesh, colour)


def _size(kind: str, shape: DrakeShape) -> dict[str, str]:
    return {
        name: " ".join(map(str, np.atleast_1d(getattr(shape, name)())))
        for name in _SIZES.get(kind, ())
    }
