"""What is in the file stays there, and nothing else gets in."""

import csv
import hashlib
import random

import pytest

from nadia_balance.sweep.limits import LIMITS, OTHERS, WORST
from nadia_balance.sweep.search import SearchParams
from nadia_balance.sweep.trials import FROM_SUMMARY, KEY, TRIALS, Rows
from tests.source_files import ROOT
from tests.sweep.made_up import identity_of, made_up_rows, papers

SEARCH = SearchParams(resolution=0.1, stride=2, replicas=2)
IDENTITY = identity_of(SEARCH)
RESULTS = ROOT / "docs" / "results"
ART = ".gif", ".ipynb", ".png", ".svg"
ROWS = made_up_rows(papers(), SEARCH)[:60]


def test_has_every_row_that_was_added(tmp_path):
    """Oracle: the rows themselves; their order is forgotten."""
    with Rows.opened(tmp_path, IDENTITY) as rows:
        for row in random.Random(1).sample(ROWS, len(ROWS)):
            rows.add(row)
    rows = Rows.read(tmp_path)
    assert rows.identity == IDENTITY
    assert rows.all == sorted(ROWS, key=lambda r: [r[n] for n in KEY])


def test_a_measurement_has_four_digits_and_a_push_all_of_its_own(tmp_path):
    """Oracle: by hand; the search would make a rounded push once more."""
    measured = {"max_icp_error_m": 1.0 / 7.0, "positive_power_w": 12345.678}
    row = {**ROWS[0], **measured, "delta_v": 0.123456789, "qp_failures": 12345}
    with Rows.opened(tmp_path, IDENTITY) as rows:
        rows.add(row)
    rounded = {"max_icp_error_m": 0.1429, "positive_power_w": 12350.0}
    assert rows.all == Rows.read(tmp_path).all == [row | rounded]


def test_the_published_files_have_four_digits():
    """Oracle: the digits as they stand, of all that is measured or computed."""
    columns = {*FROM_SUMMARY, *OTHERS, *WORST} - {"reason"}
    for path in [*RESULTS.rglob(TRIALS), *RESULTS.rglob(LIMITS)]:
        text = path.read_text("utf-8")
        lines = [line for line in text.splitlines() if line[0] != "#"]
        assert len(lines) > 1, path
        for line in csv.DictReader(lines):
            for name in columns & {*line}:
                digits = line[name].partition("e")[0].replace(".", "")
                assert len(digits.strip("0")) <= 4, f"{path}: {name}"


def test_refuses_another_sweep_and_another_process(tmp_path):
    """Oracle: the bytes that were there."""
    with Rows.opened(tmp_path, IDENTITY):
        with pytest.raises(ValueError, match="^out = .*in use by no other"):
            Rows.opened(tmp_path, IDENTITY).__enter__()
    before = (tmp_path / TRIALS).read_bytes()
    for name, value in ("resolution", 0.2), ("plant", "lipm"), ("commit", "0"):
        with pytest.raises(ValueError, match=f"^{name} = {value}: must be "):
            Rows.opened(tmp_path, {**IDENTITY, name: value}).__enter__()
    assert (tmp_path / TRIALS).read_bytes() == before


SPOILT = {
    "outcome": ("recovered", "bogus"),
    "number": ("0.125", "9;9"),
    "column": ("seed,", ""),
    "moment": ("right swing 25 %", "now"),
    "mechanisms": ("icp_only", "luck"),
    "scenario": ("\npush,", "\nshove,"),
    "size": (",0.0,0.2,", ",0.0,NaN,"),
    "list": (",0.0,0.2,", ",0.0,[0.2],"),
    "direction": (",0.0,0.2,", ",400.0,0.2,"),
    "PNG": ("scenario,", "\x89PNG\r\n\xff,"),
}


@pytest.mark.parametrize("change", SPOILT)
def test_another_kind_of_file_is_refused_and_kept(tmp_path, change):
    with Rows.opened(tmp_path, IDENTITY) as rows:
        rows.add(ROWS[0])
    text = (tmp_path / TRIALS).read_text()
    assert SPOILT[change][0] in text
    spoilt = text.replace(*SPOILT[change]).encode("latin-1")
    (tmp_path / TRIALS).write_bytes(spoilt)
    with pytest.raises(ValueError, match=f"^trials = .*{TRIALS}: must be rows"):
        Rows.read(tmp_path)
    assert (tmp_path / TRIALS).read_bytes() == spoilt


def test_a_torn_line_is_left_out(tmp_path):
    """Oracle: the rows before it; the sweep goes on with them."""
    with Rows.opened(tmp_path, IDENTITY) as rows:
        rows.add(ROWS[0])
        rows.add(ROWS[1])
    whole = (tmp_path / TRIALS).read_bytes()
    for size in range(len(whole) - 90, len(whole), 10):
        (tmp_path / TRIALS).write_bytes(whole[:size])
        with Rows.opened(tmp_path, IDENTITY) as rows:
            assert rows.all == ROWS[:1]
            rows.add(ROWS[1])
        assert (tmp_path / TRIALS).read_bytes() == whole


def test_the_page_tells_how_the_single_pushes_ended():
    """Oracle: their rows."""
    page = (RESULTS / "README.md").read_text("utf-8").splitlines()
    for folder in (RESULTS / "single").iterdir():
        ended = [row["outcome"] for row in Rows.read(folder).all]
        link = f"(single/{folder.name}/failures.md)"
        (line,) = (line for line in page if link in line)
        assert f"| {ended.count('recovered')} of {len(ended)} |" in line


def test_results_and_pictures_are_of_the_commit_that_is_told():
    """Oracle: the fingerprints of what `make results` has made.

    A policy's rows are not of our control. A line of the page may end anywhere.
    """
    page = " ".join((RESULTS / "README.md").read_text("utf-8").split())
    first, *lines = (RESULTS / "made.txt").read_text("utf-8").splitlines()
    assert f"commit `{first.split()[1]}`" in page, "docs/results/README.md"
    for path in RESULTS.rglob(TRIALS):
        rows = Rows.read(path.parent)
        if "controller" not in rows.identity:
            commit = rows.identity["commit"]
            assert f"commit `{commit}`" in page, f"{path}: make results"
    assert f"{len(Rows.read(RESULTS / 'fig10').all)} trials" in page
    made = dict(line.split()[::-1] for line in lines)
    docs = [path for path in (ROOT / "docs").rglob("*.*") if path.suffix in ART]
    assert {*made} == {str(path.relative_to(ROOT)) for path in docs}
    for name, digest in made.items():
        found = hashlib.sha256((ROOT / name).read_bytes()).hexdigest()
        assert found == digest, f"{name}: make results"
