"""Reader of anybody's URDF, mended where no robot is as it says."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import cast
from xml.etree.ElementTree import Element

import numpy as np
import trimesh
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.tree import SpatialInertia

from nadia_balance.core.math.arrays import Array
from nadia_balance.new_robot.description import (
    COLLIDING,
    SOLIDS,
    VISUAL,
    Description,
    Joint,
    Link,
    Notes,
    Shape,
    Vector,
    spatial_inertia,
)
from nadia_balance.parameters.bounds import require

DRAKE = "{http://drake.mit.edu}"
MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_TAGS = {"link", "joint", "material", "transmission"}
_LOOPS = ("loop", "bushing", "constraint")
TURN = 6.3  # largest angle that is meant in rad
_POSITIVE = {"size", "radius", "length", "a", "b", "c"}
_NOT_NEGATIVE = {"effort", "velocity", "damping", "value"}
_ZERO = "0 0 0"
_Z_UP = RigidTransform(RotationMatrix.MakeXRotation(0.5 * np.pi))  # from y up


@dataclass
class _Part:
    """A part of the file, with its `name` in messages."""

    name: str
    element: Element

    def text(self, path: str, key: str, default: str = "") -> str:
        element = self.element.find(path)
        return default if element is None else element.get(key, default)

    def numbers(self, path: str, key: str, default: str = "0") -> Vector:
        """An attribute with as many numbers as `default`, checked."""
        text = self.text(path, key, default)
        count = len(default.split())
        tag = path.rpartition("}")[2].rpartition("/")[2]
        place = f"{self.name}: {tag}: {key} = {text!r}"
        try:
            values = np.array(text.split(), float)
        except ValueError:
            values = np.array([])
        require(
            len(values) == count and np.isfinite(values).all(),
            f"{place}: must be {count} finite number(s)",
        )
        require(
            key not in _POSITIVE or min(values) > 0.0, f"{place}: must be > 0"
        )
        require(
            key not in _NOT_NEGATIVE or min(values) >= 0.0,
            f"{place}: must be >= 0",
        )
        return values

    def number(self, path: str, key: str, default: str = "0") -> float:
        return float(self.numbers(path, key, default)[0])

    def pose(self, path: str) -> RigidTransform:
        rpy = self.numbers(path, "rpy", _ZERO)
        require(
            np.abs(rpy).max() <= TURN,
            f"{self.name}: {path}: rpy = {rpy.tolist()}: must be within "
            "+-2 pi; units are rad",
        )
        return RigidTransform(
            p=self.numbers(path, "xyz", _ZERO), rpy=RollPitchYaw(rpy)
        )


def read_urdf(
    top: Element, file: Path, roots: Sequence[Path], notes: Notes
) -> Description:
    """Reads the robot of a URDF.

    Args:
        top: the tag <robot>.
        file: that it is in.
        roots: folders of its packages; those above `file` are, too.
        notes: get what was left out or made possible.

    Returns:
        The robot.

    Raises:
        ValueError: it has xacro or closed loops, or a number is invalid.
    """
    require(
        top.tag == "robot"
        and not top.findall(".//{http://www.ros.org/wiki/xacro}*"),
        f"<{top.tag}>: must be a URDF, xacro expanded, or an MJCF",
    )
    for tag in sorted({child.tag for child in top} - _TAGS):
        require(
            not any(word in tag for word in _LOOPS),
            f"<{tag}>: must not be there, a closed loop",
        )
        notes.add("changed", "left out the tags", tag)
    links = _links(top, [*roots, *file.resolve().parents], notes)
    joints = {
        name: _joint(name, part) for name, part in _parts(top, "joint").items()
    }
    for element in top.findall("transmission"):
        drive = _Part("transmission", element)
        name = drive.text("joint", "name")
        rotor = drive.number(f".//{DRAKE}rotor_inertia", "value")
        gear = drive.number(f".//{DRAKE}gear_ratio", "value", "1")
        if rotor and name in joints:
            joints[name].rotor_inertia = rotor * gear**2
    joints = {n: j for n, j in joints.items() if j.type != "floating"}
    let_go(links, joints, notes)
    return described(top.get("name") or file.stem, links, joints, notes)


def _links(
    top: Element, folders: Sequence[Path], notes: Notes
) -> dict[str, Link]:
    """The links of a URDF, with shapes and inertias."""
    colours = {
        material.get("name", ""): colour.get("rgba", "")
        for material in top.iter("material")
        for colour in material.findall("color")
    }
    parts = _parts(top, "link")
    links = {name: Link(name) for name in parts}
    for name, part in parts.items():
        for element in part.element:
            if element.tag in (VISUAL, COLLIDING):
                _take_shape(
                    links[name],
                    _Part(f"{element.tag} of {part.name}", element),
                    colours=colours,
                    folders=folders,
                    notes=notes,
                )
    _turn_upright(
        list(links.values()),
        [p.numbers("inertial/origin", "xyz", _ZERO) for p in parts.values()],
        notes,
    )
    for name, part in parts.items():
        links[name].M = _inertia(part, links[name], notes)
    return links


def let_go(
    links: Mapping[str, Link], joints: dict[str, Joint], notes: Notes
) -> None:
    """Frees a robot that is welded to the world, if no other base is free.

    Args:
        links: by name.
        joints: by name; loses the weld.
        notes: get what was changed.
    """
    if {joint.child for joint in joints.values()} >= {*links} - {"world"}:
        holders = {joint.parent for joint in joints.values()}
        for name, joint in list(joints.items()):
            if (
                joint.type == "weld"
                and joint.parent == "world"
                and joint.child in holders
            ):
                notes.add(
                    "changed", "no longer welded to the world", joint.child
                )
                del joints[name]


def described(
    name: str, links: dict[str, Link], joints: dict[str, Joint], notes: Notes
) -> Description:
    """Makes the robot, and notes which bodies are no parts of it.

    Args:
        name: of the robot.
        links: by name.
        joints: by name.
        notes: get the links that no joint joins to the floating base.

    Returns:
        The robot.

    Raises:
        ValueError: the joints leave no tree, or not one floating base.
    """
    robot = Description(name, links, joints)
    others = [
        link for link in links if link != "world" and link not in robot.links
    ]
    if others:
        notes.add("changed", "left out, not joined to the robot", *others)
    return robot


def _parts(top: Element, tag: str) -> dict[str, _Part]:
    parts: dict[str, _Part] = {}
    for element in top.findall(tag):
        name = element.get("name", "")
        require(
            name != "" and name not in parts and "::" not in name,
            f"{tag} {name!r}: must be a unique name, no ::",
        )
        parts[name] = _Part(f"{tag} {name}", element)
    return parts


def _joint(name: str, part: _Part) -> Joint:
    kind = part.element.get("type", "")
    axis = (
        np.eye(3)[0]  # as that of the file may be 0 0 0
        if kind == "fixed"
        else part.numbers("axis", "xyz", "1 0 0")
    )
    require(axis.any(), f"{part.name}: axis: must not be 0 0 0")
    lower = part.number("limit", "lower")
    upper = part.number("limit", "upper")
    require(
        lower <= upper,
        f"{part.name}: lower limit = {lower}: must be <= upper = {upper}",
    )
    return Joint(
        name=name,
        type="weld" if kind == "fixed" else kind,
        parent=part.text("parent", "link"),
        child=part.text("child", "link"),
        X_PC=part.pose("origin"),
        axis=axis / np.linalg.norm(axis),
        lower=-np.pi if kind == "continuous" else lower,
        upper=np.pi if kind == "continuous" else upper,
        effort=part.number("limit", "effort"),
        speed=part.number("limit", "velocity"),
        damping=part.number("dynamics", "damping"),
        mimics=part.element.find("mimic") is not None,
    )


def _take_shape(
    link: Link,
    part: _Part,
    *,
    colours: Mapping[str, str],
    folders: Sequence[Path],
    notes: Notes,
) -> None:
    """Adds the shape in `part` to `link`, if its kind and file are there."""
    solids = part.element.findall("geometry/*")
    kind = solids[0].tag.removeprefix(DRAKE) if solids else "nothing"
    if kind not in SOLIDS:
        notes.add("changed", f"left out the {kind} of {part.name}")
        return
    path = f"geometry/{solids[0].tag}"
    mesh = trimesh.Trimesh()
    try:
        size = {
            key: part.numbers(path, key, _ZERO if kind == "box" else "0")
            for key in SOLIDS[kind]
        }
        if kind == "mesh":
            mesh = _load(
                _find_mesh(part.text(path, "filename"), folders)
            ).copy()
            mesh.apply_scale(part.numbers(path, "scale", "1 1 1"))  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        message = str(error).removeprefix(f"{part.name}: ")
        link.missing = link.missing or message
        notes.add("changed", f"left out {part.name}: {message}")
        return
    colour = part.text(
        "material/color",
        "rgba",
        default=colours.get(part.text("material", "name"), ""),
    )
    if colour and not _is_colour(colour):
        notes.add("changed", "left out the colours of", part.name)
        colour = ""
    link.shapes.append(
        Shape(
            role=part.element.tag,
            kind=kind,
            size=size,
            X_LG=part.pose("origin"),
            colour=colour,
            mesh=mesh,
        )
    )


def _is_colour(text: str) -> bool:
    """True for red, green, blue and alpha in [0, 1]: Drake refuses others."""
    try:
        parts = [float(part) for part in text.split()]
    except ValueError:
        return False
    return len(parts) == 4 and all(0.0 <= part <= 1.0 for part in parts)


def _find_mesh(name: str, folders: Sequence[Path]) -> Path:
    """The path of mesh `name`; packages may also be above the URDF."""
    scheme, separator, rest = name.partition("://")
    tails = [rest or name]
    if separator and scheme != "file":
        package, _, inside = rest.lstrip("/").partition("/")
        tails = [f"{package}/{inside}", inside]
    for path in [folder.resolve() / t for folder in folders for t in tails]:
        if path.is_file():
            return path
    raise FileNotFoundError(f"there is no {name} (--package-root?)")


@cache
def _load(path: Path) -> trimesh.Trimesh:
    try:
        mesh = cast(
            trimesh.Trimesh,
            trimesh.load(path, force="mesh", skip_materials=True),
        )
    except Exception:  # trimesh's readers raise any class
        mesh = trimesh.Trimesh()
    if not len(mesh.vertices):
        raise OSError(f"{path}: must be a whole STL, OBJ or Collada file")
    if path.suffix.lower() == ".dae":
        mesh.metadata["y up"] = b"<up_axis>Y_UP" in path.read_bytes()[:8192]
    return mesh


def _turn_upright(
    links: Sequence[Link], coms: Sequence[Array], notes: Notes
) -> None:
    """Turns meshes whose files say "y is up", if nearer to the CoMs then."""
    meshes = [
        (shape, com)
        for link, com in zip(links, coms, strict=True)
        for shape in link.shapes
        if shape.mesh.metadata.get("y up")
    ]
    nearer = 0.0
    for shape, com in meshes:
        middle = shape.mesh.bounds.mean(axis=0)
        p_GC = shape.X_LG.inverse() @ com
        nearer += float(np.linalg.norm(p_GC - middle))
        nearer -= float(np.linalg.norm(p_GC - _Z_UP @ middle))
    if nearer > 0.0:
        notes.add(
            "changed",
            f"turned {len(meshes)} meshes, of which the files say: y is up",
        )
        for shape, _ in meshes:
            shape.X_LG = shape.X_LG @ _Z_UP


def _inertia(part: _Part, link: Link, notes: Notes) -> SpatialInertia:
    """The inertia of a link; without moments it is that of a box."""
    mass = part.number("inertial/mass", "value")
    X = part.pose("inertial/origin")
    if not mass:
        return SpatialInertia.Zero()
    com: Vector = X.translation()
    given = np.take(
        [part.number("inertial/inertia", key) for key in MOMENTS],
        [[0, 3, 4], [3, 1, 5], [4, 5, 2]],
    )
    if link.shapes and not given.any():
        notes.add("changed", "moments of inertia of 0, now of a box", link.name)
        return SpatialInertia.SolidBoxWithMass(
            mass, *np.ptp(link.corners(), axis=0)
        ).Shift(-com)
    possible = _possible(given, mass)
    if not np.allclose(given, possible, rtol=1e-3, atol=0.0):
        notes.add(
            "changed",
            "moments of inertia that no body has, made possible",
            link.name,
        )
    R = X.rotation().matrix()
    return spatial_inertia(mass, com, R @ possible @ R.T)


def _possible(inertia: Array, mass: float) -> Array:
    """Makes principal moments those of a body, at least of a ball of 1 cm."""
    given, axes = np.linalg.eigh(inertia)
    moments = np.maximum(np.abs(given), 0.4 * mass * 0.01**2)
    largest = int(moments.argmax())
    rest = moments.sum() - moments[largest]
    moments[largest] = min(moments[largest], 0.999 * rest)
    return (
        inertia
        if (moments == given).all()
        else np.asarray(axes @ np.diag(moments) @ axes.T)
    )
