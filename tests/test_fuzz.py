"""Bad input at random: one line, exit code 2, and nothing is simulated.

Every input is bad by its making, which is the oracle.  BAD_INPUTS in the
environment says how many are tried; by default a small part of 300.
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
from nadia_balance.scripts import (
    benchmark,
    capture_regions,
    command_line,
    envelope,
    picture,
    push,
    simulate,
)
from nadia_balance.scripts.envelope_sweep.trials_file import (
    TrialsFile,
    line_of,
)
from tests.scripts.envelope_sweep.test_trials_file import IDENTITY, ROWS
from tests.scripts.running import environment, run_script

NUMBER = int(os.environ.get("BAD_INPUTS", "40"))
HUGE = (".nan", "-.inf", "1.0e+12", "-1.0e+12", "[1]", "{a: 1}", "up", "true")
WORDS = ("nan", "inf", "-1e12", "1e12", "", "up", "\0", "é", "--", "1:30")
SCRIPTS = {
    push: "delta-v direction at shape random seed duration port "
    "robot mechanisms fidelity scenario_name scenario_file plant out",
    simulate: "seed duration robot scenario_file",
    envelope: "directions at resolution stride replicas largest workers "
    "timeout protocol plot-only scenario_name",
    picture: "run times azimuth distance width",
    capture_regions: "figure out",
    benchmark: "seconds scenario_name mechanisms",
}
# What is not bad for these flags.
ALLOWED = {
    "out": {"nan", "inf", "-1e12", "1e12", "up", "é", "1:30"},
    "direction": {"1e12", "-1e12"},
    "at": {""},
}


def leaves(params: object, path: str = "") -> Iterator[tuple[str, object]]:
    """Each field that holds no other ones, with its way from the top."""
    for field in dataclasses.fields(params):
        value, name = getattr(params, field.name), f"{path}{field.name}"
        if dataclasses.is_dataclass(value):
            yield from leaves(value, f"{name}: {{")
        else:
            yield name, value


FIELDS = list(leaves(Scenario()))


def bad_flag(rng, folder):
    script = rng.choice(list(SCRIPTS))
    flag = rng.choice(SCRIPTS[script].split())
    value = rng.choice([w for w in WORDS if w not in ALLOWED.get(flag, ())])
    needed = {simulate: ["--scenario_name", "stand"]}.get(script, [])
    if script is envelope and flag != "plot-only":
        needed = ["--plant", "lipm", "--quick", "--out", str(folder / "out")]
    return script, [*needed, f"--{flag}={value}"]


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
    return push, ["--scenario_text", text]


def bad_push(rng, folder):
    fields = {"delta_v": "0.1", "at": "1 s"}
    name = rng.choice(
        "delta_v force duration direction_deg after_steps delay frequency "
        "shape at body".split()
    )
    words = ("BOGUS", "7", "[]") if name in ("shape", "at", "body") else HUGE
    fields[name] = rng.choice(words)
    text = ", ".join(f"{key}: {value}" for key, value in fields.items())
    return push, ["--scenario_text", f"pushes: [{{{text}}}]"]


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
    return push, ["--robot", str(robot / "robot.yaml")]


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
    return push, ["--robot", str(file)]


def bad_rows(rng, folder):
    path = folder / "trials.csv"
    identity = dict(IDENTITY)
    if rng.randrange(3) == 0:
        name = rng.choice(["protocol", "resolution", "stride", "replicas"])
        identity[name] = rng.choice([-1, 0, 10**9, "up", None])
    file = TrialsFile(path, identity)
    assert file.path == path
    name = rng.choice(
        ["outcome", "delta_v", "direction_deg", "replica", "at", "mechanisms"]
        + ["steps_after_push", "qp_failures", "max_torque_ratio"]
    )
    bad = rng.choice(["bogus", -1, "nan", "1e400"])
    with path.open("a") as text:
        text.write(line_of({**ROWS[0], name: bad}))
    return envelope, ["--plot-only", str(folder)]


def bad_disk(rng, folder):
    file = folder / "file"
    file.write_text("")
    old = folder / "old"
    old.mkdir()
    (old / "summary.json").write_text("")
    loop = folder / "loop"
    loop.symlink_to(loop)
    places = [file, old, loop, "/dev/null/x", "/proc/x", "x" * 300, ""]
    script = rng.choice([push, simulate, capture_regions])
    argv = ["--scenario_name", "stand"] if script is simulate else []
    place = rng.choice(places)
    if script is capture_regions:
        (old / "figure_9.png").write_text("")
        argv = ["--figure", "9"]
    return script, [*argv, "--out", str(place)]


MAKERS = (bad_flag, bad_yaml, bad_push, bad_urdf, bad_robot, bad_rows, bad_disk)


@pytest.mark.parametrize("seed", range(NUMBER))
def test_bad_input_is_refused_in_one_line(seed, tmp_path, monkeypatch, capsys):
    def accept(*args):
        raise AssertionError("accepted")

    for module in (command_line, envelope, benchmark):
        for name in ("advance", "measure", "_run"):
            if hasattr(module, name):
                monkeypatch.setattr(module, name, accept)
    monkeypatch.chdir(tmp_path)
    rng = random.Random(seed)
    script, argv = MAKERS[seed % len(MAKERS)](rng, tmp_path)
    if script in (push, simulate):
        argv = ["--no-meshcat", *argv]
        if "--plant" not in str(argv) and seed % 2:
            argv = ["--plant", "lipm", *argv]
    began = time.monotonic()
    outcome = run_script(script, argv, capsys)
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
