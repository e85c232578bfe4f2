"""An MJCF as a URDF: what MuJoCo's own compiler makes of it."""

from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np
import trimesh
from mujoco import mjtEq, mjtGeom, mjtJoint
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RotationMatrix

from nadia_balance.new_robot import Notes
from nadia_balance.new_robot.shapes import (
    COLLIDING,
    SOLIDS,
    VISUAL,
    Array,
    Shape,
)
from nadia_balance.new_robot.urdf import (
    add_pose,
    add_transmission,
    inertia_attributes,
    text_of,
)

_KINDS = {mjtJoint.mjJNT_HINGE: "revolute", mjtJoint.mjJNT_SLIDE: "prismatic"}


def urdf_of_mjcf(
    file: Path, notes: Notes
) -> tuple[Element, dict[str, list[Shape]]]:
    """Returns the one floating robot in an MJCF, and the shapes of its links.

    A body with several joints becomes as many links.  Joint angles count from
    where the file shows the robot.

    Raises:
        ValueError: MuJoCo cannot compile it, it has a closed loop, or not one
            floating base.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(file))
        paired = {n for p in spec.pairs for n in (p.geomname1, p.geomname2)}
        _leave_out(spec, file, notes)
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        why = " ".join(str(error).split())
        raise ValueError(f"MuJoCo cannot compile it: {why}") from None
    free = [
        int(body)
        for body, kind in zip(model.jnt_bodyid, model.jnt_type, strict=True)
        if kind == mjtJoint.mjJNT_FREE
    ]
    if len(free) != 1:
        names = ", ".join(model.body(body).name for body in free) or "none"
        raise ValueError(f"floating bases: must be one; these are: {names}")
    top = Element("robot", name=model.names.split(b"\0")[0].decode())
    shapes = {}
    mimics = _mimics(model)
    for body in range(1, model.nbody):
        if model.body_rootid[body] == free[0]:
            shapes[_name(model, body)] = list(_shapes(model, body, paired))
            _add_link(top, model, body, mimics)
    return top, shapes


def _leave_out(spec: mujoco.MjSpec, file: Path, notes: Notes) -> None:
    """Drops what belongs to a scene, and shapes whose files are missing."""
    scene = spec.pairs, spec.excludes, spec.sensors, spec.keys
    for element in [element for part in scene for element in part]:
        spec.delete(element)
    folder = file.resolve().parent / spec.meshdir
    for mesh in list(spec.meshes):
        if mesh.file and not (folder / mesh.file).is_file():
            for geom in [g for g in spec.geoms if g.meshname == mesh.name]:
                spec.delete(geom)
            notes.changed.append(f"left out a shape: there is no {mesh.file}")
            spec.delete(mesh)


def _mimics(model: mujoco.MjModel) -> set[int]:
    """The joints that follow others; raises ValueError for a closed loop."""
    followers = set()
    for i, kind in enumerate(map(mjtEq, model.eq_type)):
        if kind == mjtEq.mjEQ_JOINT:
            followers.add(int(model.eq_obj1id[i]))
        elif kind in (mjtEq.mjEQ_CONNECT, mjtEq.mjEQ_WELD):
            raise ValueError(
                f"equality {model.eq(i).name}: must not be there, a closed loop"
            )
    return followers


def _name(model: mujoco.MjModel, body: int) -> str:
    return model.body(body).name or f"body_{body}"


def _joints(model: mujoco.MjModel, body: int) -> list[int]:
    """The joints of a body but a free one, from its parent on."""
    first, count = model.body_jntadr[body], model.body_jntnum[body]
    joints = range(first, first + count)
    return [j for j in joints if model.jnt_type[j] != mjtJoint.mjJNT_FREE]


def _origin(model: mujoco.MjModel, body: int) -> Array:
    """The origin (3,) of a body's link in the body: its last joint."""
    joints = _joints(model, body)
    return model.jnt_pos[joints[-1]] if joints else np.zeros(3)


def _pose(quaternion: Array, position: Array) -> RigidTransform:
    R = RotationMatrix(Quaternion(quaternion / np.linalg.norm(quaternion)))
    return RigidTransform(R, position)


def _add_link(
    top: Element, model: mujoco.MjModel, body: int, mimics: set[int]
) -> None:
    name, origin = _name(model, body), _origin(model, body)
    parent = int(model.body_parentid[body])
    X = _pose(model.body_quat[body], model.body_pos[body])
    holder, joints = _name(model, parent), _joints(model, body)
    at = -_origin(model, parent) if parent else np.zeros(3)
    before = np.zeros(3)  # the joint before, in the body
    for joint in joints:
        child = name
        if joint != joints[-1]:
            child = f"{name}_{model.joint(joint).name}"
            SubElement(top, "link", name=child)
        step = RigidTransform(model.jnt_pos[joint] - before)
        element = _add_joint(top, model, joint, joint in mimics)
        _place(element, RigidTransform(at) @ X @ step, holder, child)
        holder, before, at = child, model.jnt_pos[joint], np.zeros(3)
        X = RigidTransform()
    if parent and not joints:
        element = SubElement(top, "joint", name=f"{name}_weld", type="fixed")
        _place(element, RigidTransform(at) @ X, holder, name)
    link = SubElement(top, "link", name=name)
    inertial = SubElement(link, "inertial")
    X_BI = _pose(model.body_iquat[body], model.body_ipos[body] - origin)
    add_pose(inertial, X_BI)
    SubElement(inertial, "mass", value=text_of(model.body_mass[body]))
    moments = np.diag(model.body_inertia[body])
    SubElement(inertial, "inertia", inertia_attributes(moments))


def _place(joint: Element, X: RigidTransform, parent: str, child: str) -> None:
    add_pose(joint, X)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)


def _add_joint(
    top: Element, model: mujoco.MjModel, joint: int, follows: bool
) -> Element:
    name, kind = model.joint(joint).name, int(model.jnt_type[joint])
    if kind not in _KINDS:
        raise ValueError(f"joint {name}: must not be a ball")
    dof = int(model.jnt_dofadr[joint])
    limits = {"effort": text_of(_effort(model, joint))}
    tag = "continuous"
    if model.jnt_limited[joint]:
        tag = _KINDS[kind]
        zero = model.qpos0[model.jnt_qposadr[joint]]
        ends = model.jnt_range[joint] - zero
        limits |= {"lower": text_of(ends[0]), "upper": text_of(ends[1])}
    element = SubElement(top, "joint", name=name, type=tag)
    SubElement(element, "axis", xyz=text_of(model.jnt_axis[joint]))
    SubElement(element, "limit", limits)
    damping = text_of(np.ravel(model.dof_damping[dof])[0])
    SubElement(element, "dynamics", damping=damping)
    if follows:
        SubElement(element, "mimic")
    inertia = float(model.dof_armature[dof])
    add_transmission(top, name, rotor_inertia=inertia)
    return element


def _effort(model: mujoco.MjModel, joint: int) -> float:
    """The smallest effort limit [N m] of joint and motors; 0 if none has."""
    efforts = []
    if model.jnt_actfrclimited[joint]:
        efforts.append(np.abs(model.jnt_actfrcrange[joint]).max())
    for i in range(model.nu):
        if model.actuator_trnid[i, 0] == joint:
            gear = abs(model.actuator_gear[i, 0])
            if model.actuator_forcelimited[i]:
                force = np.abs(model.actuator_forcerange[i]).max()
                efforts.append(gear * force)
            motor = not model.actuator_biastype[i]
            if motor and model.actuator_ctrllimited[i]:
                gain = gear * abs(model.actuator_gainprm[i, 0])
                efforts.append(gain * np.abs(model.actuator_ctrlrange[i]).max())
    return float(min(efforts, default=0.0))


def _shapes(
    model: mujoco.MjModel, body: int, paired: set[str]
) -> Iterator[Shape]:
    """Yields the shapes of a body; what MuJoCo lets touch is colliding."""
    first, count = model.body_geomadr[body], model.body_geomnum[body]
    origin = _origin(model, body)
    for i in range(first, first + count):
        kind = mjtGeom(model.geom_type[i]).name[len("mjGEOM_") :].lower()
        if kind not in SOLIDS:
            continue
        touches = model.geom_contype[i] or model.geom_conaffinity[i]
        touches = touches or model.geom(i).name in paired
        size, mesh = model.geom_size[i], None
        # MuJoCo's sizes are half of a URDF's, but for radii and ellipsoids.
        half = {"box": [0.5, 0.5, 0.5], "ellipsoid": [1.0, 1.0, 1.0]}
        a, b, c = map(text_of, size / half.get(kind, [1.0, 0.5, 1.0]))
        sizes = {"radius": a, "length": b, "a": a, "b": b, "c": c}
        sizes["size"] = f"{a} {b} {c}"
        if kind == "mesh":
            mesh = _mesh(model, int(model.geom_dataid[i]))
        yield Shape(
            COLLIDING if touches else VISUAL,
            kind,
            {key: sizes[key] for key in SOLIDS[kind] if key in sizes},
            _pose(model.geom_quat[i], model.geom_pos[i] - origin),
            text_of(model.geom_rgba[i]),
            mesh,
        )


def _mesh(model: mujoco.MjModel, mesh: int) -> trimesh.Trimesh:
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return trimesh.Trimesh(
        model.mesh_vert[first : first + count].astype(float),
        model.mesh_face[face : face + faces],
    )
