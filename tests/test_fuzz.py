"""Bad input at random: one line, exit code 2, and nothing is simulated.

Every input is bad by its making, which is the oracle.  BAD_INPUTS in the
environment says how many are tried.
"""

import dataclasses
import os
import random
import re
import shutil
from collections.abc import Iterator

import pytest

from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.robot.model import MODELS
from nadia_balance.scripts import command_line, push
from tests import run_cache
from tests.scripts.running import run_script

NUMBER = int(os.environ.get("BAD_INPUTS", "16"))
HUGE = (".nan", "-.inf", "1.0e+12", "-1.0e+12", "[1]", "{a: 1}", "up", "true")


def leaves(params: object, path: str = "") -> Iterator[tuple[str, object]]:
    """Each field that holds no other ones, with its way from the top."""
    for field in dataclasses.fields(params):
        value, name = getattr(params, field.name), f"{path}{field.name}"
        if dataclasses.is_dataclass(value):
            yield from leaves(value, f"{name}: {{")
        else:
            yield name, value


FIELDS = list(leaves(Scenario()))


# What does not fit a field of this type; all else is a number.
UNFIT = {
    str: ("7", "[]", "true", ".nan"),
    bool: ("7", "maybe", "[]", ".nan"),
    list: ("7", "{a: 1}", "[.nan]", "[up]"),
    dict: ("7", "[]", "{X: .nan}", "{X: up}"),
}


def bad_yaml(rng, folder):
    name, value = rng.choice(FIELDS)
    bad = rng.choice(UNFIT.get(type(value), HUGE))
    text = f"{name}: {bad}{'}' * name.count('{')}"
    twice, unknown = f"{{{text}, {text}}}", name.rpartition(" ")[2]
    damaged = [twice, text.replace(unknown, "xyzzy"), f"{{{text}", *5 * [text]]
    return ["--scenario_text", rng.choice(damaged)]


def bad_push(rng, folder):
    fields = {"delta_v": "0.1", "at": "1 s"}
    name = rng.choice(
        "delta_v force duration direction_deg after_steps delay frequency "
        "shape at body".split()
    )
    words = ("BOGUS", "7", "[]") if name in ("shape", "at", "body") else HUGE
    fields[name] = rng.choice(words)
    text = ", ".join(f"{key}: {value}" for key, value in fields.items())
    return ["--scenario_text", f"pushes: [{{{text}}}]"]


def with_bad(file, pattern, rng, folder):
    """A copy of Nadia's folder, and one of the places in this file of it."""
    robot = shutil.copytree(MODELS / "nadia", folder / "robot") / "robot.yaml"
    path = robot.with_name(file)
    text = path.read_text()
    return robot, path, text, rng.choice([*re.finditer(pattern, text)])


def bad_urdf(rng, folder):
    what = '(mass value|effort|velocity)="[^"]*"'
    robot, path, text, spot = with_bad("nadia.urdf", what, rng, folder)
    bad = rng.choice(["nan", "-5", "inf", "up", ""])
    rest = f'{spot[1]}="{bad}"{text[spot.end() :]}' if rng.randrange(3) else ""
    path.write_text(text[: spot.start()] + rest)
    return ["--robot", str(robot)]


def bad_robot(rng, folder):
    what = r"(?m)^\s*\w+: (-?[\d.]+)\s*(#.*)?$"
    robot, path, text, spot = with_bad("robot.yaml", what, rng, folder)
    before, after = text[: spot.start(1)], text[spot.end(1) :]
    path.write_text(before + rng.choice(HUGE) + after)
    return ["--robot", str(robot)]


MAKERS = (bad_yaml, bad_push, bad_urdf, bad_robot)


@pytest.mark.parametrize("seed", range(NUMBER))
def test_bad_input_is_refused_in_one_line(seed, tmp_path, monkeypatch, capsys):
    def accept(*args):
        raise AssertionError("accepted")

    def said():
        rng = random.Random(seed)
        argv = ["--no-meshcat", *MAKERS[seed % len(MAKERS)](rng, tmp_path)]
        if seed % 2:
            argv += ["--plant", "lipm"]
        outcome = run_script(push, argv, capsys)
        return argv, outcome, (tmp_path / "runs").exists()

    monkeypatch.setattr(command_line.simulation, "advance", accept)
    monkeypatch.chdir(tmp_path)
    argv, outcome, ran = run_cache.once(__name__, str(seed), said)
    assert outcome.code == 2, (argv, outcome)
    assert len(outcome.err) == 1, (argv, outcome)
    assert not ran
