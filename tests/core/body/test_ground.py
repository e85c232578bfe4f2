"""Oracles: planes in space, dense search, figures by hand."""

import math
import weakref
from dataclasses import replace

import numpy as np
import pytest
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RotationMatrix

from nadia_balance.core.body.ground import (
    Ground,
    GroundError,
    Region,
    believed,
    check_friction,
    check_ground,
)
from nadia_balance.core.math.arrays import rectangle
from nadia_balance.core.math.polygon import contains
from nadia_balance.core.walking.state import FootPose
from nadia_balance.parameters.bounds import check
from tests.example_walks import SOLE


def square(name, x=0.0, y=0.0, side=0.5, **more):
    corners = [x, y] + rectangle(side, side)
    return Region(name=name, vertices=corners.tolist(), **more)


def test_a_pose_puts_all_corners_of_the_sole_on_the_plane():
    """Oracle: Drake's rotation of the sole, and the plane's own heights."""
    region = square("up", height=0.3, normal=[-0.2, 0.1, 1.0])
    ground = Ground((region,), SOLE)
    foot = ground.pose(np.array([0.03, 0.02]), 0.4, 0.0)
    assert ground.region_under(foot) is region
    n = foot.normal
    axis = np.cross([0.0, 0.0, 1.0], n) / math.hypot(n[0], n[1])
    turn = AngleAxis(math.acos(n[2]), axis)
    R_WF = RotationMatrix(turn) @ RotationMatrix.MakeZRotation(0.4)
    corners = foot.p_WF + np.column_stack([SOLE, np.zeros(4)]) @ R_WF.matrix().T
    assert foot.outline(SOLE) == pytest.approx(corners[:, :2], abs=1e-12)
    on_plane = region.heights(corners[:, :2])
    assert corners[:, 2] == pytest.approx(on_plane, abs=1e-12)


def test_the_nearest_foothold_is_on_the_nearest_region():
    """Oracle: dense search of both stones."""
    stones = square("near", 0.5), square("far", 1.2, 0.3, height=0.2)
    ground = Ground(stones, SOLE, margin=0.05)
    grid = np.stack(np.meshgrid(*[np.arange(-0.5, 2.0, 0.01)] * 2), -1)
    grid = grid.reshape(-1, 2)
    holds = [h for h in ground.footholds(0.3) if len(h)]
    good = [any(contains(p, hold) for hold in holds) for p in grid]
    for point in np.random.default_rng(4).uniform(-0.5, 2.0, (20, 2)):
        found = ground.nearest(point, 0.3)
        best = np.linalg.norm(grid[good] - point, axis=1).min()
        assert math.dist(found, point) == pytest.approx(best, abs=0.015)
        pose = ground.pose(found, 0.3, 0.0)
        assert pose.p_WF[2] == ground.region_under(pose).height


def test_a_foothold_at_an_edge_is_on_its_slope():
    """Oracle: the slope; a level sole there would not fit on it."""
    slope = square("up", normal=[-0.2, 0.1, 1.0])
    ground = Ground((slope,), SOLE, margin=0.0)
    for corner in ground.footholds(0.4)[0]:
        foot = ground.pose(0.9999 * corner, 0.4, 0.7)
        assert foot.normal == pytest.approx(slope.unit_normal)


def test_a_sole_across_an_edge_is_on_no_region():
    """Oracle: by hand; a pose there keeps the height that it is given."""
    ground = Ground((square("a"), square("b", 0.5)), SOLE)
    across = ground.pose(np.array([0.25, 0.0]), 0.0, 0.7)
    assert ground.region_under(across) is None and across.p_WF[2] == 0.7
    assert ground.region_under(FootPose()).name == "a"


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("vertices", [[0, 0], [2, 0], [1, 0.5], [0, 2]]),
        ("vertices", [[0, 0], [1, 1]]),
        ("vertices", [[0], [1, 1], [2, 0]]),
        ("normal", [0.0, 0.1, -1.0]),
        ("height", math.nan),
    ],
)
def test_refuses_what_is_no_region(field, value):
    """Oracle: the message names the field."""
    with pytest.raises(ValueError, match=field):
        check(replace(square("L"), **{field: value}))


@pytest.mark.parametrize(
    ("name", "regions"),
    [
        ("'a'.*larger than the sole", [square("a", side=0.2)]),
        ("'a' and 'b'.*overlap", [square("a"), square("b", 0.4, height=0.2)]),
        ("name = 'a'", [square("a"), square("a", 2.0)]),
        ("name = ''", [square("")]),
    ],
)
def test_refuses_regions_that_are_no_ground(name, regions):
    """Oracle: the message names the region."""
    with pytest.raises(ValueError, match=name):
        check_ground(Ground(tuple(regions), SOLE))


def test_no_region_is_steeper_than_friction_allows():
    """Oracle: Drake's turned normals; 30.96 deg is the angle of 0.6."""

    def tilted(degrees, **more):
        turn = AngleAxis(math.radians(degrees), np.array([0.6, -0.8, 0.0]))
        normal = RotationMatrix(turn).matrix()[:, 2].tolist()
        slope = square("b", 2.0, normal=normal, **more)
        return Ground((square("a"), slope), SOLE)

    check_friction(tilted(30.9), 0.6)
    check_friction(tilted(40.0, obstacle=True), 0.6)
    with pytest.raises(ValueError, match=r"'b': must be .* 31.0 .* 31.1 deg"):
        check_friction(tilted(31.1), 0.6)


def test_no_foot_is_put_on_an_obstacle():
    """Oracle: by hand; it may be as small as it is, and counts no height."""
    stone = square("stone")
    wall = square("wall", 1.0, side=0.1, height=1.0, obstacle=True)
    ground = Ground((stone, wall), SOLE)
    check_ground(ground)
    assert ground.is_level and len(ground.footholds(0.0)[1]) == 0
    assert ground.nearest(np.array([1.0, 0.0]), 0.0)[0] < 0.25


def test_the_footholds_of_yaws_long_past_are_forgotten():
    """Oracle: the garbage collector: a foot that stands has a yaw a tick."""
    ground = Ground((square("one", side=2.0),), SOLE)
    kept = weakref.ref(ground.footholds(0.0)[0])
    assert kept() is ground.footholds(0.0)[0]
    for yaw in np.linspace(0.1, 0.2, 100):
        ground.footholds(float(yaw))
    assert kept() is None


HERE = np.zeros(2)


def test_what_is_believed_is_wrong_by_no_more_than_asked_for():
    """Oracle: differences, within the bounds, and some near to them."""
    true = tuple(
        square(f"{i}", 1.0 * i, normal=[0.01 * i, -0.2, 1.0]) for i in range(50)
    )
    error = GroundError(height=0.03, tilt_deg=3.0, place=0.05)
    assert believed(true, GroundError(), 0, HERE) is true
    found = believed(true, error, 1, HERE)
    off = np.array([f.vertices for f in found])
    off -= [t.vertices for t in true]
    assert 0.04 < np.max(np.abs(off)) <= 0.05 + 1e-12
    assert 0.025 < max(abs(f.height) for f in found) <= 0.03
    angles = [
        math.degrees(math.acos(min(f.unit_normal @ t.unit_normal, 1.0)))
        for f, t in zip(found, true, strict=True)
    ]
    assert 2.8 < max(angles) <= 3.0 + 1e-6
    assert found[0] is true[0]  # where the robot stands
    assert found[9].vertices == believed(true, error, 1, HERE)[9].vertices
