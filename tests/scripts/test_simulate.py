"""Any scenario, any robot, from anywhere."""

import numpy as np
import pytest

from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.scripts import simulate
from tests.scripts.running import run_script, summary_of

QUICK = ["--plant", "lipm", "--no-meshcat"]


def test_simulates_a_scenario_of_a_file(tmp_path, capsys):
    """Oracle: two steps, of which the file knows, and the one beside them."""
    file = tmp_path / "mine.yaml"
    gait = "gait: {num_steps: 2, step: {length: 0.1}}"
    file.write_text(f"two: {{duration: 5.5, {gait}}}\n")
    argv = ["--scenario_file", file, "--scenario_name", "two", *QUICK]
    outcome = run_script(simulate, [*argv, "--out", tmp_path / "run"], capsys)
    assert (outcome.code, outcome.err) == (0, [])
    assert "WALKED 2 steps, and one to bring the feet tog" in outcome.out[0]
    summary = summary_of(tmp_path / "run")
    assert (summary["steps_taken"], summary["commanded_steps"]) == (3, 2)
    assert summary["pushes"] == []
    assert (summary["direction_deg"], summary["delta_v"]) == (None, None)


def test_a_long_run_leaves_its_last_minute(tmp_path, monkeypatch, capsys):
    """Oracle: by hand, with minutes of 2 s; pushes 10 s apart, from 11 s on."""
    pushes = load_scenario("hour").pushes
    times = [push.moment.time for push in pushes]
    assert times == pytest.approx(1.0 + 10.0 * np.arange(1, 360))
    assert max(push.delta_v for push in pushes) <= 0.4
    monkeypatch.setattr(simulate.command_line, "CHAPTER", 2.0)
    argv = ["--scenario_name", "hour", "--duration", 5, *QUICK]
    outcome = run_script(simulate, [*argv, "--out", tmp_path / "run"], capsys)
    assert (outcome.code, outcome.err) == (0, [])
    told = [line.partition(":")[0] for line in outcome.out[:2]]
    assert told == ["t=2 s  walks on", "t=4 s  walks on"]
    with np.load(tmp_path / "run" / "log.npz") as log:
        begun, ended = log["t"][[0, -1]]
    assert (begun, ended) == pytest.approx((4.0, 5.0), abs=0.01)
