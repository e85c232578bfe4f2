"""The benchmark of a robot: what it takes, refuses, survives and leaves."""

import contextlib
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.scripts import envelope
from nadia_balance.scripts.envelope_sweep.limits import envelope_of
from nadia_balance.scripts.envelope_sweep.plan import PROTOCOL
from nadia_balance.scripts.envelope_sweep.run import HEADROOM
from nadia_balance.scripts.envelope_sweep.trials_file import (
    alone_in,
    cell_of,
    read_trials,
)
from tests.scripts.running import (
    as_program,
    assert_refused,
    environment,
    run_script,
)

# Some twenty trials of less than a second of processor time each.
SHORT = [
    *("--plant", "lipm", "--mechanisms", "icp_only", "--duration", "6"),
    *("--scenario_text", "calm_steps: 0", "--resolution", "0.1"),
    *("--stride", "2", "--replicas", "2"),
]
SWEEP = [*SHORT, "--directions", "0,90"]
ALONE = [*SWEEP, "--workers", "1"]  # each takes a second to begin
PATIENCE = 60.0  # with a machine that is busy [s]
FILES = {"trials.csv", "costs.csv", "scenario.yaml", "command.txt"}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The folder of a sweep that nobody disturbed, and what it said."""
    folder = tmp_path_factory.mktemp("undisturbed")
    done = as_program("envelope", *ALONE, "--out", folder, cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder, done.stdout.splitlines()


def started(*argv, cwd):
    """The program, running."""
    return subprocess.Popen(
        [
            sys.executable,
            "-m",
            "nadia_balance.scripts.envelope",
            *map(str, argv),
        ],
        cwd=cwd,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def wait_for_rows(process, folder, number):
    """Waits until a sweep has done so many trials, or has ended."""
    while process.poll() is None:
        with contextlib.suppress(FileNotFoundError):
            if len(read_trials(folder / "trials.csv")[1]) >= number:
                return
        time.sleep(0.05)


def test_says_what_it_does_and_what_came_of_it(undisturbed):
    """Oracle: the files themselves."""
    folder, said = undisturbed
    _, rows = read_trials(folder / "trials.csv")
    assert said[0] == (
        "2 limits to find (gaits 1 x mechanisms 1 x moments 1 x directions 2)"
    )
    assert said[1].startswith("about ")
    assert said[1].endswith(" at a time; 0 are there already")
    assert said[2] == f"into {folder}"
    (title,) = (i for i, line in enumerate(said) if line.startswith("largest"))
    assert said[title + 1].split() == ["direction", "icp_only"]
    for line, direction in zip(said[title + 2 :], (0.0, 90.0), strict=False):
        good = [
            row["delta_v"]
            for row in rows
            if row["direction_deg"] == direction
            and row["outcome"] == "recovered"
        ]
        assert [float(word) for word in line.split()] == [direction, max(good)]
    names = said[-1].removeprefix(f"wrote {folder}/{{").removesuffix("}")
    assert set(names.split(", ")) == {path.name for path in folder.iterdir()}
    assert FILES | {"envelope.png", "tables.md"} <= set(names.split(", "))


def test_begins_below_the_limits_that_another_folder_knows(
    undisturbed, tmp_path, capsys
):
    """Oracles: the same limits, of fewer trials, none far below them."""
    argv = [*SWEEP, "--from", undisturbed[0], "--out", tmp_path]
    assert run_script(envelope, argv, capsys).code == 0
    found, known = (
        envelope_of(*read_trials(folder / "trials.csv"))
        for folder in (tmp_path, undisturbed[0])
    )
    assert found.limits == known.limits
    assert len(found.rows) < len(known.rows)
    for row in found.rows:
        lowest = known.limits[cell_of(row)].recovered - HEADROOM
        assert row["delta_v"] > lowest - 0.051  # to a resolution of 0.1


def test_refuses_to_begin_at_limits_of_another_protocol(
    undisturbed, tmp_path, capsys
):
    """Oracle: the published way: one line, and nothing is written."""
    text = (undisturbed[0] / "trials.csv").read_text()
    old, out = tmp_path / "old", tmp_path / "out"
    old.mkdir()
    (old / "trials.csv").write_text(
        text.replace(f'"protocol": {PROTOCOL}', '"protocol": 4', 1)
    )
    argv = [*SWEEP, "--from", old, "--out", out]
    outcome = run_script(envelope, argv, capsys)
    assert_refused(outcome, f"trials = {old / 'trials.csv'}: line 1: protocol")
    assert not out.exists()


def test_leaves_behind_what_is_needed_to_do_it_again(undisturbed):
    folder, _ = undisturbed
    scenario = load_scenario("push", folder / "scenario.yaml")
    assert (scenario.duration, scenario.calm_steps) == (6.0, 0)
    (command,) = (folder / "command.txt").read_text().splitlines()
    assert command.startswith("envelope.py --plant lipm --mechanisms icp_only ")
    assert "--scenario_text 'calm_steps: 0'" in command


def test_killed_at_any_time_it_goes_on_where_it_was(undisturbed, tmp_path):
    """Oracle: the file of the sweep that nobody disturbed, byte by byte.

    It is killed as soon as it has done some more trials, or a bit later.
    """
    whole = undisturbed[0] / "trials.csv"
    total = len(read_trials(whole)[1])
    file = tmp_path / "trials.csv"
    for more, later in ((1, 0.0), (2, 0.5)):
        rows = read_trials(file)[1] if file.exists() else []
        process = started(*SWEEP, "--out", tmp_path, cwd=tmp_path)
        wait_for_rows(process, tmp_path, len(rows) + more)
        time.sleep(later)
        process.kill()
        process.communicate()
        after = read_trials(file)[1]
        assert after[: len(rows)] == rows
        assert min(len(rows) + more, total) <= len(after) <= total
    with open(file, "r+b") as torn:  # and the power fails, too
        torn.truncate(file.stat().st_size - 7)
    last = started(*SWEEP, "--out", tmp_path, cwd=tmp_path)
    said, _ = last.communicate()
    assert last.returncode == 0, said
    assert f"; {len(after) - 1} are there already" in said
    assert file.read_bytes() == whole.read_bytes()


def test_ctrl_c_ends_it_with_plots_of_what_is_there(undisturbed, tmp_path):
    """Oracle: the exit code of the shell; the rows of the whole sweep."""
    process = started(*ALONE, "--out", tmp_path, cwd=tmp_path)
    wait_for_rows(process, tmp_path, 2)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate()
    assert process.returncode == 130, said
    assert "Traceback" not in said
    assert f"the same flags and --out {tmp_path} go on from here" in said
    whole = read_trials(undisturbed[0] / "trials.csv")[1]
    rows = read_trials(tmp_path / "trials.csv")[1]
    assert 2 <= len(rows) < len(whole)
    assert all(row in whole for row in rows)
    assert {*FILES, "envelope.png", "tables.md"} <= {
        path.name for path in tmp_path.iterdir()
    }


def test_who_is_never_pushed_has_no_limit(tmp_path, capsys):
    """Oracle: exit code 3, one line; a limit of 0.00 would be a lie."""
    argv = [*ALONE, "--duration", 1.2]
    outcome = run_script(envelope, [*argv, "--out", tmp_path], capsys)
    assert outcome.code == 3
    assert outcome.err[-1].startswith("envelope.py: no limit: of ")
    assert outcome.err[-1].endswith(
        "none was decided: not pushed: the push did not come before the end"
    )
    assert not any("0.00" in line for line in outcome.out)
    rows = read_trials(tmp_path / "trials.csv")[1]
    assert {row["outcome"] for row in rows} == {"undecided"}
    again = run_script(envelope, ["--plot-only", tmp_path], capsys)
    assert (again.code, len(again.err)) == (2, 1)


@pytest.mark.parametrize(
    "end", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL]
)
def test_no_child_outlives_it(tmp_path, end):
    """Oracle: the table of processes of the system."""
    process = started(*ALONE, "--out", tmp_path, cwd=tmp_path)
    wait_for_rows(process, tmp_path, 1)
    children = children_of(process.pid)
    assert children
    process.send_signal(end)
    process.communicate()
    late = time.monotonic() + PATIENCE
    while any(map(is_alive, children)):
        assert time.monotonic() < late
        time.sleep(0.05)


def children_of(parent):
    tasks = Path(f"/proc/{parent}/task").iterdir()
    texts = [(task / "children").read_text() for task in tasks]
    return [int(pid) for text in texts for pid in text.split()]


def is_alive(pid):
    """A zombie is not: nobody may care for orphans in a container."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False
    return text.rpartition(")")[2].split()[0] != "Z"


def test_a_finished_sweep_needs_no_trial(undisturbed, capsys):
    folder, said = undisturbed
    before = (folder / "trials.csv").read_bytes()
    outcome = run_script(envelope, [*SWEEP, "--out", folder], capsys)
    assert outcome.code == 0
    assert outcome.out[1].startswith("about 0 trials to run")
    assert outcome.out[3:] == said[3:]
    assert (folder / "trials.csv").read_bytes() == before


def test_plots_need_nothing_but_the_trials(undisturbed, tmp_path, capsys):
    """Oracle: the bytes of what the sweep itself has written."""
    folder, said = undisturbed
    trials = (folder / "trials.csv").read_bytes()
    (tmp_path / "trials.csv").write_bytes(trials)
    outcome = run_script(envelope, ["--plot-only", tmp_path], capsys)
    assert outcome.code == 0
    assert outcome.err == []
    made = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert made == {
        path.name: path.read_bytes()
        for path in folder.iterdir()
        if path.name not in FILES - {"trials.csv"}
    }
    assert outcome.out[:-1] == said[3:-1]


def test_prints_what_no_controller_can_recover_from(capsys):
    """Oracle: half the sole's width over the ICP's 0.256 m for 1 m/s."""
    argv = ["--limit", "--mechanisms", "icp_only", "--directions", "90,270"]
    outcome = run_script(envelope, argv, capsys)
    assert outcome.code == 0
    rows = [line.split() for line in outcome.out[2:5]]
    assert [row[0] for row in rows] == ["90", "270", "mean"]
    for value, way in zip(rows[-1][1:], (0.06, 0.06 + 0.05), strict=True):
        assert float(value) == pytest.approx(way / 0.256, abs=0.01)
    assert outcome.out[5].startswith("assumes a point mass 0.888 m high;")


TEXT = "--scenario_text"
PUSH = "{delta_v: 0.1, at: 1.0 s}"
REFUSED = [
    (["--mechanisms", "luck"], "mechanisms = 'luck': must be one of icp_only,"),
    (["--directions", "0,up"], "directions = 'up': must be degrees, such as"),
    (["--at", "noon"], "at = 'noon': must be like \"right swing 25 %\""),
    (["--resolution", "0"], "resolution = 0.0: must be >= 0.0001"),
    (["--resolution", "x"], "argument --resolution: 'x': must be a finite num"),
    (["--replicas", "1.5"], "argument --replicas: invalid int value: '1.5'"),
    (["--largest", "0.01"], "largest = 0.01: must be in [resolution = 0.1, 1"),
    (["--workers", "0"], "workers = 0: must be >= 1"),
    (["--timeout", "0"], "timeout = 0.0: must be in (0, 1e+06] s"),
    (["--robot", "fred"], "robot = 'fred': must be one of atlas, nadia"),
    (["--seed", "-1"], "seed = -1: must be in [0, 4.29"),
    (
        ["--scenario_name", "stand"],
        "scenario_name = 'stand': must have exactly one push, has 0",
    ),
    (
        [TEXT, f"{{pushes: [{PUSH}], gait: {{num_steps: 0}}}}"],
        "at = 'right swing 25 %': must come with steps in the gait",
    ),
    (
        [TEXT, "pushes: [{delta_v: 1, at: 1 s, duration: 0.001}]"],
        "duration = 0.001: must be a multiple of 0.01 s",
    ),
    (
        ["--scheduler", "tcp://127.0.0.1:1"],
        "scheduler = 'tcp://127.0.0.1:1': must be",
    ),
    (
        ["--out", "/dev/null/x"],
        "out = '/dev/null/x': must be a folder to write",
    ),
    (
        ["--plot-only", "nowhere"],
        "plot_only = 'nowhere': must be a folder with",
    ),
    (["--from", "nowhere"], "from = 'nowhere': must be a folder with"),
    (
        ["--scenario_text", "max_torso_tilt_deg: 91"],
        "max_torso_tilt_deg = 91.0: must be in (0, 90] deg",
    ),
    (
        ["--scenario_text", "controller: {control_period: 0.0035}"],
        "time_step = 0.001: must divide control_period = 0.0035 s",
    ),
]


@pytest.mark.parametrize(("argv", "message"), REFUSED)
def test_refuses_what_has_no_meaning(
    argv, message, tmp_path, capsys, monkeypatch
):
    """On one line, before anything runs, and with nothing left behind."""
    monkeypatch.chdir(tmp_path)
    outcome = run_script(envelope, [*SWEEP, *argv], capsys)
    assert_refused(outcome, message)
    assert outcome.out == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["--resolution", "0.2"], "resolution = 0.2: must be 0.1 as in "),
        (["--replicas", "3"], "replicas = 3: must be 2 as in "),
        (["--plant", "humanoid"], "plant = humanoid: must be lipm as in "),
        (["--seed", "1"], "seed = 1: must be 0 as in "),
        (["--duration", "7"], "parameters = "),
    ],
)
def test_refuses_a_folder_of_another_sweep(undisturbed, argv, message, capsys):
    folder, _ = undisturbed
    before = (folder / "trials.csv").read_bytes()
    argv = [*SWEEP, *argv, "--out", folder]
    outcome = run_script(envelope, argv, capsys)
    assert_refused(outcome, message)
    assert str(folder / "trials.csv") in outcome.err[0]
    assert (folder / "trials.csv").read_bytes() == before


def test_refuses_a_folder_that_another_sweep_is_writing_to(tmp_path, capsys):
    """Oracle: the lock that each sweep holds."""
    with alone_in(tmp_path):
        outcome = run_script(envelope, [*SWEEP, "--out", tmp_path], capsys)
    told = f"out = {str(tmp_path)!r}: must not be in use by another sweep"
    assert_refused(outcome, told)
    assert list(tmp_path.iterdir()) == []
