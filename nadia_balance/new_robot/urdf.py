"""Changes to a user's URDF, in place, that make Drake's parser accept it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from nadia_balance.new_robot import Notes

DRAKE = "{http://drake.mit.edu}"
# Drake accepts STL and Collada only as visual shapes; collision shapes become
# visual ones whose names start with this.
COLLISION = "collision"
_KNOWN = {
    "robot": {"link", "joint", "material", "transmission"},
    "link": {"inertial", "visual", "collision"},
    "joint": {"origin", "parent", "child", "axis", "limit", "dynamics"},
}
_LOOPS = ("loop", "bushing", "constraint")
_SOLIDS = ("box", "sphere", "cylinder", "capsule", "ellipsoid", "mesh")
_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_VECTORS = {"xyz", "rpy", "size", "scale"}
_POSITIVE = {"size", "radius", "length"}
_NOT_NEGATIVE = {"effort", "velocity", "damping", "value"}
_NUMBERS = {*_VECTORS, *_POSITIVE, *_NOT_NEGATIVE, *_MOMENTS, "lower", "upper"}
ElementTree.register_namespace("drake", DRAKE[1:-1])


@dataclass
class Mended:
    """A URDF for Drake's parser, and what had to be taken out of it."""

    text: str = ""
    mimics: set[str | None] = field(default_factory=set)  # joints
    missing: dict[str | None, str] = field(default_factory=dict)  # link: mesh


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
        raise ValueError(f"<{top.tag}>: must be a URDF, xacro expanded")
    top.set("name", top.get("name") or file.stem)
    mended = Mended(mimics={j.get("name") for j in top if j.findall("mimic")})
    _drop_tags(top, notes)
    for part in top.findall("link") + top.findall("joint"):
        _check_numbers(part)
    colours = {
        material.get("name", ""): colour
        for material in top.iter("material")
        if (colour := material.find("color")) is not None
    }
    folders = [*roots, *file.resolve().parents]
    changed = []
    for link in top.findall("link"):
        shapes = link.findall("visual") + link.findall("collision")
        for i, part in enumerate(shapes):
            part.attrib = {"name": f"{part.tag}_{i}"}
            _paint(part, colours)
            if missing := _mend_shape(link, part, folders, notes):
                mended.missing.setdefault(link.get("name"), missing)
        for inertial in link.findall("inertial"):
            if _mend_mass(link, inertial):
                changed.append(link.get("name", ""))
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


def _paint(part: Element, colours: Mapping[str, Element]) -> None:
    """Replaces a material by its colour alone, under a name of its own."""
    for material in part.findall("material"):
        part.remove(material)
        colour = material.find("color")
        if colour is None:
            colour = colours.get(material.get("name", ""))
        if colour is not None:
            name = colour.get("rgba", "")
            SubElement(part, "material", name=name).append(colour)


def _mend_shape(
    link: Element, part: Element, folders: Sequence[Path], notes: Notes
) -> str:
    """Makes a shape visual, with the path of its mesh; returns a missing one.

    Shapes that Drake does not know or find are left out.
    """
    where = f"{part.tag} of link {link.get('name')}"
    part.tag = "visual"
    solid = part.find("geometry/*")
    if solid is None:
        link.remove(part)
        return ""
    kind, name = solid.tag.removeprefix(DRAKE), solid.get("filename", "")
    if kind not in _SOLIDS:
        link.remove(part)
        notes.changed.append(f"left out the {kind} of {where}")
    elif kind == "mesh":
        path = _find_mesh(name, folders)
        if path is None:
            link.remove(part)
            notes.changed.append(
                f"left out {where}: there is no {name} (--package-root?)"
            )
            return name
        solid.set("filename", f"file://{path}")
    return ""


def _find_mesh(name: str, folders: Sequence[Path]) -> Path | None:
    """The path of mesh `name`; packages may also be above the URDF."""
    scheme, separator, rest = name.partition("://")
    tails = [rest or name]
    if separator and scheme != "file":
        package, _, inside = rest.lstrip("/").partition("/")
        tails = [f"{package}/{inside}", inside]
    places = (folder.resolve() / tail for folder in folders for tail in tails)
    return next((place for place in places if place.is_file()), None)


def _mend_mass(link: Element, inertial: Element) -> bool:
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
    return not np.allclose(given, possible, rtol=1e-3, atol=0.0)


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
