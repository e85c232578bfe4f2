"""Avoidance of self-collisions: distances of links and rows of the QP."""

import itertools
import math
from collections.abc import Collection
from typing import Any, cast

import numpy as np
from pydrake.geometry import (
    Capsule,
    GeometryId,
    SceneGraph,
    SceneGraphInspector,
    Sphere,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, JacobianWrtVariable, RigidBody
from pydrake.systems.framework import Context

from nadia_balance.core.math.arrays import Array
from nadia_balance.core.math.segments import (
    BODIES,
    DISTANCE,
    GAP,
    Segment,
    SegmentPairs,
    gap_rates,
)
from nadia_balance.core.whole_body.command import Avoidance
from nadia_balance.core.whole_body.params import CollisionAvoidanceParams
from nadia_balance.parameters.bounds import require
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import body_poses, joints

MAX_PAIRS = 8  # largest number of pairs that count
_V = JacobianWrtVariable.kV
_ORIGIN = np.zeros(3)


class CollisionAvoidance:
    """Keeps links apart: (d/dt + rate)^2 (d - clearance) >= 0.

    A pair counts if its distance d is less than `attention`, then as a hard
    limit, or, with a link of the upper body, if it is less than `arm_attention`
    and decreases so fast that it must brake, then as a soft task.  Pairs of
    legs have no larger distance: legs pass each other closely, and the swing
    foot's reference makes its own detour.

    Capsules and spheres are measured in closed form, all pairs at once; pairs
    with another shape are measured by the SceneGraph, one by one.

    Args:
        params: rate, clearance and distances that count.
        robot: the robot.
        plant: of the robot alone, finalized.
        scene: with its shapes.
        given: joints that somebody else moves, whose links do not count.
    """

    def __init__(
        self,
        params: CollisionAvoidanceParams,
        robot: RobotModel,
        plant: MultibodyPlant,
        scene: SceneGraph,
        given: Collection[str] = (),
    ) -> None:
        self._params = params
        self._plant = plant
        self._world = plant.world_frame()
        none = np.empty((0, plant.num_velocities() + 1))
        self._nothing = Avoidance(limits=none, braking=none)
        inspector = scene.model_inspector()
        others = _moved_by(plant, given)
        candidates = [
            pair
            for pair in sorted(inspector.GetCollisionCandidates())
            if not others & {_body(inspector, plant, id).index() for id in pair}
        ]
        self._shapes = {
            shape: _Shape(inspector, plant, shape)
            for shape in itertools.chain.from_iterable(candidates)
        }
        self._bodies = [
            plant.get_body(body)
            for body in sorted({s.body.index() for s in self._shapes.values()})
        ]
        self._number = {b.index(): i for i, b in enumerate(self._bodies)}
        upper_body = _upper_body(robot, plant)
        arm_attention = max(params.arm_attention, params.attention)
        round_shapes = [id for id, s in self._shapes.items() if s.is_round]
        number = {id: i for i, id in enumerate(round_shapes)}
        pairs: list[tuple[int, int, float]] = []
        self._others: list[tuple[GeometryId, GeometryId, float]] = []
        for a, b in candidates:
            first, second = self._shapes[a], self._shapes[b]
            is_arm = {first.body.index(), second.body.index()} & upper_body
            attention = arm_attention if is_arm else params.attention
            if first.is_round and second.is_round:
                pairs.append((number[a], number[b], attention))
            else:
                self._others.append((a, b, attention))
        segments = [self._segment(self._shapes[id]) for id in round_shapes]
        self._round_pairs = SegmentPairs(segments, pairs)

    def _segment(self, shape: "_Shape") -> Segment:
        body = self._number[shape.body.index()]
        return Segment(shape.begin, shape.axis, shape.radius, body)

    def calc(self, context: Context) -> Avoidance:
        """The rows of the pairs that need the largest decelerations.

        Args:
            context: of the plant, at the robot's state.

        Returns:
            At most MAX_PAIRS rows, sorted, the most urgent first.
        """
        distance, rows = self.distances(context)
        if not distance.size:
            return self._nothing
        v: Any = self._plant.GetVelocities(context)
        law = -self._params.braking(distance, rows @ v)
        table = np.column_stack((rows, law))
        near = distance < self._params.attention
        return Avoidance(
            limits=table[near],
            braking=math.sqrt(self._params.arm_weight) * table[~near],
        )

    def distances(self, context: Context) -> tuple[Array, Array]:
        """Distances d of the pairs that count, and their rows A: d_dot = A v.

        Args:
            context: of the plant, at the robot's state.

        Returns:
            Distances (k,) [m] and rows (k, nv), k <= MAX_PAIRS.
        """
        plant = self._plant
        X_WB = body_poses(plant, context, self._bodies)
        gaps = self._round_pairs.near(X_WB)
        if self._others:
            gaps = np.concatenate([gaps, self._near_others(context, X_WB)])
        if not len(gaps):
            return np.empty(0), np.empty((0, plant.num_velocities()))
        distance, bodies = gaps[:, DISTANCE], gaps[:, BODIES].astype(int)
        V = np.empty((len(self._bodies), 6))
        for i in set(bodies.ravel().tolist()):
            V[i] = plant.EvalBodySpatialVelocityInWorld(
                context, self._bodies[i]
            ).get_coeffs()
        rates, W = gap_rates(gaps, X_WB, V)
        braking = self._params.braking(distance, rates)
        counts = (distance < self._params.attention) | (braking > 0.0)
        urgent = counts.nonzero()[0]
        if urgent.size > 1:
            urgent = urgent[np.argsort(-braking[urgent])][:MAX_PAIRS]
        J = {
            i: self._jacobian(context, i)
            for i in set(bodies[urgent].ravel().tolist())
        }
        rows = np.empty((urgent.size, plant.num_velocities()))
        for row, k in zip(rows, urgent.tolist(), strict=True):
            first, second = bodies[k].tolist()
            row[:] = W[k, 0] @ J[first] + W[k, 1] @ J[second]
        return distance[urgent], rows

    def _jacobian(self, context: Context, number: int) -> Any:
        """Jacobian (6, nv) [w, v] of a link's origin, in W."""
        return self._plant.CalcJacobianSpatialVelocity(
            context=context,
            with_respect_to=_V,
            frame_B=self._bodies[number].body_frame(),
            p_BoBp_B=cast(Any, _ORIGIN),
            frame_A=self._world,
            frame_E=self._world,
        )

    def _near_others(self, context: Context, X_WB: Array) -> Array:
        """The gaps of other shapes, with points on the surfaces."""
        query: Any = self._plant.get_geometry_query_input_port().Eval(context)
        rows = []
        for a, b, attention in self._others:
            pair = query.ComputeSignedDistancePairClosestPoints(a, b)
            if pair.distance < attention:
                first, second = self._shapes[a], self._shapes[b]
                i = self._number[first.body.index()]
                j = self._number[second.body.index()]
                p_WA = X_WB[i] @ [*(first.X_BG @ pair.p_ACa), 1.0]
                p_WB = X_WB[j] @ [*(second.X_BG @ pair.p_BCb), 1.0]
                rows.append(
                    (pair.distance, *pair.nhat_BA_W, *p_WA, *p_WB, i, j)
                )
        return np.array(rows).reshape(-1, GAP)


class _Shape:
    """A shape of a link, with its axis if it is a capsule or a sphere."""

    def __init__(
        self,
        inspector: SceneGraphInspector,
        plant: MultibodyPlant,
        shape: GeometryId,
    ) -> None:
        """Begin and vector (3,) of the axis [m] are in the frame of the body.

        They mean something if the shape is a capsule or a sphere.
        """
        self.body = _body(inspector, plant, shape)
        self.X_BG = inspector.GetPoseInFrame(shape)
        form = inspector.GetShape(shape)
        self.is_round = isinstance(form, Capsule | Sphere)
        self.radius = 0.0
        self.axis = np.zeros(3)
        if isinstance(form, Capsule | Sphere):
            self.radius = form.radius()
        if isinstance(form, Capsule):
            self.axis = form.length() * self.X_BG.rotation().matrix()[:, 2]
        self.begin = self.X_BG.translation() - 0.5 * self.axis


def _body(
    inspector: SceneGraphInspector, plant: MultibodyPlant, shape: GeometryId
) -> RigidBody:
    return plant.GetBodyFromFrameId(inspector.GetFrameId(shape))


def _moved_by(plant: MultibodyPlant, names: Collection[str]) -> set[BodyIndex]:
    """The bodies moved by joints of these names, given ones."""
    for name in names:
        require(
            plant.HasJointNamed(name),
            f"given_joints: {name}: the robot has no such joint",
        )
    moving = [plant.GetJointByName(name).index() for name in names]
    return set(plant.GetBodiesKinematicallyAffectedBy(moving))


def _upper_body(robot: RobotModel, plant: MultibodyPlant) -> set[BodyIndex]:
    """The bodies moved by a joint that moves no foot."""
    feet = {plant.GetBodyByName(n).index() for n in robot.foot_bodies.values()}
    upper: set[BodyIndex] = set()
    for joint in joints(plant):
        if joint.num_velocities() == 1:
            moved = set(plant.GetBodiesKinematicallyAffectedBy([joint.index()]))
            if not moved & feet:
                upper |= moved
    return upper
