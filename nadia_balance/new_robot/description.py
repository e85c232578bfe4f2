"""A robot's description as Drake's parser reads it.

Joints may be welded, another link made the root, and frames of links turned:
all of it is how the same `MultibodyPlant` is seen, which itself stays.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import trimesh
from numpy.typing import NDArray
from pydrake.geometry import GeometryId, Role, SceneGraph
from pydrake.geometry import Shape as Geometry
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RigidBody, SpatialInertia
from pydrake.multibody.tree import Joint as DrakeJoint
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.new_robot import Notes
from nadia_balance.new_robot.urdf import COLLISION, Mended, mend_urdf

Array = NDArray[np.float64]
VISUAL, COLLIDING = "visual", "collision"
LEAST_MASS = 0.02  # mass of links without one [kg]


@dataclass
class Shape:
    """A `solid` with the pose X_LG in its link, and its triangle mesh."""

    solid: Geometry
    X_LG: RigidTransform
    mesh: trimesh.Trimesh  # in G
    colour: str = ""  # "r g b a"

    @property
    def kind(self) -> str:
        """The tag of the solid in a URDF."""
        kind = type(self.solid).__name__.lower()
        return "mesh" if kind == "convex" else kind

    def points(self) -> Array:
        """Vertices (k, 3) in the frame of the link."""
        return (self.X_LG @ np.asarray(self.mesh.vertices).T).T


def triangles(solid: Geometry) -> trimesh.Trimesh:
    """Returns the triangle mesh of `solid` in its own frame.

    Raises:
        ValueError: the file of a mesh is empty, or cannot be read.
    """
    make, kind = trimesh.creation, type(solid).__name__
    match kind:
        case "Box":
            return make.box(solid.size())
        case "Sphere":
            return make.icosphere(3, solid.radius())
        case "Cylinder" | "Capsule":
            form = getattr(make, kind.lower())
            return form(radius=solid.radius(), height=solid.length())
        case "Ellipsoid":
            axes = solid.a(), solid.b(), solid.c()
            return make.icosphere(3, 1.0).apply_scale(axes)
        case "Mesh" | "Convex":
            path = solid.source().path()
            try:
                mesh = trimesh.load(path, force="mesh", skip_materials=True)
            except Exception as error:  # trimesh's readers raise any class
                raise ValueError(f"{path}: {error}") from None
            if not len(mesh.vertices):
                raise ValueError(f"{path}: must not be empty")
            return mesh.apply_scale(solid.scale3())
    raise ValueError(f"{kind}: must be a solid")


@dataclass
class Joint:
    """A joint between two links; `sense` is -1 where they are exchanged."""

    drake: DrakeJoint
    name: str
    type: str
    parent: str
    child: str
    lower: float = -np.inf  # [rad]
    upper: float = np.inf
    effort: float = 0.0  # [N m]; 0: not given
    speed: float = 0.0  # [rad/s]; 0: not given
    rotor_inertia: float = 0.0  # reflected [kg m^2]; 0: not given
    damping: float = 0.0  # [N m s/rad]
    mimics: bool = False
    sense: float = 1.0

    def nearest(self, angle: float, margin: float = 0.0) -> float:
        """The angle [rad] nearest to `angle` in the range less a margin."""
        margin = min(margin, 0.25 * (self.upper - self.lower))
        return min(max(angle, self.lower + margin), self.upper - margin)


@dataclass
class Description:
    """Links and joints of a robot, a tree with the link `root`.

    A link is one body of Drake's or several, welded together, and has the name
    of the first.  Its frame L has the fixed pose `X_BL` in that one.
    """

    name: str
    root: str
    plant: MultibodyPlant
    scene_graph: SceneGraph
    links: dict[str, list[RigidBody]]
    joints: dict[str, Joint]
    X_BL: dict[str, RigidTransform]
    missing: dict[str, str] = field(default_factory=dict)  # mesh by body

    def __post_init__(self):
        """Puts all joints at 0, or as near to it as they get."""
        self._context = self.plant.CreateDefaultContext()
        self.poses()

    def joint_to(self, link: str) -> Joint:
        """The joint that holds `link`."""
        return next(j for j in self.joints.values() if j.child == link)

    def children(self, link: str) -> list[Joint]:
        """The joints that `link` holds."""
        return [j for j in self.joints.values() if j.parent == link]

    def chain(self, link: str) -> list[Joint]:
        """The joints from the root to `link`."""
        if link == self.root:
            return []
        joint = self.joint_to(link)
        return [*self.chain(joint.parent), joint]

    def below(self, link: str) -> Iterator[str]:
        """Yields `link` and its descendants, parents first."""
        yield link
        for joint in self.children(link):
            yield from self.below(joint.child)

    def holder(self, name: str) -> str:
        """The link of which the body `name` is a part, or `name` itself."""
        for link, bodies in self.links.items():
            if name in [body.name() for body in bodies]:
                return link
        return name

    def mass(self, links: Iterable[str]) -> float:
        """Mass of `links` [kg]."""
        bodies = [body for link in links for body in self.links[link]]
        return sum(body.get_mass(self._context) for body in bodies)

    def inertia(self, link: str) -> SpatialInertia:
        """Spatial inertia of `link` about the origin of its frame, in it."""
        bodies = [body.index() for body in self.links[link]]
        world, X_WL = self.plant.world_frame(), self._pose(link)
        M = self.plant.CalcSpatialInertia(self._context, world, bodies)
        return M.Shift(X_WL.translation()).ReExpress(X_WL.rotation().inverse())

    def give_mass(self) -> list[str]:
        """Gives the massless links LEAST_MASS each; returns their names."""
        light = [link for link in self.links if not self.mass([link])]
        ball = SpatialInertia.SolidSphereWithMass(LEAST_MASS, 0.02)
        for link in light:
            body = self.links[link][0]
            body.SetSpatialInertiaInBodyFrame(self._context, ball)
        return light

    def poses(
        self, angles: Mapping[str, float] | None = None
    ) -> dict[str, RigidTransform]:
        """The pose of each link in the frame of the root.

        Joints without an angle [rad] are at the nearest angle to 0.
        """
        self._put(self.joints.values(), angles or {})
        X_RW = self._pose(self.root).inverse()
        return {link: X_RW @ self._pose(link) for link in self.links}

    def com(self, angles: Mapping[str, float]) -> Array:
        """The centre of mass (3,) in the frame of the root."""
        self._put(self.joints.values(), angles)
        p_WC = self.plant.CalcCenterOfMassPositionInWorld(self._context)
        return self._pose(self.root).inverse() @ p_WC

    def _put(
        self, joints: Iterable[Joint], angles: Mapping[str, float]
    ) -> None:
        """Puts joints at their angles, or at the nearest ones to 0."""
        q = self.plant.GetPositions(self._context)
        for joint in joints:
            if joint.drake.num_positions() == 1:
                angle = angles.get(joint.name, joint.nearest(0.0))
                q[joint.drake.position_start()] = angle
        self.plant.SetPositions(self._context, q)

    def _pose(self, link: str) -> RigidTransform:
        X_WB = self.links[link][0].EvalPoseInWorld(self._context)
        return X_WB @ self.X_BL[link]

    def axis(self, joint: Joint) -> Array:
        """Unit vector (3,) along a revolute `joint`, in its child's frame."""
        drake, R_WL = joint.drake, self._pose(joint.child).rotation()
        kept = joint.sense > 0.0
        frame = drake.frame_on_child() if kept else drake.frame_on_parent()
        R_WJ = frame.CalcPoseInWorld(self._context).rotation()
        return joint.sense * (R_WL.inverse() @ R_WJ @ drake.revolute_axis())

    def shapes(self, link: str, role: str) -> list[Shape]:
        """The shapes of `link` that are VISUAL or COLLIDING.

        Raises:
            ValueError: a mesh cannot be read; names the link.
        """
        inspector = self.scene_graph.model_inspector()
        found, X_WL = [], self._pose(link)
        for body in self.links[link]:
            X_LB = X_WL.inverse() @ body.EvalPoseInWorld(self._context)
            frame = self.plant.GetBodyFrameIdOrThrow(body.index())
            chosen = [
                geometry
                for geometry in inspector.GetGeometries(
                    frame, Role.kIllustration
                )
                if (COLLISION in inspector.GetName(geometry))
                == (role == COLLIDING)
            ]
            if role == COLLIDING:
                chosen += inspector.GetGeometries(frame, Role.kProximity)
            try:
                found += [self._shape(g, X_LB) for g in chosen]
            except ValueError as error:
                raise ValueError(
                    f"{role} of link {body.name()}: {error}"
                ) from None
        return found

    def _shape(self, geometry: GeometryId, X_LB: RigidTransform) -> Shape:
        inspector = self.scene_graph.model_inspector()
        solid = inspector.GetShape(geometry)
        X_LG = X_LB @ inspector.GetPoseInFrame(geometry)
        shape = Shape(solid, X_LG, triangles(solid))
        properties = inspector.GetIllustrationProperties(geometry)
        if properties and properties.HasProperty("phong", "diffuse"):
            rgba = properties.GetProperty("phong", "diffuse").rgba
            shape.colour = " ".join(f"{value:.3g}" for value in rgba)
        return shape

    def weld(self, names: Iterable[str]) -> None:
        """Welds joints at the nearest angle to 0."""
        for joint in [self.joints[name] for name in names]:
            del self.joints[joint.name]
            self._put([joint], {})
            self.links[joint.parent] += self.links.pop(joint.child)
            for other in self.children(joint.child):
                other.parent = joint.parent

    def reroot(self, link: str) -> None:
        """Makes `link` the root; all joints keep their angles."""
        for joint in self.chain(link):
            # The frame of the new child must be that of the joint.
            X_WB = self.links[joint.parent][0].EvalPoseInWorld(self._context)
            X_WJ = joint.drake.frame_on_parent().CalcPoseInWorld(self._context)
            self.X_BL[joint.parent] = X_WB.InvertAndCompose(X_WJ)
            joint.parent, joint.child = joint.child, joint.parent
            joint.sense = -1.0
        self.root = link

    def turn(self, link: str, R_LN: RotationMatrix) -> None:
        """Changes the frame of `link` to the rotated frame N."""
        self.X_BL[link] = self.X_BL[link] @ RigidTransform(R_LN)


def read(file: Path, roots: Sequence[Path], notes: Notes) -> Description:
    """Returns the robot of a URDF, MJCF or SDF.

    `roots` are folders of its packages.

    Raises:
        ValueError: Drake cannot parse it, or it has a closed loop, or not
            exactly one floating base.
        OSError: the file does not exist.
    """
    try:
        top = ElementTree.parse(file).getroot()
    except ElementTree.ParseError as error:
        raise ValueError(f"malformed XML: {error}") from None
    mended = Mended()
    if top.tag in ("mujoco", "sdf"):
        _refuse_several_joints(top.iter("body"))
        notes.changed.append(
            "read by Drake, which leaves out what it cannot show"
        )
    else:
        mended = mend_urdf(top, file, roots, notes)
    return _parsed(file, roots, mended)


def _refuse_several_joints(bodies: Iterable[ElementTree.Element]) -> None:
    """Raises ValueError for an MJCF body with several joints.

    Drake 1.51 misplaces all of them but the last: the first axis of a hip with
    three joints was at its parent's origin.
    """
    for body in bodies:
        if len(body.findall("joint")) > 1:
            raise ValueError(
                f"body {body.get('name')}: must have one joint: of several, "
                "Drake misplaces all but the last"
            )


def _parsed(file: Path, roots: Sequence[Path], mended: Mended) -> Description:
    """The description of the `mended` URDF, or of `file` if it has no text."""
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    parser = Parser(plant)
    # SystemExit is how pydrake reports a condition of Drake's own code.
    try:
        for package in (p for root in roots for p in root.iterdir()):
            if package.is_dir() and not mended.text:
                parser.package_map().Add(package.name, str(package.resolve()))
        if mended.text:
            model, *_ = parser.AddModelsFromString(mended.text, "urdf")
        else:
            model, *_ = parser.AddModels(str(file))
        joints = [plant.get_joint(i) for i in plant.GetJointIndices()]
        _refuse_loops(joints)
        plant.Finalize()
    except (RuntimeError, SystemExit) as error:
        why = str(error).replace("<literal-string>.urdf", file.name)
        raise ValueError(f"Drake cannot read it: {why}") from None
    if plant.num_constraints():
        raise ValueError("constraints: must not be there: closed loops, mimics")
    name = plant.GetModelInstanceName(model)
    return _described(name, plant, scene_graph, joints, mended)


def _described(
    name: str,
    plant: MultibodyPlant,
    scene_graph: SceneGraph,
    joints: Sequence[DrakeJoint],
    mended: Mended,
) -> Description:
    """The description of the robot; the frames of its links are the joints'."""
    root, world = _base(plant, joints), plant.world_body().name()
    joints = [j for j in joints if j.parent_body().name() != world]
    drives = map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
    drives = {drive.joint().name(): drive for drive in drives}
    X_BL = {root: RigidTransform()}
    for joint in joints:
        X_BM = joint.frame_on_child().GetFixedPoseInBodyFrame()
        X_BL[joint.child_body().name()] = X_BM
    bodies = [plant.get_body(BodyIndex(i)) for i in range(plant.num_bodies())]
    return Description(
        name=name,
        root=root,
        plant=plant,
        scene_graph=scene_graph,
        links={b.name(): [b] for b in bodies if b.name() in X_BL},
        joints={
            joint.name(): _joint(joint, drives.get(joint.name()), mended)
            for joint in joints
        },
        X_BL=X_BL,
        missing=mended.missing,
    )


def _refuse_loops(joints: Iterable[DrakeJoint]) -> None:
    held: dict[str, str] = {}
    for joint in joints:
        link, name = joint.child_body().name(), joint.name()
        if link in held:
            raise ValueError(
                f"link {link}: must be held by one joint, not by {held[link]} "
                f"and {name}: a closed loop"
            )
        held[link] = name


def _base(plant: MultibodyPlant, joints: Iterable[DrakeJoint]) -> str:
    """The floating base; a frame without mass and joints is none."""
    holders = {joint.parent_body().name() for joint in joints}
    bases = [plant.get_body(i) for i in plant.GetFloatingBaseBodies()]
    bases = [b for b in bases if b.default_mass() or b.name() in holders]
    if len(bases) != 1:
        names = ", ".join(body.name() for body in bases)
        raise ValueError(
            f"floating bases: must be one; these are: {names or 'none'}"
        )
    return bases[0].name()


def _joint(joint: DrakeJoint, drive, mended: Mended) -> Joint:
    name, kind = joint.name(), joint.type_name()
    ends = joint.parent_body().name(), joint.child_body().name()
    found = Joint(joint, name, kind, *ends, mimics=name in mended.mimics)
    if joint.num_positions() == 1:
        found.lower = joint.position_lower_limit()
        found.upper = joint.position_upper_limit()
        found.damping = joint.default_damping()
        speed = joint.velocity_upper_limit()
        found.speed = speed if np.isfinite(speed) else 0.0
    if kind == "revolute" and np.isinf(found.upper - found.lower):
        found.type = "continuous"
        found.lower, found.upper = -np.pi, np.pi
    if drive and np.isfinite(drive.effort_limit()):
        found.effort = drive.effort_limit()
        found.rotor_inertia = drive.default_reflected_inertia()
    return found
