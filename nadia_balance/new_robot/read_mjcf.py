"""Reader of anybody's MJCF."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import mujoco  # type: ignore[import-untyped]
import numpy as np
import trimesh
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.tree import SpatialInertia

from nadia_balance.core.math.arrays import Array
from nadia_balance.new_robot.description import (
    COLLIDING,
    SOLIDS,
    VISUAL,
    Description,
    Joint,
    Link,
    Notes,
    Shape,
    Vector,
    spatial_inertia,
)
from nadia_balance.new_robot.read import described, let_go

_KINDS = {
    mujoco.mjtJoint.mjJNT_HINGE: "revolute",
    mujoco.mjtJoint.mjJNT_SLIDE: "prismatic",
}
# MuJoCo's sizes are half of a URDF's, but for radii and ellipsoids.
_HALF = {"box": (0.5, 0.5, 0.5), "ellipsoid": (1.0, 1.0, 1.0)}


def read_mjcf(file: Path, notes: Notes) -> Description:
    """Reads the one floating robot in an MJCF.

    A body with several joints becomes as many links.  Joint angles count from
    where the file shows the robot.

    Args:
        file: the MJCF.
        notes: get what was left out.

    Returns:
        The robot.

    Raises:
        ValueError: MuJoCo cannot compile it, or no tree with one base.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(file))
        paired = {
            name
            for pair in spec.pairs
            for name in (pair.geomname1, pair.geomname2)
        }
        _leave_out(spec, file, notes)
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ValueError(f"MuJoCo cannot compile it: {error}") from None
    names = [model.body(i).name or f"body_{i}" for i in range(model.nbody)]
    # A link has its origin at the last joint of its body.
    origins = np.zeros((model.nbody, 3))
    held = model.jnt_type != mujoco.mjtJoint.mjJNT_FREE
    origins[model.jnt_bodyid[held]] = model.jnt_pos[held]
    links = {"world": Link("world")}
    joints: dict[str, Joint] = {}
    for body in range(1, model.nbody):
        for joint in _chain(model, names, origins, body=body):
            joints[joint.name] = joint
            links[joint.child] = Link(joint.child)
        link = links.setdefault(names[body], Link(names[body]))
        link.shapes = list(
            _shapes(model, body, origin=origins[body], paired=paired)
        )
        link.M = _inertia_of_body(model, body, origins[body])
    _mark_mimics(model, joints)
    let_go(links, joints, notes)
    return described(spec.modelname, links, joints, notes)


def _leave_out(spec: mujoco.MjSpec, file: Path, notes: Notes) -> None:
    """Drops parts of a scene, textures, and shapes whose files are missing."""
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    for element in [
        *spec.pairs,
        *spec.excludes,
        *spec.sensors,
        *spec.keys,
        *spec.textures,
    ]:
        spec.delete(element)
    folder = file.resolve().parent / spec.meshdir
    for mesh in list(spec.meshes):
        if mesh.file and not (folder / mesh.file).is_file():
            for geom in [g for g in spec.geoms if g.meshname == mesh.name]:
                spec.delete(geom)
            notes.add("changed", f"left out a shape: there is no {mesh.file}")
            spec.delete(mesh)


def _mark_mimics(model: mujoco.MjModel, joints: Mapping[str, Joint]) -> None:
    """Marks joints whose angles equalities set; refuses closed loops."""
    for i in np.flatnonzero(model.eq_active0):
        kind = mujoco.mjtEq(model.eq_type[i])
        if kind == mujoco.mjtEq.mjEQ_JOINT:
            joint = model.eq_obj1id[i]
            joints[model.joint(joint).name or f"joint_{joint}"].mimics = True
        elif kind in (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD):
            raise ValueError(
                f"equality {model.eq(i).name}: must not be there, a closed loop"
            )


def _pose(position: Vector, quaternion: Vector) -> RigidTransform:
    return RigidTransform(
        RotationMatrix(Quaternion(quaternion / np.linalg.norm(quaternion))),
        position,
    )


def _inertia_of_body(
    model: mujoco.MjModel, body: int, origin: Array
) -> SpatialInertia:
    """The inertia about a point `origin` (3,) [m] of the body."""
    X = _pose(model.body_ipos[body] - origin, model.body_iquat[body])
    R = X.rotation().matrix()
    return spatial_inertia(
        mass=model.body_mass[body],
        com=X.translation(),
        central=R @ np.diag(model.body_inertia[body]) @ R.T,
    )


def _chain(
    model: mujoco.MjModel, names: Sequence[str], origins: Array, *, body: int
) -> Iterator[Joint]:
    """Yields the joints from a body's parent to it; a weld if it has none."""
    link = names[body]
    parent = model.body_parentid[body]
    holder = names[parent]
    X = _pose(model.body_pos[body] - origins[parent], model.body_quat[body])
    if not model.body_jntnum[body]:
        yield Joint(
            name=f"{link}_weld", type="weld", parent=holder, child=link, X_PC=X
        )
    joints = np.flatnonzero(model.jnt_bodyid == body)
    before: Vector = np.zeros(3)  # the joint before, in the body
    for i in joints[model.jnt_type[joints] != mujoco.mjtJoint.mjJNT_FREE]:
        name = model.joint(i).name or f"joint_{i}"
        child = link if i == joints[-1] else f"{link}_{name}"
        dof = model.jnt_dofadr[i]
        kind = _KINDS.get(int(model.jnt_type[i]), "ball")
        ends = model.jnt_range[i] - model.qpos0[model.jnt_qposadr[i]]
        if not model.jnt_limited[i] and kind == "revolute":
            kind = "continuous"
            ends = np.array([-np.pi, np.pi])
        yield Joint(
            name=name,
            type=kind,
            parent=holder,
            child=child,
            X_PC=X @ RigidTransform(model.jnt_pos[i] - before),
            axis=model.jnt_axis[i],
            lower=float(ends[0]),
            upper=float(ends[1]),
            effort=_effort(model, i),
            rotor_inertia=float(model.dof_armature[dof]),
            damping=float(np.ravel(model.dof_damping[dof])[0]),
        )
        X = RigidTransform()
        holder = child
        before = model.jnt_pos[i]


def _effort(model: mujoco.MjModel, joint: int) -> float:
    """The smallest effort limit [N m] of joint and motors; 0 if none has."""
    efforts = []
    if model.jnt_actfrclimited[joint]:
        efforts.append(np.abs(model.jnt_actfrcrange[joint]).max())
    for i in np.flatnonzero(
        (model.actuator_trntype <= int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
        & (model.actuator_trnid[:, 0] == joint)
    ):
        gear = abs(model.actuator_gear[i, 0])
        if model.actuator_forcelimited[i]:
            efforts.append(gear * np.abs(model.actuator_forcerange[i]).max())
        if model.actuator_ctrllimited[i] and not model.actuator_biastype[i]:
            gain = gear * abs(model.actuator_gainprm[i, 0])
            efforts.append(gain * np.abs(model.actuator_ctrlrange[i]).max())
    return float(min(efforts, default=0.0))


def _shapes(
    model: mujoco.MjModel, body: int, *, origin: Array, paired: set[str]
) -> Iterator[Shape]:
    """Yields the shapes of a body; what MuJoCo lets touch is colliding."""
    for i in np.flatnonzero(model.geom_bodyid == body):
        kind = mujoco.mjtGeom(model.geom_type[i]).name[len("mjGEOM_") :].lower()
        if kind not in SOLIDS:
            continue
        touches = (
            model.geom_contype[i]
            or model.geom_conaffinity[i]
            or model.geom(i).name in paired
        )
        size = model.geom_size[i] / _HALF.get(kind, (1.0, 0.5, 1.0))
        sizes = {
            "radius": size[:1],
            "length": size[1:2],
            "a": size[:1],
            "b": size[1:2],
            "c": size[2:],
            "size": size,
        }
        yield Shape(
            role=COLLIDING if touches else VISUAL,
            kind=kind,
            size={key: sizes[key] for key in SOLIDS[kind]},
            X_LG=_pose(model.geom_pos[i] - origin, model.geom_quat[i]),
            colour=" ".join(f"{part:.9g}" for part in model.geom_rgba[i]),
            mesh=(
                _mesh(model, model.geom_dataid[i])
                if kind == "mesh"
                else trimesh.Trimesh()
            ),
        )


def _mesh(model: mujoco.MjModel, mesh: int) -> trimesh.Trimesh:
    vertices = model.mesh_vert[model.mesh_vertadr[mesh] :]
    faces = model.mesh_face[model.mesh_faceadr[mesh] :]
    return trimesh.Trimesh(
        vertices=vertices[: model.mesh_vertnum[mesh]].astype(float),
        faces=faces[: model.mesh_facenum[mesh]],
    )
