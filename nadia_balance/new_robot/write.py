"""Writer of a robot folder: robot.urdf, meshes and robot.yaml."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import trimesh
import yaml
from pydrake.math import RigidTransform, RollPitchYaw

from nadia_balance.core.body.reachability import ReachabilityParams
from nadia_balance.new_robot import description as robots
from nadia_balance.new_robot.capsules import Pairs
from nadia_balance.new_robot.measure import Fields, widths
from nadia_balance.new_robot.urdf import DRAKE, MOMENTS

_FRICTION = "0.8"
# Meshes with more faces are simplified; vertices are merged on a grid [m].
_FACES, _GRID = 2000, 0.006
_OF_URDF = ("box", "sphere", "cylinder", "mesh")
_HEADER = "# Made by nadia-new-robot from the robot's description.\n"
ElementTree.register_namespace("drake", DRAKE[1:-1])


def write_urdf(robot: robots.Description, ignored: Pairs, folder: Path) -> None:
    """Writes robot.urdf and, beside it, the visual meshes.

    The collisions of the pairs `ignored` are filtered.
    """
    top = _tag("robot", name=robot.name)
    for name in robot.below(robot.root):
        top.extend(_joint(joint) for joint in robot.chain(name)[-1:])
        link = robot.links[name]
        shapes = [
            _shape(shape, folder, re.sub(r"\W", "_", f"{name}_{i}"))
            for role in (robots.VISUAL, robots.COLLIDING)
            for i, shape in enumerate(link.of(role))
        ]
        top.append(_tag("link", _inertial(link), *shapes, name=name))
    top.extend(_transmission(joint) for joint in robot.joints.values())
    for i, pair in enumerate(sorted(map(sorted, ignored))):
        group = f"may_touch_{i}"
        members = [_tag(f"{DRAKE}member", link=link) for link in pair]
        other = _tag(f"{DRAKE}ignored_collision_filter_group", name=group)
        kind = f"{DRAKE}collision_filter_group"
        top.append(_tag(kind, *members, other, name=group))
    ElementTree.indent(top)
    file = ElementTree.ElementTree(top)
    file.write(folder / "robot.urdf", encoding="utf-8", xml_declaration=True)


def _tag(tag: str, *children: Element, **attributes: Any) -> Element:
    """A tag whose attributes are texts, or numbers."""
    texts = {
        key: value
        if isinstance(value, str)
        else " ".join(f"{number:.9g}" for number in np.ravel(value))
        for key, value in attributes.items()
    }
    element = Element(tag, texts)
    element.extend(children)
    return element


def _origin(X: RigidTransform) -> Element:
    rpy = RollPitchYaw(X.rotation()).vector()
    return _tag("origin", xyz=X.translation(), rpy=rpy)


def _inertial(link: robots.Link) -> Element:
    central = link.central()
    # All digits, which Drake needs to find it possible.
    moments = [*central.get_moments(), *central.get_products()]
    texts = [repr(float(moment)) for moment in moments]
    return _tag(
        "inertial",
        _tag("origin", xyz=link.M.get_com()),
        _tag("mass", value=link.M.get_mass()),
        _tag("inertia", **dict(zip(MOMENTS, texts, strict=True))),
    )


def _shape(shape: robots.Shape, folder: Path, name: str) -> Element:
    size: Mapping[str, Any] = shape.size
    if shape.kind == "mesh":
        file = folder / "meshes" / f"{name}.obj"
        file.parent.mkdir(exist_ok=True)
        coarse = _coarse(shape.mesh)
        coarse.export(file, include_normals=False, include_texture=False)
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


def _joint(joint: robots.Joint) -> Element:
    limits = {n: getattr(joint, n) for n in ("lower", "upper", "effort")}
    if joint.speed:
        limits["velocity"] = joint.speed
    parts = [
        _origin(joint.X_PC),
        _tag("parent", link=joint.parent),
        _tag("child", link=joint.child),
        _tag("axis", xyz=joint.axis),
        _tag("limit", **limits),
    ]
    if joint.damping:
        parts.append(_tag("dynamics", damping=joint.damping))
    return _tag("joint", *parts, name=joint.name, type="revolute")


def _transmission(joint: robots.Joint) -> Element:
    kind = Element("type")
    kind.text = "transmission_interface/SimpleTransmission"
    rotor = _tag(f"{DRAKE}rotor_inertia", value=joint.rotor_inertia)
    actuator = rotor, _tag(f"{DRAKE}gear_ratio", value="1")
    return _tag(
        "transmission",
        kind,
        _tag("joint", name=joint.name),
        _tag("actuator", *actuator, name=joint.name),
        name=f"{joint.name}_drive",
    )


def write_yaml(folder: Path, fields: Fields) -> None:
    """Writes robot.yaml, with lengths and angles to four decimals."""
    style = {"default_flow_style": None, "allow_unicode": True}
    text = yaml.safe_dump(_rounded(fields), sort_keys=False, **style)
    (folder / "robot.yaml").write_text(_HEADER + text, encoding="utf-8")


def write_reach(folder: Path, reach: ReachabilityParams) -> None:
    """Replaces the lengths and widths of `reach` in robot.yaml of `folder`."""
    text = (folder / "robot.yaml").read_text(encoding="utf-8")
    fields = {**yaml.safe_load(text), "reachability": widths(reach)}
    write_yaml(folder, fields)


def _rounded(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _rounded(v) for k, v in value.items()}
    return round(float(value), 4) if isinstance(value, float) else value
