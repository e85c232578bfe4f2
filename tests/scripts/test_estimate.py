"""One's own log through the filter, as a user sees it."""

import re

import numpy as np
import pytest

from nadia_balance.results.estimation import measure_estimate
from nadia_balance.scripts import estimate
from nadia_balance.scripts.estimate import FILES, SENSED
from tests.diagrams.simulated import EARLY, simulated
from tests.scripts.running import assert_refused, run_script
from tests.whole_body_examples import nadia


@pytest.fixture(scope="module")
def log():
    """What the sensors told in a short walk, and the plant's state."""
    run = simulated(
        f"{{duration: 2.4, {EARLY % 'num_steps: 2'}, sensors: consumer, "
        "seed: 3, engine: drake}"
    )
    return {name: run.logs[name] for name in ("t", *SENSED, "state")}


def outcome(log, folder, capsys, *flags):
    """Writes `log`, estimates, and returns what the user sees."""
    np.savez(folder / "log.npz", **log)
    argv = [folder / "log.npz", "--out", folder / "out", *flags]
    return run_script(estimate, argv, capsys)


def test_the_log_of_a_run_is_estimated_as_in_its_loop(log, tmp_path, capsys):
    """Oracle: the plant's state, in the bars of the estimator in the loop."""
    found = outcome(log, tmp_path, capsys)
    assert (found.code, found.err) == (0, [])
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [*FILES]
    with np.load(tmp_path / "out" / "estimate.npz") as data:
        told = dict(data)
    errors = measure_estimate(told)
    assert errors["rms_velocity_m_s"] < 0.012
    assert errors["max_tilt_deg"] < 0.8
    assert max(errors["last_horizontal_m"], errors["max_height_m"]) < 0.03
    assert f"mean_nees: {errors['mean_nees']:.4g}" in found.out


def test_a_csv_tells_what_an_npz_does(log, tmp_path, capsys):
    """Oracle: the same numbers by another way, columns back to front."""
    rows = {name: log[name][:50] for name in ("t", *SENSED)}
    rows["imu"], rows["t"] = rows["imu"][:, :6], rows["t"] + 7.0
    joints = nadia().control_plant().GetPositionNames(False, False)[7:]
    head = ["t", *(f"{of}_{x}" for of in ("gyro", "force") for x in "xyz")]
    head += [*joints, *(f"{joint}_speed" for joint in joints)]
    head += ["left_force", "right_force"]
    table = np.column_stack([*rows.values()])[:, ::-1]
    csv = tmp_path / "log.csv"
    look = {"delimiter": ",", "comments": "", "fmt": "%.17g"}
    look["encoding"] = "utf-8-sig"  # a spreadsheet's
    np.savetxt(csv, table, header=",".join(head[::-1]), **look)
    outcome(rows, tmp_path, capsys)
    found = run_script(estimate, [csv, "--out", tmp_path / "csv"], capsys)
    assert (found.code, found.err) == (0, [])
    told = []
    for folder in ("out", "csv"):
        with np.load(tmp_path / folder / "estimate.npz") as data:
            told.append(data["estimated_state"])
    assert told[0].shape == (50, log["state"].shape[1])
    assert np.array_equal(*told)


@pytest.mark.parametrize(
    ("name", "spoil", "message"),
    [
        ("imu", lambda a: a[:, :5], r"log = .*imu must be [(]\d+, 9[)]"),
        ("imu", lambda a: a[:, :7], r"log = .*imu must be [(]\d+, 9[)]"),
        ("imu", lambda a: -a, r"log = .*force_x, .* must be 9.81 m/s\^2"),
        ("imu", lambda a: a / 9.81, r"log = .*must be 9.81 m/s\^2 together"),
        ("joints", np.degrees, "log = .*must be angles in rad"),
        ("foot_forces", lambda a: a / 9.81, "log = .* must be its weight"),
        ("t", lambda a: 1e3 * a, "log = .*t must rise, in steps of at most"),
        ("imu", None, "log = .*: must be a CSV .*it has no imu; it has t"),
        ("joints", lambda a: a[:-1], r"log = .*joints must be [(]\d+, 46[)]"),
        ("t", lambda a: a**2, "log = .*t must rise in equal steps"),
        (
            "foot_forces",
            lambda a: np.where(
                np.arange(len(a))[:, None] // 10 == 2, np.nan, a
            ),
            r"log = .*row 26, t = 0.100 s: must be finite",
        ),
    ],
)
def test_a_wrong_log_is_refused(log, tmp_path, capsys, name, spoil, message):
    """Oracle: the one line, and that nothing is written."""
    spoilt = {**log, name: spoil and spoil(log[name])}
    if spoil is None:
        del spoilt[name]
    found = outcome(spoilt, tmp_path, capsys)
    assert found.code == 2
    (line,) = found.err
    assert re.search(f"^estimate.py: {message}", line), line
    assert not any((tmp_path / "out").glob("*"))


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("a.txt", "t,gyro_x\n", "by its name it is neither"),
        ("a.csv", "", "it is empty"),
        ("a.csv", "t;gyro_x\n0;1\n", "it has no column t; it begins with t;g"),
        ("a.csv", "t, gyro_x\n0,1\n", "it has no column gyro_y; it begins wi"),
    ],
)
def test_a_log_of_another_kind_is_refused(name, text, reason, tmp_path, capsys):
    """Oracle: the line, by hand; NumPy's tells to load it unsafely."""
    (tmp_path / name).write_text(text)
    found = run_script(estimate, [tmp_path / name], capsys)
    assert_refused(
        found,
        f"log = {tmp_path}/{name}: must be a CSV or npz as in docs/sensors.md "
        f"({reason}",
    )
    assert "unsafely" not in found.err[0]
