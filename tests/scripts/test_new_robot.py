"""One command from a URDF of anybody's to a robot that walks."""

import math
import re
import sys

import pytest

from nadia_balance.robot.model import load_robot
from nadia_balance.scripts import new_robot
from tests import run_cache
from tests.diagrams.simulated import EARLY
from tests.new_robot.biped import Biped
from tests.scripts.running import assert_refused, run_script


@pytest.fixture
def file(tmp_path):
    return Biped(seed=7).write(tmp_path)


@pytest.fixture
def any_reach(monkeypatch):
    """The reach is that of the legs' lengths, and takes no search."""

    def reach_of(robot):
        return robot.point_mass.reach, set()

    monkeypatch.setattr(new_robot, "reach_within", reach_of)


def test_an_unseen_biped_walks_at_once(file, tmp_path, capsys, monkeypatch):
    """Oracle: the bar for robots nobody has tuned, an ICP error of 10 mm.

    Two steps of the twenty.  The standing push is more than ankles stop, to a
    tenth of sqrt(g z).  The ankles' 250 N m are more than the weight times
    the sole, which ends 0.12 m from its middle.
    """
    short = f"{{duration: 3.1, {EARLY % 'num_steps: 2'}}}"
    monkeypatch.setattr(new_robot, "WALK", short)

    def walked():
        made = tmp_path / "made"
        outcome = run_script(new_robot, [file, "--out", made], capsys)
        robot = load_robot(str(made / "robot.yaml"))
        return outcome, robot.com_height, robot.mass

    outcome, height, mass = run_cache.once(__name__, short, walked)
    assert (outcome.code, outcome.err) == (0, [])
    words = {line.partition(": ")[0] for line in outcome.out}
    assert {"guessed", "changed", "unknown"} <= words
    assert "rotor inertia of 16 joints" in " ".join(outcome.out)
    (line,) = [line for line in outcome.out if line.startswith("WALKED")]
    walked, error = line.split("max ICP error ")
    assert walked.startswith("WALKED: 2 steps")
    assert float(error.split(" mm")[0]) < 10.0
    assert (
        "  ankles hold the CoP ahead and behind: 12.0 and 12.0 cm, of the "
        "sole's 12.0 and 12.0 cm"
    ) in outcome.out
    recovered, impulse, failed = map(
        float,
        re.fullmatch(
            r"standing, pushed forward for 0\.1 s: recovers from (.*) m/s "
            r"\((.*) N s\), not from (\S+): .+",
            outcome.out[-1],
        ).groups(),
    )
    speed = math.sqrt(9.81 * height)
    # An ankle alone stops omega times what is ahead of it, and there are steps.
    assert recovered > 0.12 * 9.81 / speed
    assert failed - recovered == pytest.approx(0.1 * speed, abs=0.011)
    assert impulse == pytest.approx(recovered * mass, rel=0.01)


@pytest.mark.usefixtures("any_reach")
def test_a_robot_that_does_not_walk_says(file, tmp_path, capsys, monkeypatch):
    """Oracle: a scenario that needs soles of more than a metre."""
    large = "{controller: {step_adjuster: {foot_front: 1.0}}}"
    monkeypatch.setattr(new_robot, "WALK", large)
    outcome = run_script(new_robot, [file, "--out", tmp_path / "made"], capsys)
    assert outcome.code == 1
    assert outcome.out[-1].startswith("DID NOT WALK: foot_front = 1.0")


@pytest.mark.parametrize(
    "argv, message",
    [
        (["none.urdf"], "[Errno 2] No such file or directory: 'none.urdf'"),
        ([__file__], f"{__file__}: must be XML ("),
        (["FILE", "--fix", "tail"], "fix = 'tail': must match a joint"),
        (["FILE", "--fix", "("], "fix = '(': must be a regular expression"),
        (["FILE", "--package-root", "none"], "package-root = none: must be"),
    ],
)
def test_refuses_what_makes_no_robot(file, argv, message, tmp_path, capsys):
    argv = [file if word == "FILE" else word for word in argv]
    outcome = run_script(new_robot, ["--out", tmp_path / "made", *argv], capsys)
    assert_refused(outcome, message)


@pytest.mark.usefixtures("any_reach")
@pytest.mark.parametrize("name", new_robot.MADE)
def test_an_edited_robot_is_overwritten_only_by_force(
    name, file, tmp_path, capsys
):
    """Oracle: the text of the user, and that it is gone."""
    made = tmp_path / name
    made.write_text("mine", encoding="utf-8")
    argv = [file, "--out", tmp_path, "--no-walk"]
    assert_refused(run_script(new_robot, argv, capsys), f"{made}: exists; ")
    assert made.read_text(encoding="utf-8") == "mine"
    assert run_script(new_robot, [*argv, "--force"], capsys).code == 0
    assert "mine" not in made.read_text(encoding="utf-8")


def test_what_is_refused_leaves_everything_as_it_was(file, tmp_path, capsys):
    """Oracle: the files; an effort of 1 N m carries nobody."""
    mine = tmp_path / "robot.urdf"
    weak = re.sub(r'effort="\d+', 'effort="1', file.read_text("utf-8"))
    mine.write_text(weak, encoding="utf-8")
    for out, why in (tmp_path, "out = "), (tmp_path / "made", "urdf = "):
        argv = [mine, "--out", out, "--force"]
        assert_refused(run_script(new_robot, argv, capsys), why)
        assert mine.read_text(encoding="utf-8") == weak
    assert not (tmp_path / "made").exists()


def test_a_missing_extra_is_named(file, tmp_path, capsys, monkeypatch):
    """Oracle: without trimesh, one line; for --help, see test_packaging."""
    for name in "make", "read":
        module = f"nadia_balance.new_robot.{name}"
        monkeypatch.delitem(sys.modules, module, raising=False)
    monkeypatch.setitem(sys.modules, "trimesh", None)
    outcome = run_script(new_robot, [file, "--out", tmp_path / "made"], capsys)
    message = "trimesh is missing: pip install 'nadia_balance[robots]'"
    assert_refused(outcome, message)
