"""Readers of anybody's URDF, mended where no robot is as it says, or MJCF."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from xml.etree.ElementTree import Element

import mujoco
import numpy as np
import trimesh
from mujoco import mjtEq, mjtGeom, mjtJoint, mjtTrn
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody.tree import SpatialInertia

import nadia_balance.new_robot.description as robots
from nadia_balance.core.math.arrays import Array

DRAKE = "{http://drake.mit.edu}"
MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_KNOWN = {"link", "joint", "material", "transmission"}
_LOOPS = ("loop", "bushing", "constraint")
_POSITIVE = {"size", "radius", "length", "a", "b", "c"}
_NOT_NEGATIVE = {"effort", "velocity", "damping", "value"}
_ZERO = "0 0 0"
_Z_UP = RigidTransform(RotationMatrix.MakeXRotation(0.5 * np.pi))  # from y up
_KINDS = {mjtJoint.mjJNT_HINGE: "revolute", mjtJoint.mjJNT_SLIDE: "prismatic"}
# MuJoCo's sizes are half of a URDF's, but for radii and ellipsoids.
_HALF = {"box": (0.5, 0.5, 0.5), "ellipsoid": (1.0, 1.0, 1.0)}


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
            raise ValueError(f"{where} {count} finite number(s)")
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
    top: Element, file: Path, roots: Sequence[Path], notes: robots.Notes
) -> robots.Description:
    """Returns the robot `top` of `file`; `roots` are folders of its packages.

    Raises ValueError: it has xacro or closed loops, or a number is invalid.
    """
    if top.tag != "robot" or top.findall(".//{http://www.ros.org/wiki/xacro}*"):
        why = "must be a URDF, xacro expanded, or an MJCF"
        raise ValueError(f"<{top.tag}>: {why}")
    for tag in sorted({child.tag for child in top} - _KNOWN):
        if any(word in tag for word in _LOOPS):
            raise ValueError(f"<{tag}>: must not be there, a closed loop")
        notes.add("changed", "left out the tags", tag)
    colours: dict[str, str] = {}
    for material in top.iter("material"):
        for colour in material.findall("color"):
            colours[material.get("name", "")] = colour.get("rgba", "")
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
    _let_go(links, joints, notes)
    return robots.Description(top.get("name") or file.stem, links, joints)


def _let_go(links: dict, joints: dict, notes: robots.Notes) -> None:
    """Frees a robot that is welded to the world, if no other base is free."""
    if {joint.child for joint in joints.values()} >= {*links} - {"world"}:
        holders = {joint.parent for joint in joints.values()}
        for name, joint in list(joints.items()):
            ends = joint.type, joint.parent
            if ends == ("weld", "world") and joint.child in holders:
                line = "no longer welded to the world"
                notes.add("changed", line, joint.child)
                del joints[name]


def _parts(top: Element, tag: str) -> dict[str, _Part]:
    found: dict[str, _Part] = {}
    for element in top.findall(tag):
        name = element.get("name", "")
        if not name or name in found or "::" in name:
            raise ValueError(f"{tag} {name!r}: must be a unique name, no ::")
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


def _take_shape(link: robots.Link, part: _Part, colours, folders, notes):
    """Adds the shape in `part` to `link`, if it is known and found."""
    solids = part.element.findall("geometry/*")
    kind = solids[0].tag.removeprefix(DRAKE) if solids else "nothing"
    if kind not in robots.SOLIDS:
        notes.add("changed", f"left out the {kind} of {part.name}")
        return
    mesh, at = None, f"geometry/{solids[0].tag}"
    zeros, keys = _ZERO if kind == "box" else "0", robots.SOLIDS[kind][0]
    try:
        size = {key: part.numbers(at, key, zeros) for key in keys}
        if kind == "mesh":
            mesh = _load(_find_mesh(part.text(at, "filename"), folders)).copy()
            mesh.apply_scale(part.numbers(at, "scale", "1 1 1"))
    except (OSError, ValueError) as error:
        why = str(error).removeprefix(f"{part.name}: ")
        link.missing = link.missing or why
        notes.add("changed", f"left out {part.name}: {why}")
        return
    material = colours.get(part.text("material", "name"), "")
    colour = part.text("material/color", "rgba", material)
    if colour and not _is_colour(colour):
        notes.add("changed", "left out the colours of", part.name)
        colour = ""
    X, role = part.pose("origin"), part.element.tag
    link.shapes.append(robots.Shape(role, kind, size, X, colour, mesh))


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
        mesh.metadata["y up"] = b"<up_axis>Y_UP" in path.read_bytes()[:8192]
    return mesh


def _turn_upright(links: list, coms: list[Array], notes: robots.Notes) -> None:
    """Turns meshes whose files say "y is up", if nearer to the CoMs then."""
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


def _inertia(part: _Part, link: robots.Link, notes) -> SpatialInertia:
    """The inertia of a link; without moments it is that of a box."""
    mass = part.number("inertial/mass", "value")
    X = part.pose("inertial/origin")
    if not mass:
        return SpatialInertia.Zero()
    com, R = X.translation(), X.rotation().matrix()
    moments = [part.number("inertial/inertia", key) for key in MOMENTS]
    given = np.take(moments, [[0, 3, 4], [3, 1, 5], [4, 5, 2]])
    what = "moments of inertia"
    if link.shapes and not given.any():
        notes.add("changed", f"{what} of 0, now of a box", link.name)
        sides = np.ptp(link.corners(), axis=0)
        return SpatialInertia.SolidBoxWithMass(mass, *sides).Shift(-com)
    possible = _possible(given, mass)
    if not np.allclose(given, possible, rtol=1e-3, atol=0.0):
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
    changed = (moments != given).any()
    return axes @ np.diag(moments) @ axes.T if changed else inertia


def read_mjcf(file: Path, notes: robots.Notes) -> robots.Description:
    """Returns the one floating robot in an MJCF.

    A body with several joints becomes as many links.  Joint angles count from
    where the file shows the robot.

    Raises ValueError: MuJoCo cannot compile it, or no tree with one base.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(file))
        paired = {n for p in spec.pairs for n in (p.geomname1, p.geomname2)}
        _leave_out(spec, file, notes)
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ValueError(f"MuJoCo cannot compile it: {error}") from None
    names = [model.body(i).name or f"body_{i}" for i in range(model.nbody)]
    # A link has its origin at the last joint of its body.
    origins, held = np.zeros((model.nbody, 3)), model.jnt_type != 0
    origins[model.jnt_bodyid[held]] = model.jnt_pos[held]
    links, joints = {"world": robots.Link("world")}, {}
    for body in range(1, model.nbody):
        for joint in _chain(model, names, origins, body):
            joints[joint.name] = joint
            links[joint.child] = robots.Link(joint.child)
        link = links.setdefault(names[body], robots.Link(names[body]))
        link.shapes = list(_shapes(model, body, origins[body], paired))
        X = _pose(model.body_ipos[body] - origins[body], model.body_iquat[body])
        R, mass = X.rotation().matrix(), model.body_mass[body]
        central = R @ np.diag(model.body_inertia[body]) @ R.T
        link.M = robots.spatial_inertia(mass, X.translation(), central)
    for i in np.flatnonzero(model.eq_active0):
        kind = mjtEq(model.eq_type[i])
        if kind == mjtEq.mjEQ_JOINT:
            joint = model.eq_obj1id[i]
            joints[model.joint(joint).name or f"joint_{joint}"].mimics = True
        elif kind in (mjtEq.mjEQ_CONNECT, mjtEq.mjEQ_WELD):
            why = "must not be there, a closed loop"
            raise ValueError(f"equality {model.eq(i).name}: {why}")
    _let_go(links, joints, notes)
    return robots.Description(spec.modelname, links, joints)


def _leave_out(spec: mujoco.MjSpec, file: Path, notes: robots.Notes) -> None:
    """Drops parts of a scene, textures, and shapes whose files are missing."""
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    scene = spec.pairs, spec.excludes, spec.sensors, spec.keys, spec.textures
    for element in [element for part in scene for element in part]:
        spec.delete(element)
    folder = file.resolve().parent / spec.meshdir
    for mesh in list(spec.meshes):
        if mesh.file and not (folder / mesh.file).is_file():
            for geom in [g for g in spec.geoms if g.meshname == mesh.name]:
                spec.delete(geom)
            notes.add("changed", f"left out a shape: there is no {mesh.file}")
            spec.delete(mesh)


def _pose(position: Array, quaternion: Array) -> RigidTransform:
    R = RotationMatrix(Quaternion(quaternion / np.linalg.norm(quaternion)))
    return RigidTransform(R, position)


def _chain(model: mujoco.MjModel, names, origins: Array, body: int) -> Iterator:
    """Yields the Joints from a body's parent to it; a weld if it has none."""
    parent, link = model.body_parentid[body], names[body]
    at = model.body_pos[body] - origins[parent]
    X, holder = _pose(at, model.body_quat[body]), names[parent]
    if not model.body_jntnum[body]:
        yield robots.Joint(f"{link}_weld", "weld", holder, link, X)
    joints = np.flatnonzero(model.jnt_bodyid == body)
    before = np.zeros(3)  # the joint before, in the body
    for i in joints[model.jnt_type[joints] != mjtJoint.mjJNT_FREE]:
        name, at = model.joint(i).name or f"joint_{i}", model.jnt_pos[i]
        child = link if i == joints[-1] else f"{link}_{name}"
        X = X @ RigidTransform(at - before)
        dof = model.jnt_dofadr[i]
        kind = _KINDS.get(int(model.jnt_type[i]), "ball")
        ends = model.jnt_range[i] - model.qpos0[model.jnt_qposadr[i]]
        if not model.jnt_limited[i] and kind == "revolute":
            kind, ends = "continuous", np.array([-np.pi, np.pi])
        yield robots.Joint(
            *(name, kind, holder, child, X, model.jnt_axis[i]),
            *map(float, ends),
            effort=_effort(model, i),
            rotor_inertia=float(model.dof_armature[dof]),
            damping=float(np.ravel(model.dof_damping[dof])[0]),
        )
        X, holder, before = RigidTransform(), child, at


def _effort(model: mujoco.MjModel, joint: int) -> float:
    """The smallest effort limit [N m] of joint and motors; 0 if none has."""
    efforts = []
    if model.jnt_actfrclimited[joint]:
        efforts.append(np.abs(model.jnt_actfrcrange[joint]).max())
    of_joint = model.actuator_trntype <= int(mjtTrn.mjTRN_JOINTINPARENT)
    for i in np.flatnonzero(of_joint & (model.actuator_trnid[:, 0] == joint)):
        gear = abs(model.actuator_gear[i, 0])
        if model.actuator_forcelimited[i]:
            efforts.append(gear * np.abs(model.actuator_forcerange[i]).max())
        if model.actuator_ctrllimited[i] and not model.actuator_biastype[i]:
            gain = gear * abs(model.actuator_gainprm[i, 0])
            efforts.append(gain * np.abs(model.actuator_ctrlrange[i]).max())
    return float(min(efforts, default=0.0))


def _shapes(model: mujoco.MjModel, body: int, origin, paired) -> Iterator:
    """Yields the Shapes of a body; what MuJoCo lets touch is colliding."""
    for i in np.flatnonzero(model.geom_bodyid == body):
        kind = mjtGeom(model.geom_type[i]).name[len("mjGEOM_") :].lower()
        if kind not in robots.SOLIDS:
            continue
        touches = model.geom_contype[i] or model.geom_conaffinity[i]
        touches = touches or model.geom(i).name in paired
        size = model.geom_size[i] / _HALF.get(kind, (1.0, 0.5, 1.0))
        a, b, c = size[:, None]
        sizes = dict(radius=a, length=b, a=a, b=b, c=c, size=size)
        yield robots.Shape(
            robots.COLLIDING if touches else robots.VISUAL,
            kind,
            {key: sizes[key] for key in robots.SOLIDS[kind][0]},
            _pose(model.geom_pos[i] - origin, model.geom_quat[i]),
            " ".join(f"{part:.9g}" for part in model.geom_rgba[i]),
            _mesh(model, model.geom_dataid[i]) if kind == "mesh" else None,
        )


def _mesh(model: mujoco.MjModel, mesh: int) -> trimesh.Trimesh:
    first, face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    vertices = model.mesh_vert[first:][: model.mesh_vertnum[mesh]]
    faces = model.mesh_face[face:][: model.mesh_facenum[mesh]]
    return trimesh.Trimesh(vertices.astype(float), faces)
