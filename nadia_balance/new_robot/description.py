"""A robot's description as Drake's parser reads it.

Joints may be welded, another link made the root, and frames of links turned:
all of it is how the same `MultibodyPlant` is seen, which itself stays.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Joint as DrakeJoint
from pydrake.multibody.tree import RigidBody, SpatialInertia

from nadia_balance.new_robot import Notes
from nadia_balance.new_robot.mjcf import urdf_of_mjcf
from nadia_balance.new_robot.shapes import Array, Shape
from nadia_balance.new_robot.urdf import Mended, mend_urdf

LEAST_MASS = 0.02  # mass of links without one [kg]


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
    links: dict[str, list[RigidBody]]
    joints: dict[str, Joint]
    X_BL: dict[str, RigidTransform]
    mended: Mended

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
            self.set_inertia(self.links[link][0], ball)
        return light

    def set_inertia(self, body: RigidBody, M: SpatialInertia) -> None:
        """Replaces the spatial inertia of a body, about its origin, in it."""
        body.SetSpatialInertiaInBodyFrame(self._context, M)

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

    def shapes(self, link: str, role: str = "") -> list[Shape]:
        """The shapes of `link` in its frame: VISUAL, COLLIDING, or both."""
        X_LW, found = self._pose(link).inverse(), []
        for body in self.links[link]:
            X_LB = X_LW @ body.EvalPoseInWorld(self._context)
            for shape in self.mended.shapes.get(body.name(), []):
                if role in ("", shape.role):
                    X_LG = X_LB @ shape.X_LG
                    found.append(replace(shape, X_LG=X_LG))
        return found

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
    """Returns the robot of a URDF or an MJCF.

    `roots` are folders of its packages.

    Raises:
        ValueError: it cannot be parsed, or it has a closed loop, or not exactly
            one floating base.
        OSError: the file does not exist.
    """
    try:
        top = ElementTree.parse(file).getroot()
    except ElementTree.ParseError as error:
        raise ValueError(f"malformed XML: {error}") from None
    shapes = {}
    if top.tag == "mujoco":
        top, shapes = urdf_of_mjcf(file, notes)
    mended = mend_urdf(top, file, roots, notes)
    mended.shapes |= shapes
    plant = MultibodyPlant(0.001)
    # SystemExit is how pydrake reports a condition of Drake's own code.
    try:
        model, *_ = Parser(plant).AddModelsFromString(mended.text, "urdf")
        joints = [plant.get_joint(i) for i in plant.GetJointIndices()]
        _refuse_loops(joints)
        plant.Finalize()
    except (RuntimeError, SystemExit) as error:
        why = str(error).replace("<literal-string>.urdf", file.name)
        raise ValueError(f"Drake cannot read it: {why}") from None
    root, world = _base(plant, joints), plant.world_body().index()
    joints = [j for j in joints if j.parent_body().index() != world]
    drives = map(plant.get_joint_actuator, plant.GetJointActuatorIndices())
    drives = {drive.joint().name(): drive for drive in drives}
    X_BL = {root.name(): RigidTransform()}  # frames of links: of their joints
    links = {root.name(): [root]}
    for joint in joints:
        body = joint.child_body()
        X_BL[body.name()] = joint.frame_on_child().GetFixedPoseInBodyFrame()
        links[body.name()] = [body]
    return Description(
        plant.GetModelInstanceName(model),
        root.name(),
        plant,
        links,
        {j.name(): _joint(j, drives.get(j.name()), mended) for j in joints},
        X_BL,
        mended,
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


def _base(plant: MultibodyPlant, joints: Iterable[DrakeJoint]) -> RigidBody:
    """The floating base; a frame without mass and joints is none."""
    holders = {joint.parent_body().name() for joint in joints}
    bases = [plant.get_body(i) for i in plant.GetFloatingBaseBodies()]
    bases = [b for b in bases if b.default_mass() or b.name() in holders]
    if len(bases) != 1:
        names = ", ".join(body.name() for body in bases)
        raise ValueError(
            f"floating bases: must be one; these are: {names or 'none'}"
        )
    return bases[0]


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
