"""Blocks of a user's own in sweeps and runs, by the names of their classes.

The module is written anew for each test, from the page that shows it.
"""

import csv
import os
import re
import sys

import numpy as np
import pytest

import nadia_balance as nb
from nadia_balance.diagrams import own_blocks
from nadia_balance.diagrams.simulation import closed_loop
from nadia_balance.scripts import envelope, push, single_pushes
from nadia_balance.sweep.search import SearchParams
from nadia_balance.sweep.trials import Rows
from tests.scripts.running import (
    assert_refused,
    ended,
    environment,
    program,
    run_script,
    summary_of,
)
from tests.scripts.test_envelope import SWEEP, workers_here
from tests.source_files import ROOT

PAGE = (ROOT / "docs" / "own_blocks.md").read_text("utf-8")
EXAMPLE = (ROOT / "examples" / "own_block.py").read_text("utf-8")
ADJUSTER = EXAMPLE.partition("if __name__")[0]
CONTACTS = re.search(
    r"## A whole-body.*?```python\n(.*?)mine = ", PAGE, re.DOTALL
)[1]
OTHERS = """
import multiprocessing
import os

class Writes(ErrorStepAdjuster):
    def __init__(self, model):
        super().__init__(model)
        with open("makers.txt", "a") as file:
            file.write(f"{os.getpid()}\\n")

class OnlyHere(ErrorStepAdjuster):
    def __init__(self, model):
        if multiprocessing.parent_process():
            raise RuntimeError("not elsewhere")
        super().__init__(model)

class Bare(LeafSystem):
    pass


class Breaks(ErrorStepAdjuster):
    def calc(self, context, output):
        raise KeyError("no such foot")


class Exit(LeafSystem):
    def __init__(self):
        raise SystemExit(3)


class Greedy(ErrorStepAdjuster):
    def __init__(self, model, weather):
        super().__init__(model)

class Relaxed(LeafSystem):
    "It lets all joints go."
    def __init__(self, robot):
        super().__init__()
        plant = robot.control_plant()
        self.DeclareVectorInputPort(
            "estimated_state", plant.num_multibody_states()
        )
        self.DeclareVectorOutputPort(
            "actuation",
            plant.num_actuated_dofs(),
            lambda context, output: output.SetZero(),
        )
"""
MINE = "step_adjuster=mine:ErrorStepAdjuster"
FORWARD = [*SWEEP, "--directions", "0,"]


@pytest.fixture
def here(tmp_path, monkeypatch):
    """The present folder, with the module; cells run in this process."""
    (tmp_path / "mine.py").write_text(ADJUSTER + CONTACTS + OTHERS)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "mine", raising=False)
    yield tmp_path
    sys.modules.pop("mine", None)


def limits_in(folder) -> list[float]:
    rows = Rows.read(folder)
    return [r["delta_v"] for r in rows.all if r["outcome"] == "recovered"]


def point_mass_limit(folder) -> float:
    with open(folder / "limits.csv", encoding="utf-8") as file:
        return float(next(csv.DictReader(file))["limit"])


def test_a_sweep_takes_the_adjuster_of_the_page(here, capsys, monkeypatch):
    """Oracle: ankles alone recover from less; the table has both, the file one.

    Another code under the same name does not go on.
    """
    monkeypatch.setattr(envelope.run_trial, "open_workers", workers_here)
    flags = {"ours": [], "mine": ["--block", MINE, "--beside", "ours"]}
    for name, more in flags.items():
        argv = [*FORWARD, *more, "--out", name]
        outcome = run_script(envelope, argv, capsys)
        assert outcome.code == 0
    (head,) = (line for line in outcome.out if line.startswith("| direction"))
    assert head.split(" | ")[1:] == [f"icp_only, {MINE}", "beside: ours |"]
    largest = {name: max(limits_in(here / name)) for name in flags}
    assert largest["mine"] > largest["ours"] > 0.0
    (line,) = (line for line in outcome.out if re.match(r"\| +0 \|", line))
    told = [float(word) for word in re.findall(r"\d\.\d\d", line)]
    assert told == pytest.approx([largest["mine"], largest["ours"]])
    # The point mass may step if an adjuster of one's own might.
    limits = {name: point_mass_limit(here / name) for name in flags}
    assert limits["mine"] > limits["ours"]
    other = [*argv[:-1], "other", "--directions", "90,"]
    assert_refused(
        run_script(envelope, other, capsys),
        "beside = 'ours': must have a limit of the same scenario, moment and "
        "direction, with icp_only",
    )
    identity = Rows.read(here / "mine").identity
    name, digest = identity["block step_adjuster"].split(" ")
    assert (name, len(digest)) == ("mine:ErrorStepAdjuster", 16)
    (here / "mine.py").write_text(f"{ADJUSTER}{OTHERS}# other\n")
    outcome = run_script(envelope, argv, capsys)
    message = "block step_adjuster = mine:ErrorStepAdjuster "
    assert_refused(outcome, message)
    assert f"must be {name} {digest} as in" in outcome.err[0]
    outcome = run_script(envelope, [*FORWARD, "--out", "mine"], capsys)
    assert_refused(outcome, "block step_adjuster = None: must be mine:Err")


def test_each_worker_makes_its_own(here):
    """Oracles: the process that a block is made in; the sweep of the scripts.

    A class of this call's own module has no name for others.
    """
    text = SWEEP[SWEEP.index("--scenario_text") + 1]
    search = SearchParams(resolution=0.2, stride=2, replicas=2)
    kind = own_blocks.class_of("mine:Writes")
    call = {
        "directions": [0.0],
        "mechanisms": ["icp_only"],
        "plant": "lipm",
        "search": search,
        "workers": 1,
        "text": text,
        "duration": 3.5,
    }
    table = nb.envelope(here / "out", blocks={"step_adjuster": kind}, **call)
    (record,) = table.records
    assert record["complete"]
    assert record["recovered"] == max(limits_in(here / "out"))
    makers = {int(line) for line in (here / "makers.txt").read_text().split()}
    assert os.getpid() in makers and len(makers) == 2

    class Local(kind):
        pass

    Local.__module__ = "__main__"
    with pytest.raises(ValueError, match=r"^'__main__:Local': must be module"):
        nb.envelope(here / "no", blocks={"step_adjuster": Local}, **call)
    assert not (here / "no").exists()


def test_a_block_that_breaks_is_no_fall(here, capsys, monkeypatch):
    """Oracle: exit code 1, and Python's own words of its error."""
    monkeypatch.setattr(envelope.run_trial, "open_workers", workers_here)
    more = "--mechanisms", "step", "--block", "step_adjuster=mine:Breaks"
    outcome = run_script(envelope, [*FORWARD, *more, "--out", "out"], capsys)
    assert outcome.code == 1
    (line,) = (line for line in outcome.err if "error of a block" in line)
    assert "no such foot" in line


def test_a_worker_that_cannot_make_it_says_so(here):
    """Oracle: exit code 1, and one line with the class and its words."""
    more = "--block", "step_adjuster=mine:OnlyHere", "--workers", "1"
    argv = [*FORWARD, *more, "--out", "out"]
    outcome = ended(
        program("envelope", *argv, env=environment(), cwd=str(here))
    )
    (line,) = (line for line in outcome.err if "a worker failed" in line)
    assert outcome.code == 1
    assert "block step_adjuster = mine:OnlyHere: must be made" in line
    assert "(RuntimeError: not elsewhere)" in line


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--block", "mine:ErrorStepAdjuster"], "block = 'mine:ErrorStepAdjus"),
        (["--block", MINE, "--block", MINE], f"block = '{MINE}': must be role"),
        (["--block", "step_adjuster=no.mine:A"], "module no.mine: must be imp"),
        (["--block", "step_adjuster=mine:Adj"], "must be a class of the modul"),
        (["--block", "step_adjuster=mine:Greedy"], "must be made with some of"),
        (["--block", "step_adjuster=mine:Exit"], "must be made with some of"),
        (["--block", "step_adjuster=mine:Bare"], "must have the output port"),
        (["--block", "adjuster=mine:ErrorStepAdjuster"], "block = 'adjuster':"),
        (["--block", "momentum_qp=mine:ErrorStepAdjuster"], "must have the ou"),
        (["--block", "step_adjuster=os:PathLike"], "must be made with some of"),
        (["--beside", "nowhere"], "beside = 'nowhere': must have a limits.csv"),
        (["--controller", "mine:Relaxed"], "controller = 'mine:Relaxed': must"),
    ],
)
def test_what_is_not_there_is_refused_before(here, capsys, flags, message):
    """Oracle: exit code 2, one line; no folder is made."""
    outcome = run_script(envelope, [*FORWARD, *flags, "--out", "out"], capsys)
    assert outcome.code == 2
    (line,) = outcome.err
    assert message in line
    assert not (here / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"directions": []}, r"directions = \(\): must be one or more"),
        ({"directions": 0}, r"directions = 0: must be in \[1, 72\]"),
        ({"directions": [-90.0]}, r"directions = -90.0: must be in \[0, 360\)"),
        ({"directions": [np.nan]}, "directions.* = nan: must be"),
        ({"directions": [5.0, 5.0]}, "directions = .*: must be .* each once"),
        ({"directions": "12"}, "directions = '12': must be a list"),
        ({"mechanisms": "step"}, "mechanisms = 'step': must be a list"),
        ({"mechanisms": ["no"]}, "mechanisms = 'no': must be one of icp_only"),
        ({"at": None}, "at = None: must be a str"),
        ({"search": SearchParams(largest=500.0)}, "largest = 500.0: must be"),
        ({"search": SearchParams(largest=0.01)}, "largest = 0.01: must be >="),
        ({"search": SearchParams(replicas=2.5)}, "replicas = 2.5: must be an"),
        ({"blocks": {"icp_planner": 5}}, "5: must be a class, or its name"),
        ({"plant": "x"}, "plant = 'x': must be one of humanoid, lipm"),
    ],
)
def test_a_call_is_checked_before_anything_runs(tmp_path, arguments, message):
    """Oracle: the rules; no folder is made."""
    with pytest.raises(ValueError, match=f"^{message}"):
        nb.envelope(tmp_path / "out", **arguments)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("has_mine", [False, True])
def test_a_single_run_takes_it_too(here, capsys, has_mine):
    """Oracle: 0.45 m/s outward, from which ankles alone do not recover."""
    flags = ["--plant", "lipm", "--mechanisms", "icp_only", "--out", "run"]
    flags += ["--direction", "270", "--delta-v", "0.45"]
    flags += ["--block", MINE] if has_mine else []
    outcome = run_script(push, flags, capsys)
    summary = summary_of(here / "run")
    assert outcome.code == (0 if has_mine else 1), summary["reason"]
    own = ", step_adjuster=ErrorStepAdjuster"
    assert summary["mechanisms"] == f"icp_only{own if has_mine else ''}"
    argv = [*flags[:4], "--limits", "nadia_fig10", "--share", "0.5"]
    args = ["--block", MINE] if has_mine else []
    sweep = single_pushes_of([*argv, *args])
    assert sweep.blocks == (
        {"step_adjuster": "mine:ErrorStepAdjuster"} if has_mine else {}
    )


def single_pushes_of(argv):
    """The sweep of these flags."""
    made = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            envelope, "carry_out", lambda sweep, **_: made.append(sweep) or 0
        )
        assert single_pushes.main(argv) == 0
    return made[0]


def test_a_block_may_be_left_out(here):
    """Oracle: the blocks of the controller, by name."""
    own = ["whole_body_inverse_dynamics=mine:ContactForceController"]
    named = own_blocks.parsed_blocks([*own, "friction_estimator=none"])
    diagram = closed_loop(nb.load_scenario("push_standing"), blocks=named)
    names = {system.get_name() for system in diagram.controller.GetSystems()}
    assert "state_predictor" in names and "friction_estimator" not in names
    assert diagram.replaced == [
        "whole_body_inverse_dynamics=ContactForceController",
        "friction_estimator=None",
    ]


def test_a_controller_of_a_class_walks_as_a_policy_does(here):
    """Oracle: without torques the robot falls; the class is told."""
    scenario = nb.load_scenario("push", robot="g1", duration=1.5)
    diagram = closed_loop(scenario, controller="mine:Relaxed")
    assert type(diagram.controller).__name__ == "Relaxed"
    assert diagram.scenario.gait.num_steps == 0
    run = nb.simulate(diagram, 1.5)
    assert run.fall_reason == "pelvis too low"
    assert run.summary["mechanisms"].endswith(", controller=Relaxed")
    assert np.all(run.logs["actuation"] == 0.0)
    with pytest.raises(ValueError, match="must not come with blocks"):
        closed_loop(
            scenario,
            controller="mine:Relaxed",
            blocks={"step_adjuster": "mine:ErrorStepAdjuster"},
        )
