"""Writer of a robot folder: robot.urdf, meshes and robot.yaml."""

import itertools
import re
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import trimesh
import yaml
from pydrake.math import RigidTransform

from nadia_balance.core.body.reachability import ReachabilityParams
from nadia_balance.core.math.size import scaled
from nadia_balance.new_robot.anatomy import Anatomy
from nadia_balance.new_robot.capsules import Capsules, Pairs
from nadia_balance.new_robot.description import Description, Joint
from nadia_balance.new_robot.measure import Measurements
from nadia_balance.new_robot.shapes import VISUAL, Shape
from nadia_balance.new_robot.urdf import (
    DRAKE,
    add_pose,
    add_transmission,
    inertia_attributes,
    text_of,
)

_FRICTION = "0.8"
_SPHERE = 0.005  # radius of the spheres at the soles' corners [m]
# Meshes with more faces are simplified; vertices are merged on a grid [m].
_FACES, _GRID = 2000, 0.006
_OF_URDF = ("box", "sphere", "cylinder", "mesh")
_HEADER = "# Made by nadia-new-robot from the robot's description.\n"


def write_urdf(
    robot: Description,
    anatomy: Anatomy,
    measured: Measurements,
    shapes: tuple[Capsules, Pairs],
    folder: Path,
) -> None:
    """Writes robot.urdf and, beside it, the visual meshes."""
    capsules, ignored = shapes
    top = Element("robot", name=robot.name)
    poses = robot.poses(dict.fromkeys(robot.joints, 0.0))
    for name in robot.below(robot.root):
        if name != robot.root:
            _joint(top, robot, robot.joint_to(name), poses)
        link = SubElement(top, "link", name=name)
        _inertial(link, robot)
        for i, shape in enumerate(robot.shapes(name, VISUAL)):
            _visual(link, shape, folder, re.sub(r"\W", "_", f"{name}_{i}"))
        for capsule in capsules.get(name, []):
            size = {"radius": capsule.radius, "length": capsule.length}
            _collision(link, capsule.X_LG, "capsule", size)
        if name in anatomy.feet.values():
            sole = measured.sole
            ends, side = (sole.x_min, sole.x_max), sole.half_width
            for x, y in itertools.product(ends, (side, -side)):
                centre = RigidTransform([x, y, sole.z + _SPHERE])
                _collision(link, centre, "sphere", {"radius": _SPHERE})
    for joint in robot.joints.values():
        add_transmission(top, joint.name, rotor_inertia=joint.rotor_inertia)
    for i, pair in enumerate(sorted(map(sorted, ignored))):
        group = {"name": f"may_touch_{i}"}
        filtered = SubElement(top, f"{DRAKE}collision_filter_group", group)
        for link in pair:
            SubElement(filtered, f"{DRAKE}member", link=link)
        SubElement(filtered, f"{DRAKE}ignored_collision_filter_group", group)
    ElementTree.indent(top)
    text = ElementTree.tostring(top, encoding="unicode")
    file = folder / "robot.urdf"
    file.write_text(f'<?xml version="1.0"?>\n{text}\n', encoding="utf-8")


def _solid(parent: Element, kind: str, size: Mapping[str, str]) -> None:
    tag = kind if kind in _OF_URDF else DRAKE + kind
    SubElement(SubElement(parent, "geometry"), tag, size)


def _inertial(link: Element, robot: Description) -> None:
    inertia = robot.inertia(link.get("name", ""))
    com = inertia.get_com()
    central = inertia.Shift(com).CalcRotationalInertia().CopyToFullMatrix3()
    inertial = SubElement(link, "inertial")
    SubElement(inertial, "origin", xyz=text_of(com))
    SubElement(inertial, "mass", value=text_of(inertia.get_mass()))
    SubElement(inertial, "inertia", inertia_attributes(central))


def _visual(link: Element, shape: Shape, folder: Path, name: str) -> None:
    visual = SubElement(link, "visual", name=name)
    add_pose(visual, shape.X_LG)
    if shape.kind == "mesh":
        file = folder / "meshes" / f"{name}.obj"
        file.parent.mkdir(exist_ok=True)
        coarse = _coarse(shape.mesh)
        coarse.export(file, include_normals=False, include_texture=False)
        size = {"filename": f"meshes/{file.name}"}
    else:
        size = shape.size
    _solid(visual, shape.kind, size)
    if shape.colour:
        material = SubElement(visual, "material", name=f"{name}_colour")
        SubElement(material, "color", rgba=shape.colour)


def _coarse(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh; a large one with the vertices of each grid cell merged."""
    if len(mesh.faces) <= _FACES:
        return mesh
    cells = np.round(mesh.vertices / _GRID)
    _, first, cell = np.unique(
        cells, axis=0, return_index=True, return_inverse=True
    )
    faces = np.unique(cell.ravel()[mesh.faces], axis=0)
    faces = faces[[len(set(face)) == 3 for face in faces.tolist()]]
    return trimesh.Trimesh(mesh.vertices[first], faces, process=False)


def _collision(
    link: Element, X_LG: RigidTransform, kind: str, size: Mapping[str, float]
) -> None:
    number = len(link.findall("collision"))
    name = f"{link.get('name')}_{number}"
    collision = SubElement(link, "collision", name=name)
    add_pose(collision, X_LG)
    _solid(collision, kind, {k: text_of(v) for k, v in size.items()})
    ground = SubElement(collision, f"{DRAKE}proximity_properties")
    for friction in ("mu_static", "mu_dynamic"):
        SubElement(ground, f"{DRAKE}{friction}", value=_FRICTION)


def _joint(
    top: Element,
    robot: Description,
    joint: Joint,
    poses: Mapping[str, RigidTransform],
) -> None:
    """Appends a joint; `poses` are those of the links with all joints at 0."""
    element = SubElement(top, "joint", name=joint.name, type="revolute")
    add_pose(element, poses[joint.parent].InvertAndCompose(poses[joint.child]))
    SubElement(element, "parent", link=joint.parent)
    SubElement(element, "child", link=joint.child)
    SubElement(element, "axis", xyz=text_of(robot.axis(joint)))
    limits = {n: getattr(joint, n) for n in ("lower", "upper", "effort")}
    if joint.speed:
        limits["velocity"] = joint.speed
    SubElement(element, "limit", {k: text_of(v) for k, v in limits.items()})
    if joint.damping:
        SubElement(element, "dynamics", damping=text_of(joint.damping))


def robot_fields(
    name: str, anatomy: Anatomy, m: Measurements, max_joint_speed: float | None
) -> dict[str, Any]:
    """Returns the fields of robot.yaml [m, rad, rad/s]."""
    left, right = anatomy.feet.values()
    fields = {
        "name": name,
        "urdf": "robot.urdf",
        "pelvis_body": anatomy.pelvis,
        "torso_body": anatomy.torso,
        "left_foot_body": left,
        "right_foot_body": right,
        "sole": asdict(m.sole),
        "com_height": m.com_height,
        "step_width": m.step_width,
        "posture": m.posture,
        "legs": asdict(m.legs),
        "reachability": _widths(_reach(m)),
        "max_joint_speed": max_joint_speed,
        # Knees that are never straight.
        "whole_body": {
            f"joint_{which}_limits": {
                knee: limits[i]
                for knee, limits in m.knee_limits.items()
                if np.isfinite(limits[i])
            }
            for i, which in enumerate(("lower", "upper"))
        },
    }
    return {k: v for k, v in fields.items() if v is not None}


def write_yaml(folder: Path, fields: Mapping[str, Any]) -> None:
    """Writes robot.yaml, with lengths and angles to four decimals."""
    text = yaml.safe_dump(
        _rounded(fields),
        default_flow_style=None,
        sort_keys=False,
        allow_unicode=True,
    )
    (folder / "robot.yaml").write_text(_HEADER + text, encoding="utf-8")


def write_reach(folder: Path, reach: ReachabilityParams) -> None:
    """Replaces the lengths and widths of `reach` in robot.yaml of `folder`."""
    text = (folder / "robot.yaml").read_text(encoding="utf-8")
    fields = {**yaml.safe_load(text), "reachability": _widths(reach)}
    write_yaml(folder, fields)


def _rounded(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _rounded(v) for k, v in value.items()}
    return round(float(value), 4) if isinstance(value, float) else value


def _reach(m: Measurements) -> ReachabilityParams:
    """Lengths and widths [m]: Nadia's, scaled, at most the legs' reach."""
    nadias = scaled(ReachabilityParams(), m.size)
    length = min(nadias.length_forward, m.reach.length)
    width = min(nadias.width_max, m.reach.width_max)
    lengths = {"length_forward": length, "length_backward": length}
    widths = {"width_nominal": m.step_width, "width_max": width}
    return replace(nadias, **lengths, **widths)


def _widths(reach: ReachabilityParams) -> dict[str, float]:
    lengths = "length_forward", "length_backward"
    widths = "min", "nominal", "max", "forward", "backward"
    names = (*lengths, *(f"width_{name}" for name in widths))
    return {name: getattr(reach, name) for name in names}
