"""The picture of both robots, read from the drawing itself."""

import csv
import math
from statistics import fmean

import numpy as np
import pytest

import envelopes
from nadia_balance.diagrams.scenario import AT
from tests.scripts.running import assert_refused, run_script
from tests.source_files import ROOT

RESULTS = ROOT / "docs" / "results"


def published(folder: str) -> dict[float, float]:
    """The limits in a folder's table, by direction [deg]."""
    with open(RESULTS / folder / "limits.csv", encoding="utf-8") as file:
        return {
            float(line["direction_deg"]): float(line["recovered"])
            for line in csv.DictReader(file)
            if (line["at"], line["mechanisms"]) == (AT, envelopes.MOST)
        }


def test_the_curves_are_those_of_the_tables():
    """Oracles: limits.csv; the paper's figure in the folder of its robot."""
    text = (ROOT / "models/nadia/nadia_fig10.csv").read_text("utf-8")
    lines = [line for line in text.splitlines() if line[0] != "#"]
    paper = {
        float(line["direction"]): float(line[envelopes.MOST])
        for line in csv.DictReader(lines)
    }
    expected = [
        [published("fig10"), paper],
        [published("g1"), published("g1_policy_moments")],
    ]
    figure = envelopes.draw(RESULTS)
    for ax, limits in zip(figure.axes, expected, strict=True):
        for line, values in zip(ax.lines, limits, strict=True):
            angles, radii = np.degrees(line.get_xdata()), line.get_ydata()
            drawn = dict(zip(angles.round(), radii, strict=True))
            assert drawn == pytest.approx(values)
            assert len(radii) == 13
            mean = f"{fmean(values.values()):.2f} m/s in the mean"
            assert line.get_label().endswith(mean)
    one, two = (ax.get_rmax() for ax in figure.axes)
    assert one == two
    assert math.isclose(one % 0.5, 0.0)


def test_says_what_is_wrong_on_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for argv, message in (
        (["--out", "a.gif"], "out = 'a.gif': must end in .png"),
        (["--results", "b"], "limits = 'b/fig10': must have a limits.csv"),
    ):
        assert_refused(run_script(envelopes, argv, capsys), message)
    assert not list(tmp_path.iterdir())
