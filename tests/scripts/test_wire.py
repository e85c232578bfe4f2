"""Robot and controller, each a program of its own, on both wires."""

import argparse
import os
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest

from nadia_balance.scripts import control, robot
from nadia_balance.wire.process import Counts
from tests import run_cache
from tests.scripts.running import (
    assert_refused,
    ended,
    environment,
    program,
    run_script,
)

DOMAIN = 20 + os.getpid() % 50  # of this test alone


def stood(wire: str) -> tuple[int, list[str], int, list[str]]:
    """Exit code and lines of the robot, and of its controller.

    In lock step: neither of them goes on before it has heard the other one.
    """
    where = "--wire", wire, "--domain", DOMAIN, "--lockstep", 400
    # What is installed for these tests, wherever it is.
    env = environment() | {"PYTHONPATH": os.pathsep.join(sys.path)}
    push = "--push", "1 0.2 90", "--duration", 6.0
    bus = "--lost", 0.02, "--late", 0.01
    body = program("robot", *where, *push, *bus, env=env)
    mind = program("control", *where, "--duration", 5.9, env=env)
    heard = ended(body)
    try:
        mind.wait(60.0)
    except subprocess.TimeoutExpired:  # it waits for a robot that has gone
        mind.kill()
    told = ended(mind)
    return heard.code, heard.out, told.code, told.out + told.err


@pytest.mark.parametrize("wire", ["lcm", "unitree"])
def test_a_robot_is_set_down_stands_and_is_pushed(wire):
    """Oracle: the robot, which knows where it is; each lost sample counts."""
    code, heard, control_code, told = run_cache.once(
        __name__, wire, lambda: stood(wire)
    )
    text = "\n".join(heard)
    for event in ("it is commanded", "it stands alone", "pushed by 0.2 m/s"):
        assert event in text, heard
    assert "falls 0" in text
    assert (code, control_code) == (0, 0), told
    lines = [line.split()[-1] for line in told if line.startswith("t=")]
    assert lines[:4] == ["posture", "load", "balance", "stopped"]
    (counts,) = [line for line in told if line.startswith("samples")]
    assert "refused 0" in counts
    assert "lost 0" not in counts
    assert "late 0" not in counts


@pytest.mark.parametrize(
    ("script", "argv", "message"),
    [
        (control, ["--wire", "can"], "argument --wire: invalid choice: 'can'"),
        (control, ["--lockstep", "0.5"], "lockstep = 0.5: must be in [1, 1000"),
        (robot, ["--lockstep", "1e9"], "lockstep = 1000000000.0: must be in"),
        (control, ["--duration", "0"], "duration = 0.0: must be in (0, 86400"),
        (robot, ["--interface", "nope0"], "interface = 'nope0': must be one"),
        (robot, ["--sticks", "0 5 0"], "sticks, left = 5.0: must be in [-1, 1"),
        (robot, ["--seed", "-1"], "seed = -1: must be in [0, "),
        (robot, ["--push", "1 1e9 0"], "push, how strong = 1000000000.0: must"),
        (robot, ["--push", "0 0.5 0"], "push, when = 0.0: must be in (0, 8640"),
        (control, ["--robot", "no"], "robot = 'no': must be one of"),
        (control, ["--domain", "300"], "domain = 300: must be in [0, 232]"),
        (
            control,
            ["--robot", "nadia", "--wire", "unitree"],
            "wire = 'unitree': must be of a robot with the 29 joints",
        ),
        (robot, ["--engine", "bullet"], "engine = 'bullet': must be one of"),
        (robot, ["--lost", "2"], "lost = 2.0: must be in [0, 1]"),
        (robot, ["--model", "no.xml"], "model = no.xml: "),
        (robot, ["--push", "1 2"], "argument --push: '1 2': must be"),
        (robot, ["--push", "1 1 1e6"], "push, where to = 1000000.0: must be"),
        (robot, ["--late_by", "0.01"], "late_by = 0.01: must come with late"),
        (robot, ["--silent_at", "2"], "silent_at = 2.0: must come with silenc"),
    ],
)
def test_refuses_bad_input_in_one_line(script, argv, message, capsys):
    """Oracle: the rules."""
    assert_refused(run_script(script, argv, capsys), message)


@pytest.mark.parametrize(
    ("came", "ends"),
    [
        # Samples, those that were refused, and the robot's time, each 1 s.
        ([(0, 0, 0.0)] * 9, None),  # nobody is there
        ([(0, 5 * i, 0.0) for i in range(9)], 5),  # another robot
        ([(9 * i, 0, 3.0 + i) for i in range(9)], 5),  # 4 s from the first on
        ([(9, 0, 3.0), (18, 0, 4.0), *[(18, 0, 4.0)] * 9], 7),  # it has gone
    ],
)
def test_a_duration_ends_also_without_samples(came, ends, monkeypatch):
    """Oracle: by hand: 5 s after the last sample that was used."""
    monkeypatch.setattr(control, "time", SimpleNamespace(monotonic=lambda: now))
    now = 0.0
    process = SimpleNamespace(phase=None)
    each = control._until(
        process,
        SimpleNamespace(duration=4.0, command=None),
        keys=str,
        interrupted=bool,
    )
    goes_on = []
    for samples, refused, clock in came:
        now += 1.0
        process.counts = Counts(samples=samples, refused=refused)
        process.time = clock
        goes_on.append(each())
    first = next((i for i, on in enumerate(goes_on) if not on), None)
    assert first == ends


@pytest.mark.parametrize(
    ("argv", "factor"),
    [
        ([], 50.0),  # one machine: slow motion
        (["--interface", "eth0"], 1.0),
        (["--lockstep", "1"], 1.0),
        (["--interface", "eth0", "--lockstep", "3"], 3.0),
    ],
)
def test_the_robot_waits_by_default_where_nothing_leaves_the_machine(
    argv, factor
):
    """Oracle: the rules of docs/wire.md."""
    parser = argparse.ArgumentParser()
    control.wire_flags(parser)
    args = parser.parse_args(argv)
    control.check_wire_flags(args)
    assert args.lockstep == factor


def test_waits_for_a_robot_until_ctrl_c():
    """Oracle: the exit code; nobody has been commanded."""
    waiting = program("control", "--domain", DOMAIN + 60)
    assert waiting.stdout.readline().startswith("waits for the robot on lcm,")
    assert "Ctrl-C end" in waiting.stdout.readline()
    waiting.send_signal(signal.SIGINT)
    outcome = ended(waiting)
    assert outcome.code == 130
    assert outcome.out[0].startswith("samples 0")
