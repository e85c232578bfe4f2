"""Avoidance of self-collisions: distances of links and rows of the QP."""

import itertools
import math
from collections.abc import Sequence
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import (
    Capsule,
    GeometryId,
    SceneGraph,
    SceneGraphInspector,
    Sphere,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, JacobianWrtVariable
from pydrake.systems.framework import Context

from nadia_balance.core.math.arrays import Array, SegmentPairs, cross
from nadia_balance.core.whole_body.command import Avoidance
from nadia_balance.core.whole_body.params import CollisionAvoidanceParams
from nadia_balance.robot.model import RobotModel
from nadia_balance.robot.plants import body_poses, joints

MAX_PAIRS = 8  # largest number of pairs that count
_V = JacobianWrtVariable.kV
_ORIGIN = np.zeros(3)
_TINY = 1e-9  # avoids division by zero if the axes of links meet [m]


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
    """

    def __init__(
        self,
        params: CollisionAvoidanceParams,
        robot: RobotModel,
        plant: MultibodyPlant,
        scene: SceneGraph,
    ) -> None:
        self._params = params
        self._plant = plant
        self._world = plant.world_frame()
        inspector = scene.model_inspector()
        candidates = sorted(inspector.GetCollisionCandidates())
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
        round_pairs: list[tuple[_Shape, _Shape, float]] = []
        self._others: list[tuple[GeometryId, GeometryId, float]] = []
        for a, b in candidates:
            first, second = self._shapes[a], self._shapes[b]
            is_arm = {first.body.index(), second.body.index()} & upper_body
            attention = arm_attention if is_arm else params.attention
            if first.radius is None or second.radius is None:
                self._others.append((a, b, attention))
            else:
                round_pairs.append((first, second, attention))
        self._set_round_pairs(round_pairs)

    def _set_round_pairs(
        self, pairs: Sequence[tuple["_Shape", "_Shape", float]]
    ) -> None:
        """Builds the tables of k pairs of capsules and spheres."""
        sides = [[pair[0] for pair in pairs], [pair[1] for pair in pairs]]
        shapes = list(dict.fromkeys(sides[0] + sides[1]))
        # The pose of its body times a segment is [begin, axis] (3, 2) in W.
        self._segments = np.array([s.segment for s in shapes]).reshape(-1, 4, 2)
        self._owner = np.array(
            [self._number[s.body.index()] for s in shapes], dtype=int
        )
        # Indices of the first and the second shape, and body, of each pair.
        self._sides = np.array(
            [[shapes.index(s) for s in side] for side in sides], dtype=int
        )
        self._pair_bodies = self._owner[self._sides]
        lengths = np.linalg.norm(self._segments[:, :3, 1], axis=1)
        self._pairs = SegmentPairs(lengths[self._sides])
        radii = np.array([s.radius for s in shapes])
        self._radii = radii[self._sides].sum(axis=0)
        self._squared_far = (self._radii + [pair[2] for pair in pairs]) ** 2

    def calc(self, context: Context) -> Avoidance:
        """The rows of the pairs that need the largest decelerations.

        Args:
            context: of the plant, at the robot's state.

        Returns:
            At most MAX_PAIRS rows, sorted, the most urgent first.
        """
        distance, rows = self.distances(context)
        v: Any = self._plant.GetVelocities(context)
        near = distance < self._params.attention
        limits = self._rows_of_law(distance[near], rows[near], v)
        braking = self._rows_of_law(distance[~near], rows[~near], v)
        return Avoidance(limits, math.sqrt(self._params.arm_weight) * braking)

    def _rows_of_law(self, distance: Array, rows: Array, v: Array) -> Array:
        """Rows (k, nv + 1) of pairs: d_ddot less what the law asks for."""
        return np.column_stack(
            (rows, -self._params.braking(distance, rows @ v))
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
        distance, normal, p, bodies = pairs = self._near_round(X_WB)
        if self._others:
            both = zip(pairs, self._near_others(context, X_WB), strict=True)
            distance, normal, p, bodies = (
                np.concatenate(arrays, axis=-1) for arrays in both
            )
        if not distance.size:
            return np.empty(0), np.empty((0, plant.num_velocities()))
        # n . (v + w x r) = (r x n) . w + n . v for V = [w, v] of a body; a
        # shift of the point along n, from axis to surface, has no effect.
        W = np.empty((6, 2, distance.size))
        W[3:, 0] = normal
        W[3:, 1] = -normal
        W[:3] = cross(p - X_WB[:, :, 3].T.take(bodies, axis=1), W[3:])
        V = np.empty((len(self._bodies), 6))
        for i in set(bodies.ravel().tolist()):
            V[i] = plant.EvalBodySpatialVelocityInWorld(
                context, self._bodies[i]
            ).get_coeffs()
        rates = np.einsum("ipk,pki->k", W, V.take(bodies, axis=0))
        braking = self._params.braking(distance, rates)
        counts = (distance < self._params.attention) | (braking > 0.0)
        urgent = counts.nonzero()[0]
        if urgent.size > 1:
            urgent = urgent[np.argsort(-braking[urgent])][:MAX_PAIRS]
        rows = np.empty((urgent.size, plant.num_velocities()))
        for row, k in zip(rows, urgent.tolist(), strict=True):
            J_A = self._jacobian(context, bodies[0, k])
            J_B = self._jacobian(context, bodies[1, k])
            row[:] = W[:, 0, k] @ J_A + W[:, 1, k] @ J_B
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

    def _near_round(self, X_WB: Array) -> tuple[NDArray[Any], ...]:
        """The n near pairs of capsules and spheres.

        Distances (n,) [m], normals (3, n) from the second to the first link,
        closest points (3, 2, n) [m] on the axes, both in W, and numbers (2, n)
        of the links.
        """
        placed = (X_WB.take(self._owner, axis=0) @ self._segments).T
        begin, axes = placed.take(self._sides, axis=2)
        p = self._pairs.closest_points(begin, axes)
        apart = p[:, 0] - p[:, 1]
        squares = np.einsum("ik,ik->k", apart, apart)
        near = (squares < self._squared_far).nonzero()[0]
        length = np.sqrt(squares.take(near))
        return (
            length - self._radii.take(near),
            apart.take(near, axis=1) / np.maximum(length, _TINY),
            p.take(near, axis=2),
            self._pair_bodies.take(near, axis=1),
        )

    def _near_others(
        self, context: Context, X_WB: Array
    ) -> tuple[NDArray[Any], ...]:
        """The same for other shapes, with points on the surfaces."""
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
        columns = np.array(rows).reshape(-1, 12).T
        return (
            columns[0],
            columns[1:4],
            columns[4:10].reshape(2, 3, -1).transpose(1, 0, 2),
            columns[10:].astype(int),
        )


class _Shape:
    """A shape of a link, with its axis if it is a capsule or a sphere."""

    def __init__(
        self,
        inspector: SceneGraphInspector,
        plant: MultibodyPlant,
        shape: GeometryId,
    ) -> None:
        """A pose [R, p] of the body times `segment` (4, 2) is [begin, axis].

        `radius` [m] is None unless the shape is a capsule or a sphere.
        """
        self.body = plant.GetBodyFromFrameId(inspector.GetFrameId(shape))
        self.X_BG = inspector.GetPoseInFrame(shape)
        form = inspector.GetShape(shape)
        self.radius = (
            form.radius() if isinstance(form, Capsule | Sphere) else None
        )
        axis = np.zeros(3)
        if isinstance(form, Capsule):
            axis = form.length() * self.X_BG.rotation().matrix()[:, 2]
        begin = self.X_BG.translation() - 0.5 * axis
        self.segment = np.array([[*begin, 1.0], [*axis, 0.0]]).T


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
