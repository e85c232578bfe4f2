"""The replay in a real browser: offline, small, and with everything to see.

A kinematic imitation of a walk takes the place of a simulation: it draws the
same robot through the same visualizers, in a fraction of a second.
"""

import io
import json
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from playwright.sync_api import Browser, ConsoleMessage, Page
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder
from shapely import Point, Polygon, union_all

from nadia_balance import palette
from nadia_balance.core.body.ground import Ground
from nadia_balance.core.steps import capture_region
from nadia_balance.core.steps.foothold_adjustment import CaptureRegions
from nadia_balance.core.walking.state import (
    Adjustment,
    ContactSchedule,
    FootPose,
    FootPoses,
    Footstep,
    Phase,
    ReferencePoint,
    Side,
    WalkingState,
)
from nadia_balance.results.pages import start_recording, write_replay
from nadia_balance.systems.steps import CaptureRegionStepAdjuster
from nadia_balance.systems.wiring import connect
from nadia_balance.view import scene
from nadia_balance.view.balance_visualizer import (
    FOOTPRINTS,
    RADIUS,
    BalanceVisualizer,
)
from nadia_balance.view.scene import LINE
from tests.blocks import asked
from tests.core.body.test_ground import square
from tests.example_walks import MODEL, SOLE

URDF = Path(__file__).parents[2] / "models" / "nadia" / "nadia.urdf"
DURATION, STEP_LENGTH, TRANSFER, SWING = 5.5, 0.2, 0.3, 0.7  # [s], [m]
PUSH = (4.2, 4.3)  # [s]
MEGABYTE = 1e6
PARTS = (
    *("footprints", "footsteps", "support_polygon"),
    *("icp", "icp_reference", "com", "com_ground", "cop", "ecmp"),
    *("capture_regions/c_1", "capture_regions/c_2", "capture_regions/c_3"),
    *("capture_regions/reach", "capture_regions/nominal", "ground"),
)


def foot(step: int) -> tuple[Side, FootPose]:
    """The foothold of this step; the even ones are left."""
    side = Side.LEFT if step % 2 == 0 else Side.RIGHT
    return side, FootPose([step * STEP_LENGTH, 0.125 * side.sign, 0.0])


def walking_state(time: float) -> WalkingState:
    """A step a second; at time 0 the left foot has just landed."""
    taken = int(time)
    clock = time - taken
    side, landed = foot(taken)
    feet = FootPoses(landed, landed)
    feet = feet.with_foot(side.other, foot(taken - 1)[1])
    swings = clock >= TRANSFER
    next_ones = map(foot, range(taken + 1, taken + 5))
    steps = [Footstep(*one, TRANSFER, SWING) for one in next_ones]
    schedule = ContactSchedule(
        Phase.SWING if swings else Phase.TRANSFER,
        side,
        SWING if swings else TRANSFER,
        feet,
        tuple(steps),
        ReferencePoint(np.zeros(2), np.zeros(2), np.zeros(2)),
    )
    if not swings:
        return WalkingState(schedule, clock, steps_taken=taken)
    clock -= TRANSFER
    return WalkingState(
        schedule,
        clock,
        clock,
        steps_taken=taken,
        adjustment=Adjustment(nominal(taken + 1), steps[0].pose),
    )


def nominal(step: int) -> Footstep:
    """Where this step was to land: farther out."""
    side, pose = foot(step)
    out = FootPose(pose.p_WF + [0.0, 0.2 * side.sign, 0.0])
    return Footstep(side, out, TRANSFER, SWING)


def com(time: float) -> np.ndarray:
    """Position (3,) of the made-up centre of mass."""
    sway = 0.05 * math.cos(math.pi * (time - 0.65))
    return np.array([STEP_LENGTH * time, sway, 1.0])


def icp(time: float) -> np.ndarray:
    """Position (2,) of the made-up ICP."""
    return com(time)[:2] + [0.08, 0.03 * math.sin(math.pi * time)]


def vectors(time: float) -> dict[str, np.ndarray]:
    """The vector inputs of the visualizer."""
    pushed = PUSH[0] <= time < PUSH[1]
    return {
        "com_state": np.concatenate([com(time), np.zeros(3)]),
        "icp_reference": np.concatenate([icp(time) + 0.02, np.zeros(6)]),
        "ecmp_command": np.concatenate([icp(time) - 0.05, icp(time) - 0.1]),
        "push_force": np.array([0.0, 500.0 * pushed, 0.0]),
    }


def write_imitation(path: Path) -> dict[float, CaptureRegions]:
    """Writes the replay of the imitated walk; returns the capture regions.

    They are drawn in every frame: twice as often as in a simulation.
    """
    meshcat = scene.start_meshcat()[0]
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
    Parser(plant).AddModels(str(URDF))
    plant.Finalize()
    scene.add_robot_view(builder, scene_graph, meshcat)
    stones = [square(f"{n}", n * STEP_LENGTH, 0.13) for n in (2, 4)]
    ground = Ground(tuple(stones), SOLE)
    visualizer = builder.AddSystem(BalanceVisualizer(meshcat, SOLE, ground))
    params = capture_region.CaptureRegionStepAdjusterParams()
    adjuster = CaptureRegionStepAdjuster(params, MODEL, period=0.002)
    builder.AddSystem(adjuster)
    connect(builder, adjuster, visualizer, "capture_regions")
    builder.ExportInput(visualizer.GetInputPort("walking_state"), "state")
    builder.ConnectInput("state", adjuster.GetInputPort("walking_state"))
    builder.ExportInput(visualizer.GetInputPort("icp"), "icp")
    builder.ConnectInput("icp", adjuster.GetInputPort("alip_icp"))
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    robot = plant.GetMyMutableContextFromRoot(root)
    inputs = visualizer.GetMyMutableContextFromRoot(root)
    pelvis = plant.GetBodyByName("PELVIS_LINK")
    scene.set_scene(meshcat)
    regions = {}

    def draw(time: float) -> None:
        root.SetTime(time)
        plant.SetFloatingBaseBodyPoseInWorldFrame(
            robot, pelvis, RigidTransform(com(time))
        )
        port = diagram.GetInputPort("state")
        port.FixValue(root, Value(walking_state(time)))
        diagram.GetInputPort("icp").FixValue(root, icp(time))
        for name, value in vectors(time).items():
            visualizer.GetInputPort(name).FixValue(inputs, value)
        diagram.ForcedPublish(root)
        port = adjuster.GetOutputPort("capture_regions")
        regions[time] = port.Eval(adjuster.GetMyContextFromRoot(root))

    start_recording(meshcat)
    diagram.ExecuteInitializationEvents(root)
    for frame in range(round(DURATION * scene.FRAMES_PER_SECOND) + 1):
        draw(frame / scene.FRAMES_PER_SECOND)
    write_replay(meshcat, path)
    return regions


@dataclass
class Replay:
    """A replay that is open in the browser."""

    page: Page
    regions: dict[float, CaptureRegions]  # that were drawn, by their times [s]
    requests: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    console: list[ConsoleMessage] = field(default_factory=list)

    def seek(self, time: float) -> None:
        """Shows the frame at `time` [s]."""
        self.page.evaluate(
            """(time) => {
              viewer.animator.pause();
              viewer.animator.seek(time);
              viewer.render();  // moves the camera, ...
              viewer.render();  // ... and draws what it sees
            }""",
            time,
        )

    def show(self, path: str, visible: bool) -> None:
        """Shows or hides all below `path`, in the next picture."""
        self.page.evaluate(
            """([path, visible]) => {
              const names = path.split("/").filter((name) => name);
              viewer.set_property(names, "visible", visible);
            }""",
            [path, visible],
        )

    def look_up(self, path: str, script: str):
        """What JavaScript finds out about the `node` at `path`."""
        names = json.dumps(path.split("/"))
        node = f"const node = viewer.scene_tree.find({names})"
        return self.page.evaluate(f"() => {{ {node}; return {script}; }}")

    def position(self, path: str) -> np.ndarray:
        """Where the browser has put the object at `path`, in W (3,) [m]."""
        return np.array(self.look_up(path, "node.object.position.toArray()"))

    def triangles(self, path: str) -> np.ndarray:
        """The triangles (n, 3, 3) [m] that are visible below `path`."""
        script = """Object.values(node.children)
          .filter((child) => child.object.visible)
          .flatMap((child) => {
            const {attributes, index} = (
                child.children["<object>"] ?? child).object.geometry;
            return Array.from(index.array).flatMap((i) =>
                Array.from(attributes.position.array).slice(3 * i, 3 * i + 3));
          })"""
        return np.array(self.look_up(path, script)).reshape(-1, 3, 3)

    def picture(self) -> np.ndarray:
        """A screenshot (height, width, 3)."""
        self.page.evaluate("viewer.render()")
        png = io.BytesIO(self.page.screenshot())
        return np.rint(255.0 * imread(png)[:, :, :3]).astype(int)


@pytest.fixture(scope="module")
def replay(browser: Browser, tmp_path_factory) -> Iterator[Replay]:
    """The replay, with every network blocked."""
    html = tmp_path_factory.mktemp("replay") / "replay.html"
    regions = write_imitation(html)
    assert html.stat().st_size <= 3.8 * MEGABYTE, "5 MB for ten seconds"
    size = {"width": 686, "height": 360}  # the scene has 480
    context = browser.new_context(viewport=size, offline=True)
    replay = Replay(context.new_page(), regions)
    page = replay.page
    page.on("request", lambda request: replay.requests.append(request.url))
    page.on("pageerror", lambda error: replay.errors.append(str(error)))
    page.on("console", lambda message: replay.console.append(message))
    page.goto(html.as_uri())
    page.wait_for_function("viewer.animator.duration > 0")
    yield replay
    context.close()


def changed_pixels(a: np.ndarray, b: np.ndarray) -> int:
    """How many pixels differ by more than the noise of a gradient."""
    return int(np.sum(np.max(np.abs(a - b), axis=2) > 12))


def test_the_replay_opens_offline_and_whole(replay):
    """Oracle: the browser asks for the file alone, and complains of nothing."""
    local = ("file:", "data:", "blob:")
    assert all(url.startswith(local) for url in replay.requests)
    complaints = [m.text for m in replay.console if m.type == "error"]
    assert replay.errors == complaints == []
    assert replay.page.evaluate("viewer.animator.duration") == DURATION
    legend = replay.page.inner_text("#legend")
    for name in (*palette.LEGEND, "foothold as adjusted"):
        assert name in legend


def test_all_that_is_drawn_is_seen(replay):
    """Oracle: control pictures of the same frame with the thing hidden.

    About half of the pixels that were counted when the picture was right; the
    points shine through the feet.
    """
    replay.seek(4.5)
    with_it = replay.picture()
    for path, pixels in {
        **{scene.ROBOT: 2200, "/overlay": 450, "/Floor": 11_000},
        **{f"/overlay/{name}": 8 for name in PARTS},
    }.items():
        replay.show(path, False)
        assert changed_pixels(with_it, replay.picture()) > pixels, path
        replay.show(path, True)
    assert changed_pixels(with_it, replay.picture()) == 0


@pytest.mark.parametrize("time", [0.0, 3.25, DURATION])
def test_the_overlay_moves_with_time(replay, time):
    """Oracle: the made-up trajectories, at the times of frames."""
    replay.seek(time)
    given, footsteps = vectors(time), walking_state(time).schedule.footsteps
    for name, expected in {
        "com": com(time),
        "com_ground": [*com(time)[:2], 0.0],
        "icp": [*icp(time), 0.0],
        "icp_reference": [*given["icp_reference"][:2], 0.0],
        "cop": [*given["ecmp_command"][:2], 0.0],
        "ecmp": [*given["ecmp_command"][2:], 0.0],
        f"footsteps/{footsteps[0].side.value}_0": footsteps[0].pose.p_WF,
        f"footsteps/{footsteps[2].side.value}_1": footsteps[2].pose.p_WF,
    }.items():
        p_W = replay.position(f"overlay/{name}")
        assert p_W == pytest.approx(np.array(expected), abs=1e-6), name


def drawn(replay: Replay, name: str) -> tuple[Polygon, float]:
    """What is painted, in plan view, and how much of it twice [m^2]."""
    painted = replay.triangles(f"overlay/{name}")
    turns = np.cross(*np.diff(painted, axis=1).transpose(1, 0, 2))
    # The outline of an edge that is shorter than its width is folded.
    assert (turns[:, 2] > -2.0 * LINE**2).all(), "seen from above"
    triangles = [Polygon(corners[:, :2]) for corners in painted]
    whole = union_all(triangles)
    return whole, sum(t.area for t in triangles) - whole.area


@pytest.mark.parametrize("time", [3.5, 3.875])
def test_regions_are_filled_up_to_a_circle_about_the_stance_foot(replay, time):
    """Oracle: shapely; corners that move by less than 5 mm are not redrawn."""
    replay.seek(time)
    expected = replay.regions[time]
    stance = foot(int(time))[1].p_WF[:2]
    assert len(expected.regions) >= 2
    for i, region in enumerate(expected.regions[:3], start=1):
        shape, twice = drawn(replay, f"capture_regions/c_{i}")
        near = Polygon(region) & Point(stance).buffer(RADIUS)
        off = 0.01 * near.length + 0.02 * near.area
        assert shape.symmetric_difference(near).area < off
        assert twice == pytest.approx(LINE * near.length, rel=0.1)
    line, twice = drawn(replay, "capture_regions/reach")
    ring = Polygon(expected.reach)
    assert line.within(ring.exterior.buffer(3.0 * LINE))
    assert line.area == pytest.approx(LINE * ring.length, rel=0.1)
    landing = replay.position("overlay/capture_regions/nominal")
    assert landing == pytest.approx(nominal(int(time) + 1).pose.p_WF, abs=1e-6)


def test_draws_nothing_that_is_not_connected_nor_of_a_run_before():
    """Oracle: Drake's own Meshcat, which packs false as 0xc2."""
    meshcat = scene.start_meshcat()[0]
    visualizer = BalanceVisualizer(meshcat, SOLE)
    for time in 3.5, 7.5:
        context = asked(visualizer, walking_state=walking_state(time))
        visualizer.ExecuteInitializationEvents(context)
        visualizer.ForcedPublish(context)
        paths = [f"{FOOTPRINTS}/{foot(n)[0].value}_{n}" for n in range(9)]
        prints = [n for n, path in enumerate(paths) if meshcat.HasPath(path)]
        assert prints == [int(time)], "the other foot is in the air"
    for name in ("icp", "icp_reference", "cop", "ecmp", "com", "push"):
        packed = meshcat._GetPackedProperty(f"/overlay/{name}", "visible")
        assert packed.endswith(b"\xc2"), name
