"""Each script in examples/ is short, runs, and does what it says."""

import ast
import contextlib
import csv
import io
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

import nadia_balance as nb
from nadia_balance.diagrams.lipm import LipmDiagram
from nadia_balance.robot.plants import actuators
from tests import run_cache
from tests.onnx_bytes import linear_policy
from tests.scripts.running import ended, python
from tests.source_files import ROOT, imports

EXAMPLES = {path.stem: path for path in sorted(ROOT.glob("examples/*.py"))}
NADIA = nb.load_robot("nadia")


def said_by(name: str, code: str, *argv: str) -> list[str]:
    """The lines that an example prints."""
    said = io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(said),
    ):
        patch.setattr(sys, "argv", [name, *argv])
        exec(compile(code, name, "exec"), {"__name__": "__main__"})
    return said.getvalue().splitlines()


def printed(name: str, *argv: str, acts: str = "", idles: str = "") -> list:
    """The same, made once; with `idles` in the place of what `acts`."""
    code = EXAMPLES[name].read_text("utf-8")
    assert acts in code
    code = code.replace(acts, idles) if acts else code
    return run_cache.once(
        f"examples.{name}", code, lambda: said_by(name, code, *argv)
    )


def test_there_are_eleven_of_40_lines_that_a_page_tells():
    """Oracles: the files; the first sentence of each, in docs/examples.md."""
    page = (ROOT / "docs" / "examples.md").read_text("utf-8")
    assert len(EXAMPLES) == 11
    for name, path in EXAMPLES.items():
        code = path.read_text("utf-8")
        assert len(code.splitlines()) <= 40, name
        told, _, _ = ast.get_docstring(ast.parse(code)).partition("\n\n")
        assert told in " ".join(page.split()), name
        assert f"(../examples/{name}.py)" in page


def test_a_diagram_needs_neither_our_diagrams_nor_scripts():
    """Oracle: the pelvis is up, the ICP where it is planned, the push done.

    In a process of its own, which has no `diagrams` and no `scripts`.
    """
    code = EXAMPLES["own_diagram"].read_text("utf-8")
    packages = {name.split(".")[0] for name in imports(ast.parse(code))}
    assert packages == {"nadia_balance", "pydrake"}
    blocked = [
        f"{prefix}{name}"
        for prefix in ("", "nadia_balance.")
        for name in ("diagrams", "scripts")
    ]
    code = f"""
import json, sys
sys.modules.update(dict.fromkeys({blocked}))
{code}
from nadia_balance.systems.signals import PushSignal
root = simulator.get_context()
def value(system, port):
    context = system.GetMyContextFromRoot(root)
    return system.GetOutputPort(port).Eval(context).tolist()
print(json.dumps({{
    "started": robot.standing_positions()[6],
    "icp": value(controller, "icp"),
    "planned": value(controller, "icp_reference")[:2],
    "waiting": PushSignal(value(push, "push_signal")).waiting,
}}))
"""

    def run() -> list[str]:
        return ended(python("-c", code)).out

    height, line = run_cache.once("examples.own_diagram", code, run)
    measured = json.loads(line)
    height = float(height.removeprefix("pelvis at ").removesuffix(" m"))
    assert height == pytest.approx(measured["started"], abs=0.02)
    assert measured["icp"] == pytest.approx(measured["planned"], abs=0.02)
    assert measured["waiting"] == 0.0


def test_a_block_of_ones_own_keeps_the_robot_on_its_feet():
    """Oracle: it falls if the block is idle."""
    assert printed("own_block") == ["It keeps its feet."]
    idle = printed("own_block", acts="step_adjuster=mine")
    assert idle == ["pelvis too low"]


def test_a_task_of_ones_own_bends_the_elbow():
    """Oracle: the angle that it wants; without it the posture's."""
    posture = NADIA.params.posture["LEFT_ELBOW_Y"]
    assert abs(posture + 1.2) > 0.3
    for idles, angle in {"": -1.2, "tasks=[]": posture}.items():
        acts = "tasks=[mine]" if idles else ""
        (line,) = printed("own_task", acts=acts, idles=idles)
        bend = float(line.removeprefix("elbow at ").removesuffix(" rad"))
        assert bend == pytest.approx(angle, abs=0.02)


def test_a_robot_of_ones_own_is_pushed():
    """Oracle: the G1 of models, which was made of the same URDF."""
    *_, size, outcome = printed("own_robot")
    g1 = nb.load_robot("g1")
    assert size.startswith(f"{g1.mass:.1f} kg")
    assert outcome == "recovered"


def test_pushes_of_ones_own_have_their_impulses():
    """Oracle: 2 / pi of peak and time for a half sine; mass times delta_v."""
    first, second, outcome = printed("own_push")
    halfsine = 2.0 / math.pi * 60.0 * 0.6
    assert first == f"t=1.00 s: {halfsine:.1f} N s"
    assert second == f"t=2.00 s: {NADIA.mass * 0.1:.1f} N s"
    assert outcome == "recovered"


def test_a_point_mass_tells_its_steps():
    """Oracle: F = m delta_v / 0.1 s; the outcome without the printed story."""
    first, *_, last = printed("point_mass")
    assert "push 0.60 m/s outward" in first
    assert f"F = {NADIA.mass * 0.6 / 0.1:.0f} N" in first
    assert "RECOVERED in 2 steps" in last


def test_a_sweep_finds_the_largest_push():
    """Oracle: single runs at the limit, and one resolution beyond it."""
    lines = [line.split() for line in printed("sweep")]
    assert [line[0] for line in lines] == ["icp_only"] * 2 + ["step"] * 2
    limits = {(line[0], line[1]): float(line[3]) for line in lines}
    assert limits["step", "270"] > limits["icp_only", "270"]

    def outcome(delta_v: float) -> str:
        scenario = nb.load_scenario("push", mechanisms="icp_only")
        scenario = scenario.with_push("outward", delta_v)
        return nb.simulate(LipmDiagram(scenario)).summary["outcome"]

    limit = limits["icp_only", "270"]
    assert outcome(limit) == "recovered"
    assert outcome(limit + 0.1) == "failed"


def test_a_log_becomes_a_table(tmp_path):
    """Oracles: by hand: ticks of 4 ms, the CoM's height, one step."""
    path, name = tmp_path / "push.csv", "log_to_csv"

    def run() -> str:
        code = EXAMPLES[name].read_text("utf-8")
        (line,) = said_by(name, code, str(path))
        assert line.startswith(f"wrote {path}: ")
        return path.read_text()

    text = run_cache.once(f"examples.{name}", "the file", run)
    rows = list(csv.DictReader(io.StringIO(text)))
    columns = {name: [float(row[name]) for row in rows] for name in rows[0]}
    assert columns["t"] == pytest.approx(0.004 * np.arange(751))
    height = NADIA.point_mass.com_height
    assert columns["com_height"] == pytest.approx([height] * 751, abs=0.03)
    assert [columns["steps_taken"][row] for row in (0, -1)] == [0.0, 1.0]


def test_springs_hold_a_standing_robot_and_no_more():
    """Oracle: it falls without their torques."""
    assert printed("null_controller") == ["It keeps its feet."]
    idle = {"acts": "10.0 * self.most", "idles": "0.0 * self.most"}
    assert printed("null_controller", **idle) == ["pelvis too low"]


def test_a_policy_takes_the_place_of_the_controller(tmp_path):
    """Oracle: springs alone, an action of 0, do not keep a robot upright."""
    plant = nb.load_robot("g1").control_plant()
    names = [drive.joint().name() for drive in actuators(plant)]
    n = len(names)
    network = linear_policy(
        np.zeros((n, 3 * n + 13)),
        np.zeros(n),
        dof_names=names,
        kp=[200.0] * n,
        kd=[5.0] * n,
    )
    path = Path(tmp_path / "policy.onnx")
    path.write_bytes(network)
    assert printed("policy", str(path)) == ["pelvis too low"]


def test_an_estimate_takes_the_place_of_the_state():
    """Oracle: a consistent filter: the NEES of nine errors is 9 on average."""
    outcome, *errors = printed("sensors")
    assert outcome == "recovered"
    estimate = dict(line.split(": ") for line in errors)
    assert 0.0 < float(estimate["rms_velocity_m_s"]) < 0.02
    assert 3.0 < float(estimate["mean_nees"]) < 27.0
