"""A robot's description: a tree of links and joints, and its anatomy."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import RotationalInertia, SpatialInertia
from trimesh import Trimesh, bounds, creation

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import Side

Vector = Any  # array (3,): Drake's stubs name no type of numpy's
VISUAL, COLLIDING = "visual", "collision"
Poses = dict[str, RigidTransform]  # of links, by name, in the root
# Tags of solids in a URDF, with their attributes [m].
SOLIDS = {
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "ellipsoid": ("a", "b", "c"),
    "mesh": (),
}
# What makes the mesh of a solid, of the numbers in its attributes.
_MESHES: dict[str, Callable[..., Trimesh]] = {
    "box": lambda x, y, z: creation.box((x, y, z)),
    "sphere": lambda radius: creation.icosphere(3, radius),
    "cylinder": creation.cylinder,
    "capsule": lambda radius, length: creation.capsule(length, radius),
    "ellipsoid": lambda a, b, c: creation.icosphere(3).apply_scale((a, b, c)),
}


class Notes:
    """Lines on guessed, changed and unknown properties, and warnings."""

    KINDS = ("guessed", "changed", "unknown", "warning")

    def __init__(self) -> None:
        self._names: dict[str, dict[str, list[str]]] = {
            kind: {} for kind in self.KINDS
        }

    def add(self, kind: str, line: str, *names: str) -> None:
        """Adds a line, or more names to the same line.

        Args:
            kind: one of KINDS.
            line: what was guessed, changed, ...
            *names: links or joints that it is about.
        """
        self._names[kind].setdefault(line, []).extend(names)

    def of(self, kind: str) -> list[str]:
        """Lists the lines of one kind.

        Args:
            kind: one of KINDS.

        Returns:
            The lines, each with its names.
        """
        return [
            f"{line}: {', '.join(names)}" if names else line
            for line, names in self._names[kind].items()
        ]

    def lines(self) -> list[str]:
        """Lists the lines of all kinds.

        Returns:
            The lines, each with its kind as prefix.
        """
        return [
            f"{kind}: {line}" for kind in self.KINDS for line in self.of(kind)
        ]


@dataclass
class Shape:
    """A shape that is fixed in a link."""

    role: str  # VISUAL or COLLIDING
    kind: str  # its tag in a URDF, of SOLIDS
    size: dict[str, Array]  # attributes of that tag [m]; of a mesh: none
    X_LG: RigidTransform
    colour: str = ""  # red, green, blue and alpha, "r g b a"
    mesh: Trimesh = field(default_factory=Trimesh)  # in G [m]; else it is made

    def __post_init__(self) -> None:
        if self.kind in _MESHES:
            numbers = np.concatenate([*self.size.values()])
            self.mesh = _MESHES[self.kind](*map(float, numbers))

    def points(self) -> Array:
        """Lists the vertices of the mesh.

        Returns:
            Points (k, 3) in the link [m].
        """
        return np.asarray(self.X_LG @ self.mesh.vertices.T).T

    def spine(self, count: int) -> Array:
        """Samples the axis of a sphere or capsule.

        Args:
            count: number of points.

        Returns:
            Points (3, count) in the link [m].
        """
        z = 0.5 * self.size.get("length", 0.0) * np.linspace(-1.0, 1.0, count)
        return np.asarray(self.X_LG @ np.stack([0.0 * z, 0.0 * z, z]))


@dataclass
class Link:
    """Bodies of the file that are welded together, seen in one frame L."""

    name: str  # of the body that holds the others
    M: SpatialInertia = field(default_factory=SpatialInertia.Zero)  # about Lo
    shapes: list[Shape] = field(default_factory=list)
    bodies: list[str] = field(default_factory=list)  # names of the others
    missing: str = ""  # why a shape was left out

    def of(self, role: str) -> list[Shape]:
        """Lists the shapes with one role.

        Args:
            role: VISUAL or COLLIDING.

        Returns:
            These shapes, in the order of the file.
        """
        return [shape for shape in self.shapes if shape.role == role]

    def corners(self) -> Array:
        """Lists the corners of the boxes about its shapes.

        Returns:
            Points (k, 3) in L [m].
        """
        boxes = [
            shape.X_LG @ bounds.corners(shape.mesh.bounds).T  # type: ignore[no-untyped-call]
            for shape in self.shapes
        ]
        return np.concatenate(boxes, axis=1).T

    def move(self, X_NL: RigidTransform) -> None:
        """Changes its frame from L to N.

        Args:
            X_NL: pose of L in N.
        """
        self.M = self.M.ReExpress(X_NL.rotation()).Shift(
            np.negative(X_NL.translation())
        )
        for shape in self.shapes:
            shape.X_LG = X_NL @ shape.X_LG

    def central(self) -> RotationalInertia:
        """Returns its rotational inertia about its CoM, in L.

        Returns:
            The inertia [kg m^2].
        """
        return self.M.Shift(self.M.get_com()).CalcRotationalInertia()


def spatial_inertia(mass: float, com: Vector, central: Array) -> SpatialInertia:
    """Makes the spatial inertia of a body about the origin of its frame.

    Args:
        mass: of the body [kg]; 0 gives no inertia.
        com: CoM (3,) [m].
        central: rotational inertia (3, 3) about the CoM [kg m^2].

    Returns:
        The inertia about the origin, in the body's frame.
    """
    if not mass:
        return SpatialInertia.Zero()
    return SpatialInertia.MakeFromCentralInertia(
        mass,
        com,
        RotationalInertia(
            Ixx=central[0, 0],
            Iyy=central[1, 1],
            Izz=central[2, 2],
            Ixy=central[0, 1],
            Ixz=central[0, 2],
            Iyz=central[1, 2],
        ),
    )


@dataclass
class Joint:
    """A joint between two links, at the origin of its child C."""

    name: str
    type: str  # of a URDF, or "weld"
    parent: str
    child: str
    X_PC: RigidTransform  # at angle 0
    axis: Vector = field(default_factory=lambda: np.eye(3)[0])  # unit, in C
    lower: float = 0.0  # [rad]
    upper: float = 0.0
    effort: float = 0.0  # [N m]; 0: not given
    speed: float = 0.0  # [rad/s]; 0: not given
    rotor_inertia: float = 0.0  # reflected [kg m^2]; 0: not given
    damping: float = 0.0  # [N m s/rad]
    mimics: bool = False

    def nearest(self, angle: float, margin: float = 0.0) -> float:
        """Finds the nearest angle in the range.

        Args:
            angle: asked for [rad].
            margin: to both limits [rad]; at most a quarter of the range.

        Returns:
            The angle [rad].
        """
        margin = min(margin, 0.25 * (self.upper - self.lower))
        return min(max(angle, self.lower + margin), self.upper - margin)

    def pose(self, angle: float) -> RigidTransform:
        """Moves the joint.

        Args:
            angle: [rad]; of a prismatic joint [m].

        Returns:
            The child's pose in the parent.
        """
        if self.type == "prismatic":
            return RigidTransform(self.X_PC @ RigidTransform(angle * self.axis))
        R = RotationMatrix(AngleAxis(angle, self.axis))
        return RigidTransform(self.X_PC @ RigidTransform(R))


@dataclass
class Description:
    """A robot; its links are a tree, of which `root` is the floating one.

    Args:
        name: of the robot.
        links: by name; those outside of the tree are left out.
        joints: by name.

    Raises:
        ValueError: the joints leave no tree, or not one floating base.
    """

    name: str
    links: dict[str, Link]
    joints: dict[str, Joint]

    def __post_init__(self) -> None:
        held: dict[str, str] = {}
        for name, joint in self.joints.items():
            for link in {joint.parent, joint.child} - self.links.keys():
                raise ValueError(f"joint {name}: link {link}: must be there")
            if joint.child in held:
                raise ValueError(
                    f"link {joint.child}: must be held by one joint, not by "
                    f"{held[joint.child]} and {name}: a closed loop"
                )
            held[joint.child] = name
        self._find_root([link for link in self.links if link not in held])
        self.links = {name: self.links[name] for name in self.below(self.root)}
        self.joints = {
            name: joint
            for name, joint in self.joints.items()
            if joint.parent in self.links
        }

    def _find_root(self, free: list[str]) -> None:
        """Sets the root, the one of the links `free` that is a base.

        Beside one that holds others, a link alone is of a scene, as a ball is.
        """
        bases = [
            link
            for link in free
            if link != "world" and (self.mass([link]) or self.children(link))
        ]
        bases = [link for link in bases if self.children(link)] or bases
        tree = {link for base in free for link in self.below(base)}
        loop = [link for link in self.links if link not in tree]
        if len(bases) != 1 or loop:
            raise ValueError(
                f"floating bases: must be one; these are: "
                f"{', '.join(bases) or 'none'}; links in closed loops: "
                f"{', '.join(loop) or 'none'}"
            )
        self.root = bases[0]

    def children(self, link: str) -> list[Joint]:
        """Lists the joints that a link holds.

        Args:
            link: name of the link.

        Returns:
            The joints to its children.
        """
        return [j for j in self.joints.values() if j.parent == link]

    def chain(self, link: str) -> list[Joint]:
        """Lists the joints from the root to a link.

        Args:
            link: name of the link.

        Returns:
            The joints, the root's first; of the root: none.
        """
        return next(
            (
                [*self.chain(joint.parent), joint]
                for joint in self.joints.values()
                if joint.child == link
            ),
            [],
        )

    def below(self, link: str) -> Iterator[str]:
        """Walks through a link and its descendants, parents first.

        Args:
            link: name of the link.

        Yields:
            Names of links.
        """
        yield link
        for joint in self.children(link):
            yield from self.below(joint.child)

    def holder(self, name: str) -> str:
        """Finds the link that a body is a part of.

        Args:
            name: of a body in the file.

        Returns:
            The name of the link.

        Raises:
            ValueError: there is no such body.
        """
        for link in self.links.values():
            if name in (link.name, *link.bodies):
                return link.name
        raise ValueError(
            f"link {name}: must be one of {', '.join(sorted(self.links))}"
        )

    def mass(self, links: Iterable[str]) -> float:
        """Adds the masses of links.

        Args:
            links: their names.

        Returns:
            The mass [kg].
        """
        return sum(self.links[link].M.get_mass() for link in links)

    def poses(self, angles: Mapping[str, float] | None = None) -> Poses:
        """Moves the joints.

        Args:
            angles: by joint [rad]; all others are at 0, or as near as can be.

        Returns:
            The poses of all links in the root.
        """
        poses = {self.root: RigidTransform()}
        for link in self.below(self.root):
            for joint in self.children(link):
                angle = (angles or {}).get(joint.name, joint.nearest(0.0))
                poses[joint.child] = poses[link] @ joint.pose(angle)
        return poses

    def com(self, poses: Poses) -> Array:
        """Returns the CoM, sum m p / sum m.

        Args:
            poses: of all links.

        Returns:
            The point (3,) in the root [m].
        """
        moment = sum(
            self.links[name].M.get_mass() * (X @ self.links[name].M.get_com())
            for name, X in poses.items()
        )
        return np.asarray(moment / self.mass(self.links))

    def hinges(self, names: Iterable[str], poses: Poses) -> tuple[Array, Array]:
        """Returns where joints are, and their axes.

        Args:
            names: of n joints.
            poses: of all links.

        Returns:
            Points (n, 3) on the joints [m] and their axes (n, 3), in the root.
        """
        joints = [self.joints[name] for name in names]
        points = [poses[joint.child].translation() for joint in joints]
        axes = [poses[joint.child].rotation() @ joint.axis for joint in joints]
        return np.array(points), np.array(axes)

    def weld(self, names: Iterable[str]) -> None:
        """Welds joints at the nearest angle to 0; their children become parts.

        Args:
            names: of the joints.
        """
        for name in names:
            joint = self.joints.pop(name)
            X_PC = joint.pose(joint.nearest(0.0))
            child = self.links.pop(joint.child)
            child.move(X_PC)
            link = self.links[joint.parent]
            link.M += child.M
            link.shapes += child.shapes
            link.bodies += [child.name, *child.bodies]
            link.missing = link.missing or child.missing
            for other in self.children(child.name):
                other.parent = joint.parent
                other.X_PC = X_PC @ other.X_PC

    def reroot(self, link: str) -> None:
        """Makes another link the root; all joints keep their angles.

        Args:
            link: name of the new root.
        """
        for joint in self.chain(link):
            self.move(joint.parent, joint.X_PC.inverse())
            joint.parent, joint.child = joint.child, joint.parent
            joint.axis = -joint.axis
        self.root = link

    def move(self, link: str, X_NL: RigidTransform) -> None:
        """Changes the frame of a link from L to N.

        Args:
            link: name of the link.
            X_NL: pose of L in N, of which the origin stays on the joint.
        """
        self.links[link].move(X_NL)
        for joint in self.joints.values():
            if joint.parent == link:
                joint.X_PC = X_NL @ joint.X_PC
            elif joint.child == link:
                joint.X_PC = joint.X_PC @ X_NL.inverse()
                joint.axis = X_NL.rotation() @ joint.axis


@dataclass
class Leg:
    """Names of one leg's foot and joints."""

    foot: str
    joints: list[str]  # from the pelvis to the foot
    pitches: list[str] = field(default_factory=list)  # of hip, knee and ankle

    @property
    def knee(self) -> str:
        """The joint between thigh and shin."""
        return self.pitches[1]


@dataclass
class Anatomy:
    """Names and axes of a robot at zero posture, in its root."""

    torso: str  # link of which arms and head are children
    legs: dict[Side, Leg]
    axes: Array  # (3, 3): forward, left, up, one a column

    @property
    def feet(self) -> dict[Side, str]:
        """The foot links by side."""
        return {side: leg.foot for side, leg in self.legs.items()}
