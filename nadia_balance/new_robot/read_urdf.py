"""Tolerant reader of URDF files into a Tree."""

import math
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import trimesh
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.tree import (
    RotationalInertia,
    SpatialInertia,
    UnitInertia,
)

from nadia_balance.new_robot.notes import Notes
from nadia_balance.new_robot.primitives import primitive_mesh
from nadia_balance.new_robot.tree import Joint, Link, Shape, Tree

_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
_DRAKE = "{http://drake.mit.edu}"
_KNOWN = {"link", "joint", "material", "transmission"}


def read_urdf(file: Path, roots: Sequence[Path], notes: Notes) -> Tree:
    """Returns the robot of a URDF; `roots` are folders of its packages.

    Raises:
        ValueError: the links are no tree, or a number is invalid; names the
            link or joint.
        OSError: the file cannot be read.
    """
    try:
        top = ElementTree.parse(file).getroot()
    except ElementTree.ParseError as error:
        raise ValueError(f"malformed XML: {error}") from None
    if top.tag != "robot" or top.findall(".//{http://www.ros.org/wiki/xacro}*"):
        raise ValueError(f"<{top.tag}>: must be a URDF, xacro expanded")
    dropped = sorted({child.tag for child in top} - _KNOWN)
    for tag in dropped:
        if "loop" in tag or "bushing" in tag or "constraint" in tag:
            name = top.find(tag).get("name", "")
            raise ValueError(
                f"<{tag}> {name}: must not be there, a closed loop"
            )
    if dropped:
        notes.changed.append(f"left out the tags {', '.join(dropped)}")
    reader = _Reader(file, roots, notes, _colours(top))
    links = [reader.link(element) for element in top.findall("link")]
    joints = [reader.joint(element) for element in top.findall("joint")]
    if reader.mended:
        notes.changed.append(
            "moments of inertia that no body has, made possible: "
            + ", ".join(reader.mended)
        )
    _read_rotors(top, joints)
    for what, named in ("link", links), ("joint", joints):
        names = [one.name for one in named]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"{what} {name}: must be there once")
    return _tree(top.get("name", file.stem), links, joints)


def _tree(name: str, links: list[Link], joints: list[Joint]) -> Tree:
    by_name = {link.name: link for link in links}
    held: dict[str, str] = {}
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in by_name:
                raise ValueError(f"joint {joint.name}: no link {link!r}")
        if joint.child in held:
            raise ValueError(
                f"link {joint.child}: must be held by one joint, not by "
                f"{held[joint.child]} and {joint.name}: a closed loop"
            )
        held[joint.child] = joint.name
    roots = [link for link in by_name if link not in held]
    if not roots:
        raise ValueError(f"joint {joints[0].name}: must not close a loop")
    if len(roots) > 1:
        raise ValueError(
            f"links {' and '.join(roots)}: only one must be held by no joint, "
            "the floating base"
        )
    tree = Tree(name, roots[0], by_name, {j.name: j for j in joints})
    inside = set(tree.below(tree.root))
    for link in by_name:
        if link not in inside:
            raise ValueError(f"link {link}: must not be in a closed loop")
    return tree


def _colours(top: Element) -> dict[str, str]:
    return {
        material.get("name", ""): material.find("color").get("rgba", "")
        for material in top.findall("material")
        if material.find("color") is not None
    }


def _read_rotors(top: Element, joints: list[Joint]) -> None:
    by_name = {joint.name: joint for joint in joints}
    for transmission in top.findall("transmission"):
        driven = transmission.find("joint")
        inertia = transmission.find(f".//{_DRAKE}rotor_inertia")
        gear = transmission.find(f".//{_DRAKE}gear_ratio")
        if inertia is None or driven is None:
            continue
        name = driven.get("name", "")
        ratio = 1.0 if gear is None else _number(gear, "value", name)
        if name in by_name:
            rotor = _number(inertia, "value", f"joint {name}")
            by_name[name].rotor_inertia = rotor * ratio**2


def _number(
    element: Element, attribute: str, where: str, default: float | None = None
) -> float:
    text = element.get(attribute)
    if text is None and default is not None:
        return default
    try:
        if math.isfinite(value := float(text or "")):
            return value
    except ValueError:
        pass
    raise ValueError(f"{where}: {attribute} = {text}: must be a finite number")


def _read_limits(element: Element, joint: Joint) -> None:
    where = f"joint {joint.name}"

    def value(tag: str, attribute: str) -> float:
        child = element.find(tag)
        if child is None:
            return 0.0
        return _number(child, attribute, where, 0.0)

    joint.lower, joint.upper = value("limit", "lower"), value("limit", "upper")
    if joint.lower > joint.upper:
        raise ValueError(
            f"{where}: lower limit = {joint.lower}: must be <= upper = "
            f"{joint.upper}"
        )
    if joint.type == "continuous":
        joint.lower, joint.upper = -math.pi, math.pi
    joint.effort = value("limit", "effort")
    joint.speed = value("limit", "velocity")
    joint.damping = max(value("dynamics", "damping"), 0.0)
    for what in ("effort", "speed"):
        if getattr(joint, what) < 0.0:
            raise ValueError(
                f"{where}: {what} = {getattr(joint, what)}: must be >= 0"
            )


def _vector(element: Element, attribute: str, where: str, default: str):
    text = element.get(attribute, default)
    try:
        value = np.array(text.split(), dtype=float)
        if value.shape == (3,) and np.isfinite(value).all():
            return value
    except ValueError:
        pass
    raise ValueError(f"{where}: {attribute} = {text!r}: must be three numbers")


def _origin(element: Element, where: str) -> RigidTransform:
    origin = element.find("origin")
    if origin is None:
        return RigidTransform()
    rpy = RollPitchYaw(_vector(origin, "rpy", where, "0 0 0"))
    return RigidTransform(rpy, _vector(origin, "xyz", where, "0 0 0"))


class _Reader:
    def __init__(self, file, roots, notes, colours):
        self._file, self._roots, self._notes = file, roots, notes
        self._colours = colours
        self.mended: list[str] = []  # links

    def link(self, element: Element) -> Link:
        name = element.get("name", "")
        link = Link(name, self._inertia(element, f"link {name}"))
        for kind, shapes in (
            ("visual", link.visuals),
            ("collision", link.collisions),
        ):
            for part in element.findall(kind):
                if shape := self._shape(part, f"{kind} of link {name}", link):
                    shapes.append(shape)
        return link

    def _inertia(self, element: Element, where: str) -> SpatialInertia | None:
        inertial = element.find("inertial")
        if inertial is None or inertial.find("mass") is None:
            return None
        mass = _number(inertial.find("mass"), "value", where)
        if mass < 0.0:
            raise ValueError(f"{where}: mass = {mass}: must be >= 0 kg")
        if mass == 0.0:
            return None
        moments = inertial.find("inertia")
        names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        xx, yy, zz, xy, xz, yz = (
            0.0 if moments is None else _number(moments, n, where, 0.0)
            for n in names
        )
        given = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        possible = _possible(given, mass)
        if not np.allclose(given, possible, rtol=1e-3, atol=0.0):
            self.mended.append(where.removeprefix("link "))
        X = _origin(inertial, where)
        unit = UnitInertia(RotationalInertia(*_six(possible / mass)))
        central = SpatialInertia(mass, np.zeros(3), unit)
        turned = central.ReExpress(X.rotation())
        return turned.Shift(-X.translation())

    def joint(self, element: Element) -> Joint:
        name, kind = element.get("name", ""), element.get("type", "")
        where = f"joint {name}"
        if kind not in _TYPES:
            allowed = ", ".join(_TYPES)
            raise ValueError(f"{where}: type = {kind!r}: must be of {allowed}")
        for end in ("parent", "child"):
            if element.find(end) is None:
                raise ValueError(f"{where}: must have a <{end}>")
        axis = element.find("axis")
        axis = Element("axis") if axis is None else axis
        direction = _vector(axis, "xyz", where, "1 0 0")
        length = np.linalg.norm(direction) or 1.0
        if kind != "fixed" and not direction.any():
            raise ValueError(f"{where}: axis = 0 0 0: must have a direction")
        found = Joint(
            name=name,
            type=kind,
            parent=element.find("parent").get("link", ""),
            child=element.find("child").get("link", ""),
            X_PC=_origin(element, where),
            axis=direction / length,
            mimics=element.find("mimic") is not None,
        )
        _read_limits(element, found)
        return found

    def _shape(self, part: Element, where: str, link: Link) -> Shape | None:
        geometry = part.find("geometry")
        if geometry is None or not len(geometry):
            return None
        size = geometry[0]
        kind = size.tag.removeprefix(_DRAKE)
        mesh = self._mesh(kind, size, where)
        if mesh is None:
            link.missing.append(size.get("filename", kind))
            return None
        material = part.find("material")
        colour = ""
        if material is not None:
            own = material.find("color")
            known = self._colours.get(material.get("name", ""), "")
            colour = known if own is None else own.get("rgba", "")
        X_LG = _origin(part, where)
        return Shape(kind, dict(size.attrib), X_LG, mesh, colour)

    def _mesh(self, kind, size, where) -> trimesh.Trimesh | None:
        if kind == "mesh":
            return self._load(size, where)
        mesh = primitive_mesh(kind, size.attrib, where)
        if mesh is None:
            self._notes.changed.append(f"left out the {kind} of {where}")
        return mesh

    def _load(self, size: Element, where: str) -> trimesh.Trimesh | None:
        name = size.get("filename", "")
        path = self._find(name)
        if path is None:
            self._notes.changed.append(
                f"left out {where}: there is no {name} (--package-root?)"
            )
            return None
        try:
            mesh = trimesh.load(path, force="mesh", skip_materials=True)
        except Exception as error:  # trimesh's readers raise any class
            raise ValueError(f"{where}: {path}: {error}") from None
        if not len(mesh.vertices):
            raise ValueError(f"{where}: {path}: must not be empty")
        mesh.apply_scale(_vector(size, "scale", where, "1 1 1"))
        return mesh

    def _find(self, name: str) -> Path | None:
        """The path of mesh `name`; packages may also be above the URDF."""
        scheme, separator, rest = name.partition("://")
        if not separator:
            places = [self._file.parent / name]
        elif scheme == "file":
            places = [Path(rest)]
        else:
            rest = rest.lstrip("/")
            folders = [*self._roots, *self._file.resolve().parents]
            inside = rest.partition("/")[2]
            places = [f / tail for f in folders for tail in (rest, inside)]
        return next((place for place in places if place.is_file()), None)


def _six(inertia) -> tuple:
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertia
    return xx, yy, zz, xy, xz, yz


def _possible(inertia: np.ndarray, mass: float) -> np.ndarray:
    """Corrects `inertia` (3, 3) [kg m^2] to a physically possible one.

    Principal moments become positive, fulfil the triangle inequality, and are
    at least those of a solid sphere of 1 cm radius.
    """
    moments, axes = np.linalg.eigh(inertia)
    moments = np.maximum(np.abs(moments), 0.4 * mass * 0.01**2)
    largest = int(moments.argmax())
    rest = moments.sum() - moments[largest]
    moments[largest] = min(moments[largest], 0.999 * rest)
    if (moments == np.linalg.eigvalsh(inertia)).all():
        return inertia
    return axes @ np.diag(moments) @ axes.T
