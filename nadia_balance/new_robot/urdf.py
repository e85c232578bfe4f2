"""Changes to a user's URDF, in place, that make Drake's parser accept it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw

from nadia_balance.new_robot import Notes
from nadia_balance.new_robot.shapes import SOLIDS, Shape

DRAKE = "{http://drake.mit.edu}"
_KNOWN = {
    "robot": {"link", "joint", "material", "transmission"},
    "link": {"inertial", "visual", "collision"},
    "joint": {"origin", "parent", "child", "axis", "limit", "dynamics"},
}
_LOOPS = ("loop", "bushing", "constraint")
_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_VECTORS = {"xyz", "rpy", "size", "scale"}
_POSITIVE = {"size", "radius", "length"}
_NOT_NEGATIVE = {"effort", "velocity", "damping", "value"}
_NUMBERS = {*_VECTORS, *_POSITIVE, *_NOT_NEGATIVE, *_MOMENTS, "lower", "upper"}
ElementTree.register_namespace("drake", DRAKE[1:-1])


@dataclass
class Mended:
    """A URDF for Drake's parser, and what had to be taken out of it."""

    text: str
    mimics: set[str | None]  # joints
    shapes: dict[str, list[Shape]] = field(default_factory=dict)  # by link
    missing: dict[str, str] = field(default_factory=dict)  # mesh by link
    left_out: list[str] = field(default_factory=list)  # lines
    pointlike: list[str] = field(default_factory=list)  # links without moments


def mend_urdf(
    top: Element, file: Path, roots: Sequence[Path], notes: Notes
) -> Mended:
    """Returns the URDF `top` of `file` as Drake's parser accepts it.

    `roots` are folders of its packages.

    Raises:
        ValueError: it has xacro or closed loops in it, or a number is invalid;
            names the link or joint.
    """
    if top.tag != "robot" or top.findall(".//{http://www.ros.org/wiki/xacro}*"):
        raise ValueError(
            f"<{top.tag}>: must be a URDF, xacro expanded, or an MJCF"
        )
    top.set("name", top.get("name") or file.stem)
    mended = Mended("", {j.get("name") for j in top if j.findall("mimic")})
    _drop_tags(top, notes)
    for part in top.findall("link") + top.findall("joint"):
        _check_numbers(part)
    colours = {
        material.get("name", ""): colour.get("rgba", "")
        for material in top.iter("material")
        if (colour := material.find("color")) is not None
    }
    folders = [*roots, *file.resolve().parents]
    changed = []
    for link in top.findall("link"):
        for part in link.findall("visual") + link.findall("collision"):
            link.remove(part)
            _take_shape(link.get("name", ""), part, colours, folders, mended)
        for inertial in link.findall("inertial"):
            if _mend_mass(link, inertial, mended):
                changed.append(link.get("name", ""))
    notes.changed += mended.left_out
    if changed:
        notes.changed.append(
            "moments of inertia that no body has, made possible: "
            + ", ".join(changed)
        )
    _mend_drives(top)
    mended.text = ElementTree.tostring(top, encoding="unicode")
    return mended


def _drop_tags(top: Element, notes: Notes) -> None:
    """Drops what other programs put in; refuses closed loops."""
    strange = [child for child in top if child.tag not in _KNOWN["robot"]]
    for child in strange:
        if any(word in child.tag for word in _LOOPS):
            raise ValueError(
                f"<{child.tag}> {child.get('name', '')}: must not be there, "
                "a closed loop"
            )
    if strange:
        tags = ", ".join(sorted({child.tag for child in strange}))
        notes.changed.append(f"left out the tags {tags}")
    for element in [top, *top.findall("link"), *top.findall("joint")]:
        for child in list(element):
            if child.tag not in _KNOWN[element.tag]:
                element.remove(child)
    for dynamics in top.iter("dynamics"):
        dynamics.attrib.pop("friction", None)


def _check_numbers(part: Element) -> None:
    """Raises ValueError for an invalid number in a link or joint."""
    name = f"{part.tag} {part.get('name')}"
    for element in part.iter():
        for key in sorted(_NUMBERS & element.attrib.keys()):
            text, count = element.attrib[key], 3 if key in _VECTORS else 1
            where = f"{name}: {element.tag}: {key} = {text!r}"
            try:
                values = np.array(text.split(), float)
            except ValueError:
                values = np.array([])
            if len(values) != count or not np.isfinite(values).all():
                numbers = "three numbers" if count == 3 else "a number"
                raise ValueError(f"{where}: must be {numbers}")
            if key in _POSITIVE and min(values) <= 0.0:
                raise ValueError(f"{where}: must be > 0")
            if key in _NOT_NEGATIVE and min(values) < 0.0:
                raise ValueError(f"{where}: must be >= 0")
    for limit in part.findall("limit"):
        lower, upper = limit.get("lower", "0"), limit.get("upper", "0")
        if float(lower) > float(upper):
            raise ValueError(
                f"{name}: lower limit = {lower}: must be <= upper = {upper}"
            )


def _take_shape(
    link: str,
    part: Element,
    colours: Mapping[str, str],
    folders: Sequence[Path],
    mended: Mended,
) -> None:
    """Adds the shape in `part` to those of `link`, if it is known and found."""
    solid, where = part.find("geometry/*"), f"{part.tag} of link {link}"
    if solid is None:
        return
    kind, size = solid.tag.removeprefix(DRAKE), dict(solid.attrib)
    if kind not in SOLIDS:
        mended.left_out.append(f"left out the {kind} of {where}")
        return
    for key in SOLIDS[kind]:
        if key not in size:
            raise ValueError(f"{where}: {kind}: must have a {key}")
    if kind == "mesh":
        path = _find_mesh(name := size["filename"], folders)
        if path is None:
            mended.left_out.append(
                f"left out {where}: there is no {name} (--package-root?)"
            )
            mended.missing.setdefault(link, f"there is no {name}")
            return
        size["filename"] = str(path)
    colour = part.find("material/color")
    material = "" if (m := part.find("material")) is None else m.get("name", "")
    rgba = colours.get(material, "") if colour is None else colour.get("rgba")
    X = RigidTransform()
    if (origin := part.find("origin")) is not None:
        xyz, rpy = (
            np.array(origin.get(key, "0 0 0").split(), float)
            for key in ("xyz", "rpy")
        )
        X = RigidTransform(RollPitchYaw(rpy), xyz)
    shape = Shape(part.tag, kind, size, X, rgba or "")
    mended.shapes.setdefault(link, []).append(shape)


def _find_mesh(name: str, folders: Sequence[Path]) -> Path | None:
    """The path of mesh `name`; packages may also be above the URDF."""
    scheme, separator, rest = name.partition("://")
    tails = [rest or name]
    if separator and scheme != "file":
        package, _, inside = rest.lstrip("/").partition("/")
        tails = [f"{package}/{inside}", inside]
    places = (folder.resolve() / tail for folder in folders for tail in tails)
    return next((place for place in places if place.is_file()), None)


def _mend_mass(link: Element, inertial: Element, mended: Mended) -> bool:
    """Drops an inertia without mass; True if the moments had to be changed."""
    element = inertial.find("mass")
    mass = 0.0 if element is None else float(element.get("value", "0"))
    if not mass:
        link.remove(inertial)
        return False
    moments = inertial.find("inertia")
    if moments is None:
        moments = SubElement(inertial, "inertia")
    xx, yy, zz, xy, xz, yz = (float(moments.get(n, "0")) for n in _MOMENTS)
    given = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    possible = _possible(given, mass)
    moments.attrib = inertia_attributes(possible)
    if not given.any():
        mended.pointlike.append(link.get("name", ""))
        return False
    return not np.allclose(given, possible, rtol=1e-3, atol=0.0)


def text_of(values) -> str:
    """The numbers as an attribute of a URDF."""
    return " ".join(f"{value:.9g}" for value in np.ravel(values))


def add_pose(parent: Element, X: RigidTransform) -> None:
    """Appends the `<origin>` of the pose X."""
    rpy = RollPitchYaw(X.rotation()).vector()
    SubElement(parent, "origin", xyz=text_of(X.translation()), rpy=text_of(rpy))


def inertia_attributes(inertia: np.ndarray) -> dict[str, str]:
    """The attributes of `<inertia>` for a matrix (3, 3) [kg m^2]."""
    values = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    texts = [repr(float(value)) for value in values]
    return dict(zip(_MOMENTS, texts, strict=True))


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


def _mend_drives(top: Element) -> None:
    """Gives each joint with an effort limit one transmission."""
    driven = set()
    for drive in top.findall("transmission"):
        joint = drive.find("joint")
        if drive.find(f".//{DRAKE}rotor_inertia") is None or joint is None:
            top.remove(drive)
        else:
            driven.add(joint.get("name", ""))
    for joint in top.findall("joint"):
        name, kind = joint.get("name", ""), joint.get("type")
        if kind == "revolute" and joint.find("limit") is None:
            SubElement(joint, "limit")
        for limit in joint.findall("limit"):
            bounds = {"lower": "0", "upper": "0", **limit.attrib}
            if kind == "continuous":
                del bounds["lower"], bounds["upper"]
            limit.attrib = bounds
            moves = kind in ("revolute", "continuous", "prismatic")
            if moves and float(limit.get("effort", "0")) and name not in driven:
                add_transmission(top, name, rotor_inertia=0.0)


def add_transmission(top: Element, joint: str, rotor_inertia: float) -> None:
    """Appends a drive of `joint`, with reflected inertia [kg m^2]."""
    element = SubElement(top, "transmission", name=f"{joint}_drive")
    kind = SubElement(element, "type")
    kind.text = "transmission_interface/SimpleTransmission"
    SubElement(element, "joint", name=joint)
    actuator = SubElement(element, "actuator", name=joint)
    inertia = f"{rotor_inertia:.9g}"
    SubElement(actuator, f"{DRAKE}rotor_inertia", value=inertia)
    SubElement(actuator, f"{DRAKE}gear_ratio", value="1")
