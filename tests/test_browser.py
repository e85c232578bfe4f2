"""The replay in a real browser: offline, small, and with everything to see.

A kinematic imitation of a walk takes the place of a simulation: it draws the
same robot through the same visualizers, in a fraction of a second.
"""

import io
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from playwright.sync_api import Browser, Page
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from nadia_balance.core.swing_geometry import CaptureRegionStepAdjusterParams
from nadia_balance.core.walking import (
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
from nadia_balance.results.folder import start_recording, write_replay
from nadia_balance.results.replay_page import replay_status
from nadia_balance.results.scene import (
    FRAMES_PER_SECOND,
    ROBOT,
    add_robot_view,
    set_scene,
    start_meshcat,
)
from nadia_balance.results.story import telling
from nadia_balance.systems.balance_visualizer import MIDDLE, BalanceVisualizer
from nadia_balance.systems.capture_region_step_adjuster import (
    CaptureRegionStepAdjuster,
)
from nadia_balance.systems.ports import connect
from tests.example_walks import MODEL, SOLE
from tests.results.made_up_run import Recipe, make_log, summary_of

URDF = Path(__file__).parents[1] / "models" / "nadia" / "nadia.urdf"
DURATION, STEP_LENGTH, TRANSFER, SWING = 10.0, 0.2, 0.3, 0.7  # [s], [m]
PUSH = (4.2, 4.3)  # [s]
MEGABYTE = 1e6
PARTS = (
    *("footprints", "footsteps", "support_polygon"),
    *("icp", "icp_reference", "com", "com_ground", "cop", "ecmp"),
    *("capture_regions/c_1", "capture_regions/c_2", "capture_regions/c_3"),
    *("capture_regions/reach", "capture_regions/nominal"),
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
    feet = FootPoses(landed, landed).with_foot(side.other, foot(taken - 1)[1])
    swings = clock >= TRANSFER
    schedule = ContactSchedule(
        Phase.SWING if swings else Phase.TRANSFER,
        side,
        SWING if swings else TRANSFER,
        feet,
        tuple(Footstep(*foot(taken + i), TRANSFER, SWING) for i in range(1, 5)),
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
        adjustment=Adjustment(nominal(taken + 1), schedule.footsteps[0].pose),
    )


def nominal(step: int) -> Footstep:
    """Where this step was to land: farther out."""
    side, pose = foot(step)
    out = np.array([0.0, 0.2 * side.sign, 0.0])
    return Footstep(side, FootPose(pose.p_WF + out), TRANSFER, SWING)


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


def legs(plant, context, time: float) -> None:
    """Bends the knee of the foot in the air."""
    clock = time - int(time)
    lift = 0.6 * math.sin(math.pi * max(0.0, clock - TRANSFER) / SWING)
    swing = foot(int(time) + 1)[0]
    for side in Side:
        bend = lift if side is swing else 0.0
        for joint, angle in (
            ("HIP_Y", -0.35 - 0.5 * bend),
            ("KNEE_Y", 0.7 + bend),
            ("ANKLE_Y", -0.35 - 0.5 * bend),
        ):
            name = f"{side.name}_{joint}"
            plant.GetJointByName(name).set_angle(context, angle)


def write_imitation(path: Path) -> None:
    """Writes the replay of the imitated walk.

    With capture regions in every frame: twice as often as in a simulation.
    """
    meshcat = start_meshcat()[0]
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.001)
    Parser(plant).AddModels(str(URDF))
    plant.Finalize()
    add_robot_view(builder, scene_graph, meshcat)
    visualizer = builder.AddSystem(BalanceVisualizer(meshcat, SOLE))
    adjuster = builder.AddSystem(
        CaptureRegionStepAdjuster(
            CaptureRegionStepAdjusterParams(), MODEL, period=0.002
        )
    )
    connect(builder, adjuster, visualizer, "capture_regions")
    builder.ExportInput(visualizer.GetInputPort("walking_state"), "state")
    builder.ConnectInput("state", adjuster.GetInputPort("walking_state"))
    builder.ExportInput(visualizer.GetInputPort("icp"), "icp")
    builder.ConnectInput("icp", adjuster.GetInputPort("icp"))
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    robot = plant.GetMyMutableContextFromRoot(root)
    inputs = visualizer.GetMyMutableContextFromRoot(root)
    pelvis = plant.GetBodyByName("PELVIS_LINK")
    set_scene(meshcat)
    start_recording(meshcat)
    diagram.ExecuteInitializationEvents(root)
    for frame in range(round(DURATION * FRAMES_PER_SECOND) + 1):
        time = frame / FRAMES_PER_SECOND
        root.SetTime(time)
        plant.SetFloatingBaseBodyPoseInWorldFrame(
            robot, pelvis, RigidTransform(com(time))
        )
        legs(plant, robot, time)
        port = diagram.GetInputPort("state")
        port.FixValue(root, Value(walking_state(time)))
        diagram.GetInputPort("icp").FixValue(root, icp(time))
        for name, value in vectors(time).items():
            visualizer.GetInputPort(name).FixValue(inputs, value)
        diagram.ForcedPublish(root)
    write_replay(meshcat, path)


@dataclass
class Replay:
    """A replay that is open in the browser."""

    page: Page
    requests: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)

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
        """Shows or hides all below `path`."""
        self.page.evaluate(
            """([path, visible]) => {
              const names = path.split("/").filter((name) => name);
              viewer.set_property(names, "visible", visible);
              viewer.render();
            }""",
            [path, visible],
        )

    def position(self, path: str) -> np.ndarray:
        """Where the browser has put the object at `path`, in W (3,) [m]."""
        script = """(path) => {
          const names = path.split("/").filter((name) => name);
          return viewer.scene_tree.find(names).object.position.toArray();
        }"""
        return np.array(self.page.evaluate(script, path))

    def picture(self) -> np.ndarray:
        """A screenshot (height, width, 3)."""
        png = io.BytesIO(self.page.screenshot())
        return np.rint(255.0 * imread(png)[:, :, :3]).astype(int)


@pytest.fixture(scope="module")
def html(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("replay") / "replay.html"
    write_imitation(path)
    return path


@pytest.fixture(scope="module")
def replay(browser: Browser, html: Path) -> Iterator[Replay]:
    """The replay, with every network blocked."""
    context = browser.new_context(
        viewport={"width": 640, "height": 480}, offline=True
    )
    replay = Replay(context.new_page())
    page = replay.page
    page.on("request", lambda request: replay.requests.append(request.url))
    page.on("pageerror", lambda error: replay.errors.append(str(error)))
    page.on(
        "console",
        lambda message: (
            replay.errors.append(message.text)
            if message.type == "error"
            else None
        ),
    )
    page.goto(html.as_uri())
    page.wait_for_function("viewer.animator.duration > 0")
    yield replay
    context.close()


def changed_pixels(a: np.ndarray, b: np.ndarray) -> int:
    """How many pixels differ by more than the noise of a gradient."""
    return int(np.sum(np.max(np.abs(a - b), axis=2) > 12))


def test_ten_seconds_are_no_more_than_five_megabytes(html):
    assert html.stat().st_size <= 5.0 * MEGABYTE


def test_the_replay_opens_offline_and_whole(replay):
    """Oracle: the browser asks for the file alone, and complains of nothing."""
    remote = [
        url
        for url in replay.requests
        if not url.startswith(("file:", "data:", "blob:"))
    ]
    assert remote == []
    assert replay.errors == []
    assert replay.page.evaluate("viewer.animator.duration") == DURATION


def test_all_that_is_drawn_is_seen(replay):
    """Oracle: control pictures of the same frame with the thing hidden.

    About half of the pixels that were counted when the picture was right; the
    points shine through the feet.
    """
    replay.seek(8.5)
    with_it = replay.picture()
    for path, pixels in {
        **{ROBOT: 4000, "/overlay": 800, "/Floor": 20_000},
        **{f"/overlay/{name}": 15 for name in PARTS},
    }.items():
        replay.show(path, False)
        assert changed_pixels(with_it, replay.picture()) > pixels, path
        replay.show(path, True)
    assert changed_pixels(with_it, replay.picture()) == 0


@pytest.mark.parametrize("time", [0.0, 3.25, 10.0])
def test_the_overlay_moves_with_time(replay, time):
    """Oracle: the made-up trajectories, at the times of frames."""
    replay.seek(time)
    assert replay.position("/overlay/icp")[:2] == pytest.approx(
        icp(time), abs=1e-6
    )
    assert replay.position("/overlay/com") == pytest.approx(com(time), abs=1e-6)
    first = foot(int(time) + 1)
    path = f"/overlay/footsteps/{first[0].value}_0"
    assert replay.position(path) == pytest.approx(first[1].p_WF, abs=1e-6)


def arrow_pixels(replay, time):
    replay.seek(time)
    arrow = "viewer.scene_tree.find(['overlay', 'push']).object.scale"
    pictures = []
    for scale in (0, 1):
        replay.page.evaluate(f"{arrow}.setScalar({scale}); viewer.render()")
        pictures.append(replay.picture())
    return changed_pixels(*pictures)


def test_the_push_is_seen_long_enough_and_not_before(replay):
    """Oracle: pushed from 4.2 to 4.3 s; the arrow lingers for half a second."""
    pixels = [arrow_pixels(replay, t) for t in (0.0, 4.0, 4.25, 4.7, 5.5)]
    assert [n > 200 for n in pixels] == [False, False, True, True, False]


def test_footprints_stay_and_future_ones_are_hidden(replay):
    """Oracle: at 4.5 s steps -1 to 4 have landed, 5 to 10 have not."""
    replay.seek(4.5)
    visible = replay.page.evaluate(
        """() => Object.entries(
             viewer.scene_tree.find(["overlay", "footprints"]).children)
           .filter(([name, node]) => node.object.visible)
           .map(([name, node]) => name)"""
    )
    expected = [f"{foot(n)[0].value}_{n}" for n in range(-1, 5)]
    assert sorted(visible) == sorted(expected)


def test_the_camera_follows_the_walk(replay):
    """Oracle: the robot walks 1.8 m; the view lags by the dead band at most."""
    targets = []
    for time in (0.0, 9.0):
        replay.seek(time)
        target = replay.page.evaluate("viewer.controls.target.toArray()")
        targets.append(np.array(target))
    way = com(9.0)[0] - com(0.0)[0]
    moved = targets[1] - targets[0]
    assert moved[0] == pytest.approx(way, abs=0.31)
    assert abs(moved[1]) < 1e-9, "the height stays"


def test_the_legend_names_what_is_drawn(replay):
    text = replay.page.inner_text("#legend")
    for name in ("ICP", "CoM", "CoP", "eCMP", "left foot", "push", "C₁"):
        assert name in text


def test_the_page_tells_the_time_and_begins_again(browser, tmp_path):
    """Oracle: the story of the made-up run, and the viewer's own clock."""
    meshcat, path = start_meshcat()[0], tmp_path / "replay.html"
    start_recording(meshcat)
    log = make_log(Recipe())
    summary = summary_of(log)
    end, _ = telling(log, summary)[-1]
    for time in (0.0, end + 1.0):
        meshcat.SetTransform(MIDDLE, RigidTransform([time, 0.0, 0.0]), time)
    write_replay(meshcat, path, replay_status(log, summary))
    page = browser.new_page(offline=True)
    page.goto(path.as_uri())
    page.wait_for_function("viewer.animator.duration > 0")
    for time, seen in ((end - 0.1, False), (end + 0.5, True)):
        page.evaluate(
            "(t) => { viewer.animator.pause(); viewer.animator.seek(t); }",
            time,
        )
        clock = f"t = {time:.2f} s"
        page.wait_for_function(
            "(t) => document.body.innerText.includes(t)", arg=clock
        )
        assert ("RECOVERED" in page.inner_text("#status")) == seen
    page.evaluate("viewer.animator.play()")
    page.wait_for_function(
        "(t) => viewer.animator.playing && viewer.animator.time < t", arg=end
    )
    page.close()
