"""A tree of links and joints, with changes that keep the robot's mechanics.

Poses and welds treat every joint as revolute unless it is fixed; as in a URDF,
the frame of a link is that of the joint that holds it.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import trimesh
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import SpatialInertia

Array = NDArray[np.float64]


@dataclass
class Shape:
    """A geometry: `kind` and `size` as in a URDF, and its triangle mesh."""

    kind: str
    size: dict[str, str]
    X_LG: RigidTransform  # in the frame of its link
    mesh: trimesh.Trimesh  # in G; also of primitives
    colour: str = ""  # "r g b a"

    def points(self) -> Array:
        """Vertices (k, 3) in the frame of the link."""
        return (self.X_LG @ np.asarray(self.mesh.vertices).T).T


@dataclass
class Link:
    """A rigid body with its `inertia` about its origin; None: massless."""

    name: str
    inertia: SpatialInertia | None = None
    visuals: list[Shape] = field(default_factory=list)
    collisions: list[Shape] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)  # meshes

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return self.inertia.get_mass() if self.inertia else 0.0

    def move(self, X_NL: RigidTransform) -> None:
        """Re-expresses shapes and inertia in frame N; X_NL is the old frame."""
        for shape in self.visuals + self.collisions:
            shape.X_LG = X_NL @ shape.X_LG
        if self.inertia:
            turned = self.inertia.ReExpress(X_NL.rotation())
            self.inertia = turned.Shift(-X_NL.translation())

    def take(self, other: "Link") -> None:
        """Merges `other`, expressed in the same frame, into this link."""
        self.visuals += other.visuals
        self.collisions += other.collisions
        self.missing += other.missing
        if self.inertia and other.inertia:
            self.inertia += other.inertia
        self.inertia = self.inertia or other.inertia


@dataclass
class Joint:
    """A joint about `axis`; X_PC is the pose of `child` in `parent` at 0."""

    name: str
    type: str  # as in the URDF
    parent: str
    child: str
    X_PC: RigidTransform
    axis: Array  # (3,), a unit vector
    lower: float = -np.inf  # [rad]
    upper: float = np.inf
    effort: float = 0.0  # [N m]; 0: not given
    speed: float = 0.0  # [rad/s]; 0: not given
    rotor_inertia: float = 0.0  # reflected [kg m^2]; 0: not given
    damping: float = 0.0  # [N m s/rad]
    mimics: bool = False

    def pose(self, angle: float) -> RigidTransform:
        """Pose X_PC of the child at `angle` [rad]."""
        if self.type == "fixed":
            return self.X_PC
        turn = trimesh.transformations.rotation_matrix(angle, self.axis)
        return self.X_PC @ RigidTransform(RotationMatrix(turn[:3, :3]))

    def nearest(self, angle: float, margin: float = 0.0) -> float:
        """The angle [rad] nearest to `angle` in the range less a margin."""
        margin = min(margin, 0.25 * (self.upper - self.lower))
        return min(max(angle, self.lower + margin), self.upper - margin)


@dataclass
class Tree:
    """A robot whose links form a tree with the link `root`."""

    name: str
    root: str
    links: dict[str, Link]
    joints: dict[str, Joint]
    welded_to: dict[str, str] = field(default_factory=dict)

    def joint_to(self, link: str) -> Joint:
        """The joint that holds `link`."""
        return next(j for j in self.joints.values() if j.child == link)

    def children(self, link: str) -> list[Joint]:
        """The joints that `link` holds."""
        return [j for j in self.joints.values() if j.parent == link]

    def chain(self, link: str) -> list[Joint]:
        """The joints from the root to `link`."""
        joints: list[Joint] = []
        while link != self.root:
            joints.insert(0, self.joint_to(link))
            link = joints[0].parent
        return joints

    def below(self, link: str) -> Iterator[str]:
        """Yields `link` and its descendants, parents first."""
        yield link
        for joint in self.children(link):
            yield from self.below(joint.child)

    def mass(self, link: str) -> float:
        """Mass of `link` and its descendants [kg]."""
        return sum(self.links[name].mass for name in self.below(link))

    def poses(
        self, angles: Mapping[str, float] | None = None
    ) -> dict[str, RigidTransform]:
        """The pose of each link in the frame of the root.

        Joints without an angle [rad] are at the nearest angle to 0.
        """
        found = {self.root: RigidTransform()}
        for link in list(self.below(self.root))[1:]:
            joint = self.joint_to(link)
            angle = (angles or {}).get(joint.name, joint.nearest(0.0))
            found[link] = found[joint.parent] @ joint.pose(angle)
        return found

    def com(self, poses: Mapping[str, RigidTransform]) -> Array:
        """The centre of mass (3,) in the frame of the root."""
        moments = [
            link.mass * (poses[name] @ link.inertia.get_com())
            for name, link in self.links.items()
            if link.inertia
        ]
        return np.sum(moments, axis=0) / self.mass(self.root)

    def weld(self, joint: Joint, angle: float = 0.0) -> None:
        """Merges the child of `joint` into its parent, at `angle` [rad]."""
        X_PC = joint.pose(joint.nearest(angle))
        child = self.links.pop(joint.child)
        child.move(X_PC)
        self.links[joint.parent].take(child)
        del self.joints[joint.name]
        for further in self.children(joint.child):
            further.parent, further.X_PC = joint.parent, X_PC @ further.X_PC
        self.welded_to[joint.child] = joint.parent

    def holder(self, link: str) -> str:
        """The link to which `link` is welded, or `link` itself."""
        while link in self.welded_to:
            link = self.welded_to[link]
        return link

    def reframe(self, link: str, X_LN: RigidTransform) -> None:
        """Changes the frame of `link` to N, a rotated one; any for the root."""
        self.links[link].move(X_LN.inverse())
        for joint in self.children(link):
            joint.X_PC = X_LN.inverse() @ joint.X_PC
        if link != self.root:
            joint = self.joint_to(link)
            joint.X_PC = joint.X_PC @ X_LN
            joint.axis = X_LN.rotation().inverse() @ joint.axis

    def reroot(self, link: str) -> None:
        """Makes `link` the root; all joints keep their angles."""
        for joint in self.chain(link):
            # The frame of the new child must be that of the joint.
            self.reframe(self.root, joint.X_PC)
            joint.parent, joint.child = joint.child, joint.parent
            joint.axis = -joint.axis
            self.root = joint.parent
