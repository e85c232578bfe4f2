"""Writer of a Tree and its Figures as robot.urdf, meshes and robot.yaml."""

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
import trimesh
from pydrake.math import RigidTransform, RollPitchYaw

from nadia_balance.core.reachability import ReachabilityParams
from nadia_balance.core.size import scaled
from nadia_balance.new_robot.anatomy import Anatomy
from nadia_balance.new_robot.capsules import Capsules, Pairs
from nadia_balance.new_robot.figures import Figures
from nadia_balance.new_robot.tree import Joint, Link, Shape, Tree

_DRAKE = "{http://drake.mit.edu}"
_FRICTION = "0.8"
_SPHERE = 0.005  # radius of the spheres at the soles' corners [m]
# Meshes with more faces are simplified; vertices are merged on a grid [m].
_FACES, _GRID = 2000, 0.006
ElementTree.register_namespace("drake", _DRAKE[1:-1])


def write_urdf(
    tree: Tree,
    anatomy: Anatomy,
    figures: Figures,
    shapes: tuple[Capsules, Pairs],
    folder: Path,
) -> None:
    """Writes robot.urdf and, beside it, the visual meshes."""
    capsules, ignored = shapes
    top = Element("robot", name=tree.name)
    for name in tree.below(tree.root):
        if name != tree.root:
            _joint(top, tree.joint_to(name))
        link = SubElement(top, "link", name=name)
        _inertial(link, tree.links[name])
        for i, shape in enumerate(tree.links[name].visuals):
            _visual(link, shape, folder, re.sub(r"\W", "_", f"{name}_{i}"))
        for capsule in capsules.get(name, []):
            size = {"radius": capsule.radius, "length": capsule.length}
            _collision(link, capsule.X_LG, f"{_DRAKE}capsule", size)
        if name in anatomy.feet.values():
            for corner in _corners(figures):
                centre = RigidTransform([*corner, figures.sole_z + _SPHERE])
                _collision(link, centre, "sphere", {"radius": _SPHERE})
    for joint in tree.joints.values():
        _transmission(top, joint)
    for i, pair in enumerate(sorted(map(sorted, ignored))):
        group = {"name": f"may_touch_{i}"}
        filtered = SubElement(top, f"{_DRAKE}collision_filter_group", group)
        for link in pair:
            SubElement(filtered, f"{_DRAKE}member", link=link)
        tag = f"{_DRAKE}ignored_collision_filter_group"
        SubElement(filtered, tag, group)
    ElementTree.indent(top)
    text = ElementTree.tostring(top, encoding="unicode")
    file = folder / "robot.urdf"
    file.write_text(f'<?xml version="1.0"?>\n{text}\n', encoding="utf-8")


def _corners(figures: Figures) -> list[tuple[float, float]]:
    w = figures.half_width
    return [(x, y) for x in (figures.heel, figures.toe) for y in (w, -w)]


def _text(values) -> str:
    return " ".join(f"{value:.9g}" for value in np.ravel(values))


def _origin(parent: Element, X: RigidTransform) -> None:
    rpy = RollPitchYaw(X.rotation()).vector()
    SubElement(parent, "origin", xyz=_text(X.translation()), rpy=_text(rpy))


def _inertial(parent: Element, link: Link) -> None:
    inertial = SubElement(parent, "inertial")
    com = link.inertia.get_com()
    SubElement(inertial, "origin", xyz=_text(com))
    SubElement(inertial, "mass", value=_text(link.mass))
    central = link.inertia.Shift(com).CalcRotationalInertia()
    matrix = central.CopyToFullMatrix3()
    names = [f"i{a}{b}" for a, b in ("xx", "yy", "zz", "xy", "xz", "yz")]
    places = (0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)
    moments = {n: _text(matrix[p]) for n, p in zip(names, places, strict=True)}
    SubElement(inertial, "inertia", moments)


def _visual(parent: Element, shape: Shape, folder: Path, name: str) -> None:
    visual = SubElement(parent, "visual", name=name)
    _origin(visual, shape.X_LG)
    geometry = SubElement(visual, "geometry")
    if shape.kind == "mesh":
        file = folder / "meshes" / f"{name}.obj"
        file.parent.mkdir(exist_ok=True)
        coarse = _coarse(shape.mesh)
        coarse.export(file, include_normals=False, include_texture=False)
        SubElement(geometry, "mesh", filename=f"meshes/{file.name}")
    else:
        primitive = shape.kind in ("box", "sphere", "cylinder")
        tag = shape.kind if primitive else f"{_DRAKE}{shape.kind}"
        SubElement(geometry, tag, shape.size)
    if shape.colour:
        material = SubElement(visual, "material", name=f"{name}_colour")
        SubElement(material, "color", rgba=shape.colour)


def _coarse(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh; a large one with the vertices of each grid cell merged."""
    if len(mesh.faces) <= _FACES:
        return mesh
    _, which = np.unique(
        np.round(mesh.vertices / _GRID), axis=0, return_inverse=True
    )
    which = which.ravel()
    count = np.bincount(which)
    vertices = np.stack(
        [np.bincount(which, column) / count for column in mesh.vertices.T],
        axis=1,
    )
    faces = np.unique(which[mesh.faces], axis=0)
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    return trimesh.Trimesh(vertices, faces, process=False)


def _collision(
    parent: Element, X: RigidTransform, tag: str, size: Mapping[str, float]
) -> None:
    number = len(parent.findall("collision"))
    name = f"{parent.get('name')}_{number}"
    collision = SubElement(parent, "collision", name=name)
    _origin(collision, X)
    geometry = SubElement(collision, "geometry")
    SubElement(geometry, tag, {k: _text(v) for k, v in size.items()})
    ground = SubElement(collision, f"{_DRAKE}proximity_properties")
    for kind in ("mu_static", "mu_dynamic"):
        SubElement(ground, f"{_DRAKE}{kind}", value=_FRICTION)


def _joint(parent: Element, joint: Joint) -> None:
    element = SubElement(parent, "joint", name=joint.name, type="revolute")
    _origin(element, joint.X_PC)
    SubElement(element, "parent", link=joint.parent)
    SubElement(element, "child", link=joint.child)
    SubElement(element, "axis", xyz=_text(joint.axis))
    limit = {
        "lower": _text(joint.lower),
        "upper": _text(joint.upper),
        "effort": _text(joint.effort),
    }
    if joint.speed:
        limit["velocity"] = _text(joint.speed)
    SubElement(element, "limit", limit)
    if joint.damping:
        SubElement(element, "dynamics", damping=_text(joint.damping))


def _transmission(parent: Element, joint: Joint) -> None:
    element = SubElement(parent, "transmission", name=f"{joint.name}_drive")
    kind = SubElement(element, "type")
    kind.text = "transmission_interface/SimpleTransmission"
    SubElement(element, "joint", name=joint.name)
    actuator = SubElement(element, "actuator", name=joint.name)
    inertia = _text(joint.rotor_inertia)
    SubElement(actuator, f"{_DRAKE}rotor_inertia", value=inertia)
    SubElement(actuator, f"{_DRAKE}gear_ratio", value="1")


_REACH = (
    *("length_forward", "length_backward"),
    *("width_min", "width_nominal", "width_max"),
    *("width_forward", "width_backward"),
)


def write_yaml(
    tree: Tree,
    anatomy: Anatomy,
    figures: Figures,
    max_joint_speed: float | None,
    folder: Path,
) -> None:
    """Writes robot.yaml, with lengths and angles to four decimals."""
    f, (left, right) = figures, anatomy.feet.values()
    lower, upper = (
        {knee: pair[i] for knee, pair in f.knee_limits.items()} for i in (0, 1)
    )
    lines = [
        "# Made by nadia-new-robot from the robot's description.",
        f"name: {json.dumps(tree.name)}",
        "urdf: robot.urdf",
        f"pelvis_body: {json.dumps(anatomy.pelvis)}",
        f"torso_body: {json.dumps(anatomy.torso)}",
        f"left_foot_body: {json.dumps(left)}",
        f"right_foot_body: {json.dumps(right)}",
        "sole: "
        + _flow(x_min=f.heel, x_max=f.toe, half_width=f.half_width, z=f.sole_z),
        f"com_height: {f.com_height:.4f}",
        f"step_width: {f.step_width:.4f}",
        f"posture: {_by_joint(f.posture)}",
        f"legs: {_flow(**asdict(f.legs))}",
        f"reachability: {_flow(**_reach(f))}",
    ]
    if max_joint_speed:
        lines.append(f"max_joint_speed: {max_joint_speed}")
    lines.append("whole_body:  # knees that are never straight")
    for which, limits in ("lower", lower), ("upper", upper):
        finite = {k: v for k, v in limits.items() if np.isfinite(v)}
        lines.append(f"  joint_{which}_limits: {_by_joint(finite)}")
    text = "\n".join(lines) + "\n"
    (folder / "robot.yaml").write_text(text, encoding="utf-8")


def _reach(f: Figures) -> dict[str, float]:
    """Lengths and widths [m]: Nadia's, scaled, at most the legs' reach."""
    nadias = scaled(ReachabilityParams(), f.size)
    length = min(nadias.length_forward, f.reach.length)
    reach = replace(
        nadias,
        length_forward=length,
        length_backward=length,
        width_nominal=f.step_width,
        width_max=min(nadias.width_max, f.reach.width_max),
    )
    return {name: getattr(reach, name) for name in _REACH}


def write_reach(folder: Path, reach: ReachabilityParams) -> None:
    """Replaces the lengths and widths of `reach` in robot.yaml of `folder`."""
    file = folder / "robot.yaml"
    lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
    found = _flow(**{name: getattr(reach, name) for name in _REACH})
    text = "".join(
        f"reachability: {found}\n" if line.startswith("reachability:") else line
        for line in lines
    )
    file.write_text(text, encoding="utf-8")


def _by_joint(values: Mapping[str, float]) -> str:
    """A YAML mapping by joint; names are quoted, as they may be any text."""
    return _flow(**{json.dumps(k): v for k, v in values.items()})


def _flow(**values: float) -> str:
    return f"{{{', '.join(f'{k}: {v:.4f}' for k, v in values.items())}}}"
