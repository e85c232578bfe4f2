"""A sweep makes each of its trials once, whatever happens meanwhile."""

import shutil
import threading
from concurrent.futures import BrokenExecutor, CancelledError

import pytest

from diagrams.envelope.executors import open_executor
from diagrams.envelope.limit_search import SearchParams, limit
from diagrams.envelope.run_sweep import agenda_of, run_sweep
from diagrams.envelope.trial_rows import key_of
from diagrams.envelope.trials_file import TrialsFile
from nadia_balance.robot import MODELS
from tests.diagrams.envelope.made_up_robot import (
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


def run(sweep, file, workers=2, spoil=lambda scenario: None, **more):
    """Runs the sweep on a made-up robot; returns what was tried, and if all."""
    with MadeUpRobot(workers, spoil) as robot:
        done = run_sweep(sweep, file, robot, workers, **more)
    return robot.tried, done


def results(rows, cell, search):
    """What the search of a cell was told."""
    return {
        (round(row["delta_v"] / search.resolution), row["replica"]): (
            row["outcome"] == "recovered"
        )
        for row in rows
        if (row["mechanisms"], row["direction_deg"])
        == (cell.mechanisms, cell.direction_deg)
    }


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
    for workers in (1, 2, 7):
        file = open_file(sweep, f"{workers}.csv")
        run(sweep, file, workers)
        file.finish()
        written.add(file.path.read_bytes())
    assert len(written) == 1


def test_a_row_says_which_trial_it_was(open_file):
    sweep = made_up_sweep()
    sweep.scenario.seed = 10
    file = open_file(sweep)
    run(sweep, file)
    row = next(r for r in file.rows() if r["replica"] == 2)
    assert row["seed"] == 12
    assert row["phase"] == "right swing 25 %"
    assert row["predicted_at_touchdowns"] == "2;1;0"
    assert row["plant"] == "lipm"
    assert row["max_icp_error_m"] == row["delta_v"] / 7.0
    costs = file.path.with_name("costs.csv").read_text().splitlines()
    assert len(costs) == 1 + len(file.rows())


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


def test_a_finished_sweep_makes_no_trial(open_file):
    sweep = made_up_sweep()
    run(sweep, open_file(sweep))
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
        (BrokenExecutor(), "the workers are gone"),
        (OSError("full"), "a worker failed: OSError: full"),
        (ImportError("no x"), "a worker failed: ImportError: no x"),
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


@pytest.mark.parametrize("slots", [1, 3])
def test_no_more_trials_wait_than_one(open_file, slots):
    """So that the next one can be chosen late."""
    busy, most, lock = [0], [0], threading.Lock()

    class Counting(MadeUpRobot):
        def submit(self, *args):
            with lock:
                busy[0] += 1
                most[0] = max(most[0], busy[0])
            return super().submit(*args)

        def _run(self, *args):
            try:
                return super()._run(*args)
            finally:  # before anybody hears of it
                with lock:
                    busy[0] -= 1

    sweep = made_up_sweep()
    with Counting(slots) as robot:
        run_sweep(sweep, open_file(sweep), robot, slots)
    assert most[0] <= slots + 1
    assert most[0] > 1


def test_tells_its_progress_after_every_trial(open_file):
    sweep, told = made_up_sweep(), []
    file = open_file(sweep)
    run(sweep, file, progress=told.append)
    assert [now.done for now in told] == list(range(len(file.rows()) + 1))
    assert told[-1].total == told[-1].done
    assert told[-1].complete == told[-1].cells == 6
    assert agenda_of(sweep, file).progress() == told[-1]


def test_ends_when_the_robot_becomes_another_one(open_file, tmp_path):
    """A real child; the file is changed after its hash was taken."""
    shutil.copytree(MODELS / "nadia", tmp_path / "nadia")
    sweep = made_up_sweep()
    sweep.scenario.robot = str(tmp_path / "nadia" / "robot.yaml")
    file = open_file(sweep)
    with (tmp_path / "nadia" / "nadia.urdf").open("a") as urdf:
        urdf.write("<!-- changed -->")
    asked = file.identity["robot_files"]
    told = rf"robot_files = \w+: must be {asked}, as when the sweep began"
    with open_executor(1) as (executor, slots):
        with pytest.raises(RuntimeError, match=told):
            run_sweep(sweep, file, executor, slots)
    assert file.rows() == []


def test_a_trial_that_hangs_is_a_row_and_the_sweep_goes_on(open_file):
    """A real child, which needs longer for its imports alone."""
    search = SearchParams(resolution=0.2, stride=1, replicas=1)
    sweep = made_up_sweep(
        directions=(0.0, 90.0),
        mechanisms=("step",),
        search=search,
        timeout=0.05,
    )
    file = open_file(sweep)
    with open_executor(1) as (executor, slots):
        assert run_sweep(sweep, file, executor, slots)
    assert len(file.rows()) == 2
    assert {row["outcome"] for row in file.rows()} == {"hung"}
    assert {row["reason"] for row in file.rows()} == {"no result after 0.05 s"}


def test_two_processes_make_the_rows_of_one(open_file):
    """Real trials of the point mass.  Oracle: the bytes of the files."""
    search = SearchParams(resolution=0.4, stride=1, replicas=2, largest=1.2)
    sweep = made_up_sweep(
        directions=(0.0, 180.0), mechanisms=("icp_only",), search=search
    )
    sweep.scenario.duration, sweep.scenario.required_steps = 6.0, 1
    written = []
    for workers in (1, 2):
        file = open_file(sweep, f"{workers}.csv")
        with open_executor(workers) as (executor, slots):
            assert run_sweep(sweep, file, executor, slots)
        file.finish()
        written.append(file.path.read_bytes())
        outcomes = {row["outcome"] for row in file.rows()}
        assert not outcomes & {"error", "crashed", "hung"}
    assert written[0] == written[1]
    assert len({key_of(row) for row in file.rows()}) == len(file.rows()) > 2
