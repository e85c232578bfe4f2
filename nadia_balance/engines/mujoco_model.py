"""MuJoCo model of the robot and its ground, from Drake's MultibodyPlant."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, cast

import mujoco  # type: ignore[import-untyped]
import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    GeometryId,
    HalfSpace,
    Mesh,
    PenetrationAsPointPair,
    SceneGraphInspector,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    ExternallyAppliedSpatialForce,
    MultibodyPlant,
    PointPairContactInfo,
)
from pydrake.multibody.tree import (
    BodyIndex,
    Joint,
    JointIndex,
    RevoluteJoint,
    RigidBody,
)

from nadia_balance.core.math.arrays import Array
from nadia_balance.parameters.bounds import require
from nadia_balance.robot.plants import actuators, joints
from nadia_balance.robot.urdf import hull_points

# Time constant of contacts and joint limits, which are damped springs [s];
# MuJoCo needs two steps or more.  Its default, 0.02, is as soft as a mat.
STIFFNESS_TIME = 0.004
_HARDNESS = [0.95, 0.99, 0.001, 0.5, 2.0]  # the impedance of all constraints
# Ratio of frictional to normal impedance; with less, soles creep.
_FRICTION_IMPEDANCE = 10.0
# Drake's type of a shape: MuJoCo's, and its size.
_SHAPES: dict[type, tuple[Any, Callable[[Any], Any]]] = {
    Box: (mujoco.mjtGeom.mjGEOM_BOX, lambda s: 0.5 * s.size()),
    Capsule: (
        mujoco.mjtGeom.mjGEOM_CAPSULE,
        lambda s: [s.radius(), 0.5 * s.length(), 0],
    ),
    Cylinder: (
        mujoco.mjtGeom.mjGEOM_CYLINDER,
        lambda s: [s.radius(), s.length() / 2, 0],
    ),
    Ellipsoid: (
        mujoco.mjtGeom.mjGEOM_ELLIPSOID,
        lambda s: [s.a(), s.b(), s.c()],
    ),
    HalfSpace: (mujoco.mjtGeom.mjGEOM_PLANE, lambda s: [0.0, 0.0, 1.0]),
    Sphere: (mujoco.mjtGeom.mjGEOM_SPHERE, lambda s: [s.radius(), 0.0, 0.0]),
}
_JOINTS = {
    "revolute": mujoco.mjtJoint.mjJNT_HINGE,
    "quaternion_floating": mujoco.mjtJoint.mjJNT_FREE,
}


class MujocoModel:
    """A plant whose motion MuJoCo computes.

    Bodies, inertias, joints with their limits, damping and reflected inertia,
    collision shapes and filters are those of Drake's plant, and so is the order
    of q, v and of the actuators: x = [q, v] (nq + nv,).
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        inspector: SceneGraphInspector,
        mjcf: Path | None = None,
    ) -> None:
        """Models a plant.

        Args:
            plant: finalized.
            inspector: of the scene with its shapes.
            mjcf: file of the same robot, with links and joints of the same
                names, that moves in the plant's place, on flat ground.

        Raises:
            ValueError: a joint or a shape of a type that is not supported; or
                the MJCF is not of this robot.
        """
        self._plant = plant
        self._inboard = {j.child_body().index(): j for j in joints(plant)}
        # MuJoCo's names.
        self._joint_names: dict[JointIndex, str] = {}
        self._body_names: dict[BodyIndex, str] = {}
        if mjcf is None:
            self._translate(inspector)
        else:
            self._read(mjcf)
        self.data = mujoco.MjData(self.model)
        self._actuation: Any = plant.MakeActuationMatrix()
        self._lower_efforts: Any = plant.GetEffortLowerLimits()
        self._upper_efforts: Any = plant.GetEffortUpperLimits()
        self._find_columns()

    def _translate(self, inspector: SceneGraphInspector) -> None:
        """Makes MuJoCo's model of the plant, and of the shapes in its scene."""
        plant = self._plant
        self._spec = mujoco.MjSpec()
        self._spec.compiler.degree = False
        self._spec.compiler.inertiafromgeom = False
        _set_options(self._spec, plant)
        self._softness = [max(STIFFNESS_TIME, 2.0 * plant.time_step()), 1.0]
        self._bodies = {plant.world_body().index(): self._spec.worldbody}
        for i in range(1, plant.num_bodies()):
            self._add_body(plant.get_body(BodyIndex(i)))
        self._add_shapes(inspector)
        self.model = self._spec.compile()
        for joint in self._inboard.values():
            if joint.num_velocities() == 1:
                dof = self.model.joint(self._joint_names[joint.index()]).dofadr
                self.model.dof_damping[dof] = joint.default_damping_vector()[0]

    def _read(self, mjcf: Path) -> None:
        """Reads MuJoCo's model, and puts it on flat ground.

        Joints that have no reflected inertia there have that of the plant.
        Actuators have no place: torques are applied to joints.

        Raises ValueError: it is no MJCF, or not of this robot.
        """
        try:
            spec = mujoco.MjSpec.from_file(str(mjcf))
        except ValueError as error:
            raise ValueError(f"model = {mjcf}: {error}") from None
        _set_options(spec, self._plant)
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
        plane = mujoco.mjtGeom.mjGEOM_PLANE
        if all(geom.type != plane for geom in spec.worldbody.geoms):
            spec.worldbody.add_geom(type=plane, size=[0.0, 0.0, 1.0])
        for joint in self._inboard.values():
            self._name(spec, joint, mjcf)
        self.model = spec.compile()
        moving = sum(j.num_velocities() for j in self._inboard.values())
        require(
            self.model.nv == moving,
            f"model = {mjcf}: has {self.model.nv} velocities: must be {moving}",
        )
        for actuator in actuators(self._plant):
            name = self._joint_names[actuator.joint().index()]
            dof = self.model.joint(name).dofadr
            if not self.model.dof_armature[dof].any():
                inertia = actuator.default_reflected_inertia()
                self.model.dof_armature[dof] = inertia

    def _name(self, spec: Any, joint: Joint, mjcf: Path) -> None:
        """Notes what a joint and its child are called in an MJCF."""
        child = joint.child_body()
        body, added = spec.body(child.name()), spec.joint(joint.name())
        if joint.num_velocities() > 1 and body and body.joints:
            added = body.joints[0]
            added.name = added.name or joint.name()
        if body:
            self._body_names[child.index()] = body.name
        if joint.num_velocities():
            require(
                body and added,
                f"model = {mjcf}: must have {child.name()} and {joint.name()}",
            )
            self._joint_names[joint.index()] = added.name

    def _add_body(self, body: RigidBody) -> Any:
        """Adds `body`, after its parents; returns MuJoCo's."""
        if body.index() in self._bodies:
            return self._bodies[body.index()]
        joint = self._inboard[body.index()]
        X_BM = joint.frame_on_child().GetFixedPoseInBodyFrame()
        X_PB = (
            joint.frame_on_parent().GetFixedPoseInBodyFrame() @ X_BM.inverse()
        )
        self._body_names[body.index()] = str(int(body.index()))
        added = self._add_body(joint.parent_body()).add_body(
            name=self._body_names[body.index()],
            pos=X_PB.translation(),
            quat=X_PB.rotation().ToQuaternion().wxyz(),
        )
        M_B = body.default_spatial_inertia()
        if M_B.get_mass() > 0.0:
            I_BBcm = M_B.Shift(M_B.get_com()).CalcRotationalInertia()
            added.explicitinertial = True
            added.mass = M_B.get_mass()
            added.ipos = M_B.get_com()
            added.inertia, axes = I_BBcm.CalcPrincipalMomentsAndAxesOfInertia()
            added.iquat = axes.ToQuaternion().wxyz()
        if joint.num_velocities():
            self._add_joint(added, joint, X_BM)
        self._bodies[body.index()] = added
        return added

    def _add_joint(self, body: Any, joint: Joint, X_BM: RigidTransform) -> None:
        """Adds `joint` to its child, a body of MuJoCo's."""
        require(
            joint.type_name() in _JOINTS,
            f"joint {joint.name()}: type {joint.type_name()}: must be one of "
            f"{', '.join(_JOINTS)} or fixed, for MuJoCo",
        )
        self._joint_names[joint.index()] = str(int(joint.index()))
        added = body.add_joint(
            name=self._joint_names[joint.index()],
            type=_JOINTS[joint.type_name()],
        )
        if joint.num_velocities() > 1:
            return
        hinge = cast(RevoluteJoint, joint)
        limits = hinge.position_lower_limit(), hinge.position_upper_limit()
        added.pos = X_BM.translation()
        added.axis = X_BM.rotation() @ hinge.revolute_axis()
        added.limited = bool(np.isfinite(limits).any())
        added.range = np.clip(limits, -1e6, 1e6)
        added.solref_limit = self._softness
        added.solimp_limit = _HARDNESS
        for actuator in actuators(self._plant):
            if actuator.joint().index() == joint.index():
                added.armature = actuator.default_reflected_inertia()

    def _add_shapes(self, inspector: SceneGraphInspector) -> None:
        pairs = sorted(inspector.GetCollisionCandidates())
        for shape in sorted({shape for pair in pairs for shape in pair}):
            self._add_shape(inspector, shape)
        for first, second in pairs:
            a, b = _friction(inspector, first), _friction(inspector, second)
            mu = 2.0 * a * b / (a + b) if a + b else 0.0  # Drake's rule
            self._spec.add_pair(
                geomname1=_name(first),
                geomname2=_name(second),
                condim=3,
                solref=self._softness,
                solimp=_HARDNESS,
                friction=[mu, mu, 0.0, 0.0, 0.0],
            )

    def _add_shape(
        self, inspector: SceneGraphInspector, shape: GeometryId
    ) -> None:
        body = self._plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
        X_BG = inspector.GetPoseInFrame(shape)
        added = self._bodies[body.index()].add_geom(
            name=_name(shape),
            pos=X_BG.translation(),
            quat=X_BG.rotation().ToQuaternion().wxyz(),
            contype=0,
            conaffinity=0,
        )
        form = inspector.GetShape(shape)
        if isinstance(form, Convex | Mesh):
            # The convex hull, as in Drake.
            self._spec.add_mesh(
                name=_name(shape),
                uservert=np.ravel(hull_points(inspector, shape)),
            )
            added.type = mujoco.mjtGeom.mjGEOM_MESH
            added.meshname = _name(shape)
            return
        require(
            type(form) in _SHAPES,
            f"shape {inspector.GetName(shape)}: must not be a "
            f"{type(form).__name__}, for MuJoCo",
        )
        added.type, size = _SHAPES[type(form)]
        added.size = size(form)

    def _find_columns(self) -> None:
        """Finds the index in the plant's q and v of each entry of MuJoCo's."""
        model = self.model
        self._q = np.empty(model.nq, int)
        self._v = np.empty(model.nv, int)
        # Slices of quaternion and angular velocity of free bodies.
        self._turning: list[tuple[slice, slice]] = []
        for joint in self._inboard.values():
            if joint.num_velocities() == 0:
                continue
            address = model.joint(self._joint_names[joint.index()])
            q, v = int(address.qposadr[0]), int(address.dofadr[0])
            if joint.num_velocities() == 1:
                self._q[q] = joint.position_start()
                self._v[v] = joint.velocity_start()
            else:
                self._q[q : q + 7] = joint.position_start() + np.array(
                    [4, 5, 6, 0, 1, 2, 3]
                )
                self._v[v : v + 6] = joint.velocity_start() + np.array(
                    [3, 4, 5, 0, 1, 2]
                )
                self._turning.append((slice(q + 3, q + 7), slice(v + 3, v + 6)))
        # Drake's body of each geom of MuJoCo.
        bodies = {name: body for body, name in self._body_names.items()}
        self._body_of = [
            bodies.get(model.body(i).name, BodyIndex(0))
            for i in model.geom_bodyid
        ]

    def rates(self, vector: Array) -> Array:
        """Velocities, or accelerations, in Drake's order.

        Args:
            vector: v or its derivative (nv,), in MuJoCo's order.

        Returns:
            The same (nv,), angular ones of free bodies in W.
        """
        in_world = vector.copy()
        for quaternion, turning in self._turning:
            mujoco.mju_rotVecQuat(
                in_world[turning], vector[turning], self.data.qpos[quaternion]
            )
        ordered = np.empty(self.model.nv)
        ordered[self._v] = in_world
        return ordered

    def step(
        self,
        x: Array,
        torques: Array,
        forces: Iterable[ExternallyAppliedSpatialForce] = (),
    ) -> tuple[Array, list[PointPairContactInfo]]:
        """Integrates a time step; `data` is scratch.

        Args:
            x: state [q, v] (nq + nv,).
            torques: those of the actuators (nu,) [N m].
            forces: external ones.

        Returns:
            The state after the step, and the contacts during it.
        """
        self.forward(x, torques, forces)
        contacts = self._contacts()
        mujoco.mj_Euler(self.model, self.data)
        after = np.empty_like(x)
        after[self._q] = self.data.qpos
        after[self.model.nq :] = self.rates(self.data.qvel)
        return after, contacts

    def forward(
        self,
        x: Array,
        torques: Array,
        forces: Iterable[ExternallyAppliedSpatialForce] = (),
    ) -> None:
        """Computes accelerations and contact forces in `data`.

        It does not call mj_step, which resets a state that diverges.

        Args:
            x: state [q, v] (nq + nv,).
            torques: those of the actuators (nu,) [N m].
            forces: external ones.
        """
        model, data = self.model, self.data
        data.qpos[:] = x[self._q]
        data.qvel[:] = x[model.nq + self._v]
        inverse = np.empty(4)
        for quaternion, turning in self._turning:  # MuJoCo has w in B
            mujoco.mju_negQuat(inverse, data.qpos[quaternion])
            w_W = data.qvel[turning].copy()
            mujoco.mju_rotVecQuat(data.qvel[turning], w_W, inverse)
        # As Drake's plant does.
        torques = np.clip(torques, self._lower_efforts, self._upper_efforts)
        data.qfrc_applied[:] = (self._actuation @ torques)[self._v]
        mujoco.mj_fwdPosition(model, data)
        for force in forces:
            body = model.body(self._body_names[force.body_index]).id
            mujoco.mj_applyFT(
                m=model,
                d=data,
                force=force.F_Bq_W.translational(),
                torque=force.F_Bq_W.rotational(),
                point=data.xpos[body]
                + data.xmat[body].reshape(3, 3) @ force.p_BoBq_B,
                body=body,
                qfrc_target=data.qfrc_applied,
            )
        mujoco.mj_forwardSkip(
            m=model, d=data, skipstage=mujoco.mjtStage.mjSTAGE_POS, skipsensor=1
        )

    def _contacts(self) -> list[PointPairContactInfo]:
        """The present contacts as Drake's type, with zero speeds."""
        contacts = self.data.contact
        infos = []
        wrench = np.zeros(6)
        for i in range(self.data.ncon):
            mujoco.mj_contactForce(self.model, self.data, i, wrench)
            body_A, body_B = (self._body_of[geom] for geom in contacts.geom[i])
            infos.append(
                PointPairContactInfo(
                    bodyA_index=body_A,
                    bodyB_index=body_B,
                    f_Bc_W=wrench[:3] @ contacts.frame[i].reshape(3, 3),
                    p_WC=contacts.pos[i],
                    separation_speed=0.0,
                    slip_speed=0.0,
                    point_pair=PenetrationAsPointPair(),
                )
            )
        return infos


def _set_options(spec: Any, plant: MultibodyPlant) -> None:
    """Gives a MjSpec the options of a plant."""
    spec.option.timestep = plant.time_step()
    spec.option.gravity = plant.gravity_field().gravity_vector()
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = _FRICTION_IMPEDANCE
    # Without a warm start, a step depends on state and inputs only.
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_WARMSTART


def _name(shape: GeometryId) -> str:
    return str(shape.get_value())


def _friction(inspector: SceneGraphInspector, shape: GeometryId) -> float:
    friction = cast(Any, inspector.GetProximityProperties(shape)).GetProperty(
        "material", "coulomb_friction"
    )
    return float(friction.dynamic_friction())
