"""Bad input at random: one line, exit code 2, and nothing is simulated.

Every input is bad by its making, which is the oracle.  BAD_INPUTS in the
environment says how many are tried.
"""

import dataclasses
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from nadia_balance.diagrams.scenario import Scenario
from nadia_balance.robot import MODELS
from nadia_balance.scripts import command_line, push
from tests.scripts.running import environment, run_script

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


def bad_yaml(rng, folder):
    name, value = rng.choice(FIELDS)
    bad = rng.choice(HUGE)
    if isinstance(value, str):
        bad = rng.choice(["7", "[]", "true", ".nan"])
    elif isinstance(value, bool):
        bad = rng.choice(["7", "maybe", "[]", ".nan"])
    elif isinstance(value, list):
        bad = rng.choice(["7", "{a: 1}", "[.nan]", "[up]"])
    elif isinstance(value, dict):
        bad = rng.choice(["7", "[]", "{X: .nan}", "{X: up}"])
    text = f"{name}: {bad}{'}' * name.count('{')}"
    damage = rng.randrange(8)
    if damage == 0:
        text = f"{{{text}, {text}}}"
    elif damage == 1:
        text = text.replace(name.rpartition(" ")[2], "xyzzy")
    elif damage == 2:
        text = f"{{{text}"
    return ["--scenario_text", text]


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


def bad_urdf(rng, folder):
    robot = folder / "robot"
    shutil.copytree(MODELS / "nadia", robot)
    urdf = robot / "nadia.urdf"
    text = urdf.read_text()
    found = list(re.finditer(r'(mass value|effort|velocity)="[^"]*"', text))
    spot, damage = rng.choice(found), rng.randrange(3)
    if damage == 0:
        text = text[: spot.start()]
    else:
        bad = rng.choice(["nan", "-5", "inf", "up", ""])
        text = text[: spot.start()] + f'{spot[1]}="{bad}"' + text[spot.end() :]
    urdf.write_text(text)
    return ["--robot", str(robot / "robot.yaml")]


def bad_robot(rng, folder):
    robot = folder / "robot"
    shutil.copytree(MODELS / "nadia", robot)
    file = robot / "robot.yaml"
    lines = file.read_text().splitlines()
    spots = [
        i
        for i, line in enumerate(lines)
        if re.fullmatch(r"\s*\w+: -?[\d.]+\s*(#.*)?", line)
    ]
    i = rng.choice(spots)
    lines[i] = f"{lines[i].partition(':')[0]}: {rng.choice(HUGE)}"
    file.write_text("\n".join(lines))
    return ["--robot", str(file)]


MAKERS = (bad_yaml, bad_push, bad_urdf, bad_robot)


@pytest.mark.parametrize("seed", range(NUMBER))
def test_bad_input_is_refused_in_one_line(seed, tmp_path, monkeypatch, capsys):
    def accept(*args):
        raise AssertionError("accepted")

    monkeypatch.setattr(command_line, "advance", accept)
    monkeypatch.chdir(tmp_path)
    rng = random.Random(seed)
    argv = ["--no-meshcat", *MAKERS[seed % len(MAKERS)](rng, tmp_path)]
    if seed % 2:
        argv += ["--plant", "lipm"]
    began = time.monotonic()
    outcome = run_script(push, argv, capsys)
    assert time.monotonic() - began < 60.0
    assert outcome.code == 2, (argv, outcome)
    assert len(outcome.err) == 1, (argv, outcome)
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("seed", range(max(NUMBER // 20, 1)))
def test_a_signal_at_any_time_is_no_traceback(seed, tmp_path):
    """Oracles: the shell's 130; what the signal itself does to a program."""
    rng = random.Random(seed)
    sent = rng.choice([signal.SIGINT, signal.SIGINT, signal.SIGTERM])
    program = subprocess.Popen(
        [sys.executable, "-m", "nadia_balance.scripts.push"]
        + ["--plant", "lipm", "--no-meshcat", "--duration", "600"]
        + ["--at", "standing", "--delta-v", "0.1"],  # to the end
        cwd=tmp_path,
        env=environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    time.sleep(rng.uniform(0.5, 6.0))
    program.send_signal(sent)
    assert program.communicate(timeout=60.0)[1] == ""
    assert program.returncode == (130 if sent == signal.SIGINT else -sent)
    for file in tmp_path.rglob("summary.json"):
        json.loads(file.read_text())
