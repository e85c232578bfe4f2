"""What tables.md says.  Oracle: the made-up sweep, and what is in its table."""

import pytest

from diagrams.envelope.limit_search import SearchParams
from diagrams.envelope.limit_tables import LimitTables
from diagrams.envelope.moment import Moment
from diagrams.envelope.references import MOMENT
from diagrams.envelope.report_text import report_text
from tests.diagrams.envelope.made_up_trials import (
    made_up_envelope,
    paper_times,
)

SEARCH = SearchParams(resolution=0.1, stride=4)
LEFT = Moment.parse("left swing 25 %")
BOTH = paper_times(1.0) | paper_times(0.8, LEFT)


def text_of(cells, speed=2.951, **options):
    envelope = made_up_envelope(cells, SEARCH, **options)
    return envelope, report_text(envelope, speed, ["envelope.png"])


def test_has_every_table_and_says_what_was_done():
    envelope, text = text_of(BOTH)
    assert text.startswith("# Push-recovery envelope: nadia, whole body\n")
    assert "![envelope](envelope.png)" in text
    prose = " ".join(text.split())
    assert "scenario `push`" in prose
    assert "multiple of 0.1 m/s" in prose
    assert "recovered in at least 4 of 5 replicas, which differ" in prose
    assert "nothing above 3 m/s was tried" in prose
    assert f"{len(envelope.rows)} trials:" in text
    assert "Not complete" not in text
    tables = LimitTables(envelope=envelope, speed=2.951)
    assert tables.over_moments() in text
    for moment in (MOMENT, LEFT):
        assert tables.summary(moment) in text
        for name in envelope.mechanisms:
            assert tables.details(name, moment) in text


def test_one_replica_is_not_called_several():
    search = SearchParams(resolution=0.1, replicas=1)
    envelope = made_up_envelope({("step", MOMENT, 0.0): 0.5}, search)
    prose = " ".join(report_text(envelope, None, []).split())
    assert "she recovered in the one trial of it; nothing above" in prose
    assert "replicas" not in prose


def test_says_for_which_robot_and_moment_there_are_references():
    paper, note = "* *paper*: Griffin et al. 2023", "right swing 25 % only"
    _, text = text_of(paper_times(1.0))
    assert paper in text
    assert note not in " ".join(text.split())
    _, text = text_of(BOTH)
    assert paper in text
    assert note in " ".join(text.split())
    _, text = text_of(paper_times(1.0), robot="atlas")
    assert paper not in text
    assert note in " ".join(text.split())


def test_a_speed_that_is_not_known_is_left_out_and_said_so():
    _, text = text_of(paper_times(1.0), speed=None, robot="atlas")
    assert "The robot atlas cannot be loaded here" in text
    assert "/ sqrt(g z)" not in text
    _, text = text_of(paper_times(1.0))
    assert "*sqrt(g z)* = 2.951 m/s" in text
    assert "cannot be loaded" not in text


@pytest.mark.parametrize(("mechanisms", "number"), [("step", 36), ("", 60)])
def test_lists_the_cells_that_are_not_complete(mechanisms, number):
    _, text = text_of(
        paper_times(1.0), is_unfinished=lambda c: c[0].startswith(mechanisms)
    )
    listed = text.partition("![")[0]
    assert f"in {number} of 60 cells" in listed
    assert listed.count("\n* `") == 12
    assert f"\n* and {number - 12} more\n" in listed


def test_paragraphs_are_apart_and_prose_fits_the_page():
    _, text = text_of(BOTH, is_unfinished=lambda c: c[2] == 0.0)
    assert "\n\n\n" not in text
    assert text.endswith("|\n")
    lines = [line for line in text.splitlines() if not line.startswith("|")]
    assert max(map(len, lines)) <= 80
