"""A sweep makes each of its trials once, whatever happens meanwhile."""

import contextlib
import shutil
from concurrent.futures import BrokenExecutor, CancelledError

import pytest

from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.robot import MODELS
from nadia_balance.scripts.envelope_sweep.run import (
    agenda_of,
    progress_bar,
    run_sweep,
)
from nadia_balance.scripts.envelope_sweep.search import (
    Progress,
    SearchParams,
    limit,
)
from nadia_balance.scripts.envelope_sweep.trials_file import (
    TrialsFile,
    cell_of,
    key_of,
)
from nadia_balance.scripts.envelope_sweep.workers import open_workers
from tests.scripts.envelope_sweep.made_up import (
    WEAKER,
    MadeUpRobot,
    largest,
    made_up_sweep,
)


@pytest.fixture
def open_file(tmp_path):
    """Opens the same file again and again, or another one."""

    def opened(sweep, name="trials.csv"):
        return TrialsFile(tmp_path / name, sweep.identity())

    return opened


def run(sweep, file, slots=2, spoil=lambda scenario: None, **more):
    """Runs the sweep on a made-up robot; returns what was tried, and if all."""
    with contextlib.closing(MadeUpRobot(slots, spoil)) as robot:
        done = run_sweep(sweep, file, robot, **more)
    return robot.tried, done


def results(rows, cell, search):
    """What the search of a cell was told."""
    return {
        (round(row["delta_v"] / search.resolution), row["replica"]): (
            row["outcome"] == "recovered"
        )
        for row in rows
        if cell_of(row) == cell
    }


def test_rows_name_the_gait_that_was_walked(open_file):
    """Oracle: the durations of the scenarios that the workers got."""
    gaits = {
        name: load_scenario("push", text=f"duration: {duration}")
        for name, duration in (("long", 14.0), ("short", 13.0))
    }
    sweep, walked = made_up_sweep(scenarios=gaits), []
    file = open_file(sweep)
    _, done = run(sweep, file, spoil=lambda s: walked.append(s.duration))
    assert done
    named = [gaits[row["scenario"]].duration for row in file.rows()]
    assert sorted(named) == sorted(walked)
    assert set(named) == {13.0, 14.0}
    assert run(sweep, open_file(sweep)) == ([], True)


def test_finds_the_limit_of_every_cell(open_file):
    """Oracle: the limits that the made-up robot has."""
    sweep = made_up_sweep()
    file = open_file(sweep)
    tried, done = run(sweep, file)
    assert done
    assert len(tried) == len(set(tried)) == len(file.rows())
    for cell in sweep.cells():
        found = limit(results(file.rows(), cell, sweep.search), sweep.search)
        # All three replicas must recover, the weaker one, too.
        true = largest(cell.mechanisms, cell.direction_deg) - WEAKER
        assert found.complete
        assert found.recovered <= true < found.failed
        assert found.failed - found.recovered == pytest.approx(0.1)


def test_rows_do_not_depend_on_the_number_of_workers(open_file):
    """Oracle: the bytes of the files."""
    sweep, written = made_up_sweep(), set()
    for slots in (1, 2, 7):
        file = open_file(sweep, f"{slots}.csv")
        run(sweep, file, slots)
        file.finish()
        written.add(file.path.read_bytes())
    assert len(written) == 1


def test_goes_on_after_being_stopped_again_and_again(open_file):
    """Oracle: the file of a sweep that nobody stopped."""
    sweep = made_up_sweep()
    whole = open_file(sweep, "whole.csv")
    run(sweep, whole)
    whole.finish()
    tried = []
    for stop_after in (0, 1, 3, 5, 8, 13, 1000):
        file = open_file(sweep)
        goal = len(file.rows()) + stop_after
        seen, done = run(
            sweep,
            file,
            stopped=lambda file=file, goal=goal: len(file.rows()) >= goal,
        )
        tried += seen
        file.finish()
    assert done
    assert file.path.read_bytes() == whole.path.read_bytes()
    assert len(tried) > len(set(tried)), "some were lost, and made again"
    assert run(sweep, open_file(sweep)) == ([], True)


def test_directions_can_be_added_to_a_finished_sweep(open_file):
    """Oracle: both at once."""
    few, all_of_them = made_up_sweep(directions=(90.0,)), made_up_sweep()
    run(few, open_file(few))
    tried, done = run(all_of_them, file := open_file(all_of_them))
    assert done
    assert {direction for _, direction, _, _ in tried} == {0.0, 210.0}
    file.finish()
    at_once = open_file(all_of_them, "at_once.csv")
    run(all_of_them, at_once)
    at_once.finish()
    assert file.path.read_bytes() == at_once.path.read_bytes()


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (CancelledError(), "the workers are gone"),
        (OSError("full"), "a worker failed: OSError: full"),
    ],
)
def test_ends_when_the_workers_are_gone_or_fail(open_file, error, told):
    """No row is made up for what was not tried: it can go on later."""

    def spoil(scenario):
        if scenario.mechanisms == "step":
            raise error

    sweep = made_up_sweep()
    file = open_file(sweep)
    with pytest.raises(RuntimeError, match=told):
        run(sweep, file, spoil=spoil)
    assert {row["mechanisms"] for row in file.rows()} <= {"icp_only"}
    _, done = run(sweep, open_file(sweep))
    assert done


def test_a_process_that_dies_costs_only_the_trial_that_killed_it(open_file):
    """Oracle: one trial kills its process whenever it is run, with all others.

    Its row says so; all other rows are those of a sweep in which none died.
    """
    sweep = made_up_sweep()
    whole = open_file(sweep, "whole.csv")
    run(sweep, whole)

    class Deadly(MadeUpRobot):
        def _run(self, scenario, trial, pause):
            if trial[:2] == ("step", 90.0) and trial[3] == 0:
                raise BrokenExecutor
            return super()._run(scenario, trial, pause)

    file = open_file(sweep)
    with contextlib.closing(Deadly(3)) as robot:
        assert run_sweep(sweep, file, robot)
    assert robot.renewed > 1
    crashed = [r for r in file.rows() if r["outcome"] == "crashed"]
    assert crashed
    for row in crashed:
        assert (row["mechanisms"], row["direction_deg"]) == ("step", 90.0)
        assert row["reason"] == "the process of the trial died"
    others = [
        {key_of(r): r for r in f.rows() if r["direction_deg"] != 90.0}
        for f in (file, whole)
    ]
    assert others[0] == others[1]


def test_ends_when_there_is_no_new_start(open_file):
    class Gone(MadeUpRobot):
        def renew(self):
            raise BrokenExecutor

        def _run(self, *args):
            raise BrokenExecutor

    sweep = made_up_sweep()
    with contextlib.closing(Gone(2)) as robot:
        with pytest.raises(RuntimeError, match="the workers are gone"):
            run_sweep(sweep, file := open_file(sweep), robot)
    assert file.rows() == []


def test_tells_its_progress_after_every_trial(open_file):
    sweep, told = made_up_sweep(), []
    file = open_file(sweep)
    run(sweep, file, progress=told.append)
    assert [now.done for now in told] == list(range(len(file.rows()) + 1))
    assert told[-1].total == told[-1].done
    assert told[-1].complete == told[-1].cells == 6
    assert agenda_of(sweep, file).progress() == told[-1]


def test_the_bar_shows_what_it_is_told(capsys):
    """Oracle: the text on stderr; what an earlier run did took no time."""

    def told(done, total, complete):
        return Progress(done=done, total=total, complete=complete, cells=6)

    with progress_bar(told(20, 80, 0)) as show:
        first = capsys.readouterr().err.split("\r")[-1]
        show(told(21, 90, 0))
        show(told(95, 95, 6))
    assert "20/80" in first
    assert "0.00trial/s" in first or "?trial/s" in first
    last = capsys.readouterr().err.split("\r")[-1]
    assert "95/95" in last
    assert "6/6 limits found" in last


def test_ends_when_the_robot_becomes_another_one(open_file, tmp_path):
    """A real process; the file is changed after its hash was taken."""
    shutil.copytree(MODELS / "nadia", tmp_path / "nadia")
    sweep = made_up_sweep()
    sweep.scenarios["push"].robot = str(tmp_path / "nadia" / "robot.yaml")
    file = open_file(sweep)
    with (tmp_path / "nadia" / "nadia.urdf").open("a") as urdf:
        urdf.write("<!-- changed -->")
    asked = file.identity["robot_files"]
    told = rf"robot_files = \w+: must be {asked}, as when the sweep began"
    with open_workers(1) as workers:
        with pytest.raises(RuntimeError, match=told):
            run_sweep(sweep, file, workers)
    assert file.rows() == []


def test_two_processes_make_the_rows_of_one(open_file):
    """Real trials of the point mass.  Oracle: the bytes of the files."""
    search = SearchParams(resolution=0.4, stride=1, replicas=2, largest=1.2)
    sweep = made_up_sweep(
        directions=(0.0, 180.0), mechanisms=("icp_only",), search=search
    )
    scenario = sweep.scenarios["push"]
    scenario.duration, scenario.calm_steps = 6.0, 1
    written = []
    for slots in (1, 2):
        file = open_file(sweep, f"{slots}.csv")
        with open_workers(slots) as workers:
            assert run_sweep(sweep, file, workers)
        file.finish()
        written.append(file.path.read_bytes())
        outcomes = {row["outcome"] for row in file.rows()}
        assert not outcomes & {"error", "crashed", "hung"}
    assert written[0] == written[1]
    assert len({key_of(row) for row in file.rows()}) == len(file.rows()) > 2
