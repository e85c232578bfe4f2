"""The whole robot, closed loop: stands, walks, recovers; exactly repeatable.

All by ankles and hips alone (icp_only), on Nadia.
"""

import hashlib
import math
from importlib.metadata import version

import numpy as np
import pytest
from pydrake.multibody import plant as mbp

from nadia_balance.core.math.lipm import GRAVITY
from nadia_balance.core.walking.mechanisms import LABELS
from nadia_balance.core.walking.state import Phase, Side
from nadia_balance.diagrams.humanoid import HumanoidDiagram
from nadia_balance.diagrams.simulation import advance, start
from nadia_balance.results.log import signal_view
from nadia_balance.systems.signals import PHASES
from nadia_balance.view.live_controls import PUSH, SIZE
from nadia_balance.view.scene import GHOST, start_meshcat
from tests import run_cache, source_files
from tests.blocks import answer
from tests.clicks import click
from tests.diagrams import simulated as runs
from tests.results.made_up_run import cut
from tests.scripts.running import ended, environment, python
from tests.whole_body_examples import make_infeasible

SWING = PHASES.index(Phase.SWING)
STANDS = "{duration: 0.8}", "{duration: 0.8, engine: mujoco}"
# Forward, then to the left, backward, and turned; then the feet close up.
STEPS = "[{length: 0.3}, {length: -0.2, sideways: 0.1, yaw_deg: 15.0}]"
WALK = f"{{duration: 3.7, {runs.EARLY % f'steps: {STEPS}'}}}"


def pushed(side, direction, duration=1.6):
    """Pushed at 25 % of the first swing; ends soon after the next begins."""
    return (
        f"{{duration: {duration}, {runs.SOON % side}, "
        f"pushes: [{{delta_v: 0.2, at: {side} swing 25 %, "
        f"direction_deg: {direction}}}]}}"
    )


def once(text, make):
    """What `make` returns of this scenario; made once, see run_cache."""
    given = runs.all_of(runs.scenario_of(text), make.__name__)
    return run_cache.once(__name__, given, make)


@pytest.mark.parametrize("text", STANDS)
def test_stands_still_on_the_commanded_wrenches(text):
    """Oracles: gravity; the engine's contact forces about each sole centre.

    0.5 N m at 446 N move the centre of pressure by 1 mm, as much as the ICP
    may be away from its point.
    """

    def stood():
        diagram = runs.diagram_of(text)
        simulator = start(diagram)
        run = advance(simulator, 0.8)
        plant, engine = diagram.plant, diagram.engine
        own = engine.GetMyContextFromRoot(simulator.get_context())
        names = "contact_results", "state"
        results, state = (answer(engine, own, name) for name in names)
        context = plant.CreateDefaultContext()
        plant.SetPositionsAndVelocities(context, state)
        measured = []
        for side in Side:
            body = plant.GetBodyByName(diagram.robot.foot_bodies[side])
            X_WF = body.EvalPoseInWorld(context)
            p_WF = (X_WF @ diagram.robot.X_FootSole[side]).translation()
            measured.append(measured_wrench(results, body, p_WF))
        return run, measured, diagram.robot.mass * GRAVITY

    run, measured, weight = once(text, stood)
    logs, found = run.logs, run.summary
    assert found["recovered"]
    assert found["max_icp_error_m"] < 0.001
    assert found["stance_slip_m"] < 1e-5
    commanded = logs["foot_wrenches"][-1].reshape(2, 6)
    for forces in (logs["foot_forces"][-1], commanded[:, 5]):
        assert np.sum(forces) == pytest.approx(weight, rel=1e-3)
    for by_engine, wrench in zip(measured, commanded, strict=True):
        assert by_engine[:3] == pytest.approx(wrench[:3], abs=0.5)
        assert by_engine[3:] == pytest.approx(wrench[3:], abs=2.0)


def measured_wrench(results: mbp.ContactResults, body, p_WF) -> np.ndarray:
    """[moment about p_WF, force] (6,) of all contacts on `body`, in W."""
    total = np.zeros(6)
    for i in range(results.num_point_pair_contacts()):
        contact = results.point_pair_contact_info(i)
        on_A, on_B = contact.bodyA_index(), contact.bodyB_index()
        if body.index() in (on_A, on_B):  # the force is that on body B
            sign = 1.0 if body.index() == on_B else -1.0
            force = sign * contact.contact_force()
            arm = contact.contact_point() - p_WF
            total += np.concatenate([np.cross(arm, force), force])
    return total


@pytest.mark.parametrize("height", [0.3, 0.9])
def test_what_touches_is_seen_in_the_shapes_alone(height):
    """Oracle: Drake's contact results, in postures at random."""
    diagram = runs.diagram_of(STANDS[0])
    plant, robot, several = diagram.plant, diagram.robot, set()
    root = diagram.CreateDefaultContext()
    own = plant.GetMyMutableContextFromRoot(root)
    rng = np.random.default_rng(0)
    for _ in range(5):
        q = robot.standing_positions()
        q[7:] += rng.uniform(-1.0, 1.0, q.size - 7)
        q[6] = height
        plant.SetPositions(own, q)
        results = plant.get_contact_results_output_port().Eval(own)
        improper = robot.improper_contacts(plant, results)
        assert diagram.improper_contacts(root) == improper
        several |= improper
    assert len(several) > 1


def test_walks_where_it_is_told():
    """Oracle: the footholds, and the bars: 2 cm beside them, 5 mm of slip.

    A foot lands with at most 1.5 body weights in a tick, and 0.1 m/s along the
    ground.
    """
    run = runs.simulated(WALK)
    landed = signal_view(run.logs, "touchdowns")
    assert landed.time.size == 3
    assert landed.speed_along.max() <= 0.1
    found = run.summary
    assert found["max_impact_body_weights"] <= 1.5
    assert found["recovered"]
    assert found["steps_taken"] == 3
    assert found["footstep_error_m"] < 0.02
    assert found["stance_slip_m"] < 0.005
    assert found["max_icp_error_m"] < 0.008
    assert found["qp_failures"] == 0


@pytest.mark.parametrize(("degrees", "impulse"), [(0, 28), (180, 28), (90, 35)])
def test_takes_a_shove_without_a_step(degrees, impulse):
    """Oracle: the bar of the project [N s], in 0.1 s at the pelvis."""
    text = (
        f"{{duration: 1.3, pushes: [{{force: {10 * impulse}, at: 0.1 s, "
        f"direction_deg: {degrees}}}]}}"
    )
    found = runs.simulated(text).summary
    assert found["recovered"]
    assert found["steps_taken"] == 0
    assert found["max_icp_error_m"] > 0.06


def test_without_solutions_it_goes_down_softly(monkeypatch):
    """Oracles: the summary; half of the joints' speed limits.

    No force is at least 1 and at most -1, from 0.6 s on.
    """

    def fell():
        diagram = runs.diagram_of()
        simulator = start(diagram)
        simulator.AdvanceTo(0.6)
        make_infeasible(monkeypatch)
        return advance(simulator, 3.0).summary

    found = once("{}", fell)
    assert found["reason"] == "fell: pelvis too low, the controller gave up"
    assert found["max_joint_speed_ratio"] < 0.5
    assert found["max_impact_body_weights"] < 4.0


def test_the_mirrored_shove_gives_the_mirrored_path():
    """Oracle: the mirror image of the ICP's path, within 3 mm.

    Nadia is not quite symmetric: the right arm is weaker, two links differ,
    and standing the pelvis is 0.3 mm beside the middle.  That makes 0.1 mm, and
    may make a foot land a control period sooner, when the ICP is moving at
    0.5 m/s: another millimetre for each of its landings.
    """
    right, left = (
        runs.simulated(pushed(side, direction)).logs
        for side, direction in (("right", 90.0), ("left", -90.0))
    )
    mirror = np.array([1.0, -1.0])
    apart = np.abs(right["icp"] - left["icp"] * mirror)
    assert np.ptp(right["icp"][:, 1]) > 0.2
    assert np.max(apart) < 3e-3
    assert np.mean(apart) < 1e-4
    phases = [signal_view(log, "walking_signal").phase for log in (right, left)]
    assert len(np.unique(phases[0])) == 3
    assert np.count_nonzero(phases[0] != phases[1]) <= 4  # of 4 changes


BEGUN = 0.8  # a push has come by then [s]
REPEATED = pushed("right", 90.0, BEGUN)


def digest(logs) -> str:
    """A fingerprint of every bit of every array.

    Touchdowns are not told before some time has passed: they are from the rest.
    """
    found = hashlib.sha256()
    for name in sorted({*logs} - {"touchdowns"}):
        values = np.ascontiguousarray(logs[name])
        found.update(f"{name} {values.dtype} {values.shape}".encode())
        found.update(values.tobytes())
    return found.hexdigest()


def test_another_process_gives_the_same_bits():
    """Oracle: the digest of all logs; Python hashes differently there.

    Of our modules, a run has loaded no other ones than its key has read.
    """
    script = """
import sys
from tests.diagrams import simulated
run = simulated.simulated(sys.argv[1])
print(*(name for name in sys.modules if name.startswith("nadia_balance.")))
from tests.diagrams.test_humanoid import digest
print(digest(run.logs))
"""

    def printed() -> list[str]:
        env = environment() | {"PYTHONHASHSEED": "17"}
        return ended(python("-c", script, REPEATED, env=env)).out

    loaded, line = once(REPEATED, printed)
    logs = runs.simulated(pushed("right", 90.0)).logs
    rows = np.count_nonzero(logs["t"] <= BEGUN + 1e-9)
    assert signal_view(logs, "push_signal").force[:, :rows].any()
    assert line == digest(cut(logs, rows))
    files = source_files.module_files()
    ours = {files[name] for name in loaded.split() if name in files}
    packages = {path for path in ours if path.name == "__init__.py"}
    assert len(ours) > 50
    assert ours - packages <= source_files.reached(runs.__name__)


def test_clicks_do_what_the_scenario_would():
    """Oracle: the bits of a run with all mechanisms and without Meshcat.

    Push is clicked before 0.6 s, and the blocks see it a tick after.  The mouse
    acts, too, from Drake 1.57 on.
    """
    text = f"{{mechanisms: %s, duration: 1.05, {runs.SOON % 'right'}%s}}"

    def run():
        meshcat = start_meshcat()[0]
        off = runs.scenario_of(text % ("icp_only", ""))
        diagram = HumanoidDiagram(off, meshcat)
        kind = mbp.ExternallyAppliedSpatialForceMultiplexer
        adding = [one for one in diagram.GetSystems() if isinstance(one, kind)]
        sums = [system.num_input_ports() for system in adding]
        simulator = start(diagram)
        simulator.Initialize()
        for label in LABELS.values():
            click(meshcat, f"{label}: off")
        simulator.AdvanceTo(0.59)
        meshcat.SetSliderValue(SIZE, 0.4)
        click(meshcat, PUSH)
        simulator.AdvanceTo(1.05)
        return diagram.read_logs(simulator.get_context()), sums

    clicked, sums = once(text % ("icp_only", ""), run)
    has_mouse = int(version("drake").split(".")[1]) >= 57
    assert sums == [1 + has_mouse]
    on = clicked["mechanisms"]
    assert not on[0].any() and on[clicked["t"] > 0.02].all()
    push = ", pushes: [{delta_v: 0.4, at: 0.602 s, direction_deg: 90.0}]"
    built = runs.simulated(text % ("all_with_cross_over", push)).logs
    of_push = signal_view(built, "push_signal").force
    assert np.array_equal(signal_view(clicked, "push_signal").force, of_push)
    rest = set(built) - {"mechanisms", "push_signal"}  # who waits for it
    kept, other = ({n: log[n] for n in rest} for log in (clicked, built))
    assert digest(kept) == digest(other)
    walking = signal_view(clicked, "walking_signal")
    footholds = walking.target[:2, walking.phase == SWING].T
    assert math.dist(footholds[0], footholds[-1]) > 0.1
    hurried = np.max(np.diff(walking.time_in_phase))
    assert hurried > 1.05 * 0.002


def test_a_ghost_is_where_the_robot_is_estimated_to_be():
    """Oracle: kinematics of the estimate; no ghost of a state that is true."""
    meshcat = start_meshcat()[0]
    scenario = runs.scenario_of("{sensors: consumer}")
    diagram = HumanoidDiagram(scenario, meshcat)
    simulator = start(diagram)
    simulator.Initialize()
    state, query = (
        answer(system, system.GetMyContextFromRoot(simulator.get_context()), it)
        for system, it in (
            (diagram.GetSubsystemByName("state_estimator"), "estimated_state"),
            (diagram.GetSubsystemByName("ghost"), "query"),
        )
    )
    plant = diagram.robot.control_plant()
    own = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(own, state)
    inspector = query.inspector()
    frames = {inspector.GetName(f): f for f in inspector.GetAllFrameIds()}
    for body in "PELVIS_LINK", "LEFT_FOOT_LINK", "TORSO_LINK":
        X_WB = plant.GetBodyByName(body).EvalPoseInWorld(own)
        found = query.GetPoseInWorld(frames[f"nadia::{body}"])
        assert found.IsNearlyEqualTo(X_WB, 1e-12)
    assert meshcat.HasPath(f"{GHOST}/nadia/PELVIS_LINK")
    meshcat = start_meshcat()[0]
    start(HumanoidDiagram(runs.scenario_of(), meshcat)).Initialize()
    assert not meshcat.HasPath(GHOST)
