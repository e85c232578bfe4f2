"""What is drawn over the robot, against a Meshcat that remembers."""

import math

import numpy as np
import pytest
from shapely import LinearRing, Point, Polygon, union_all

from nadia_balance import palette
from nadia_balance.core.foothold_adjustment import CaptureRegions
from nadia_balance.core.polygon import area, contains
from nadia_balance.core.reachability import circle
from nadia_balance.core.walking import FootPose, Side, rectangle
from nadia_balance.systems.overlay import (
    EDGES,
    RADIUS,
    Arrow,
    ConvexShape,
    Footprints,
    PolygonOutline,
    RegionOverlay,
    SoleOutline,
    thinned,
)
from tests.fake_meshcat import FakeMeshcat, drawn_edges, drawn_triangles

PENTAGON = np.array(
    [[0.3, 0.0], [0.2, 0.4], [-0.1, 0.5], [-0.3, 0.1], [0.0, -0.3]]
)
SOLE = rectangle(0.25, 0.12)
POSE = FootPose([1.0, 2.0, 0.3], math.radians(30.0))
PERIOD = 1.0 / 32.0
CENTRE = np.array([1.0, 0.5])
SMALL = CENTRE + rectangle(0.6, 0.4)
LARGE = CENTRE + rectangle(0.8, 0.6)
NOMINAL, ADJUSTED = FootPose([1.0, 0.3, 0.0]), FootPose([1.2, 0.2, 0.0])


def sides(polygon):
    """The edges of a polygon as {(start, end)}, to a millimetre."""
    return rounded(polygon, np.roll(polygon, -1, axis=0))


def rounded(starts, ends):
    lines = np.round(np.hstack([starts, ends]), 3) + 0.0
    return set(map(tuple, lines.tolist()))


def edges(meshcat, path, time=0.0):
    """The visible edges of an outline, in the same form."""
    starts, ends, _ = drawn_edges(meshcat, path, time)
    return rounded(np.reshape(starts, (-1, 2)), np.reshape(ends, (-1, 2)))


def test_an_outline_is_the_polygon_now_and_in_earlier_frames():
    """Oracle: the vertices; one object an edge, as recordings add none."""
    meshcat = FakeMeshcat()
    outline = PolygonOutline(meshcat, "/p", 5, palette.SUPPORT)
    polygons = PENTAGON, PENTAGON[:3] + 1.0, np.zeros((0, 2))
    for time, polygon in enumerate(polygons, start=1):
        outline.draw(polygon, z=0.02, time=float(time))
    for time, polygon in enumerate(polygons, start=1):
        assert edges(meshcat, "/p", time) == sides(polygon)
        assert set(drawn_edges(meshcat, "/p", time)[2]) <= {0.02}
    assert meshcat.objects == {f"/p/{i}": 1 for i in range(5)}
    with pytest.raises(ValueError, match="edges = 6: must be at most 5"):
        outline.draw(circle(1.0, 6), 0.0, 0.0)


def test_an_arrow_lingers_in_the_recording_only():
    """Oracle: pushed from 1.0 to 1.1 s at 32 Hz; LINGER is 0.5 s."""
    meshcat = FakeMeshcat()
    arrow = Arrow(meshcat, "/a", palette.PUSH)
    shaft, head = (
        meshcat.live[f"/a/{part}", "transform"][2, 3]
        for part in ("shaft", "head")
    )
    assert shaft < head < 0.0, "it must come from behind the place"
    arrow.hide(time=0.0)
    for frame in range(64):
        if pushed := 32 <= frame < 36:
            arrow.draw(np.ones(3), np.ones(3), frame / 32.0)
        else:
            arrow.hide(None)
        assert meshcat.live["/a", "visible"] == pushed
    shown = [meshcat.at("/a", "visible", t) for t in (0.9, 1.0, 1.1, 1.4, 1.7)]
    assert shown == [False, True, True, True, False]


def test_a_sole_is_outlined_at_its_pose_and_hides_again():
    """Oracle: FootPose.to_world of the corners."""
    meshcat = FakeMeshcat()
    outline = SoleOutline(meshcat, "/s", SOLE, palette.LEFT)
    outline.draw(POSE, 1.0)
    outline.draw(None, 2.0)
    starts, _, _ = drawn_edges(meshcat, "/s", 1.0)
    X = meshcat.at("/s", "transform", 1.0)
    corners = np.array(starts) @ X[:2, :2].T + X[:2, 3]
    assert corners == pytest.approx(POSE.to_world(SOLE), abs=1e-12)
    seen = [meshcat.at("/s", "visible", time) for time in (1.5, 2.0)]
    assert seen == [True, False]


def test_a_footprint_appears_with_its_step_and_stays():
    """Oracle: the second step lands at 1 s; two soles of 0.25 m x 0.12 m."""
    triangles = []

    class Spy(FakeMeshcat):
        def SetTriangleMesh(self, path, vertices, faces, rgba):
            super().SetTriangleMesh(path, vertices, faces, rgba)
            triangles.extend(vertices.T[f] for f in faces.T)

    meshcat = Spy()
    prints = Footprints(meshcat, "/f", SOLE, PERIOD)
    for frame in range(64):
        step = (Side.LEFT, 1, POSE) if frame < 32 else (Side.RIGHT, 2, NOMINAL)
        prints.draw(*step, frame * PERIOD)
    seen = [meshcat.at("/f/right_2", "visible", t) for t in (0.0, 0.96, 1.0)]
    assert seen == [False, False, True]
    for t in (0.0, 1.9):
        assert meshcat.at("/f/left_1", "visible", t)
        X = meshcat.at("/f/left_1", "transform", t)
        assert X[:2, 3] == pytest.approx([1.0, 2.0])
        assert X[:2, :2] == pytest.approx(POSE.rotation)
        assert 0.3 < X[2, 3] < 0.31, "just above the floor"
    assert meshcat.objects == {"/f/left_1": 1, "/f/right_2": 1}
    for path, side in ("/f/left_1", Side.LEFT), ("/f/right_2", Side.RIGHT):
        color, rgb = meshcat.colors[path], palette.rgb(palette.foot_color(side))
        assert [color.r(), color.g(), color.b()] == pytest.approx(rgb)
    areas = [np.cross(b - a, c - a)[2] / 2 for a, b, c in triangles]
    assert min(areas) > 0.0
    assert sum(areas) == pytest.approx(2 * 0.25 * 0.12)
    prints.forget()
    assert meshcat.objects == {}


def covered(meshcat, path, time):
    """What a filled polygon covers, and how much is painted twice [m^2]."""
    triangles = [
        Polygon(t[:, :2]) for t in drawn_triangles(meshcat, path, time)
    ]
    whole = union_all(triangles)
    return whole, sum(t.area for t in triangles) - whole.area


def test_regions_are_filled_and_vanish_when_they_are_gone():
    """Oracle: shapely's union of the triangles; N is 2, then 5, then 1."""
    meshcat = FakeMeshcat()
    overlay = RegionOverlay(meshcat, "/r", SOLE, PERIOD)
    assert not meshcat.live["/r", "visible"]
    drawn = {0.0: (SMALL, LARGE), 1.0: (SMALL,) * 5, 2.0: (LARGE,)}
    for time, regions in drawn.items():
        found = CaptureRegions(regions, SMALL + 0.1, NOMINAL, ADJUSTED)
        overlay.draw(found, CENTRE, 0.0, time)
    overlay.hide(time=3.0)
    for time, regions in drawn.items():
        line, _ = covered(meshcat, "/r/reach", time)
        assert line.exterior.equals(LinearRing(SMALL + 0.1))
        assert line.area < 0.016 * line.exterior.length
        for i in range(3):
            shape, _ = covered(meshcat, f"/r/c_{i + 1}", time + 0.9)
            expected = Polygon(regions[i] if i < len(regions) else None)
            assert shape.symmetric_difference(expected).area < 1e-9
    seen = [meshcat.at("/r", "visible", t) for t in (0.0, 2.9, 3.0)]
    assert seen == [True, True, False]
    overlay.forget()
    assert meshcat.meshes == {}


def test_a_border_is_painted_twice_and_only_it():
    """Oracle: by hand; each corner of a square moves 16 mm to its middle."""
    meshcat = FakeMeshcat()
    filled = ConvexShape(meshcat, "/p", palette.rgba("#000000"), PERIOD)
    filled.draw(rectangle(0.4, 0.4), 0.0, 0.0)
    _, twice = covered(meshcat, "/p", 0.0)
    side = 0.4 - math.sqrt(2.0) * ConvexShape.BORDER
    assert twice == pytest.approx(0.4**2 - side**2)
    triangles = drawn_triangles(meshcat, "/p", 0.0)
    turns = np.cross(*np.diff(triangles, axis=1).transpose(1, 0, 2))
    assert (turns[:, 2] > 0.0).all(), "seen from above"


def test_the_last_shapes_stay_and_the_others_leave_the_memory():
    """Oracle: KEPT shapes, each seen in the frame it was drawn in."""
    meshcat, kept = FakeMeshcat(), ConvexShape.KEPT
    filled = ConvexShape(meshcat, "/p", palette.rgba("#000000"), PERIOD)
    for frame in range(kept + 3):
        filled.draw(SMALL + [frame, 0.0], 0.0, frame * PERIOD)
        filled.draw(SMALL + [frame, 0.004], 0.0, (frame + 0.5) * PERIOD)
    assert len(meshcat.objects) == kept, "less than STILL is no new shape"
    for frame in 3, 500, kept + 2:
        seen = drawn_triangles(meshcat, "/p", frame * PERIOD)
        assert seen[:, :, 0].min() == pytest.approx(frame + SMALL[:, 0].min())
        assert np.ptp(seen[:, :, 0]) == pytest.approx(0.6), "one shape alone"


@pytest.mark.parametrize(
    ("nominal", "adjusted", "seen"),
    [
        (NOMINAL, ADJUSTED, True),
        (NOMINAL, FootPose(NOMINAL.p_WF), False),
        (None, None, False),
    ],
)
def test_the_nominal_foothold_is_seen_when_the_foot_lands_elsewhere(
    nominal, adjusted, seen
):
    """Oracle: NOMINAL and ADJUSTED are 0.22 m apart."""
    meshcat = FakeMeshcat()
    found = CaptureRegions((SMALL,), LARGE, nominal, adjusted)
    RegionOverlay(meshcat, "/r", SOLE, PERIOD).draw(found, CENTRE, 0.0, 0.0)
    assert meshcat.live["/r/nominal", "visible"] == seen
    if seen:
        X = meshcat.live["/r/nominal", "transform"]
        assert X[:3, 3] == pytest.approx(nominal.p_WF)


def test_regions_end_at_the_circle():
    """Oracle: Pythagoras: sqrt(1.2^2 - 0.72^2) = 0.96; shapely's circle."""
    meshcat = FakeMeshcat()
    strip = CENTRE + rectangle(9.0, 2 * 0.72)
    overlay = RegionOverlay(meshcat, "/r", SOLE, PERIOD)
    overlay.draw(CaptureRegions((strip,)), CENTRE, 0.0, 0.0)
    shape, _ = covered(meshcat, "/r/c_1", 0.0)
    expected = Polygon(strip) & Point(CENTRE).buffer(RADIUS, 64)
    assert shape.area == pytest.approx(expected.area, rel=0.02)
    assert (shape - expected).area < 1e-3 * expected.area
    x, y = np.array(shape.exterior.coords).T
    top = x[y > CENTRE[1] + 0.72 - 1e-9]
    assert np.ptp(top) == pytest.approx(2 * 0.96, abs=0.02)


def test_the_least_vertices_go_first():
    """Oracle: a square with a corner cut off by a millimetre; a circle."""
    square = rectangle(1.0, 1.0)
    cut = np.insert(square, 1, square[0] - [1e-3, 0.0], axis=0)
    cut[0] -= [0.0, 1e-3]
    assert thinned(cut, 4) == pytest.approx(square, abs=1.1e-3)
    wheel = circle(1.0, 64)
    inner = thinned(wheel, EDGES)
    assert len(inner) == EDGES
    assert area(inner) > 0.97 * area(wheel)
    assert all(contains(p, wheel, 1e-9) for p in inner)
    assert thinned(wheel, 64) is wheel
