"""A row of the league says what its trials say, or is refused."""

import hashlib
import json
import math
from unittest.mock import patch

import jsonschema
import pytest

import nadia_balance as nb
from nadia_balance.robot.model import MODELS
from nadia_balance.scripts import envelope
from nadia_balance.sweep import limits, push_v1, run_trial
from nadia_balance.sweep.row import read_row, read_trials, write_row
from nadia_balance.sweep.trials import Rows
from tests.scripts.running import assert_refused, run_script
from tests.scripts.test_envelope import workers_here
from tests.source_files import ROOT
from tests.sweep.made_up import MadeUpLimit, made_up_rows

SCHEMA = json.loads((ROOT / "docs" / "row.schema.json").read_text("utf-8"))
STANDING, IN_SWING = 0.7, 1.2  # limits forward of a made-up robot [m/s]
TURNED = 0.1  # more for each quarter of a turn [m/s]
LARGEST = 1.5  # that of a point mass [m/s]


def made_up_limit(cell) -> float:
    """The limit of a cell [m/s]."""
    forward = STANDING if cell.at == "standing" else IN_SWING
    return forward + TURNED * cell.direction_deg / 90.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder of a quick row of a made-up Nadia."""
    folder = tmp_path_factory.mktemp("row")
    sweeps = push_v1.sweeps(push_v1.QUICK, "nadia")
    for name, sweep in sweeps.items():
        cells = {cell: made_up_limit(cell) for cell in sweep.cells()}
        (folder / name).mkdir()
        with Rows.opened(folder / name, sweep.identity()) as rows:
            for row in made_up_rows(cells, sweep.search):
                rows.add(row)
        (folder / name / "policy.yaml").write_text("period: 0.02  # mine\n")
    made_up = [MadeUpLimit(LARGEST)] * 3
    with patch.object(limits, "limits_of", return_value=made_up):
        write_row(folder, push_v1.QUICK, sweeps, "somebody")
    return folder


def test_the_protocol_is_what_its_page_says():
    """Oracle: by hand; 100 limits, and 8 of the quick variant."""
    full, quick = (push_v1.sweeps(one, "g1") for one in ("full", "quick"))
    assert sum(len(sweep.cells()) for sweep in full.values()) == 12 * (6 + 4)
    assert sum(len(sweep.cells()) for sweep in quick.values()) == 4 * 2
    for sweep in (*full.values(), *quick.values()):
        (push,) = sweep.one.pushes
        assert (push.duration, push.body, push.shape) == (0.1, "", "rectangle")
        assert sweep.one.sensors == "perfect"
        assert sweep.mechanisms == ("all_with_cross_over",)
    walking = full["walking_realistic_drake"].one
    (command,) = walking.commands
    assert (command.forward, command.left, command.turn) == (0.5, 0.0, 0.0)
    assert walking.pushes[0].after_steps == 8
    assert full["push_ideal_drake"].one.fidelity == "ideal"
    assert full["push_realistic_mujoco"].one.engine == "mujoco"


@pytest.mark.parametrize("robot", [*push_v1.ROBOTS])
def test_the_robots_of_the_tree_are_those_of_the_protocol(robot):
    """Oracle: hashlib.  A robot that changes needs another protocol."""
    assert {*push_v1.ROBOTS[robot]} == {"robot.yaml", f"{robot}.urdf"}
    for name, digest in push_v1.ROBOTS[robot].items():
        data = (MODELS / robot / name).read_bytes()
        assert hashlib.sha256(data).hexdigest() == digest, name


def test_a_row_says_what_its_trials_say(folder):
    """Oracles: the made-up limits on a grid of 0.1 m/s; mass and height."""
    row, nadia = read_row(folder), nb.load_robot("nadia")
    tree = json.loads((folder / "row.json").read_text("utf-8"))
    jsonschema.validate(tree, SCHEMA)
    assert (row.who, row.variant, row.seeds) == ("somebody", "quick", [0])
    assert (row.controller.name, row.controller.sha256) == ("nadia_balance", "")
    assert row.contract == "period: 0.02  # mine\n"
    assert row.versions["drake"] and "mujoco" not in row.versions
    speed = math.sqrt(9.81 * nadia.com_height)
    assert len(row.limits) == 8
    for one in row.limits:
        forward = STANDING if one.at == "standing" else IN_SWING
        delta_v = forward + TURNED * one.direction_deg / 90.0
        assert one.recovered == pytest.approx(delta_v)
        assert one.froude == pytest.approx(delta_v / speed, rel=1e-3)
        assert one.impulse == pytest.approx(delta_v * nadia.mass, rel=1e-3)
        assert one.share == pytest.approx(delta_v / LARGEST, rel=1e-3)
        assert (one.landing_speed, one.landing_force) == (0.25, 1.5)
        assert one.power == 2000.0
        assert one.ended_by == "PELVIS_LINK - ground"
    assert row.worst == pytest.approx(
        {"0": 0.7, "90": 0.8, "180": 0.9, "270": 1}
    )
    assert read_trials(folder)[0]["engine"] == "drake"


REFUSED = [
    (["protocol"], "push-v2", "protocol = 'push-v2': must be 'push-v1'"),
    (
        ["robot", "files", "nadia.urdf"],
        "0" * 64,
        f"robot = 'nadia': sha256 of nadia.urdf = {'0' * 64}: must be bc78",
    ),
    (["robot", "name"], "t1", "robot.name = 't1': must be one of nadia, g1"),
    (["weather"], "fair", "weather: unknown field"),
    (["limits", 0, "recovered"], 1.3, "limit of push, realistic, drake, righ"),
    (["limits", 0, "complete"], False, "complete of push, realistic, drake, r"),
    (["limits", 0, "share"], "all", "limits[0].share = 'all': must be a num"),
    (["limits", 0, "froude"], 0.1, "froude of push, realistic, drake, right "),
    (["limits", 0, "power"], 10.0, "power of push, realistic, drake, right "),
    (["limits", 0, "ended_by"], "", "ended_by of push, realistic, drake, rig"),
    (["robot", "mass"], 1.0, "robot.mass = 1.0: must be 90."),
    (["robot", "speed"], 1.0, "robot.speed = 1.0: must be 2."),
    (["worst", "0"], 2.0, "worst: must be of the limits"),
    (["trials"], "", "trials = '': must be the sha256 of trials.csv"),
    (["who"], None, "row.who: must be there, as in docs/row.schema.json"),
    (["limits", 2, "at"], None, "row.limits[2].at: must be there, as in docs"),
    (["limits", 4, "share"], None, "row.limits[4].share: must be there, as i"),
    (["robot", "speed"], "2", "row.robot.speed: must be there, as in docs"),
    (["who"], " ", "who = ' ': must be who has measured it"),
    (["limits", 0, "direction_deg"], 45.0, "limits: must have each of the 8"),
]


def test_a_number_may_be_written_without_its_point(folder, tmp_path):
    """Oracle: JSON, in which 0 and 0.0 are one number."""
    tree = json.loads((folder / "row.json").read_text("utf-8"))
    for one in tree["limits"]:
        one["direction_deg"] = int(one["direction_deg"])
    (tmp_path / "row.json").write_text(json.dumps(tree))
    (tmp_path / "trials.csv").write_bytes((folder / "trials.csv").read_bytes())
    assert read_row(tmp_path) == read_row(folder)


@pytest.mark.parametrize(("path", "value", "message"), REFUSED)
def test_another_row_is_refused(folder, tmp_path, path, value, message):
    """Oracle: one line that names it; None takes the field away."""
    tree = json.loads((folder / "row.json").read_text("utf-8"))
    (tmp_path / "trials.csv").write_bytes((folder / "trials.csv").read_bytes())
    part = tree
    for name in path[:-1]:
        part = part[name]
    if value is None:
        del part[path[-1]]
    else:
        part[path[-1]] = value
    (tmp_path / "row.json").write_text(json.dumps(tree))
    with pytest.raises(ValueError) as refused:
        read_row(tmp_path)
    (line,) = str(refused.value).splitlines()
    assert line.startswith(f"row = {tmp_path / 'row.json'}: {message}")


def none_fell(lines):
    """Without the pushes that were too large."""
    return [line for line in lines if ",fell," not in line]


@pytest.mark.parametrize(
    ("keep", "complete", "message"),
    [
        (lambda lines: [*lines, lines[-1]], True, "trials of "),  # one twice
        (none_fell, True, "complete of .* = True: must be False"),
        (none_fell, False, "complete of .* = False: the search must end"),
        (
            lambda lines: [*lines[:2], lines[2].replace(",0.", ",x", 1)],
            True,
            "trials.csv, line 3: ",
        ),
    ],
)
def test_a_row_has_all_of_its_trials_once(
    folder, tmp_path, keep, complete, message
):
    """Oracle: the rule; the file's sum is of the changed file."""
    lines = (folder / "trials.csv").read_text("utf-8").splitlines(keepends=True)
    text = "".join(keep(lines))
    (tmp_path / "trials.csv").write_text(text, encoding="utf-8")
    tree = json.loads((folder / "row.json").read_text("utf-8"))
    tree["trials"] = hashlib.sha256(text.encode()).hexdigest()
    for one in tree["limits"]:
        one["complete"] = complete
    (tmp_path / "row.json").write_text(json.dumps(tree))
    with pytest.raises(ValueError, match=f": {message}"):
        read_row(tmp_path)


FLAGS = ["--protocol", "push-v1", "--quick", "--who", "somebody"]


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (
            ["--resolution", "0.1"],
            "resolution = 0.1: must not come with push-v",
        ),
        (["--engine", "mujoco"], "engine = mujoco: must not come with push-v1"),
        (["--robot", "t1"], "robot = 't1': must be one of nadia, g1, atlas"),
        (["--contract", "{}"], "contract = {}: must come with the ONNX file"),
        (["--controller", "no.mine:A"], "block controller = no.mine:A: module"),
        (
            ["--protocol", "nadia_fig10"],
            "who = 'somebody': must come with push",
        ),
        (["--who", ""], "who = '': must be given, your name"),
    ],
)
def test_what_the_protocol_fixes_is_no_flag(flags, message, tmp_path, capsys):
    out = ["--out", str(tmp_path / "row")]
    outcome = run_script(envelope, [*FLAGS, *out, *flags], capsys)
    assert_refused(outcome, message)
    assert not (tmp_path / "row").exists()


def test_one_command_measures_a_row(tmp_path, capsys, monkeypatch):
    """Oracle: the limits of a made-up robot, which is not simulated.

    Its controller's file has the sha256 of hashlib.
    """

    def trial(sweep, cell, delta_v, replica):
        return made_up_rows({cell: made_up_limit(cell)}, sweep.search)[0] | {
            "delta_v": delta_v,
            "replica": replica,
            "outcome": "recovered"
            if delta_v <= made_up_limit(cell) + 1e-9
            else "fell",
        }

    monkeypatch.chdir(ROOT)
    limit = MadeUpLimit(LARGEST)
    monkeypatch.setattr(limits, "limits_of", lambda *_: [limit] * 3)
    monkeypatch.setattr(run_trial, "run_trial", trial)
    monkeypatch.setattr(run_trial, "open_workers", workers_here)
    mine = ["--controller", "examples.null_controller:Springs"]
    argv = [*FLAGS, *mine, "--out", str(tmp_path)]
    outcome = run_script(envelope, argv, capsys)
    assert outcome.code == 0, outcome.err
    assert outcome.out[-1] == f"wrote {tmp_path}/{{row.json, trials.csv}}"
    row = read_row(tmp_path)
    expected = {"0": 0.7, "90": 0.8, "180": 0.9, "270": 1.0}
    assert row.worst == pytest.approx(expected)
    assert row.controller.name == "examples.null_controller:Springs"
    data = (ROOT / "examples" / "null_controller.py").read_bytes()
    assert row.controller.sha256 == hashlib.sha256(data).hexdigest()
