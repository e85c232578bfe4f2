"""What is drawn, from inputs that are fixed by hand."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import Simulator

from nadia_balance.core.foothold_adjustment import CaptureRegions
from nadia_balance.core.support_polygon import support_polygon
from nadia_balance.core.walking import (
    ContactSchedule,
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
    rectangle,
)
from nadia_balance.systems.balance_visualizer import BalanceVisualizer
from tests.fake_meshcat import FakeMeshcat

SOLE = rectangle(0.25, 0.12)
GROUND = 0.1
COM = [0.2, 0.05, 1.0, 0.3, 0.0, 0.0]
POINTS = {
    "com_state": COM,
    "icp": [0.3, 0.02],
    "icp_reference": [0.29, 0.01, 0, 0, 0, 0, 0, 0],
    "ecmp_command": [0.1, 0.11, 0.12, 0.13],
}


def foot(x, side, z=GROUND):
    return FootPose([x, 0.125 * side.sign, z])


def state(phase=Phase.SWING, steps_taken=1, num_footsteps=5):
    """The left foot has just landed at 0.3; the right one is the next."""
    sides = [Side.RIGHT, Side.LEFT] * 3
    footsteps = tuple(
        Footstep(side, foot(0.6 + 0.3 * i, side), 0.3, 0.7)
        for i, side in enumerate(sides[:num_footsteps])
    )
    feet = FootPoses(foot(0.3, Side.LEFT), foot(0.0, Side.RIGHT))
    start = ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2))
    schedule = ContactSchedule(phase, Side.LEFT, 0.7, feet, footsteps, start)
    return WalkingState(schedule, steps_taken=steps_taken)


def draw(walking, time=0.0, meshcat=None, regions=None, **vectors):
    """Draws one frame; returns the Meshcat that remembers it."""
    meshcat = meshcat or FakeMeshcat()
    visualizer = BalanceVisualizer(meshcat, SOLE)
    context = visualizer.CreateDefaultContext()
    context.SetTime(time)
    port = visualizer.GetInputPort("walking_state")
    port.FixValue(context, Value(walking))
    if regions is not None:
        port = visualizer.GetInputPort("capture_regions")
        port.FixValue(context, Value(regions))
    for name, value in vectors.items():
        visualizer.GetInputPort(name).FixValue(context, value)
    visualizer.ForcedPublish(context)
    return meshcat


def shown(meshcat, prefix):
    """Names of the visible things below `prefix`."""
    return sorted(
        path.removeprefix(f"/overlay/{prefix}/")
        for (path, name), value in meshcat.live.items()
        if name == "visible" and value and path.startswith(f"/overlay/{prefix}")
    )


@pytest.mark.parametrize(
    ("marker", "expected"),
    [
        ("icp", [0.3, 0.02, GROUND]),
        ("icp_reference", [0.29, 0.01, GROUND]),
        ("cop", [0.1, 0.11, GROUND]),
        ("ecmp", [0.12, 0.13, GROUND]),
        ("com_ground", [0.2, 0.05, GROUND]),
        ("com", [0.2, 0.05, 1.0]),
    ],
)
def test_marks_each_point_where_the_port_says(marker, expected):
    """Oracle: the columns of the port table, at the height of the soles."""
    meshcat = draw(state(), **POINTS)
    path = f"/overlay/{marker}"
    assert meshcat.live[path, "visible"]
    assert meshcat.live[path, "position"] == pytest.approx(expected)


def test_draws_nothing_that_is_not_connected():
    meshcat = draw(state())
    for marker in ("icp", "icp_reference", "cop", "ecmp", "com", "push"):
        assert not meshcat.live[f"/overlay/{marker}", "visible"]
    assert shown(meshcat, "footprints") == ["left_1"]


@pytest.mark.parametrize("phase", [Phase.SWING, Phase.TRANSFER])
def test_outlines_the_support_polygon(phase):
    """Oracle: core.support_polygon, corner by corner."""
    walking = state(phase)
    meshcat = draw(walking)
    starts = []
    for i in map(int, shown(meshcat, "support_polygon")):
        X = meshcat.live[f"/overlay/support_polygon/{i}", "transform"]
        path = f"/overlay/support_polygon/{i}/<object>"
        length, width, _ = meshcat.live[path, "scale"]
        starts.append(X[:2, 3] - 0.5 * (length - width) * X[:2, 0])
    expected = support_polygon(walking.schedule, SOLE)
    assert starts == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("count", "names"),
    [
        (0, []),
        (1, ["right_0"]),
        (3, ["left_0", "right_0", "right_1"]),
        (5, ["left_0", "left_1", "right_0", "right_1"]),
    ],
)
def test_outlines_the_next_footsteps_of_each_side(count, names):
    meshcat = draw(state(num_footsteps=count))
    feet = [n for n in shown(meshcat, "footsteps") if "/" not in n]
    assert feet == names
    if count > 0:
        X = meshcat.live["/overlay/footsteps/right_0", "transform"]
        assert X[:3, 3] == pytest.approx([0.6, -0.125, GROUND])


@pytest.mark.parametrize(
    ("phase", "prints"),
    [
        (Phase.SWING, ["left_1"]),
        (Phase.TRANSFER, ["left_1", "right_0"]),
        (Phase.STANDING, ["left_1", "right_0"]),
    ],
)
def test_feet_that_carry_leave_prints_numbered_by_their_steps(phase, prints):
    """Oracle: step 1 was the left foot's, so the right print is older."""
    assert shown(draw(state(phase)), "footprints") == prints


def test_the_arrow_points_at_the_centre_of_mass():
    meshcat = draw(state(), com_state=COM, push_force=[0.0, 500.0, 0.0])
    assert meshcat.live["/overlay/push", "visible"]
    X = meshcat.live["/overlay/push", "transform"]
    assert X[:3, 3] == pytest.approx(COM[:3])
    assert X[:3, 2] == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)


def test_there_is_no_arrow_without_a_push():
    meshcat = draw(state(), com_state=COM, push_force=np.zeros(3))
    assert not meshcat.live["/overlay/push", "visible"]


def test_every_frame_is_recorded_at_its_time():
    meshcat = draw(state(), time=1.5, **POINTS)
    frames = {
        frame
        for (path, name), track in meshcat.tracks.items()
        for frame in track
        if (path, name) != ("/overlay/footprints/left_1", "visible")
    }
    assert frames == {48}


REGION = np.array([0.3, 0.1]) + rectangle(0.6, 0.4)
REGIONS = CaptureRegions(
    (REGION, REGION), REGION, foot(0.3, Side.RIGHT), foot(0.6, Side.RIGHT)
)


@pytest.mark.parametrize(
    ("phase", "regions", "seen"),
    [
        (Phase.SWING, REGIONS, True),
        (Phase.SWING, None, False),
        (Phase.TRANSFER, REGIONS, False),
        (Phase.STANDING, REGIONS, False),
    ],
)
def test_outlines_capture_regions_in_swings_only(phase, regions, seen):
    meshcat = draw(state(phase), regions=regions)
    path = "/overlay/capture_regions"
    assert meshcat.live[path, "visible"] == seen
    if seen:
        heights = [
            meshcat.live[p, "transform"][2, 3]
            for p in meshcat.objects
            if p.startswith(f"{path}/c_") and meshcat.live[p, "visible"]
        ]
        assert len(heights) == 8, "two rectangles"
        assert all(GROUND < z < GROUND + 0.006 for z in heights)
        X = meshcat.live[f"{path}/nominal", "transform"]
        assert X[:3, 3] == pytest.approx([0.3, -0.125, GROUND])


def test_capture_regions_vanish_with_the_frame_that_ends_the_swing():
    """Oracle: the swing ends at 1/32 s, between two of their own frames."""
    meshcat = FakeMeshcat()
    visualizer = BalanceVisualizer(meshcat, SOLE)
    simulator = Simulator(visualizer)
    context = simulator.get_mutable_context()
    walking = visualizer.GetInputPort("walking_state")
    visualizer.GetInputPort("capture_regions").FixValue(context, Value(REGIONS))
    walking.FixValue(context, Value(state(Phase.SWING)))
    simulator.AdvanceTo(0.03)
    walking.FixValue(context, Value(state(Phase.TRANSFER)))
    simulator.AdvanceTo(0.1)
    path = "/overlay/capture_regions"
    seen = [meshcat.at(path, "visible", k / 32.0) for k in range(4)]
    assert seen == [True, False, False, False]


def test_draws_capture_regions_16_times_a_second():
    """Oracle: 17 frames in [0, 1] s, the first at 0."""
    meshcat = FakeMeshcat()
    visualizer = BalanceVisualizer(meshcat, SOLE)
    context = visualizer.CreateDefaultContext()
    for name, value in ("walking_state", state()), ("capture_regions", REGIONS):
        visualizer.GetInputPort(name).FixValue(context, Value(value))
    Simulator(visualizer, context).AdvanceTo(1.0)
    tracks = [
        sorted(track)
        for (path, name), track in meshcat.tracks.items()
        if path.startswith("/overlay/capture_regions/c_1")
        and name == "transform"
    ]
    assert tracks == [list(range(0, 33, 2))] * 4


def test_refuses_anything_but_capture_regions():
    message = "'capture_regions' got a FootPose"
    with pytest.raises(TypeError, match=message):
        draw(state(), regions=FootPose())


def test_refuses_anything_but_a_walking_state():
    with pytest.raises(TypeError, match="'walking_state' got a FootPose"):
        draw(FootPose())


def test_publishes_32_times_a_second_and_has_no_state():
    """Oracle: 33 frames in [0, 1] s, the first at 0."""
    meshcat = FakeMeshcat()
    visualizer = BalanceVisualizer(meshcat, SOLE)
    context = visualizer.CreateDefaultContext()
    visualizer.GetInputPort("walking_state").FixValue(context, Value(state()))
    for name, value in POINTS.items():
        visualizer.GetInputPort(name).FixValue(context, value)
    Simulator(visualizer, context).AdvanceTo(1.0)
    track = meshcat.tracks["/overlay/icp", "position"]
    assert sorted(track) == list(range(33))
    assert context.num_total_states() == 0
    assert context.num_abstract_states() == 0


def test_a_new_run_starts_with_a_clean_floor():
    """Oracle: prints of the first run are gone when the second begins."""
    meshcat = FakeMeshcat()
    visualizer = BalanceVisualizer(meshcat, SOLE)
    context = visualizer.CreateDefaultContext()
    port = visualizer.GetInputPort("walking_state")
    for steps_taken in (7, 1):
        port.FixValue(context, Value(state(steps_taken=steps_taken)))
        context.SetTime(0.0)
        Simulator(visualizer, context).AdvanceTo(0.1)
    prints = [p for p in meshcat.objects if "footprints" in p]
    assert prints == ["/overlay/footprints/left_1"]


def test_draws_into_a_real_meshcat():
    """Oracle: Drake's own Meshcat has the paths, and reports the values."""
    meshcat = draw(state(), meshcat=Meshcat(), **POINTS)
    assert meshcat.HasPath("/overlay/footprints/left_1")
    assert meshcat.HasPath("/overlay/footsteps/right_0/3")
    packed = meshcat._GetPackedProperty("/overlay/icp", "visible")
    assert packed.endswith(b"\xc3"), "true, in MessagePack"
