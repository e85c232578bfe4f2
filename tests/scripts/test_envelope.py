"""The benchmark of a robot: what it takes, refuses, survives and leaves."""

import contextlib
import csv
import io
import re
import shutil
import signal
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from dask.system import CPU_COUNT

from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.scripts import envelope
from nadia_balance.sweep.trials import TRIALS, Cell, Rows
from tests import run_cache
from tests.scripts.running import Outcome, assert_refused, program, run_script
from tests.source_files import ROOT
from tests.sweep.made_up import PATIENCE

SOON = "pushes: [{delta_v: 0.1, at: right swing 25 %}]"
# Some ten trials of a quarter of a second of processor time each.
SWEEP = [
    *("--plant", "lipm", "--mechanisms", "icp_only", "--duration", "3.5"),
    *("--scenario_text", f"{{calm_steps: 0, lipm_period: 0.02, {SOON}}}"),
    *("--resolution", "0.2"),
    *("--stride", "2", "--replicas", "2", "--directions", "0,90"),
]
WRITTEN = {
    *("trials.csv", "limits.csv", "tables.md"),
    *("envelope.png", "envelope.svg"),
}
FILES = {*WRITTEN, "scenario.yaml", "command.txt"}


def workers_here(*_):
    """They are of this process."""
    return ThreadPoolExecutor(1)


def rows_in(folder):
    return Rows.read(folder).all


def once(folder, *argv):
    """What the script says, and writes into `folder`; made once, see run_cache.

    It follows from what is there, and in other folders of `argv`.  Cells run in
    this process; the folder is told as FOLDER.
    """

    def ran():
        texts = io.StringIO(), io.StringIO()
        with (
            pytest.MonkeyPatch.context() as patch,
            redirect_stdout(texts[0]),
            redirect_stderr(texts[1]),
        ):
            patch.setattr(envelope.run_trial, "open_workers", workers_here)
            code = envelope.main([*map(str, argv), str(folder)])
        if code == envelope.command_line.INTERRUPTED:
            raise KeyboardInterrupt  # nothing to be kept
        here = str(folder)
        said = (text.getvalue().replace(here, "FOLDER") for text in texts)
        files = {path.name: path.read_bytes() for path in folder.iterdir()}
        return Outcome(code, *(text.splitlines() for text in said)), files

    folders = [folder, *(word for word in argv if isinstance(word, Path))]
    files = sorted(file for path in folders for file in path.iterdir())
    words = [word for word in argv if word not in folders]
    before = [f.read_text("utf-8") for f in files if f.suffix != ".png"]
    outcome, files = run_cache.once(__name__, f"{words} {before}", ran)
    for name, data in files.items():
        (folder / name).write_bytes(data)
    return outcome


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The folder of a sweep that nobody disturbed, and what it said."""
    folder = tmp_path_factory.mktemp("undisturbed")
    outcome = once(folder, *SWEEP, "--out")
    assert outcome.code == 0
    return folder, outcome.out


def started(folder, directions="0,90"):
    """The program, running, once it has two rows."""
    more = f"--directions={directions}", "--workers=1", "--out", folder
    process = program("envelope", *SWEEP, *more, stderr=subprocess.STDOUT)
    late, number = time.monotonic() + PATIENCE, 0
    while number < 2 and process.poll() is None and time.monotonic() < late:
        time.sleep(0.02)
        with contextlib.suppress(ValueError):
            number = len(Rows.read(folder).all)
    assert process.poll() is None, process.communicate()
    return process


def children_of(parent):
    files = Path(f"/proc/{parent}/task").glob("*/children")
    return [int(pid) for file in files for pid in file.read_text().split()]


def is_alive(pid):
    """A zombie, for which nobody may care in a container, has no command."""
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        return bool(Path(f"/proc/{pid}/cmdline").read_bytes())


def assert_all_end(children):
    late = time.monotonic() + PATIENCE
    while any(map(is_alive, children)):
        assert time.monotonic() < late
        time.sleep(0.05)


def test_says_if_a_command_is_cut(tmp_path):
    """Oracle: the limit of Nadia's speed; the page names the command."""
    more = "--command", "3 0 0", "--directions", "1", "--resolution", "1"
    said = once(tmp_path, *SWEEP, *more, "--replicas", "1", "--out").out
    (line,) = (line for line in said if line.startswith("robot: "))
    start = "robot: commands[0] = [3.0, 0.0, 0.0]: is more than it can walk, ["
    assert 0.7 < float(line.removeprefix(start).split(",")[0]) < 0.9
    assert "3 0 0 from 0 s" in (tmp_path / "tables.md").read_text("utf-8")


def test_says_what_it_does_and_what_came_of_it(undisturbed):
    """Oracle: the files themselves."""
    folder, said = undisturbed
    rows = rows_in(folder)
    assert said[0] == ("2 cells; 0 trials are there already")
    assert said[1] == "into FOLDER"
    (title,) = (i for i, line in enumerate(said) if line.startswith("largest"))
    for line, direction in zip(said[title + 3 :], (0.0, 90.0), strict=False):
        own = [row for row in rows if row["direction_deg"] == direction]
        good = [r["delta_v"] for r in own if r["outcome"] == "recovered"]
        numbers = [float(word) for word in line.split("|")[1:-1]]
        assert numbers == [direction, max(good)]
    names = said[-1].removeprefix("wrote FOLDER/{").removesuffix("}")
    assert set(names.split(", ")) == WRITTEN
    assert {path.name for path in folder.iterdir()} == FILES
    scenario = load_scenario("push", folder / "scenario.yaml")
    assert (scenario.duration, scenario.calm_steps) == (3.5, 0)
    command, *_ = (folder / "command.txt").read_text().splitlines()
    assert command.startswith("envelope.py --plant lipm --mechanisms icp_only ")


def test_begins_at_half_of_what_any_controller_can(undisturbed):
    """Oracle: limits.csv, to the resolution; at least one stride of 0.4."""
    rows = rows_in(undisturbed[0])
    with open(undisturbed[0] / "limits.csv", encoding="utf-8") as file:
        for line in csv.DictReader(file):
            half = 0.5 * float(line["with_hips"])
            direction = float(line["direction_deg"])
            own = (r for r in rows if r["direction_deg"] == direction)
            nearest = min(abs(r["delta_v"] - max(half, 0.4)) for r in own)
            assert nearest <= 0.1 + 1e-9


def test_killed_at_any_time_it_goes_on_where_it_was(
    undisturbed, tmp_path, capsys, monkeypatch
):
    """Oracle: the rows of the sweep that nobody disturbed.

    None of its processes is left.  What it goes on with are these rows' trials,
    but for those that are there.
    """
    whole, made = Rows.read(undisturbed[0]).all, []

    def looked_up(_, cell, *attempt):
        for row in whole:
            own = row["delta_v"], row["replica"]
            if (Cell.of(row), *own) == (cell, *attempt):
                made.append(row)
                return row

    monkeypatch.setattr(envelope.run_trial, "run_trial", looked_up)
    monkeypatch.setattr(envelope.run_trial, "open_workers", workers_here)
    monkeypatch.setattr(envelope, "_report", lambda *_: 0)
    process = started(tmp_path)
    children = children_of(process.pid)
    assert children
    process.kill()
    process.communicate()
    assert_all_end(children)
    number = len(rows_in(tmp_path))
    done = run_script(envelope, [*SWEEP, "--out", tmp_path], capsys)
    assert done.code == 0, done.err
    assert done.out[0].endswith(f"; {number} trials are there already")
    assert rows_in(tmp_path) == rows_in(undisturbed[0])
    assert len(made) == len(whole) - number


def test_ctrl_c_ends_it_with_plots_of_what_is_there(undisturbed, tmp_path):
    """Oracle: the exit code of the shell; the rows of a sweep of two cells."""
    process = started(tmp_path, "0,90,180,270,30,60,120,150")
    children = children_of(process.pid)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate()
    assert process.returncode == 130, said
    assert "Traceback" not in said
    assert f"the same flags and --out {tmp_path} go on from here" in said
    assert_all_end(children)
    rows, whole = rows_in(tmp_path), rows_in(undisturbed[0])
    assert len(rows) >= 2
    assert all(r in whole for r in rows if r["direction_deg"] in (0.0, 90.0))
    assert {path.name for path in tmp_path.iterdir()} == FILES


def test_runs_that_are_too_short_have_no_limit(tmp_path):
    """Oracle: exit code 3, no limit; one of 0.00 would be a lie."""
    outcome = once(tmp_path, *SWEEP, "--duration", "1.6", "--out")
    assert outcome.code == 3
    assert not any("0.00" in line for line in outcome.out)
    assert {row["outcome"] for row in rows_in(tmp_path)} == {"undecided"}
    assert outcome.err[-1].startswith("envelope.py: no limit: of ")
    assert once(tmp_path, "--plot-only").code == 3


NUMBER = re.compile(r"\d+\.\d+")


def words_and_numbers(text):
    """The words between the numbers with a point, and these as they stand."""
    return NUMBER.sub("#", text).split(), NUMBER.findall(text)


def assert_same_to_the_last_digit(ours, theirs):
    """The last digit that both print may differ by one, and nothing else.

    Another processor, BLAS or Drake computes the limits anew, equal to some
    1e-9: a number that is so near to the middle between two neighbours is
    rounded to the other one.
    """
    words, numbers = words_and_numbers(ours)
    published_words, published_numbers = words_and_numbers(theirs)
    assert words == published_words
    for number, published in zip(numbers, published_numbers, strict=True):
        digits = max(len(n.partition(".")[2]) for n in (number, published))
        difference = abs(float(number) - float(published))
        assert difference < 1.01 * 10.0**-digits, (number, published)


def test_the_published_folder_gives_the_published_tables(tmp_path):
    """Oracle: its files, which earlier code has written, on another machine."""
    published = ROOT / "docs" / "results" / "g1"
    for name in (TRIALS, "scenario.yaml"):
        shutil.copy(published / name, tmp_path)
    assert once(tmp_path, "--plot-only").code == 0
    for name in ("tables.md", "limits.csv"):
        found = (tmp_path / name).read_text()
        assert_same_to_the_last_digit(found, (published / name).read_text())


REFUSED = [
    (["--mechanisms", "luck"], "mechanisms = 'luck': must be one of "),
    (["--directions", "0,up"], "directions = '0,up': must be degrees"),
    (["--resolution", "1e-309"], "resolution = 1e-309: must be"),
    (["--workers", "0"], "workers = 0: must be in [1, "),
    (
        ["--workers", "100000"],
        f"workers = 100000: must be in [1, {4 * CPU_COUNT}], up to 4 for each",
    ),
    (["--scenario_name", ","], "scenario_name = ','"),
    (["--scheduler", "host:port"], "scheduler = 'host:port'"),
    (["--plot-only", "nowhere"], "trials = nowhere/trials.csv"),
    (
        ["--plot-only", str(ROOT / "docs" / "results" / "g1")],
        "directions = 0,90: must not come with --plot-only",
    ),
    (["--duration", "1.2"], "at = 'right swing 25 %': must be in the walk"),
]


@pytest.mark.parametrize(("argv", "message"), REFUSED)
def test_refuses_what_means_nothing(
    argv, message, tmp_path, capsys, monkeypatch
):
    """On one line, before anything runs, and with nothing left behind."""
    monkeypatch.chdir(tmp_path)
    outcome = run_script(envelope, [*SWEEP, *argv], capsys)
    assert_refused(outcome, message)
    assert outcome.out == []
    assert list(tmp_path.iterdir()) == []
