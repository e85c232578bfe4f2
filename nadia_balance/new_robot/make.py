"""Creation of a robot folder from a URDF or an MJCF."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import yaml
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.tree import SpatialInertia

import nadia_balance.new_robot.description as robots
from nadia_balance.core.body.reachability import ReachabilityParams
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.new_robot import measure
from nadia_balance.new_robot.description import Anatomy, Leg, Notes
from nadia_balance.new_robot.read import DRAKE, MOMENTS, read_urdf
from nadia_balance.new_robot.read_mjcf import read_mjcf
from nadia_balance.new_robot.shapes import Pairs, fit_capsules
from nadia_balance.parameters.scaling import NADIA

# Rotor inertia over mass and squared leg, of Nadia: 0.1 kg m^2 are assumed.
_ROTOR_SHARE = 0.1 / (90.9 * NADIA.leg**2)
_SPEED = 12.0  # speed limit of joints without one [rad/s]
_PLAUSIBLE = 25.0  # largest plausible speed limit [rad/s]
_TURN = 6.3  # largest angle of a leg's joint [rad]
_LEAST = 0.02  # mass of links without one [kg]
# Mass over the cubed length of the legs, of any humanoid [kg/m^3].
_DENSITY = np.array([20.0, 2000.0])
# Share of their mean by which left and right may differ, and the largest moment
# of inertia over mass times the square of the farthest point of a shape [-].
_UNLIKE, _LARGEST = 0.2, 2.0
_SIDES = {"l": 1, "left": 1, "r": -1, "right": -1}
_WORDS = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
_FRICTION = "0.8"
_FACES = 2000  # meshes with more are made coarser
_OF_URDF = ("box", "sphere", "cylinder", "mesh")
_HEADER = "# Made by nadia-new-robot from the robot's description.\n"
ElementTree.register_namespace("drake", DRAKE[1:-1])


def make_robot(
    file: Path,
    folder: Path,
    *,
    fix: Sequence[str] = (),
    package_roots: Sequence[Path] = (),
    armature: Path | None = None,
    named: measure.Names | None = None,
) -> Notes:
    """Writes robot.urdf, robot.yaml and meshes into `folder`.

    Joints that a regular expression of `fix` matches in full are welded.  Rotor
    inertias are those of the file `armature`, by joint names, if there is one.

    Raises ValueError: it is no biped with driven legs; OSError: as files do.
    """
    notes, named = Notes(), named or {}
    robot = _read(file, package_roots, notes)
    legs = _clean(robot, fix, named, notes)
    anatomy = measure.find_anatomy(robot, legs, named, notes)
    fields = measure.measure(robot, anatomy, notes)
    _doubt(robot, anatomy, notes)
    if armature:
        joints = _read(armature, [], Notes()).joints.values()
        theirs = {j.name: j.rotor_inertia for j in joints if j.rotor_inertia}
        if not (known := robot.joints.keys() & theirs.keys()):
            raise ValueError(f"armature = {armature}: must have rotor inertias")
        for name in known:
            robot.joints[name].rotor_inertia = theirs[name]
    _guess_drives(robot, measure.size_of(fields).leg, notes)
    if not all(joint.speed for joint in robot.joints.values()):
        fields["max_joint_speed"] = _SPEED
    folder.mkdir(parents=True, exist_ok=True)
    ignored = fit_capsules(robot, anatomy, fields, notes)
    write_urdf(robot, ignored, folder)
    write_yaml(folder, fields)
    return notes


def _read(file: Path, roots: Sequence[Path], notes) -> robots.Description:
    try:
        top = ElementTree.parse(file).getroot()
    except ElementTree.ParseError as error:
        raise ValueError(f"{file}: must be XML ({error})") from None
    if top.tag == "mujoco":
        return read_mjcf(file, notes)
    return read_urdf(top, file, roots, notes)


def _clean(robot: robots.Description, fix, named, notes: Notes) -> list[Leg]:
    """Welds joints that are not driven, adds masses; returns the legs."""
    welded = [j.name for j in robot.joints.values() if j.type == "weld"]
    for expression in fix:
        where = f"fix = {expression!r}: must"
        try:
            found = [n for n in robot.joints if re.fullmatch(expression, n)]
        except re.error as why:
            what = f"{where} be a regular expression ({why})"
            raise ValueError(what) from None
        if not found:
            raise ValueError(f"{where} match a joint")
        notes.add("changed", "welded as asked", *found)
        welded += found
    robot.weld(dict.fromkeys(welded))
    base = robot.root
    legs = measure.two_legs(robot, named)
    of_legs = {name for leg in legs for name in leg.joints}
    for joint in list(robot.joints.values()):
        reasons = {
            "mimic": joint.mimics,
            "prismatic": joint.type == "prismatic",
            "no effort limit": not joint.effort,
            "no range": joint.upper - joint.lower < 1e-3,
        }
        why = next((why for why, holds in reasons.items() if holds), "")
        name, unlike = joint.name, ""
        if joint.type not in ("revolute", "continuous", "prismatic"):
            why, unlike = joint.type, "must be revolute or prismatic"
        elif name in of_legs and (why or joint.type == "continuous"):
            unlike = "must be a hinge with range and effort (MJCF: forcerange)"
        elif name in of_legs and max(-joint.lower, joint.upper) > _TURN:
            why = f"range of {joint.lower:.4g} to {joint.upper:.4g}"
            unlike = "must be within +-2 pi; units are rad"
        if unlike:
            raise ValueError(f"joint {name}: {why or joint.type}: {unlike}")
        if why:
            notes.add("changed", f"welded, {why}", name)
            robot.weld([name])
        elif joint.type == "continuous":
            notes.add("changed", "turn by +-pi, not for ever", name)
    if (pelvis := robot.root) != base:
        notes.add("changed", f"the floating base is {pelvis}, not {base}")
    for link in robot.links.values():
        if not link.M.get_mass():
            link.M = SpatialInertia.SolidSphereWithMass(_LEAST, 0.02)
            notes.add("changed", f"{_LEAST} kg for links of no mass", link.name)
    at, _ = robot.hinges(legs[0].joints, robot.poses())
    mass = robot.mass(robot.links)
    length = np.linalg.norm(np.diff(at, axis=0), axis=1).sum()
    least, most = _DENSITY * length**3
    if not least < mass < most:
        must = f"must be in ({least:.3g}, {most:.3g}) kg; units are kg and m"
        has = f"mass = {mass:.4g} kg, with legs of {length:.4g} m"
        raise ValueError(f"{has}: {must}")
    for link in robot.links.values():
        if (far := np.linalg.norm(link.M.get_com())) > 3.0 * length:
            must = f"must be within {3.0 * length:.3g} m of its origin"
            what = f"link {link.name}: centre of mass"
            raise ValueError(f"{what}: {must}; it is {far:.3g} m away")
    return legs


def _doubt(robot: robots.Description, anatomy: Anatomy, notes: Notes) -> None:
    """Warns of inertias of no body, of unlike sides and of swapped names."""
    for link in robot.links.values():
        if link.shapes:
            corners = link.corners() - link.M.get_com()
            far = np.linalg.norm(corners, axis=1).max()
            largest = link.central().CalcPrincipalMomentsOfInertia().max()
            if largest > _LARGEST * link.M.get_mass() * far**2:
                line = "moments of inertia too large for mass and shapes"
                notes.add("warning", line, link.name)
    legs = anatomy.legs.values()
    for names in zip(*(leg.joints for leg in legs), strict=True):
        joints = [robot.joints[name] for name in names]
        for what, unit, (a, b) in (
            ("link masses", "kg", [robot.mass([j.child]) for j in joints]),
            ("effort limits", "N m", [j.effort for j in joints]),
            ("ranges", "rad", [j.upper - j.lower for j in joints]),
        ):
            if abs(a - b) > _UNLIKE * 0.5 * (a + b):
                unlike = f"{' and '.join(names)}, {a:.3g} and {b:.3g} {unit}"
                line = "left and right differ"
                notes.add("warning", line, f"{what} at {unlike}")
    for side, leg in anatomy.legs.items():
        for name in (leg.foot, *leg.joints):
            words = [word.lower() for word in _WORDS.findall(name)]
            if -side.sign in map(_SIDES.get, words):
                line = "left and right swapped? On the other side, seen forward"
                notes.add("warning", line, name)


def _guess_drives(robot: robots.Description, leg: float, notes: Notes) -> None:
    """Adds rotor inertias by the leg's length [m]; notes what is unknown."""
    mass, joints = robot.mass(robot.links), list(robot.joints.values())
    inertia, strong = _ROTOR_SHARE * mass * leg**2, GRAVITY * mass * leg
    bare = [joint for joint in joints if not joint.rotor_inertia]
    for joint in bare:
        joint.rotor_inertia = inertia
    if bare:
        line = f"taken as {inertia:.3g} kg m^2, Nadia's by mass and length"
        notes.add("unknown", f"rotor inertia of {len(bare)} joints: {line}")
    for joint in joints:
        if joint.effort > strong:
            line = f"effort limits > {strong:.3g} N m, weight times leg"
            notes.add("warning", f"{line}: no motor's?", joint.name)
        if not joint.speed or joint.speed > _PLAUSIBLE:
            known = f"> {_PLAUSIBLE:g}" if joint.speed else f"now {_SPEED:g}"
            notes.add("unknown", f"speed limits, {known} rad/s", joint.name)
    line = "drives' bandwidth, corner speed: defaults; dry friction, springs: 0"
    notes.add("unknown", line)


def write_urdf(robot: robots.Description, ignored: Pairs, folder: Path) -> None:
    """Writes robot.urdf, which filters `ignored` collisions, and its meshes."""
    top = _tag("robot", name=robot.name)
    for name in robot.below(robot.root):
        top.extend(_joint(joint) for joint in robot.chain(name)[-1:])
        link = robot.links[name]
        shapes = [
            _shape(shape, folder, re.sub(r"\W", "_", f"{name}_{len(top)}_{i}"))
            for role in (robots.VISUAL, robots.COLLIDING)
            for i, shape in enumerate(link.of(role))
        ]
        top.append(_tag("link", _inertial(link), *shapes, name=name))
    top.extend(_transmission(joint) for joint in robot.joints.values())
    for i, pair in enumerate(sorted(map(sorted, ignored))):
        group = f"may_touch_{i}"
        parts = [_tag(f"{DRAKE}member", link=link) for link in pair]
        parts.append(_tag(f"{DRAKE}ignored_collision_filter_group", name=group))
        top.append(_tag(f"{DRAKE}collision_filter_group", *parts, name=group))
    ElementTree.indent(top)
    file = ElementTree.ElementTree(top)
    file.write(folder / "robot.urdf", encoding="utf-8", xml_declaration=True)


def _tag(tag: str, *children: Element, **attributes: Any) -> Element:
    """A tag whose attributes are texts, or numbers."""
    element = Element(tag)
    for key, value in attributes.items():
        numbers = [] if isinstance(value, str) else np.ravel(value)
        text = " ".join(f"{number:.9g}" for number in numbers)
        element.set(key, text or value)
    element.extend(children)
    return element


def _origin(X: RigidTransform) -> Element:
    rpy = RollPitchYaw(X.rotation()).vector()
    return _tag("origin", xyz=X.translation(), rpy=rpy)


def _inertial(link: robots.Link) -> Element:
    moments = [*link.central().get_moments(), *link.central().get_products()]
    # All digits, which Drake needs to find it possible.
    texts = [repr(float(moment)) for moment in moments]
    inertia = _tag("inertia", **dict(zip(MOMENTS, texts, strict=True)))
    mass = _tag("mass", value=link.M.get_mass())
    return _tag("inertial", _tag("origin", xyz=link.M.get_com()), mass, inertia)


def _shape(shape: robots.Shape, folder: Path, name: str) -> Element:
    size: Mapping[str, Any] = shape.size
    if shape.kind == "mesh":
        file = folder / "meshes" / f"{name}.obj"
        file.parent.mkdir(exist_ok=True)
        mesh = shape.mesh.copy()
        if len(mesh.faces) > _FACES:  # vertices within 1 cm, or less, merge
            digits = int(np.ceil(1.0 - np.log10(mesh.extents.max())))
            mesh.merge_vertices(digits_vertex=max(digits, 2))
            mesh.update_faces(mesh.unique_faces() & mesh.nondegenerate_faces())
        mesh.export(file, include_normals=False, include_texture=False)
        size = {"filename": f"meshes/{file.name}"}
    kind = shape.kind if shape.kind in _OF_URDF else DRAKE + shape.kind
    parts = [_origin(shape.X_LG), _tag("geometry", _tag(kind, **size))]
    if shape.role == robots.COLLIDING:
        tags = f"{DRAKE}mu_static", f"{DRAKE}mu_dynamic"
        friction = [_tag(tag, value=_FRICTION) for tag in tags]
        parts.append(_tag(f"{DRAKE}proximity_properties", *friction))
    elif shape.colour:
        colour = _tag("color", rgba=shape.colour)
        parts.append(_tag("material", colour, name=f"{name}_colour"))
    return _tag(shape.role, *parts, name=name)


def _joint(joint: robots.Joint) -> Element:
    limits = {n: getattr(joint, n) for n in ("lower", "upper", "effort")}
    if joint.speed:
        limits["velocity"] = joint.speed
    ends = [_tag(end, link=getattr(joint, end)) for end in ("parent", "child")]
    axis, limit = _tag("axis", xyz=joint.axis), _tag("limit", **limits)
    parts = [_origin(joint.X_PC), *ends, axis, limit]
    if joint.damping:
        parts.append(_tag("dynamics", damping=joint.damping))
    return _tag("joint", *parts, name=joint.name, type="revolute")


def _transmission(joint: robots.Joint) -> Element:
    kind = Element("type")
    kind.text = "transmission_interface/SimpleTransmission"
    rotor = _tag(f"{DRAKE}rotor_inertia", value=joint.rotor_inertia)
    actuator = rotor, _tag(f"{DRAKE}gear_ratio", value="1")
    driven = _tag("joint", name=joint.name)
    drive = _tag("actuator", *actuator, name=joint.name)
    return _tag("transmission", kind, driven, drive, name=f"{joint.name}_drive")


def write_yaml(folder: Path, fields: measure.Fields) -> None:
    """Writes robot.yaml, with lengths and angles to four decimals."""
    style = {"default_flow_style": None, "allow_unicode": True}
    rounded = {"parse_float": lambda number: round(float(number), 4)}
    tree = json.loads(json.dumps(fields), **rounded)
    text = yaml.safe_dump(tree, sort_keys=False, **style)
    (folder / "robot.yaml").write_text(_HEADER + text, encoding="utf-8")


def write_reach(folder: Path, reach: ReachabilityParams) -> None:
    """Replaces the lengths and widths of `reach` in robot.yaml of `folder`."""
    text = (folder / "robot.yaml").read_text(encoding="utf-8")
    fields = {**yaml.safe_load(text), "reachability": measure.widths(reach)}
    write_yaml(folder, fields)
