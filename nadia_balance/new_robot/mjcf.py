"""Reader of anybody's MJCF: what MuJoCo's own compiler makes of it."""

from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import trimesh
from mujoco import mjtEq, mjtGeom, mjtJoint
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RotationMatrix

from nadia_balance.core.math.arrays import Array
from nadia_balance.new_robot import Notes
from nadia_balance.new_robot import description as robots

_KINDS = {mjtJoint.mjJNT_HINGE: "revolute", mjtJoint.mjJNT_SLIDE: "prismatic"}
# MuJoCo's sizes are half of a URDF's, but for radii and ellipsoids.
_HALF = {"box": (0.5, 0.5, 0.5), "ellipsoid": (1.0, 1.0, 1.0)}


def read_mjcf(file: Path, notes: Notes) -> robots.Description:
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
    for i, kind in enumerate(map(mjtEq, model.eq_type)):
        if kind == mjtEq.mjEQ_JOINT:
            joints[model.joint(model.eq_obj1id[i]).name].mimics = True
        elif kind in (mjtEq.mjEQ_CONNECT, mjtEq.mjEQ_WELD):
            raise ValueError(
                f"equality {model.eq(i).name}: must not be there, a closed loop"
            )
    return robots.Description(spec.modelname, links, joints)


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
            notes.add("changed", f"left out a shape: there is no {mesh.file}")
            spec.delete(mesh)


def _pose(position: Array, quaternion: Array) -> RigidTransform:
    R = RotationMatrix(Quaternion(quaternion / np.linalg.norm(quaternion)))
    return RigidTransform(R, position)


def _chain(
    model: mujoco.MjModel, names: list[str], origins: Array, body: int
) -> Iterator[robots.Joint]:
    """Yields the joints from a body's parent to it; a weld if it has none."""
    parent, link = model.body_parentid[body], names[body]
    at = model.body_pos[body] - origins[parent]
    X, holder = _pose(at, model.body_quat[body]), names[parent]
    if not model.body_jntnum[body]:
        yield robots.Joint(f"{link}_weld", "weld", holder, link, X)
    joints = np.flatnonzero(model.jnt_bodyid == body)
    before = np.zeros(3)  # the joint before, in the body
    for i in joints[model.jnt_type[joints] != mjtJoint.mjJNT_FREE]:
        name, at = model.joint(i).name, model.jnt_pos[i]
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
    for i in np.flatnonzero(model.actuator_trnid[:, 0] == joint):
        gear = abs(model.actuator_gear[i, 0])
        if model.actuator_forcelimited[i]:
            efforts.append(gear * np.abs(model.actuator_forcerange[i]).max())
        if model.actuator_ctrllimited[i] and not model.actuator_biastype[i]:
            gain = gear * abs(model.actuator_gainprm[i, 0])
            efforts.append(gain * np.abs(model.actuator_ctrlrange[i]).max())
    return float(min(efforts, default=0.0))


def _shapes(
    model: mujoco.MjModel, body: int, origin: Array, paired: set[str]
) -> Iterator[robots.Shape]:
    """Yields the shapes of a body; what MuJoCo lets touch is colliding."""
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
