"""What is drawn, from inputs that are fixed by hand."""

from dataclasses import replace

import numpy as np
import pytest

from nadia_balance.core.foothold_adjustment import CaptureRegions
from nadia_balance.core.polygon import support_polygon
from nadia_balance.core.walking import (
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    Side,
    WalkingState,
    rectangle,
)
from nadia_balance.results.scene import start_meshcat
from nadia_balance.systems.balance_visualizer import BalanceVisualizer
from tests.blocks import asked, fix, running
from tests.example_walks import standing
from tests.fake_meshcat import FakeMeshcat, drawn_edges, drawn_triangles

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
    schedule = replace(
        standing(feet), phase=phase, duration=0.7, footsteps=footsteps
    )
    return WalkingState(schedule, steps_taken=steps_taken)


def draw(walking, time=0.0, meshcat=None, **inputs):
    """Draws one frame; returns the Meshcat that remembers it."""
    meshcat = meshcat or FakeMeshcat()
    visualizer = BalanceVisualizer(meshcat, SOLE)
    context = asked(visualizer, walking_state=walking, **inputs)
    context.SetTime(time)
    visualizer.ForcedPublish(context)
    return meshcat


def shown(meshcat, prefix):
    """Names of the visible things below `prefix`."""
    return sorted(
        path.removeprefix(f"/overlay/{prefix}/")
        for (path, name), value in meshcat.live.items()
        if name == "visible" and value and path.startswith(f"/overlay/{prefix}")
    )


def test_marks_each_point_where_the_port_says():
    """Oracle: the columns of the ports, at the height of the soles."""
    meshcat = draw(state(), **POINTS)
    for marker, expected in {
        "icp": [0.3, 0.02, GROUND],
        "icp_reference": [0.29, 0.01, GROUND],
        "cop": [0.1, 0.11, GROUND],
        "ecmp": [0.12, 0.13, GROUND],
        "com_ground": [0.2, 0.05, GROUND],
        "com": [0.2, 0.05, 1.0],
    }.items():
        path = f"/overlay/{marker}"
        assert meshcat.live[path, "visible"]
        assert meshcat.live[path, "position"] == pytest.approx(expected)


def test_draws_nothing_that_is_not_connected():
    meshcat = draw(state())
    for marker in ("icp", "icp_reference", "cop", "ecmp", "com", "push"):
        assert not meshcat.live[f"/overlay/{marker}", "visible"]
    assert shown(meshcat, "footprints") == ["left_1"]


@pytest.mark.parametrize(
    ("phase", "prints"),
    [
        (Phase.SWING, ["left_1"]),
        (Phase.TRANSFER, ["left_1", "right_0"]),
        (Phase.STANDING, ["left_1", "right_0"]),
    ],
)
def test_feet_that_carry_leave_prints_and_are_in_the_polygon(phase, prints):
    """Oracle: step 1 was the left foot's; core.support_polygon."""
    meshcat = draw(state(phase))
    assert shown(meshcat, "footprints") == prints
    starts, _, _ = drawn_edges(meshcat, "/overlay/support_polygon", 0.0)
    expected = support_polygon(state(phase).schedule, SOLE)
    assert np.array(starts) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("count", "names"),
    [
        (0, []),
        (3, ["left_0", "right_0", "right_1"]),
        (5, ["left_0", "left_1", "right_0", "right_1"]),
    ],
)
def test_outlines_the_next_footsteps_of_each_side(count, names):
    """Oracle: two of each side at the most; the first is at 0.6."""
    meshcat = draw(state(num_footsteps=count))
    feet = [n for n in shown(meshcat, "footsteps") if "/" not in n]
    assert feet == names
    if count > 0:
        X = meshcat.live["/overlay/footsteps/right_0", "transform"]
        assert X[:3, 3] == pytest.approx([0.6, -0.125, GROUND])


@pytest.mark.parametrize("pushed", [True, False])
def test_the_arrow_points_at_the_centre_of_mass_during_a_push(pushed):
    """Oracle: the CoM, and the direction of the force."""
    force = [0.0, 500.0 * pushed, 0.0]
    meshcat = draw(state(), com_state=COM, push_force=force)
    assert meshcat.live["/overlay/push", "visible"] == pushed
    if pushed:
        X = meshcat.live["/overlay/push", "transform"]
        assert X[:3, 3] == pytest.approx(COM[:3])
        assert X[:3, 2] == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)


def test_every_frame_is_recorded_at_its_time():
    """Oracle: frame 48 at 1.5 s; a new print is hidden the frame before."""
    meshcat = draw(state(), time=1.5, **POINTS)
    recorded = {
        frame
        for (path, name), track in meshcat.tracks.items()
        for frame in track
        if (path, name) != ("/overlay/footprints/left_1", "visible")
    }
    assert recorded == {48}


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
    ],
)
def test_fills_capture_regions_in_swings_only(phase, regions, seen):
    """Oracle: two rectangles, just above the soles."""
    given = {} if regions is None else {"capture_regions": regions}
    meshcat = draw(state(phase), **given)
    path = "/overlay/capture_regions"
    assert meshcat.live[path, "visible"] == seen
    if seen:
        for name, count in (("c_1", 10), ("c_2", 10), ("c_3", 0)):
            found = drawn_triangles(meshcat, f"{path}/{name}", 0.0)
            assert len(found) == count, "two, and eight of the border"
            z = found[:, :, 2]
            assert ((z > GROUND) & (z < GROUND + 0.006)).all()
        X = meshcat.live[f"{path}/nominal", "transform"]
        assert X[:3, 3] == pytest.approx([0.3, -0.125, GROUND])


def test_capture_regions_vanish_with_the_frame_that_ends_the_swing():
    """Oracle: the swing ends at 1/32 s, between two of their own frames."""
    meshcat = FakeMeshcat()
    visualizer = BalanceVisualizer(meshcat, SOLE)
    simulator, context = running(
        visualizer, walking_state=state(Phase.SWING), capture_regions=REGIONS
    )
    simulator.AdvanceTo(0.03)
    fix(visualizer, context, walking_state=state(Phase.TRANSFER))
    simulator.AdvanceTo(0.1)
    path = "/overlay/capture_regions"
    seen = [meshcat.at(path, "visible", k / 32.0) for k in range(4)]
    assert seen == [True, False, False, False]


def test_draws_32_times_a_second_and_capture_regions_16_times():
    """Oracle: 33 and 17 frames in [0, 1] s, the first at 0."""
    meshcat = FakeMeshcat()
    visualizer = BalanceVisualizer(meshcat, SOLE)
    simulator, context = running(
        visualizer,
        walking_state=state(),
        capture_regions=REGIONS,
        icp=POINTS["icp"],
    )
    simulator.AdvanceTo(1.0)
    assert context.num_total_states() == context.num_abstract_states() == 0
    tracks = meshcat.tracks
    assert sorted(tracks["/overlay/icp", "position"]) == list(range(33))
    nominal = tracks["/overlay/capture_regions/nominal", "transform"]
    assert sorted(nominal) == list(range(0, 33, 2))


def test_a_new_run_starts_with_a_clean_floor():
    """Oracle: prints of the first run are gone when the second begins."""
    meshcat = FakeMeshcat()
    visualizer = BalanceVisualizer(meshcat, SOLE)
    for steps_taken in (7, 1):
        simulator, _ = running(
            visualizer, walking_state=state(steps_taken=steps_taken)
        )
        simulator.AdvanceTo(0.1)
    prints = [p for p in meshcat.objects if "footprints" in p]
    assert prints == ["/overlay/footprints/left_1"]


def test_draws_into_a_real_meshcat():
    """Oracle: Drake's own Meshcat has the paths, and reports the values."""
    meshcat = draw(state(), meshcat=start_meshcat()[0], **POINTS)
    assert meshcat.HasPath("/overlay/footprints/left_1")
    assert meshcat.HasPath("/overlay/footsteps/right_0/3")
    packed = meshcat._GetPackedProperty("/overlay/icp", "visible")
    assert packed.endswith(b"\xc3"), "true, in MessagePack"
