"""The other process: it answers, it dies, it is not left behind."""

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from diagrams.envelope.fingerprints import this_code
from diagrams.envelope.trial import run_trial
from diagrams.envelope.trial_child import TrialChild
from tests.diagrams.envelope.made_up_robot import made_up_sweep
from tests.diagrams.envelope.quick_trials import (
    ENDLESS,
    facts,
    stepping,
    text_of,
    trial,
)
from tests.source_files import ROOT

PATIENCE = 60.0  # with a machine that is busy [s]
ZOMBIE = "Z"
# Says what a row looks like, without end, on both ways out.
NOISE = """
    import os, sys, threading
    def shout():
        while True:
            for out in (1, 2):
                os.write(out, b'{"outcome": "made up"}' + os.linesep.encode())
            print('{"outcome": "made up"}', flush=True)
    threading.Thread(target=shout, daemon=True).start()
"""
PARENT = """
    from diagrams.envelope.trial_child import TrialChild
    from tests.diagrams.envelope.quick_trials import *
    children = [TrialChild(), TrialChild()]
    request = {"scenario": text_of(trial()), "plant": "lipm"}
    request |= {"timeout": 99.0, "identity": {}}
    for child in children:
        child.ask(request, 99.0)
    print(*(child.process.pid for child in children), flush=True)
    children[0].ask(request | {"scenario": LONG}, 99.0)
"""


@pytest.fixture
def child():
    child = TrialChild()
    yield child
    child.close()


def request(scenario, timeout=PATIENCE, identity=None):
    return {
        "scenario": text_of(scenario),
        "plant": "lipm",
        "timeout": timeout,
        "identity": identity or {},
    }


def test_gives_the_row_of_this_very_process(child):
    """Oracle: the same trial here; a number loses no digit on the way."""
    for scenario in (trial(0.2), trial(2.5, replica=3)):
        reply = child.ask(request(scenario), PATIENCE)
        assert facts(json.loads(reply)) == facts(run_trial(scenario, "lipm"))


def test_what_is_printed_does_not_get_into_the_reply(tmp_path, monkeypatch):
    """Oracle: this process; the child's Python is told to shout meanwhile."""
    (tmp_path / "sitecustomize.py").write_text(textwrap.dedent(NOISE))
    monkeypatch.syspath_prepend(tmp_path)
    noisy = TrialChild()
    reply = noisy.ask(request(trial(base=stepping(0.5))), PATIENCE)
    row = facts(json.loads(reply))
    assert row == facts(run_trial(trial(base=stepping(0.5)), "lipm"))
    noisy.process.kill()
    assert noisy.death() == 'SIGKILL: {"outcome": "made up"}'
    noisy.close()


def test_makes_no_row_of_what_is_not_as_in_the_sweep(child):
    """Oracle: this process; each hash is changed, and each file missed."""
    ours = made_up_sweep().identity()
    good = request(trial(), identity=ours)
    row = child.ask(good, PATIENCE)
    assert facts(json.loads(row)) == facts(run_trial(trial(), "lipm"))
    for name in (*this_code(), "robot_files"):
        told = f"{name} = {ours[name]}: must be x, as when the sweep began"
        bad = good | {"identity": ours | {name: "x"}}
        assert refusal(child, bad) == told
    gone = good | {"scenario": "{robot: gone.yaml}"}
    assert refusal(child, gone) == "robot = gone.yaml: no such file"
    bad = good | {"scenario": "{gait: 3}"}
    told = "scenario: gait = 3: must be a mapping"
    assert refusal(child, bad).startswith(told)
    assert child.is_alive


def refusal(child, asked):
    """Why it does not begin."""
    with pytest.raises(RuntimeError) as refused:
        child.ask(asked, PATIENCE)
    return str(refused.value)


def test_tells_how_a_child_died_that_did_not_begin(child):
    """Oracle: a request that is none is the end of a Python program."""
    told = "exit code 1: KeyError: 'timeout'"
    assert refusal(child, {"plant": "lipm"}) == told
    assert not child.is_alive
    assert refusal(child, request(trial())) == "exit code 1"  # nobody listens


def test_a_child_that_cannot_start_makes_no_row(tmp_path, monkeypatch):
    """Oracle: the words of Python, which finds other code in our place."""
    (tmp_path / "diagrams").mkdir()
    (tmp_path / "diagrams" / "__init__.py").write_text("1 / 0")
    monkeypatch.syspath_prepend(tmp_path)
    broken = TrialChild()
    told = "exit code 1: ZeroDivisionError: division by zero"
    assert refusal(broken, request(trial())) == told
    broken.close()


def test_computes_with_one_thread_and_the_modules_of_its_parent(child):
    """Oracle: the child's environment, as the system has it."""
    child.ask(request(trial()), PATIENCE)  # it may still be on its way to exec
    environ = Path(f"/proc/{child.process.pid}/environ").read_text()
    variables = dict(v.split("=", 1) for v in environ.split("\0") if v)
    assert variables["OMP_NUM_THREADS"] == "1"
    assert variables["OPENBLAS_NUM_THREADS"] == "1"
    assert variables["PYTHONPATH"].split(os.pathsep) == sys.path


def test_is_in_a_session_of_its_own(child):
    """Oracle: the system; Ctrl-C goes to a session."""
    assert os.getsid(child.process.pid) == child.process.pid
    assert os.getsid(child.process.pid) != os.getsid(0)


def test_ends_when_its_stdin_closes(child):
    """Oracle: nobody kills it, so that the exit code is 0."""
    child.ask(request(trial()), PATIENCE)
    child.process.stdin.close()
    assert child.process.wait(PATIENCE) == 0


def test_a_killed_parent_leaves_no_orphan():
    """Oracle: the system's list; one is in mid-trial, and one is idle."""
    code = f"LONG = {text_of(trial(base=stepping(9.0)))!r}"
    code += textwrap.dedent(PARENT)
    parent = subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
    )
    with parent:
        children = [int(word) for word in parent.stdout.readline().split()]
        assert [state(pid) not in ("", ZOMBIE) for pid in children] == [
            True
        ] * 2
        time.sleep(0.2)  # into the second trial
        parent.kill()
    gone = time.monotonic() + PATIENCE
    while {state(pid) for pid in children} - {"", ZOMBIE}:
        assert time.monotonic() < gone
        time.sleep(0.05)


def state(pid: int) -> str:
    """Of a process, a letter; empty if there is none."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
    except FileNotFoundError:
        return ""
    return text.rpartition(")")[2].split()[0]


def test_a_child_whose_time_is_up_ends_itself(child):
    """Oracle: SIGALRM; its parent is there, but does nothing."""
    endless = request(trial(base=stepping(ENDLESS)), timeout=-9.0)
    assert child.ask(endless, PATIENCE) == ""
    assert child.process.wait() == -signal.SIGALRM
