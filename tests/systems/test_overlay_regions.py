"""Capture regions on the floor, against a Meshcat that remembers."""

import math

import numpy as np
import pytest

from nadia_balance.core.capture_region import one_step_region
from nadia_balance.core.foothold_adjustment import CaptureRegions
from nadia_balance.core.polygon import area, contains, convex_hull
from nadia_balance.core.reachability import circle
from nadia_balance.core.walking import FootPose, rectangle
from nadia_balance.systems.overlay_regions import (
    BOXES,
    EDGES,
    RADIUS,
    RegionOverlay,
    boxes_of_edges,
    edges_near,
    thinned,
)
from tests.fake_meshcat import FakeMeshcat

SOLE = rectangle(0.25, 0.12)
CENTRE = np.array([1.0, 0.5])
WIDTH = 0.012
SMALL = CENTRE + rectangle(0.6, 0.4)
LARGE = CENTRE + rectangle(0.8, 0.6)
NOMINAL, ADJUSTED = FootPose([1.0, 0.3, 0.0]), FootPose([1.2, 0.2, 0.0])


def edges(meshcat, name, time=0.0):
    """The visible edges of an outline as {(start, end)}, to a millimetre."""
    found = set()
    for (path, what), _ in list(meshcat.live.items()):
        prefix, _, number = path.rpartition("/")
        if prefix != f"/r/{name}" or what != "visible":
            continue
        if meshcat.at(path, "visible", time):
            X = meshcat.at(path, "transform", time)
            length = meshcat.at(f"{path}/<object>", "scale", time)[0]
            half = 0.5 * (length - WIDTH) * X[:2, 0]
            ends = [(X[:2, 3] + s * half).round(3) + 0.0 for s in (-1, 1)]
            found.add(tuple(map(tuple, ends)))
    return found


def sides(polygon):
    """The edges of a polygon in the same form."""
    p = (np.asarray(polygon).round(3) + 0.0).tolist()
    ends = p[1:] + p[:1]
    return {(tuple(a), tuple(b)) for a, b in zip(p, ends, strict=True)}


def draw(found, meshcat=None, time=0.0):
    meshcat = meshcat or FakeMeshcat()
    RegionOverlay(meshcat, "/r", SOLE).draw(found, CENTRE, 0.0, time)
    return meshcat


def test_outlines_all_that_is_near():
    """Oracle: the sides of the very polygons."""
    found = CaptureRegions((SMALL, LARGE), SMALL + 0.1, NOMINAL, ADJUSTED)
    meshcat = draw(found)
    assert meshcat.live["/r", "visible"]
    assert edges(meshcat, "c_1") == sides(SMALL)
    assert edges(meshcat, "c_2") == sides(LARGE)
    assert edges(meshcat, "c_3") == set()
    assert edges(meshcat, "reach") == sides(SMALL + 0.1)


def test_hides_it_all_at_once_and_from_then_on():
    meshcat = FakeMeshcat()
    overlay = RegionOverlay(meshcat, "/r", SOLE)
    assert not meshcat.live["/r", "visible"]
    overlay.draw(CaptureRegions((SMALL,), LARGE), CENTRE, 0.0, time=1.0)
    overlay.hide(time=2.0)
    seen = [meshcat.at("/r", "visible", t) for t in (1.0, 1.9, 2.0)]
    assert seen == [True, True, False]


def test_a_region_that_is_no_longer_there_vanishes():
    """Oracle: N falls from 3 to 1."""
    meshcat = FakeMeshcat()
    overlay = RegionOverlay(meshcat, "/r", SOLE)
    for n, time in (3, 1.0), (1, 2.0):
        found = CaptureRegions((SMALL,) * n, LARGE)
        overlay.draw(found, CENTRE, 0.0, time)
    for time, counts in (1.0, [4, 4, 4]), (2.0, [4, 0, 0]):
        names = ("c_1", "c_2", "c_3")
        assert [len(edges(meshcat, c, time)) for c in names] == counts


def test_more_than_three_regions_are_three():
    meshcat = draw(CaptureRegions((SMALL,) * 5, LARGE))
    assert edges(meshcat, "c_3") == sides(SMALL)


@pytest.mark.parametrize(
    ("nominal", "adjusted", "seen"),
    [
        (NOMINAL, ADJUSTED, True),
        (NOMINAL, NOMINAL, False),
        (NOMINAL, FootPose(NOMINAL.p_WF), False),
        (None, None, False),
    ],
)
def test_the_nominal_foothold_is_seen_when_the_foot_lands_elsewhere(
    nominal, adjusted, seen
):
    meshcat = draw(CaptureRegions((SMALL,), LARGE, nominal, adjusted))
    assert meshcat.live["/r/nominal", "visible"] == seen
    if seen:
        X = meshcat.live["/r/nominal", "transform"]
        assert X[:3, 3] == pytest.approx(nominal.p_WF)


def test_adds_its_objects_only_once():
    """Oracle: a recording cannot hold new objects (users.md)."""
    meshcat = FakeMeshcat()
    overlay = RegionOverlay(meshcat, "/r", SOLE)
    count = len(meshcat.objects)
    for n in (3, 0, 2):
        found = CaptureRegions((circle(0.5 + n, 50),) * n, circle(0.5, 50))
        overlay.draw(found, CENTRE, 0.0, 0.1 * n)
    assert set(meshcat.objects.values()) == {1}
    assert len(meshcat.objects) == count


def test_edges_end_at_the_circle():
    """Oracle: Pythagoras; outside of it nothing is left."""
    square = rectangle(4.0, 1.2)  # its sides at y = +-0.6 cross the circle
    starts, ends = edges_near(square, np.zeros(2), 1.0)
    assert (starts[0], ends[0]) == (
        pytest.approx([0.8, 0.6]),
        pytest.approx([-0.8, 0.6]),
    )
    for i in (1, 3):
        assert np.array_equal(starts[i], ends[i])
    meshcat = draw(CaptureRegions((CENTRE + rectangle(9.0, 2 * 0.72),)))
    assert RADIUS == 1.2  # sqrt(1.2^2 - 0.72^2) = 0.96
    assert edges(meshcat, "c_1") == {
        ((1.96, 1.22), (0.04, 1.22)),
        ((0.04, -0.22), (1.96, -0.22)),
    }


def test_the_least_vertices_go_first():
    """Oracle: a square with a corner cut off by a millimetre; a circle."""
    square = rectangle(1.0, 1.0)
    cut = np.insert(square, 1, square[0] - [1e-3, 0.0], axis=0)
    cut[0] -= [0.0, 1e-3]
    kept = thinned(cut, 4)
    assert kept == pytest.approx(square, abs=1.1e-3)
    wheel = circle(1.0, 64)
    inner = thinned(wheel, EDGES)
    assert len(inner) == EDGES
    assert area(inner) > 0.97 * area(wheel)
    assert all(contains(p, wheel, 1e-9) for p in inner)
    assert thinned(wheel, 64) is wheel


@pytest.mark.parametrize("seed", range(20))
def test_every_edge_has_a_box_of_its_own(seed):
    """Oracle: no number twice, none out of range."""
    rng = np.random.default_rng(seed)
    polygon = thinned(convex_hull(rng.normal(size=(60, 2))), EDGES)
    boxes = boxes_of_edges(polygon, BOXES)
    assert len(set(boxes.tolist())) == len(polygon)
    assert boxes.min() >= 0
    assert boxes.max() < BOXES


def test_the_sides_of_the_foot_keep_their_boxes_while_the_icp_moves():
    """Oracle: C_1 has the foot's four sides, and two more or none."""
    foot = rectangle(0.18, 0.07)
    common = None
    counts = set()
    for angle in np.linspace(0.0, 2.0 * math.pi, 60):
        for distance in (0.0, 0.05, 0.1, 0.3):
            icp = distance * np.array([math.cos(angle), math.sin(angle)])
            region = one_step_region(icp, foot, 3.3, (0.2, 0.7))
            boxes = set(boxes_of_edges(region, BOXES).tolist())
            common = boxes if common is None else common & boxes
            counts.add(len(region))
    assert len(common) == 4
    assert counts >= {4, 6}
