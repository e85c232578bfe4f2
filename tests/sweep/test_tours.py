"""Runs of the tour: each is made once; its row and its table."""

from concurrent.futures import Future

import pytest

from nadia_balance.diagrams import tour
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.sweep import tour as tours
from nadia_balance.sweep.tour import Tour, TourRows, run_tours, write_table

SCENARIO = load_scenario("stand", robot="g1", duration=4.0)


class AtOnce:
    """An Executor that makes what it is given at once."""

    def submit(self, make, *given):
        future = Future()
        future.set_result(make(*given))
        return future


def made_up(scenario, stage, seed):
    """Odd runs fall after 40 s, before they have walked anywhere."""
    assert scenario == SCENARIO
    falls = seed % 2 == 1
    return {
        "outcome": "fell" if falls else "complete",
        "reason": "pelvis\ntilted" if falls else "",
        "survival_s": 40.0 if falls else 90.0,
        "upright_s": 39.123456 if falls else 90.0,
        "waypoints": 0 if falls else 18,
        "position_error_cm": None if falls else 4.0 + seed,
        "yaw_error_deg": None if falls else 2.0,
        "power_w": 100.0,
    }


@pytest.fixture
def made(monkeypatch):
    """The runs that have been made."""
    runs = []

    def run_tour(scenario, stage, seed):
        runs.append((stage, seed))
        return made_up(scenario, stage, seed)

    monkeypatch.setattr(tour, "run_tour", run_tour)
    return runs


def run(folder, stages, seeds) -> bool:
    sweep = Tour(scenario=SCENARIO, stages=stages, seeds=seeds)
    sweep.validate()
    with sweep.opened(folder) as rows:
        return run_tours(sweep, rows, AtOnce())


def test_each_run_is_made_once_and_goes_on(made, tmp_path):
    """Oracle: the list of the runs; the rows are those made up, in order."""
    assert run(tmp_path, ("held",), 2)
    assert run(tmp_path, ("held", "walked"), 3)
    assert made == [
        ("held", 0),
        ("held", 1),
        ("walked", 0),
        ("walked", 1),
        ("held", 2),
        ("walked", 2),
    ]
    rows = TourRows.read(tmp_path).all
    assert [(row["stage"], row["seed"]) for row in rows] == sorted(made)
    fell = rows[1]
    assert fell["reason"] == "pelvis tilted"
    assert fell["upright_s"] == 39.12
    assert fell["position_error_cm"] is None


def test_the_table_has_shares_and_means(made, tmp_path):
    """Oracle: by hand; runs that reached no waypoint have no error."""
    run(tmp_path, ("held",), 3)
    head, _, line = write_table(TourRows.read(tmp_path))
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    assert cells == ["held", "2 of 3", "73.3", "73.0", "5.0", "2.0", "100.0"]
    assert (tmp_path / tours.TABLE).read_text("utf-8").startswith(head)


def test_another_scenario_or_a_spoilt_row_is_refused(made, tmp_path):
    run(tmp_path, ("held",), 1)
    other = Tour(
        scenario=SCENARIO.changed(engine="mujoco"), stages=("held",), seeds=1
    )
    with (
        pytest.raises(ValueError, match="^parameters = "),
        other.opened(tmp_path),
    ):
        pass
    path = tmp_path / tours.TOURS
    text = path.read_text("utf-8")
    path.write_text(text.replace("\nheld", "\nthrown"), "utf-8")
    with pytest.raises(ValueError, match="^tours = .*thrown.*is no tour"):
        TourRows.read(tmp_path)


@pytest.mark.parametrize(
    ("stages", "seeds", "message"),
    [
        (("held", "thrown"), 1, "stages = 'thrown': must be of held"),
        (("held",), 0, "seeds = 0: must be in"),
        (("held",), 513, "seeds = 513: must be in"),
    ],
)
def test_refuses_unknown_stages_and_seeds(stages, seeds, message):
    sweep = Tour(scenario=SCENARIO, stages=stages, seeds=seeds)
    with pytest.raises(ValueError, match=f"^{message}"):
        sweep.validate()
