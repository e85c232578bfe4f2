"""A robot's description: a tree of links and joints, and its anatomy."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
import trimesh
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import RotationalInertia, SpatialInertia

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.walking.state import Side

VISUAL, COLLIDING = "visual", "collision"
Poses = dict[str, RigidTransform]  # of links, by name, in the root
_make, _ball = trimesh.creation, trimesh.creation.icosphere
# Attributes [m] of the tags of a URDF, and what makes their meshes.
SOLIDS = {
    "box": (("size",), lambda *size: _make.box(size)),
    "sphere": (("radius",), lambda r: _ball(3, r)),
    "cylinder": (("radius", "length"), _make.cylinder),
    "capsule": (("radius", "length"), lambda r, long: _make.capsule(long, r)),
    "ellipsoid": (("a", "b", "c"), lambda *s: _ball(3).apply_scale(s)),
    "mesh": ((), None),
}


class Notes:
    """Lines on guessed, changed and unknown properties, and warnings."""

    KINDS = ("guessed", "changed", "unknown", "warning")

    def __init__(self):
        self._found = {kind: {} for kind in self.KINDS}

    def add(self, kind: str, line: str, *names: str) -> None:
        """Adds a line of one of KINDS; names join those of the same line."""
        self._found[kind].setdefault(line, []).extend(names)

    def of(self, kind: str) -> list[str]:
        """The lines of a kind, with their names."""
        found = [(k, ", ".join(v)) for k, v in self._found[kind].items()]
        return [f"{line}: {names}" if names else line for line, names in found]

    def lines(self) -> list[str]:
        """All lines, each with its kind as prefix."""
        return [f"{kind}: {x}" for kind in self.KINDS for x in self.of(kind)]


@dataclass
class Shape:
    """A shape with the pose X_LG in its link."""

    role: str  # VISUAL or COLLIDING
    kind: str  # its tag in a URDF, of SOLIDS
    size: dict[str, Array]  # attributes of that tag; of a mesh: none
    X_LG: RigidTransform
    colour: str = ""  # "r g b a"
    mesh: trimesh.Trimesh | None = None  # in G; made if it is no "mesh"

    def __post_init__(self):
        if make := SOLIDS[self.kind][1]:
            self.mesh = make(*map(float, np.concatenate([*self.size.values()])))

    def points(self) -> Array:
        """Vertices (k, 3) in the frame of the link."""
        return (self.X_LG @ np.asarray(self.mesh.vertices).T).T

    def spine(self, count: int) -> Array:
        """Points (3, count) on the axis of a sphere or capsule, in the link."""
        z = 0.5 * self.size.get("length", 0.0) * np.linspace(-1.0, 1.0, count)
        return self.X_LG @ np.stack([0.0 * z, 0.0 * z, z])


@dataclass
class Link:
    """Bodies of the file that are welded together, seen in one frame L."""

    name: str  # of the body that holds the others
    M: SpatialInertia = field(default_factory=SpatialInertia.Zero)  # about Lo
    shapes: list[Shape] = field(default_factory=list)
    bodies: list[str] = field(default_factory=list)  # names of the others
    missing: str = ""  # why a shape was left out

    def of(self, role: str) -> list[Shape]:
        """Its shapes that are VISUAL or COLLIDING."""
        return [shape for shape in self.shapes if shape.role == role]

    def corners(self) -> Array:
        """Corners (k, 3) of the boxes about its shapes."""
        corners = trimesh.bounds.corners
        boxes = [s.X_LG @ corners(s.mesh.bounds).T for s in self.shapes]
        return np.concatenate(boxes, axis=1).T

    def move(self, X_NL: RigidTransform) -> None:
        """Changes its frame to N."""
        self.M = self.M.ReExpress(X_NL.rotation()).Shift(-X_NL.translation())
        for shape in self.shapes:
            shape.X_LG = X_NL @ shape.X_LG

    def central(self) -> RotationalInertia:
        """Its rotational inertia about its centre of mass."""
        return self.M.Shift(self.M.get_com()).CalcRotationalInertia()


def spatial_inertia(mass: float, com: Array, central: Array) -> SpatialInertia:
    """The inertia about the origin; `central` (3, 3) [kg m^2] is at `com`."""
    if not mass:
        return SpatialInertia.Zero()
    rows, columns = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    rotational = RotationalInertia(*central[rows, columns])
    return SpatialInertia.MakeFromCentralInertia(mass, com, rotational)


@dataclass
class Joint:
    """A joint between two links, at the origin of its child."""

    name: str
    type: str
    parent: str
    child: str
    X_PC: RigidTransform  # at angle 0
    axis: Array = field(default_factory=lambda: np.eye(3)[0])  # unit, in C
    lower: float = 0.0  # [rad]
    upper: float = 0.0
    effort: float = 0.0  # [N m]; 0: not given
    speed: float = 0.0  # [rad/s]; 0: not given
    rotor_inertia: float = 0.0  # reflected [kg m^2]; 0: not given
    damping: float = 0.0  # [N m s/rad]
    mimics: bool = False

    def nearest(self, angle: float, margin: float = 0.0) -> float:
        """The angle [rad] nearest to `angle` in the range less a margin."""
        margin = min(margin, 0.25 * (self.upper - self.lower))
        return min(max(angle, self.lower + margin), self.upper - margin)

    def pose(self, angle: float) -> RigidTransform:
        """The child's pose in the parent at an `angle` [rad], or [m]."""
        if self.type == "prismatic":
            return self.X_PC @ RigidTransform(angle * self.axis)
        R = RotationMatrix(AngleAxis(angle, self.axis))
        return self.X_PC @ RigidTransform(R)


@dataclass
class Description:
    """A robot; its links are a tree, of which `root` is the floating one.

    Raises ValueError: the joints leave no tree, or not one floating base.
    """

    name: str
    links: dict[str, Link]
    joints: dict[str, Joint]

    def __post_init__(self):
        held: dict[str, str] = {}
        for name, joint in self.joints.items():
            for link in {joint.parent, joint.child} - self.links.keys():
                raise ValueError(f"joint {name}: link {link}: must be there")
            if other := held.get(link := joint.child):
                what = f"link {link}: must be held by one joint, not by"
                raise ValueError(f"{what} {other} and {name}: a closed loop")
            held[link] = name
        free = [link for link in self.links if link not in held]
        bases = [link for link in free if link != "world"]
        bases = [b for b in bases if self.mass([b]) or self.children(b)]
        tree = {link for base in free for link in self.below(base)}
        loop = [link for link in self.links if link not in tree]
        if len(bases) != 1 or loop:
            found = [", ".join(names) or "none" for names in (bases, loop)]
            why = "must be one; these are: {}; links in closed loops: {}"
            raise ValueError(f"floating bases: {why.format(*found)}")
        (self.root,) = bases
        links, joints = list(self.below(self.root)), self.joints.items()
        self.links = {name: self.links[name] for name in links}
        self.joints = {n: j for n, j in joints if j.parent in self.links}

    def children(self, link: str) -> list[Joint]:
        """The joints that `link` holds."""
        return [j for j in self.joints.values() if j.parent == link]

    def chain(self, link: str) -> list[Joint]:
        """The joints from the root to `link`."""
        for joint in self.joints.values():
            if joint.child == link:
                return [*self.chain(joint.parent), joint]
        return []

    def below(self, link: str) -> Iterator[str]:
        """Yields `link` and its descendants, parents first."""
        yield link
        for joint in self.children(link):
            yield from self.below(joint.child)

    def holder(self, name: str) -> str:
        """The link of which the body `name` is a part, or ValueError."""
        for link in self.links.values():
            if name in (link.name, *link.bodies):
                return link.name
        known = ", ".join(sorted(self.links))
        raise ValueError(f"link {name}: must be one of {known}")

    def mass(self, links: Iterable[str]) -> float:
        """Mass of `links` [kg]."""
        return sum(self.links[link].M.get_mass() for link in links)

    def poses(self, angles: Mapping[str, float] | None = None) -> Poses:
        """The poses of links in the root; angles [rad] are 0, or near it."""
        poses, known = {self.root: RigidTransform()}, angles or {}
        for link in self.below(self.root):
            for joint in self.children(link):
                angle = known.get(joint.name, joint.nearest(0.0))
                poses[joint.child] = poses[link] @ joint.pose(angle)
        return poses

    def com(self, poses: Poses) -> Array:
        """The centre of mass (3,) in the frame of the root."""
        inertias = [(X, self.links[name].M) for name, X in poses.items()]
        moment = sum(M.get_mass() * (X @ M.get_com()) for X, M in inertias)
        return moment / self.mass(self.links)

    def hinges(self, names: Iterable[str], poses: Poses) -> tuple[Array, Array]:
        """Points (n, 3) on joints and their axes (n, 3), in the root."""
        joints = [self.joints[name] for name in names]
        at = [poses[joint.child] for joint in joints]
        axes = [X.rotation() @ j.axis for X, j in zip(at, joints, strict=True)]
        return np.array([X.translation() for X in at]), np.array(axes)

    def weld(self, names: Iterable[str]) -> None:
        """Welds joints at the nearest angle to 0."""
        for joint in map(self.joints.pop, names):
            X_PC = joint.pose(joint.nearest(0.0))
            link, child = self.links[joint.parent], self.links.pop(joint.child)
            child.move(X_PC)
            link.M += child.M
            link.shapes += child.shapes
            link.bodies += [child.name, *child.bodies]
            link.missing = link.missing or child.missing
            for other in self.children(child.name):
                other.parent, other.X_PC = joint.parent, X_PC @ other.X_PC

    def reroot(self, link: str) -> None:
        """Makes `link` the root; all joints keep their angles."""
        for joint in self.chain(link):
            self.move(joint.parent, joint.X_PC.inverse())
            joint.parent, joint.child = joint.child, joint.parent
            joint.axis = -joint.axis
        self.root = link

    def move(self, link: str, X_NL: RigidTransform) -> None:
        """Changes the frame of `link` to N; the origin stays on its joint."""
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

    torso: str
    legs: dict[Side, Leg]
    axes: Array  # (3, 3): forward, left, up, one a column

    @property
    def feet(self) -> dict[Side, str]:
        """The foot links by side."""
        return {side: leg.foot for side, leg in self.legs.items()}
