"""MuJoCo model of the robot and its ground, from Drake's MultibodyPlant."""

from collections.abc import Iterable

import mujoco
import numpy as np
from pydrake import geometry
from pydrake.geometry import GeometryId, SceneGraphInspector
from pydrake.math import RigidTransform
from pydrake.multibody import plant as mbp
from pydrake.multibody.tree import BodyIndex, Joint, RigidBody

from nadia_balance.core.math.arrays import Array
from nadia_balance.robot.plants import actuators, joints
from nadia_balance.robot.urdf import hull_points

Forces = Iterable[mbp.ExternallyAppliedSpatialForce]
# Time constant of contacts and joint limits, which are damped springs [s];
# MuJoCo needs two steps or more.  Its default, 0.02, is as soft as a mat.
STIFFNESS_TIME = 0.004
_HARDNESS = [0.95, 0.99, 0.001, 0.5, 2.0]  # the impedance of all constraints
# Ratio of frictional to normal impedance; with less, soles creep.
_FRICTION_IMPEDANCE = 10.0
_SHAPES = {  # Drake's type: the end of the name of MuJoCo's, and its size
    geometry.Box: ("BOX", lambda s: 0.5 * s.size()),
    geometry.Capsule: ("CAPSULE", lambda s: [s.radius(), 0.5 * s.length(), 0]),
    geometry.Cylinder: ("CYLINDER", lambda s: [s.radius(), s.length() / 2, 0]),
    geometry.Ellipsoid: ("ELLIPSOID", lambda s: [s.a(), s.b(), s.c()]),
    geometry.HalfSpace: ("PLANE", lambda s: [0.0, 0.0, 1.0]),
    geometry.Sphere: ("SPHERE", lambda s: [s.radius(), 0.0, 0.0]),
}
_HINGE, _FREE = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_FREE
_JOINTS = {"revolute": _HINGE, "quaternion_floating": _FREE}


class MujocoModel:
    """A plant whose motion MuJoCo computes.

    Bodies, inertias, joints with their limits, damping and reflected inertia,
    collision shapes and filters are those of Drake's plant, and so is the order
    of q, v and of the actuators: x = [q, v] (nq + nv,).
    """

    def __init__(self, plant: mbp.MultibodyPlant, inspector):
        """Models `plant`, finalized, with the shapes of a scene's `inspector`.

        Raises ValueError: a joint or a shape of a type that is not supported.
        """
        self._plant = plant
        self._spec = _empty_spec(plant)
        self._softness = [max(STIFFNESS_TIME, 2.0 * plant.time_step()), 1.0]
        self._inboard = {j.child_body().index(): j for j in joints(plant)}
        world = plant.world_body()
        self._bodies = {world.index(): self._spec.worldbody}
        for i in range(1, plant.num_bodies()):
            self._add_body(plant.get_body(BodyIndex(i)))
        self._add_shapes(inspector)
        self.model = self._spec.compile()
        self.data = mujoco.MjData(self.model)
        self._actuation = plant.MakeActuationMatrix()
        low, high = plant.GetEffortLowerLimits(), plant.GetEffortUpperLimits()
        self._efforts = low, high
        self._find_columns()

    def _add_body(self, body: RigidBody) -> mujoco.MjsBody:
        """Adds `body`, after its parents."""
        if body.index() in self._bodies:
            return self._bodies[body.index()]
        joint = self._inboard[body.index()]
        parent = self._add_body(joint.parent_body())
        X_PF = joint.frame_on_parent().GetFixedPoseInBodyFrame()
        X_BM = joint.frame_on_child().GetFixedPoseInBodyFrame()
        M_B = body.default_spatial_inertia()
        name, pose = str(int(body.index())), _pose(X_PF @ X_BM.inverse())
        added = parent.add_body(name=name, **pose)
        if (mass := M_B.get_mass()) > 0.0:
            p_BCm = M_B.get_com()
            I_BBcm = M_B.Shift(p_BCm).CalcRotationalInertia()
            moments, axes = I_BBcm.CalcPrincipalMomentsAndAxesOfInertia()
            added.explicitinertial, added.mass = True, mass
            added.ipos, added.inertia = p_BCm, moments
            added.iquat = axes.ToQuaternion().wxyz()
        if joint.num_velocities():
            self._add_joint(added, joint, X_BM)
        self._bodies[body.index()] = added
        return added

    def _add_joint(self, body: mujoco.MjsBody, joint: Joint, X_BM) -> None:
        kind = joint.type_name()
        if kind not in _JOINTS:
            which = f"must be one of {', '.join(_JOINTS)} or fixed, for MuJoCo"
            raise ValueError(f"joint {joint.name()}: type {kind}: {which}")
        added = body.add_joint(name=str(int(joint.index())), type=_JOINTS[kind])
        if joint.num_velocities() > 1:
            return
        axis = joint.revolute_axis()
        limits = joint.position_lower_limit(), joint.position_upper_limit()
        added.pos, added.axis = X_BM.translation(), X_BM.rotation() @ axis
        added.limited = bool(np.isfinite(limits).any())
        added.range = np.clip(limits, -1e6, 1e6)
        added.solref_limit, added.solimp_limit = self._softness, _HARDNESS
        for actuator in actuators(self._plant):
            if actuator.joint().index() == joint.index():
                added.armature = actuator.default_reflected_inertia()

    def _add_shapes(self, inspector: SceneGraphInspector) -> None:
        pairs = sorted(inspector.GetCollisionCandidates())
        for shape in sorted({shape for pair in pairs for shape in pair}):
            self._add_shape(inspector, shape)
        same = {"condim": 3, "solref": self._softness, "solimp": _HARDNESS}
        for shapes in pairs:
            a, b = (_friction(inspector, shape) for shape in shapes)
            mu = 2.0 * a * b / (a + b) if a + b else 0.0  # Drake's rule
            first, second = map(_name, shapes)
            pair = {"geomname1": first, "geomname2": second, **same}
            self._spec.add_pair(**pair, friction=[mu, mu, 0.0, 0.0, 0.0])

    def _add_shape(self, inspector: SceneGraphInspector, shape) -> None:
        body = self._plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
        what = inspector.GetShape(shape)
        options = _pose(inspector.GetPoseInFrame(shape))
        kind, size = _SHAPES.get(type(what), ("MESH", None))
        if isinstance(what, geometry.Convex | geometry.Mesh):
            # The convex hull, as in Drake.
            points = hull_points(inspector, shape)
            self._spec.add_mesh(name=_name(shape), uservert=np.ravel(points))
            options["meshname"] = _name(shape)
        elif size is not None:
            options["size"] = size(what)
        else:
            name = f"shape {inspector.GetName(shape)}"
            why = f"must not be a {type(what).__name__}, for MuJoCo"
            raise ValueError(f"{name}: {why}")
        options |= {"name": _name(shape), "contype": 0, "conaffinity": 0}
        options["type"] = getattr(mujoco.mjtGeom, f"mjGEOM_{kind}")
        self._bodies[body.index()].add_geom(**options)

    def _find_columns(self) -> None:
        """Finds the index in the plant's q and v of each entry of MuJoCo's."""
        model = self.model
        self._q, self._v = np.empty(model.nq, int), np.empty(model.nv, int)
        # Slices of quaternion and angular velocity of free bodies.
        self._turning = []
        for joint in self._inboard.values():
            if not (size := joint.num_velocities()):
                continue
            found = model.joint(str(int(joint.index())))
            q, v = int(found.qposadr[0]), int(found.dofadr[0])
            p, w = joint.position_start(), joint.velocity_start()
            if size == 1:
                self._q[q], self._v[v] = p, w
                model.dof_damping[v] = joint.default_damping()
                continue
            self._q[q : q + 7] = p + np.array([4, 5, 6, 0, 1, 2, 3])
            self._v[v : v + 6] = w + np.array([3, 4, 5, 0, 1, 2])
            self._turning.append((slice(q + 3, q + 7), slice(v + 3, v + 6)))
        # Drake's body of each geom of MuJoCo.
        names = (model.body(i).name for i in model.geom_bodyid)
        self._body_of = [BodyIndex(int(n) if n.isdigit() else 0) for n in names]

    def rates(self, vector: Array) -> Array:
        """Returns v, or its derivative, in Drake's order, from MuJoCo's."""
        found, vector = np.empty(self.model.nv), vector.copy()
        for quaternion, turning in self._turning:
            w_B = vector[turning].copy()
            q_WB = self.data.qpos[quaternion]
            mujoco.mju_rotVecQuat(vector[turning], w_B, q_WB)
        found[self._v] = vector
        return found

    def step(
        self, x: Array, torques: Array, forces: Forces = ()
    ) -> tuple[Array, list[mbp.PointPairContactInfo]]:
        """Returns x a time step later, and the contacts on the way there.

        `torques` (nu,) are those of the actuators.  `data` is scratch.
        """
        self.forward(x, torques, forces)
        contacts, after = self._contacts(), np.empty_like(x)
        mujoco.mj_Euler(self.model, self.data)
        after[self._q] = self.data.qpos
        after[self.model.nq :] = self.rates(self.data.qvel)
        return after, contacts

    def forward(self, x: Array, torques: Array, forces: Forces = ()) -> None:
        """Computes accelerations and contact forces in `data`.

        It does not call mj_step, which resets a state that diverges.
        """
        model, data, inverse = self.model, self.data, np.empty(4)
        data.qpos[:], data.qvel[:] = x[self._q], x[model.nq + self._v]
        for quaternion, turning in self._turning:  # MuJoCo has w in B
            mujoco.mju_negQuat(inverse, data.qpos[quaternion])
            w_W = data.qvel[turning].copy()
            mujoco.mju_rotVecQuat(data.qvel[turning], w_W, inverse)
        torques = np.clip(torques, *self._efforts)  # as Drake's plant does
        data.qfrc_applied[:] = (self._actuation @ torques)[self._v]
        mujoco.mj_fwdPosition(model, data)
        for force in forces:
            body = model.body(str(int(force.body_index))).id
            R_WB = data.xmat[body].reshape(3, 3)
            point, F = data.xpos[body] + R_WB @ force.p_BoBq_B, force.F_Bq_W
            wrench = F.translational(), F.rotational(), point
            mujoco.mj_applyFT(model, data, *wrench, body, data.qfrc_applied)
        mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_POS, 1)

    def _contacts(self) -> list[mbp.PointPairContactInfo]:
        """The present contacts as Drake's type, with zero speeds."""
        found, wrench, contacts = [], np.zeros(6), self.data.contact
        info, pair = mbp.PointPairContactInfo, geometry.PenetrationAsPointPair
        for i in range(self.data.ncon):
            mujoco.mj_contactForce(self.model, self.data, i, wrench)
            bodies = [self._body_of[geom] for geom in contacts.geom[i]]
            force = wrench[:3] @ contacts.frame[i].reshape(3, 3)
            point = contacts.pos[i]
            found.append(info(*bodies, force, point, 0.0, 0.0, pair()))
        return found


def _empty_spec(plant: mbp.MultibodyPlant) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.compiler.degree = spec.compiler.inertiafromgeom = False
    option = spec.option
    option.timestep = plant.time_step()
    option.gravity = plant.gravity_field().gravity_vector()
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = _FRICTION_IMPEDANCE
    # Without a warm start, a step depends on state and inputs only.
    option.disableflags = mujoco.mjtDisableBit.mjDSBL_WARMSTART
    return spec


def _name(shape: GeometryId) -> str:
    return str(shape.get_value())


def _pose(X: RigidTransform) -> dict:
    return {"pos": X.translation(), "quat": X.rotation().ToQuaternion().wxyz()}


def _friction(inspector: SceneGraphInspector, shape: GeometryId) -> float:
    properties = inspector.GetProximityProperties(shape)
    friction = properties.GetProperty("material", "coulomb_friction")
    return friction.dynamic_friction()
