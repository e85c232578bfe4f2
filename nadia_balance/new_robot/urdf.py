"""Reader of anybody's URDF, mended where no robot is as it says."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import trimesh
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.tree import SpatialInertia

from nadia_balance.core.math.arrays import Array
from nadia_balance.new_robot import Notes
from nadia_balance.new_robot import description as robots

DRAKE = "{http://drake.mit.edu}"
MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_KNOWN = {"link", "joint", "material", "transmission"}
_LOOPS = ("loop", "bushing", "constraint")
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

    def numbers(self, path: str, key: str, default: str = "0") -> Array:
        """An attribute with as many numbers as `default`, checked."""
        text = self.text(path, key, default)
        tag = path.rpartition("}")[2].rpartition("/")[2]
        where = f"{self.name}: {tag}: {key} = {text!r}: must be"
        try:
            values = np.array(text.split(), float)
        except ValueError:
            values = np.array([])
        count = len(default.split())
        if len(values) != count or not np.isfinite(values).all():
            raise ValueError(f"{where} {count} number(s)")
        if key in _POSITIVE and min(values) <= 0.0:
            raise ValueError(f"{where} > 0")
        if key in _NOT_NEGATIVE and min(values) < 0.0:
            raise ValueError(f"{where} >= 0")
        return values

    def number(self, path: str, key: str, default: str = "0") -> float:
        return float(self.numbers(path, key, default)[0])

    def pose(self, path: str) -> RigidTransform:
        xyz, rpy = (self.numbers(path, key, _ZERO) for key in ("xyz", "rpy"))
        return RigidTransform(RollPitchYaw(rpy), xyz)


def read_urdf(
    top: Element, file: Path, roots: Sequence[Path], notes: Notes
) -> robots.Description:
    """Returns the robot `top` of `file`; `roots` are folders of its packages.

    Raises ValueError: it has xacro or closed loops, or a number is invalid.
    """
    if top.tag != "robot" or top.findall(".//{http://www.ros.org/wiki/xacro}*"):
        raise ValueError(
            f"<{top.tag}>: must be a URDF, xacro expanded, or an MJCF"
        )
    for tag in sorted({child.tag for child in top} - _KNOWN):
        if any(word in tag for word in _LOOPS):
            raise ValueError(f"<{tag}>: must not be there, a closed loop")
        notes.add("changed", "left out the tags", tag)
    colours = {
        material.get("name", ""): colour.get("rgba", "")
        for material in top.iter("material")
        for colour in material.findall("color")
    }
    folders = [*roots, *file.resolve().parents]
    parts, links = _parts(top, "link"), {}
    for name, part in parts.items():
        links[name] = robots.Link(name)
        for element in part.element:
            if element.tag in (robots.VISUAL, robots.COLLIDING):
                shape = _Part(f"{element.tag} of {part.name}", element)
                _take_shape(links[name], shape, colours, folders, notes)
    coms = [p.numbers("inertial/origin", "xyz", _ZERO) for p in parts.values()]
    _turn_upright(list(links.values()), coms, notes)
    for name, part in parts.items():
        links[name].M = _inertia(part, links[name], notes)
    joints = {n: _joint(n, p) for n, p in _parts(top, "joint").items()}
    for element in top.findall("transmission"):
        drive = _Part("transmission", element)
        name = drive.text("joint", "name")
        rotor = drive.number(f".//{DRAKE}rotor_inertia", "value")
        gear = drive.number(f".//{DRAKE}gear_ratio", "value", "1")
        if rotor and name in joints:
            joints[name].rotor_inertia = rotor * gear**2
    joints = {n: j for n, j in joints.items() if j.type != "floating"}
    return robots.Description(top.get("name") or file.stem, links, joints)


def _parts(top: Element, tag: str) -> dict[str, _Part]:
    found: dict[str, _Part] = {}
    for element in top.findall(tag):
        name = element.get("name", "")
        if not name or name in found:
            raise ValueError(f"{tag} {name!r}: must have a name of its own")
        found[name] = _Part(f"{tag} {name}", element)
    return found


def _joint(name: str, part: _Part) -> robots.Joint:
    kind, axis = part.element.get("type", ""), np.eye(3)[0]
    if kind != "fixed":  # whose axis may be 0 0 0
        axis = part.numbers("axis", "xyz", "1 0 0")
    if not axis.any():
        raise ValueError(f"{part.name}: axis: must not be 0 0 0")
    lower, upper = (part.number("limit", key) for key in ("lower", "upper"))
    if lower > upper:
        limits = f"lower limit = {lower}: must be <= upper = {upper}"
        raise ValueError(f"{part.name}: {limits}")
    if kind == "continuous":
        lower, upper = -np.pi, np.pi
    return robots.Joint(
        name,
        "weld" if kind == "fixed" else kind,
        *(part.text(end, "link") for end in ("parent", "child")),
        part.pose("origin"),
        axis / np.linalg.norm(axis),
        *(lower, upper),
        effort=part.number("limit", "effort"),
        speed=part.number("limit", "velocity"),
        damping=part.number("dynamics", "damping"),
        mimics=part.element.find("mimic") is not None,
    )


def _take_shape(
    link: robots.Link,
    part: _Part,
    colours: Mapping[str, str],
    folders: Sequence[Path],
    notes: Notes,
) -> None:
    """Adds the shape in `part` to `link`, if it is known and found."""
    solids = part.element.findall("geometry/*")
    kind = solids[0].tag.removeprefix(DRAKE) if solids else "nothing"
    if kind not in robots.SOLIDS:
        notes.add("changed", f"left out the {kind} of {part.name}")
        return
    mesh, at = None, f"geometry/{solids[0].tag}"
    if kind == "mesh":
        try:
            mesh = _load(_find_mesh(part.text(at, "filename"), folders)).copy()
        except OSError as error:
            link.missing = link.missing or str(error)
            notes.add("changed", f"left out {part.name}: {error}")
            return
        mesh.apply_scale(part.numbers(at, "scale", "1 1 1"))
    zeros, keys = _ZERO if kind == "box" else "0", robots.SOLIDS[kind][0]
    size = {key: part.numbers(at, key, zeros) for key in keys}
    material = colours.get(part.text("material", "name"), "")
    colour = part.text("material/color", "rgba", material)
    X, role = part.pose("origin"), part.element.tag
    link.shapes.append(robots.Shape(role, kind, size, X, colour, mesh))


def _find_mesh(name: str, folders: Sequence[Path]) -> Path:
    """The path of mesh `name`; packages may also be above the URDF."""
    scheme, separator, rest = name.partition("://")
    tails = [rest or name]
    if separator and scheme != "file":
        package, _, inside = rest.lstrip("/").partition("/")
        tails = [f"{package}/{inside}", inside]
    places = (folder.resolve() / tail for folder in folders for tail in tails)
    if place := next((place for place in places if place.is_file()), None):
        return place
    raise FileNotFoundError(f"there is no {name} (--package-root?)")


@cache
def _load(path: Path) -> trimesh.Trimesh:
    try:
        mesh = trimesh.load(path, force="mesh", skip_materials=True)
    except Exception:  # trimesh's readers raise any class
        mesh = trimesh.Trimesh()
    if not len(mesh.vertices):
        raise OSError(f"{path}: must be a whole STL, OBJ or Collada file")
    if path.suffix.lower() == ".dae":
        text = path.read_bytes()
        mesh.metadata["y up"] = b"<up_axis>Y_UP" in text[:8192]
    return mesh


def _turn_upright(
    links: Sequence[robots.Link], coms: Sequence[Array], notes: Notes
) -> None:
    """Turns meshes of Collada files that say "y is up", if they mean it.

    They do if the centres of mass are nearer to the meshes then.
    """
    turned, nearer = [], 0.0
    for link, com in zip(links, coms, strict=True):
        for shape in link.shapes:
            if shape.mesh.metadata.get("y up"):
                middle = shape.mesh.bounds.mean(axis=0)
                p_GC = shape.X_LG.inverse() @ com
                nearer += np.linalg.norm(p_GC - middle)
                nearer -= np.linalg.norm(p_GC - _Z_UP @ middle)
                turned.append(shape)
    if nearer > 0.0:
        line = f"turned {len(turned)} meshes, of which the files say: y is up"
        notes.add("changed", line)
        for shape in turned:
            shape.X_LG = shape.X_LG @ _Z_UP


def _inertia(part: _Part, link: robots.Link, notes: Notes) -> SpatialInertia:
    """The inertia of a link; without moments it is that of a box."""
    mass, X = (
        part.number("inertial/mass", "value"),
        part.pose("inertial/origin"),
    )
    if not mass:
        return SpatialInertia.Zero()
    com, R = X.translation(), X.rotation().matrix()
    xx, yy, zz, xy, xz, yz = (
        part.number("inertial/inertia", key) for key in MOMENTS
    )
    given = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    what = "moments of inertia"
    if link.shapes and not given.any():
        notes.add("changed", f"{what} of 0, now of a box", link.name)
        sides = np.ptp(link.corners(), axis=0)
        return SpatialInertia.SolidBoxWithMass(mass, *sides).Shift(-com)
    possible = _possible(given, mass)
    if given.any() and not np.allclose(given, possible, rtol=1e-3, atol=0.0):
        what += " that no body has, made possible"
        notes.add("changed", what, link.name)
    return robots.spatial_inertia(mass, com, R @ possible @ R.T)


def _possible(inertia: Array, mass: float) -> Array:
    """Makes principal moments those of a body, at least of a ball of 1 cm."""
    given, axes = np.linalg.eigh(inertia)
    moments = np.maximum(np.abs(given), 0.4 * mass * 0.01**2)
    largest = int(moments.argmax())
    rest = moments.sum() - moments[largest]
    moments[largest] = min(moments[largest], 0.999 * rest)
    same = (moments == given).all()
    return inertia if same else axes @ np.diag(moments) @ axes.T
