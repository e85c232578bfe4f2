"""Creation of a robot folder from a URDF or an MJCF."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.tree import SpatialInertia

from nadia_balance.core.body.reachability import ReachabilityParams
from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.new_robot.anatomy import (
    Names,
    find_anatomy,
    side_signs,
    two_legs,
)
from nadia_balance.new_robot.description import (
    COLLIDING,
    VISUAL,
    Anatomy,
    Description,
    Joint,
    Leg,
    Link,
    Notes,
    Shape,
)
from nadia_balance.new_robot.measure import measure, size_of, widths
from nadia_balance.new_robot.read import DRAKE, MOMENTS, TURN, read_urdf
from nadia_balance.new_robot.read_mjcf import read_mjcf
from nadia_balance.new_robot.shapes import Pairs, fit_capsules
from nadia_balance.parameters.bounds import require
from nadia_balance.parameters.scaling import NADIA

# Rotor inertia over mass and squared leg, of Nadia: 0.1 kg m^2 are assumed.
_ROTOR_SHARE = 0.1 / (90.9 * NADIA.leg**2)
_SPEED = 12.0  # speed limit of joints without one [rad/s]
_PLAUSIBLE = 25.0  # largest plausible speed limit [rad/s]
_SMALL_MASS = 0.02  # of links without one [kg]
# Mass over the cubed length of the legs, of any humanoid [kg/m^3].
_DENSITY = np.array([20.0, 2000.0])
_TYPES = "revolute", "continuous", "prismatic"  # of joints that are read
_UNLIKE = 0.2  # share of their mean by which left and right may differ [-]
# Largest moment of inertia over mass times the square of the farthest point of
# a shape [-].
_LARGEST = 2.0
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
    named: Names | None = None,
) -> Notes:
    """Writes robot.urdf, robot.yaml and meshes.

    Args:
        file: a URDF or an MJCF.
        folder: that gets the files.
        fix: regular expressions; joints that match one in full are welded.
        package_roots: folders of the packages of a URDF.
        armature: file with the rotor inertias, by joint names.
        named: links of which the user tells the names.

    Returns:
        What was guessed, changed, is unknown, or hardly meant.

    Raises:
        ValueError: it is no biped with driven legs.
        OSError: a file cannot be read or written.
    """
    notes = Notes()
    robot = _read(file, package_roots, notes)
    legs = _clean(robot, fix, named=named or {}, notes=notes)
    anatomy = find_anatomy(robot, legs, named=named or {}, notes=notes)
    fields = measure(robot, anatomy, notes)
    _doubt(robot, anatomy, notes)
    if armature:
        _take_rotors(robot, armature)
    _guess_drives(robot, size_of(fields).leg, notes)
    if not all(joint.speed for joint in robot.joints.values()):
        fields["max_joint_speed"] = _SPEED
    folder.mkdir(parents=True, exist_ok=True)
    ignored = fit_capsules(robot, anatomy, fields=fields, notes=notes)
    write_urdf(robot, ignored, folder)
    write_yaml(folder, fields)
    return notes


def _read(file: Path, roots: Sequence[Path], notes: Notes) -> Description:
    try:
        top = ElementTree.parse(file).getroot()
    except ElementTree.ParseError as error:
        raise ValueError(f"{file}: must be XML ({error})") from None
    return (
        read_mjcf(file, notes)
        if top.tag == "mujoco"
        else read_urdf(top, file, roots=roots, notes=notes)
    )


def _clean(
    robot: Description, fix: Sequence[str], *, named: Names, notes: Notes
) -> list[Leg]:
    """Welds joints that are not driven, adds masses; returns the legs."""
    robot.weld(dict.fromkeys(_fixed(robot, fix, notes)))
    while ends := _undriven_ends(robot):
        for joint in ends:
            _weld_undriven(robot, joint, notes)
    base = robot.root
    legs = two_legs(robot, named)
    of_legs = {name for leg in legs for name in leg.joints}
    for joint in list(robot.joints.values()):
        require(
            joint.type in _TYPES,
            f"joint {joint.name}: {joint.type}: must be revolute or prismatic",
        )
        reason = _undriven(joint)
        if joint.name in of_legs:
            _check_of_leg(joint, reason)
        if reason:
            _weld_undriven(robot, joint, notes)
        elif joint.type == "continuous":
            notes.add("changed", "turn by +-pi, not for ever", joint.name)
    if robot.root != base:
        notes.add("changed", f"the floating base is {robot.root}, not {base}")
    for link in robot.links.values():
        if not link.M.get_mass():
            link.M = SpatialInertia.SolidSphereWithMass(_SMALL_MASS, 0.02)
            notes.add(
                "changed", f"{_SMALL_MASS} kg for links of no mass", link.name
            )
    _check_units(robot, legs[0])
    return legs


def _fixed(robot: Description, fix: Sequence[str], notes: Notes) -> list[str]:
    """Names of joints that are fixed, or that the user fixes."""
    fixed = [j.name for j in robot.joints.values() if j.type == "weld"]
    for expression in fix:
        try:
            names = [n for n in robot.joints if re.fullmatch(expression, n)]
        except re.error as error:
            raise ValueError(
                f"fix = {expression!r}: must be a regular expression ({error})"
            ) from None
        require(len(names) > 0, f"fix = {expression!r}: must match a joint")
        notes.add("changed", "welded as asked", *names)
        fixed += names
    return fixed


def _undriven_ends(robot: Description) -> list[Joint]:
    """Joints without a drive at the end of a branch, such as a rod's.

    Their links have other branches, which remain; so no leg loses its foot.
    """
    return [
        joint
        for joint in robot.joints.values()
        if joint.type in _TYPES
        and _undriven(joint)
        and not robot.children(joint.child)
        and len(robot.children(joint.parent)) > 1
    ]


def _weld_undriven(robot: Description, joint: Joint, notes: Notes) -> None:
    notes.add("changed", f"welded, {_undriven(joint)}", joint.name)
    robot.weld([joint.name])


def _undriven(joint: Joint) -> str:
    """Why no drive turns this joint; empty if one may."""
    reasons = {
        "mimic": joint.mimics,
        "prismatic": joint.type == "prismatic",
        "no effort limit": not joint.effort,
        "no range": joint.upper - joint.lower < 1e-3,
    }
    return next((reason for reason, holds in reasons.items() if holds), "")


def _check_of_leg(joint: Joint, reason: str) -> None:
    """Refuses a leg's joint that is `undriven`, or turns for ever."""
    require(
        not reason and joint.type != "continuous",
        f"joint {joint.name}: {reason or joint.type}: must be a hinge with "
        "range and effort (MJCF: forcerange)",
    )
    require(
        max(-joint.lower, joint.upper) <= TURN,
        f"joint {joint.name}: range of {joint.lower:.4g} to "
        f"{joint.upper:.4g}: must be within +-2 pi; units are rad",
    )


def _check_units(robot: Description, leg: Leg) -> None:
    """Refuses a robot of no humanoid's mass, or with a CoM far outside."""
    points, _ = robot.hinges(leg.joints, robot.poses())
    length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    mass = robot.mass(robot.links)
    smallest, largest = _DENSITY * length**3
    require(
        smallest < mass < largest,
        f"mass = {mass:.4g} kg, with legs of {length:.4g} m: must be in "
        f"({smallest:.3g}, {largest:.3g}) kg; units are kg and m",
    )
    for link in robot.links.values():
        distance = np.linalg.norm(link.M.get_com())
        require(
            distance <= 3.0 * length,
            f"link {link.name}: centre of mass: must be within "
            f"{3.0 * length:.3g} m of its origin; it is {distance:.3g} m "
            "away",
        )


def _doubt(robot: Description, anatomy: Anatomy, notes: Notes) -> None:
    """Warns of inertias of no body, of unlike sides and of swapped names."""
    for link in robot.links.values():
        if link.shapes:
            distance = np.linalg.norm(
                link.corners() - link.M.get_com(), axis=1
            ).max()
            moment = link.central().CalcPrincipalMomentsOfInertia().max()
            if moment > _LARGEST * link.M.get_mass() * distance**2:
                notes.add(
                    "warning",
                    "moments of inertia too large for mass and shapes",
                    link.name,
                )
    for joint in robot.joints.values():
        if max(-joint.lower, joint.upper) > TURN:
            notes.add("warning", "range beyond +-2 pi: degrees?", joint.name)
    left, right = anatomy.legs.values()
    for names in zip(left.joints, right.joints, strict=True):
        _doubt_pair([robot.joints[name] for name in names], robot, notes)
    for side, leg in anatomy.legs.items():
        for name in (leg.foot, *leg.joints):
            # Both are in the names of some: left_foot_front_right.
            if side_signs([name]) == {-side.sign}:
                notes.add(
                    "warning",
                    "left and right swapped? On the other side, seen forward",
                    name,
                )


def _doubt_pair(
    joints: Sequence[Joint], robot: Description, notes: Notes
) -> None:
    """Warns of the same joint of both legs, if the two are unlike."""
    for quantity, unit, (left, right) in (
        ("link masses", "kg", [robot.mass([j.child]) for j in joints]),
        ("effort limits", "N m", [j.effort for j in joints]),
        ("ranges", "rad", [j.upper - j.lower for j in joints]),
    ):
        if abs(left - right) > _UNLIKE * 0.5 * (left + right):
            notes.add(
                "warning",
                "left and right differ",
                f"{quantity} at {joints[0].name} and {joints[1].name}, "
                f"{left:.3g} and {right:.3g} {unit}",
            )


def _take_rotors(robot: Description, file: Path) -> None:
    """Takes the rotor inertias of another file's joints of these names."""
    inertias = {
        joint.name: joint.rotor_inertia
        for joint in _read(file, [], Notes()).joints.values()
        if joint.rotor_inertia and joint.name in robot.joints
    }
    require(len(inertias) > 0, f"armature = {file}: must have rotor inertias")
    for name, inertia in inertias.items():
        robot.joints[name].rotor_inertia = inertia


def _guess_drives(robot: Description, leg: float, notes: Notes) -> None:
    """Adds rotor inertias by the leg's length [m]; notes what is unknown."""
    mass = robot.mass(robot.links)
    inertia = _ROTOR_SHARE * mass * leg**2
    effort = GRAVITY * mass * leg
    bare = [j for j in robot.joints.values() if not j.rotor_inertia]
    for joint in bare:
        joint.rotor_inertia = inertia
    if bare:
        notes.add(
            "unknown",
            f"rotor inertia of {len(bare)} joints: taken as {inertia:.3g} "
            "kg m^2, Nadia's by mass and length",
        )
    for joint in robot.joints.values():
        if joint.effort > effort:
            notes.add(
                "warning",
                f"effort limits > {effort:.3g} N m, weight times leg: "
                "no motor's?",
                joint.name,
            )
        if not joint.speed or joint.speed > _PLAUSIBLE:
            limit = f"> {_PLAUSIBLE:g}" if joint.speed else f"now {_SPEED:g}"
            notes.add("unknown", f"speed limits, {limit} rad/s", joint.name)
    notes.add(
        "unknown",
        "drives' bandwidth, corner speed: defaults; dry friction, springs: 0",
    )


def write_urdf(robot: Description, ignored: Pairs, folder: Path) -> None:
    """Writes robot.urdf and its meshes.

    Args:
        robot: with capsules and rotor inertias.
        ignored: pairs of links whose collisions are filtered.
        folder: that gets the files.
    """
    top = _tag("robot", name=robot.name)
    for name in robot.below(robot.root):
        top.extend(_joint(joint) for joint in robot.chain(name)[-1:])
        link = robot.links[name]
        shapes = [
            _shape(shape, folder, re.sub(r"\W", "_", f"{name}_{len(top)}_{i}"))
            for role in (VISUAL, COLLIDING)
            for i, shape in enumerate(link.of(role))
        ]
        top.append(_tag("link", _inertial(link), *shapes, name=name))
    top.extend(_transmission(joint) for joint in robot.joints.values())
    for i, pair in enumerate(sorted(map(sorted, ignored))):
        group = f"may_touch_{i}"
        top.append(
            _tag(
                f"{DRAKE}collision_filter_group",
                *(_tag(f"{DRAKE}member", link=link) for link in pair),
                _tag(f"{DRAKE}ignored_collision_filter_group", name=group),
                name=group,
            )
        )
    ElementTree.indent(top)
    ElementTree.ElementTree(top).write(
        folder / "robot.urdf", encoding="utf-8", xml_declaration=True
    )


def _tag(
    tag: str, *children: ElementTree.Element, **attributes: Any
) -> ElementTree.Element:
    """A tag whose attributes are texts, or numbers."""
    element = ElementTree.Element(tag)
    for key, value in attributes.items():
        if not isinstance(value, str):
            value = " ".join(f"{number:.9g}" for number in np.ravel(value))
        element.set(key, value)
    element.extend(children)
    return element


def _origin(X: RigidTransform) -> ElementTree.Element:
    return _tag(
        "origin", xyz=X.translation(), rpy=RollPitchYaw(X.rotation()).vector()
    )


def _inertial(link: Link) -> ElementTree.Element:
    central = link.central()
    # All digits, which Drake needs to find it possible.
    digits = [
        repr(float(moment))
        for moment in (*central.get_moments(), *central.get_products())
    ]
    return _tag(
        "inertial",
        _tag("origin", xyz=link.M.get_com()),
        _tag("mass", value=link.M.get_mass()),
        _tag("inertia", **dict(zip(MOMENTS, digits, strict=True))),
    )


def _shape(shape: Shape, folder: Path, name: str) -> ElementTree.Element:
    solid = _tag(
        shape.kind if shape.kind in _OF_URDF else DRAKE + shape.kind,
        **shape.size,
    )
    if shape.kind == "mesh":
        solid.set("filename", f"meshes/{_write_mesh(shape, folder, name)}")
    element = _tag(
        shape.role, _origin(shape.X_LG), _tag("geometry", solid), name=name
    )
    if shape.role == COLLIDING:
        element.append(
            _tag(
                f"{DRAKE}proximity_properties",
                _tag(f"{DRAKE}mu_static", value=_FRICTION),
                _tag(f"{DRAKE}mu_dynamic", value=_FRICTION),
            )
        )
    elif shape.colour:
        element.append(
            _tag(
                "material",
                _tag("color", rgba=shape.colour),
                name=f"{name}_colour",
            )
        )
    return element


def _write_mesh(shape: Shape, folder: Path, name: str) -> str:
    """Writes an OBJ into the folder's meshes; returns its name."""
    file = folder / "meshes" / f"{name}.obj"
    file.parent.mkdir(exist_ok=True)
    mesh = shape.mesh.copy()
    if len(mesh.faces) > _FACES:  # vertices within 1 cm, or less, merge
        digits = np.ceil(1.0 - np.log10(mesh.extents.max()))
        mesh.merge_vertices(digits_vertex=max(int(digits), 2))
        mesh.update_faces(mesh.unique_faces() & mesh.nondegenerate_faces())
    mesh.export(file, include_normals=False, include_texture=False)
    return file.name


def _joint(joint: Joint) -> ElementTree.Element:
    return _tag(
        "joint",
        _origin(joint.X_PC),
        _tag("parent", link=joint.parent),
        _tag("child", link=joint.child),
        _tag("axis", xyz=joint.axis),
        _tag(
            "limit",
            lower=joint.lower,
            upper=joint.upper,
            effort=joint.effort,
            **({"velocity": joint.speed} if joint.speed else {}),
        ),
        *([_tag("dynamics", damping=joint.damping)] if joint.damping else []),
        name=joint.name,
        type="revolute",
    )


def _transmission(joint: Joint) -> ElementTree.Element:
    kind = ElementTree.Element("type")
    kind.text = "transmission_interface/SimpleTransmission"
    return _tag(
        "transmission",
        kind,
        _tag("joint", name=joint.name),
        _tag(
            "actuator",
            _tag(f"{DRAKE}rotor_inertia", value=joint.rotor_inertia),
            _tag(f"{DRAKE}gear_ratio", value="1"),
            name=joint.name,
        ),
        name=f"{joint.name}_drive",
    )


def write_yaml(folder: Path, fields: Mapping[str, Any]) -> None:
    """Writes robot.yaml, with lengths and angles to four decimals.

    Args:
        folder: that gets it.
        fields: of the robot [m, rad].
    """
    tree = json.loads(
        json.dumps(fields), parse_float=lambda text: round(float(text), 4)
    )
    text = yaml.safe_dump(
        tree, sort_keys=False, default_flow_style=None, allow_unicode=True
    )
    (folder / "robot.yaml").write_text(_HEADER + text, encoding="utf-8")


def write_reach(folder: Path, reach: ReachabilityParams) -> None:
    """Replaces the lengths and widths of the reach in robot.yaml.

    Args:
        folder: that has it.
        reach: of the legs.
    """
    text = (folder / "robot.yaml").read_text(encoding="utf-8")
    write_yaml(folder, yaml.safe_load(text) | {"reachability": widths(reach)})
