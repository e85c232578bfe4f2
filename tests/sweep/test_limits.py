"""Oracle: lipm_limit_nadia.csv of the founders, through all that is above."""

from statistics import fmean

import pytest

from nadia_balance.core.walking.mechanisms import MECHANISMS
from nadia_balance.diagrams.scenario import load_scenario
from nadia_balance.sweep import limits
from nadia_balance.sweep.limits import known_limits, limits_of
from nadia_balance.sweep.trials import Cell, Rows
from tests.source_files import ROOT
from tests.sweep.made_up import AT

AT_MOST = "all_with_cross_over"


def test_the_walk_has_the_limit_of_an_enumeration():
    """Oracle: columns v3 and free of lipm_limit_nadia.csv, to 1 %.

    Of the mean: the CoP of the plan is a little inside of the sole's centre,
    which is good for pushes inward, and as bad for those outward.
    """
    scenario = load_scenario("push", fidelity="realistic")
    scenario.controller.timing_adapter.min_swing_duration = 0.35  # the file's
    limit, with_hips, falling = limits_of(scenario, AT)
    found = [limit.largest_push(d) for d in (0, 90, 180, 270)]
    assert sum(found) == pytest.approx(1.99 + 1.02 + 1.99 + 1.93, rel=0.01)
    assert (limit.kappa, with_hips.kappa, falling.kappa) == (0.0, 0.05, 0.05)
    assert (with_hips.fall, falling.fall) == (0.0, 0.7)
    ideal = load_scenario("push", fidelity="ideal")
    ideal.controller.timing_adapter.min_swing_duration = 0.35
    free = limits_of(ideal, AT)[0]
    assert free.largest_push(0) == pytest.approx(3.36, rel=0.01)


def test_knows_the_limits_of_a_folder():
    """Oracle: the pages' figures, rounded to 0.01 m/s."""
    results = ROOT / "docs" / "results"
    known = known_limits(results / "fig10")
    page, readme = (
        " ".join(path.read_text("utf-8").split())
        for path in (results / "README.md", ROOT / "README.md")
    )
    means = {
        name: fmean([known[Cell(*AT, name, 30.0 * i)] for i in range(12)])
        for name in MECHANISMS
    }
    assert " | ".join(f"{mean:.2f}" for mean in means.values()) in page
    assert f"**{means[AT_MOST]:.2f} m/s** on average" in readme
    paper = limits.protocol_of("nadia", AT).curves("push")[AT_MOST]
    times = [known[Cell(*AT, AT_MOST, d)] / v for d, v in paper.items()]
    for text in page, readme:
        assert f"{min(times):.2f} to {max(times):.2f} times the pap" in text


HEAD = "scenario,at,mechanisms,direction_deg,recovered\npush,1 s,step,"


BAD = "", "\0", "a,b\n1,2\n", HEAD[:-6]


@pytest.mark.parametrize(
    "text", [*BAD, *(HEAD + end for end in "0,nan 0,-1 400,1 x,1".split())]
)
def test_what_is_no_limit_is_refused(text, tmp_path):
    """Oracle: no push is below zero, and no direction beyond 360 deg."""
    (tmp_path / "limits.csv").write_text(text)
    message = "^limits = .*: must have a limits.csv"
    for folder in tmp_path, tmp_path / "limits.csv", tmp_path / "none":
        with pytest.raises(ValueError, match=message):
            known_limits(folder)


def test_the_limit_is_of_a_point_mass_whatever_walks():
    """Oracle: the limit of the same scenario in Drake, with perfect sensors."""
    changed = (
        {"engine": "mujoco", "sensors": "consumer"},
        {"text": "{terrain: {name: stairs}}"},
        {"text": "{imperfections: {delay: 0.012, friction_ratio: 0.5}}"},
    )
    scenarios = (
        load_scenario("push", lipm_period=0.02, **changes)
        for changes in ({}, *changed)
    )
    wanted, *found = (limits_of(s, AT)[0].largest_push(0) for s in scenarios)
    assert found == pytest.approx(3 * [wanted], rel=1e-6)


def test_a_sweep_stands_beside_one_of_the_same_robot_alone():
    """Oracle: name and files of the robot; what differs is told."""
    folder = ROOT / "docs" / "results" / "fig10"
    identity, cells = Rows.read(folder).identity, known_limits(folder)
    for changed, title in (
        ({}, "beside: fig10"),
        ({"robot": "elsewhere/robot.yaml"}, "beside: fig10"),
        ({"robot_files": "0"}, "beside: fig10 (other robot files)"),
        ({"plant": "lipm"}, "beside: fig10 (humanoid)"),
    ):
        ours = identity | changed
        limits.check_beside(folder, ours, cells)
        assert limits._title_of(folder, ours) == title
    for files in "0", None:
        other = identity | {"robot": "else", "robot_files": files}
        with pytest.raises(ValueError, match="must be of else, not of nadia$"):
            limits.check_beside(folder, other, cells)
