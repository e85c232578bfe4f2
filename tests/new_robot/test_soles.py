"""Soles of shapes whose flat side is known."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from pydrake.math import RigidTransform, RollPitchYaw

from nadia_balance.new_robot.description import COLLIDING, VISUAL, Link, Shape
from nadia_balance.new_robot.shapes import (
    _fitted,
    find_sole,
    largest_rectangle,
    sole_plane,
)

TILT = RigidTransform(RollPitchYaw(0.2, -0.3, 0.5), [0.01, 0.02, -0.03])
UPRIGHT = RollPitchYaw(0.0, 0.0, 0.0)
LYING = RollPitchYaw(0.0, 0.5 * np.pi, 0.0)
DOWN, HIGH = np.array([0.0, 0.0, -1.0]), (0.0, 0.0, 0.05)
CORNERS = [(x, y, 0.0) for x in (-0.1, 0.1) for y in (-0.04, 0.04)]


def shape(kind, at, turned=UPRIGHT, **size) -> Shape:
    X = TILT @ RigidTransform(turned, np.array(at))
    sizes = {name: np.atleast_1d(value) for name, value in size.items()}
    return Shape(COLLIDING, kind, sizes, X)


def box(x, y, z, at=(0.0, 0.0, 0.0)) -> Shape:
    return shape("box", at, size=(x, y, z))


def along_x(kind, y) -> Shape:
    return shape(kind, (0.0, y, 0.0), LYING, radius=0.02, length=0.2)


def flat() -> Shape:
    """A mesh without thickness."""
    mesh = trimesh.Trimesh(CORNERS, [[0, 1, 2], [1, 3, 2]])
    return Shape(COLLIDING, "mesh", {}, TILT, mesh=mesh)


def rounded() -> Shape:
    """A shoe whose sole is 0.2 x 0.08 m, its edges rounded by 0.02 m."""
    ball = trimesh.creation.icosphere(4, 0.02).vertices
    points = np.concatenate([ball + corner for corner in CORNERS])
    mesh = trimesh.convex.convex_hull(points)
    return Shape(COLLIDING, "mesh", {}, TILT, mesh=mesh)


@pytest.mark.parametrize(
    "shapes, depth, size",
    [
        ([box(0.2, 0.1, 0.04)], 0.02, (0.2, 0.1)),
        ([shape("sphere", p, radius=0.01) for p in CORNERS], 0.01, (0.2, 0.08)),
        *(
            ([along_x(kind, y) for y in (-0.03, 0.03)], 0.02, (0.2, 0.06))
            for kind in ("cylinder", "capsule")
        ),
        # A point 2 mm above the plane of the rounding counts, 9 mm outside.
        ([rounded()], 0.02, (0.2172, 0.0972)),
        ([flat()], 0.0, (0.2, 0.08)),
        # An ankle on a plate.
        ([box(0.2, 0.1, 0.02), box(0.1, 0.1, 0.1, HIGH)], 0.01, (0.2, 0.1)),
    ],
    ids=["box", "spheres", "cylinders", "capsules", "rounded", "flat", "plate"],
)
def test_finds_the_flat_side_of_a_tilted_foot(shapes, depth, size):
    """Oracle: the shapes' own figures; 1 mm where the mesh is a polyhedron."""
    sole = sole_plane(shapes, DOWN, "collision")
    down = TILT.rotation() @ DOWN
    assert sole.down == pytest.approx(down, abs=1e-3)
    depth += TILT.translation() @ down
    assert sole.depth == pytest.approx(depth, abs=5e-4)
    flat = (TILT.inverse() @ sole.points.T)[:2]
    assert np.ptp(flat, axis=1) == pytest.approx(size, abs=2e-3)


def test_a_plate_has_a_capsule():
    """Oracle: by hand: 0.9 of the mean of 0.08 m and 0, the whole plate."""
    (capsule,) = _fitted(Link("plate", shapes=[flat()]), 0.1)
    radius, length = (capsule.size[name] for name in ("radius", "length"))
    assert radius == pytest.approx(0.018, abs=1e-4)
    assert length + 2.0 * radius == pytest.approx(0.2, abs=1e-4)


def test_collision_comes_before_visual_unless_it_is_small():
    """Oracle: 0.2 m x 0.1 m are more than twice 0.1 m x 0.09 m."""
    large, small = box(0.2, 0.1, 0.04), box(0.1, 0.09, 0.04)
    half = box(0.15, 0.09, 0.04)
    for colliding, source in (small, "visual"), (half, "collision"):
        shown = replace(large, role=VISUAL)
        foot = Link("foot", shapes=[colliding, shown])
        assert find_sole(foot, DOWN).source == source


def test_the_largest_rectangle_in_an_ellipse_and_in_two_soles():
    """Oracle: its sides are the diameters over sqrt(2); the common part.

    A polygon of 400 sides.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, 401)[:-1]
    ellipse = np.c_[0.1 * np.cos(angle) + 0.03, 0.05 * np.sin(angle)]
    half = np.sqrt(0.5)
    expected = 0.03 - 0.1 * half, 0.03 + 0.1 * half, 0.05 * half
    found = largest_rectangle([ellipse])
    assert found == pytest.approx(expected, abs=1e-4)
    corners = np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]])
    two = [corners * [0.1, 0.05] + [0.02, 0.01], corners * [0.08, 0.06]]
    assert largest_rectangle(two) == pytest.approx((-0.08, 0.08, 0.04))
    aside = corners * [0.1, 0.05] + [0.0, 0.06]
    with pytest.raises(ValueError, match="a part on y = 0 in common"):
        largest_rectangle([aside])
