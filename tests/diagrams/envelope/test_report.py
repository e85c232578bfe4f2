"""Everything is written from the envelope alone."""

import math

from matplotlib.image import imread

from diagrams.envelope.envelope_data import envelope_of
from diagrams.envelope.limit_search import SearchParams
from diagrams.envelope.moment import Moment
from diagrams.envelope.references import MOMENT
from diagrams.envelope.report import write_report
from diagrams.envelope.report_text import report_text
from tests.diagrams.envelope.made_up_trials import (
    identity_of,
    made_up_rows,
    paper_times,
)

SEARCH = SearchParams(resolution=0.1, stride=4)
LEFT = Moment.parse("left swing 25 %")


def report(folder, rows):
    written = write_report(folder, envelope_of(identity_of(SEARCH), rows))
    assert sorted(written) == sorted(path.name for path in folder.iterdir())
    return written


def test_writes_pictures_and_tables_of_the_trials(tmp_path):
    """Oracle: the text for the very same rows."""
    rows = made_up_rows(paper_times(1.0), SEARCH)
    written = report(tmp_path, rows)
    assert written == ["envelope.png", "bars.png", "tables.md"]
    envelope = envelope_of(identity_of(SEARCH), rows)
    speed = math.sqrt(9.81 * 0.888)  # of Nadia's robot.yaml
    expected = report_text(envelope, speed, written[:-1])
    assert (tmp_path / "tables.md").read_text("utf-8") == expected
    for name in written[:-1]:
        picture = imread(tmp_path / name)
        assert min(picture.shape[:2]) > 600
        assert picture[..., :3].std() > 0.03


def test_several_moments_have_a_picture_of_their_own(tmp_path):
    cells = {("step", m, 0.0): 0.5 for m in (MOMENT, LEFT)}
    written = report(tmp_path, made_up_rows(cells, SEARCH))
    assert written == ["envelope.png", "phases.png", "bars.png", "tables.md"]
    assert "(phases.png)" in (tmp_path / "tables.md").read_text("utf-8")


def test_a_robot_that_is_gone_is_no_hindrance(tmp_path):
    cells = {("step", MOMENT, 0.0): 0.5}
    rows = made_up_rows(cells, SEARCH, robot="/nowhere/robot.yaml")
    assert report(tmp_path, rows)[-1] == "tables.md"
    text = (tmp_path / "tables.md").read_text("utf-8")
    assert "/nowhere/robot.yaml cannot be loaded" in text


def test_a_sweep_that_has_only_begun_is_reported_too(tmp_path):
    rows = made_up_rows({("step", MOMENT, 0.0): 0.5}, SEARCH)[:1]
    assert len(report(tmp_path, rows)) == 3
    text = (tmp_path / "tables.md").read_text("utf-8")
    assert "in 1 of 1 cells" in text
