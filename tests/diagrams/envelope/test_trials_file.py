"""What is in trials.csv stays there, and nothing else gets in."""

import csv
import json
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from diagrams.envelope.limit_search import SearchParams
from diagrams.envelope.trial_rows import COLUMNS, key_of, line_of
from diagrams.envelope.trials_file import TrialsFile, read_trials
from tests.diagrams.envelope.made_up_trials import (
    identity_of,
    made_up_rows,
    paper_times,
)
from tests.scripts.running import environment

SEARCH = SearchParams(resolution=0.1, stride=2, replicas=2)
IDENTITY = identity_of(SEARCH)
ROWS = made_up_rows(paper_times(1.0), SEARCH)[:60]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "trials.csv"


@pytest.fixture
def full(path):
    """A file with all rows, in an order of its own."""
    file = TrialsFile(path, IDENTITY)
    for row in random.Random(1).sample(ROWS, len(ROWS)):
        file.append(row)
    return file


def test_has_every_row_that_was_appended(full, path):
    """Oracle: the rows themselves, and Python's own readers."""
    identity, rows = read_trials(path)
    assert identity == IDENTITY
    assert rows == full.rows()
    assert sorted(rows, key=key_of) == sorted(ROWS, key=key_of)
    first, *table = path.read_text("utf-8").splitlines()
    assert json.loads(first.removeprefix("# ")) == IDENTITY
    assert next(csv.reader(table)) == list(COLUMNS)
    assert len(table) == 1 + len(ROWS)


def test_goes_on_where_it_was_left(full, path):
    again = TrialsFile(path, IDENTITY)
    assert again.rows() == full.rows()


def test_what_it_knows_itself_need_not_be_told(path):
    """Oracle: the versions and hashes of the identity."""
    file = TrialsFile(path, IDENTITY)
    told = {k: v for k, v in ROWS[0].items() if k not in IDENTITY}
    file.append({**told, "seed": 4})
    (row,) = file.rows()
    assert row["code"] == IDENTITY["code"]
    assert row["drake"] == IDENTITY["drake"]
    assert row["seed"] == 4, "that of the trial, not of the sweep"


def test_refuses_the_same_trial_twice(full, path):
    before = path.read_bytes()
    with pytest.raises(ValueError, match="must not be repeated"):
        full.append(ROWS[7])
    assert path.read_bytes() == before


def test_the_order_of_the_rows_is_forgotten(full, path):
    """Oracle: the same file, made in another order, byte by byte."""
    full.finish()
    other = TrialsFile(path.with_name("other.csv"), IDENTITY)
    for row in ROWS:
        other.append(row)
    other.finish()
    assert other.path.read_bytes() == path.read_bytes()
    assert read_trials(path)[1] != full.rows(), "it was in another order"
    assert len(TrialsFile(path, IDENTITY).rows()) == len(ROWS)


def test_a_row_torn_at_any_byte_is_mended(path):
    """Oracle: all that was written before it; then it is appended anew."""
    file = TrialsFile(path, IDENTITY)
    for row in ROWS[:3]:
        file.append(row)
    whole = path.read_bytes()
    last = len(line_of(ROWS[2]).encode())
    for torn in range(1, last):
        path.write_bytes(whole[:-torn])
        assert read_trials(path)[1] == ROWS[:2]
        again = TrialsFile(path, IDENTITY)
        assert again.rows() == ROWS[:2]
        again.append(ROWS[2])
        assert path.read_bytes() == whole


def test_looking_at_a_torn_file_leaves_it_alone(full, path):
    torn = path.read_bytes()[:-5]
    path.write_bytes(torn)
    read_trials(path)
    assert path.read_bytes() == torn


def test_torn_costs_are_mended_too(full, path):
    costs = path.with_name("costs.csv")
    costs.write_bytes(costs.read_bytes()[:-5])
    left = dict.fromkeys(("mechanisms", "phase"), "x")
    file = TrialsFile(path, IDENTITY)
    row = {**ROWS[0], "replica": 99, "cpu_s": 1.5, "wall_s": 2.5, **left}
    file.append({**row, "mechanisms": "step"})
    *_, last = csv.DictReader(costs.read_text().splitlines())
    assert (last["cpu_s"], last["wall_s"]) == ("1.5", "2.5")
    assert len(costs.read_text().splitlines()) == 1 + len(ROWS) - 1 + 1


def test_costs_are_not_among_the_rows(path):
    """Oracle: rows are the same whenever they are made, costs are not."""
    file = TrialsFile(path, IDENTITY)
    file.append({**ROWS[0], "cpu_s": 123.456, "wall_s": 234.567})
    assert "123.456" not in path.read_text()
    costs = path.with_name("costs.csv").read_text().splitlines()
    assert costs[-1].endswith(",123.456,234.567")


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("resolution", 0.2, "resolution = 0.2: must be 0.1 as in "),
        ("protocol", 2, "protocol = 2: must be 1 as in "),
        ("python", "4.0", "python = 4.0: must be 3.11.2 as in "),
        ("parameters", "0", "parameters = 0: must be 0123456789abcdef as in "),
    ],
)
def test_names_what_is_not_the_same(full, path, name, value, told):
    before = path.read_bytes()
    with pytest.raises(ValueError) as refused:
        TrialsFile(path, {**IDENTITY, name: value})
    assert str(refused.value).startswith(f"{told}{path}")
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    "content",
    [b"", b"x", b"a,b\n1,2\n", b"# {}\na,b\n", b"# [1]\n", b"\x89PNG\r\n\xff"],
)
def test_another_kind_of_file_is_refused_and_kept(path, content):
    path.write_bytes(content)
    for look in (read_trials, lambda path: TrialsFile(path, IDENTITY)):
        with pytest.raises(ValueError) as refused:
            look(path)
        assert str(refused.value) == (
            f"trials = {path}: must be a trials.csv of this program"
        )
    assert path.read_bytes() == content


def test_names_the_line_that_is_not_right(full, path):
    lines = path.read_text().splitlines(keepends=True)
    for change, told in (
        ("a,b\n", "line 4: must have 24 cells, has 2"),
        (lines[2], "line 4: must not repeat a trial"),
        (lines[3].replace(f",{full.rows()[1]['delta_v']},", ",x,"), "line 4: "),
    ):
        path.write_text("".join([*lines[:3], change, *lines[4:]]))
        with pytest.raises(ValueError) as refused:
            read_trials(path)
        assert str(refused.value).startswith(f"trials = {path}: {told}")


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("resolution", None, "resolution = None: must be of type float"),
        ("stride", 2.5, "stride = 2.5: must be of type int"),
        ("replicas", "2", "replicas = '2': must be of type int"),
        ("largest", 1e308, "largest = 1e+308: must be in [resolution = 0.1, "),
    ],
)
def test_names_what_is_wrong_in_the_first_line(path, name, value, told):
    """Oracle: one field of a good line, changed; or not there at all."""
    good = {key: IDENTITY[key] for key in IDENTITY if key != name}
    for bad in (good | {name: value}, *([good] if value is None else [])):
        path.unlink(missing_ok=True)
        TrialsFile(path, bad)
        with pytest.raises(ValueError) as refused:
            read_trials(path)
        assert str(refused.value).startswith(f"trials = {path}: line 1: {told}")


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        (
            "mechanisms",
            "luck",
            "mechanisms = 'luck': must be one of icp_only, ",
        ),
        ("mechanisms", None, "mechanisms = '': must be one of icp_only, "),
        ("phase", "noon", "phase = 'noon': must be like \"right swing 25 %\""),
        ("phase", None, "phase = '': must be like \"right swing 25 %\""),
        ("direction_deg", None, "direction_deg = None: must be in [0, 360]"),
        ("delta_v", None, "delta_v = None: must be in [0, 3]"),
        ("delta_v", "inf", "delta_v = inf: must be in [0, 3]"),
        ("delta_v", "nan", "delta_v = nan: must be in [0, 3]"),
        ("replica", None, "replica = None: must be in [0, inf]"),
    ],
)
def test_names_the_cell_that_no_trial_has(path, name, value, told):
    """Oracle: a good row, but for this one cell."""
    TrialsFile(path, IDENTITY)
    with path.open("a") as file:
        file.write(line_of({**ROWS[0], name: value}))
    with pytest.raises(ValueError) as refused:
        read_trials(path)
    assert str(refused.value).startswith(f"trials = {path}: line 3: {told}")


def test_a_full_disk_is_told_and_nothing_is_lost(path):
    """Oracle: /dev/full, the disk that is always full."""
    file = TrialsFile(path, IDENTITY)
    file.append(ROWS[0])
    file.path = Path("/dev/full")
    with pytest.raises(OSError, match="No space left"):
        file.append(ROWS[1])
    assert file.rows() == ROWS[:1]
    file.path = path
    file.append(ROWS[1])
    assert read_trials(path)[1] == ROWS[:2]


APPENDER = """
import itertools, sys
from pathlib import Path
from diagrams.envelope.trials_file import TrialsFile
from tests.diagrams.envelope.test_trials_file import IDENTITY, ROWS
file = TrialsFile(Path(sys.argv[1]), IDENTITY)
for replica in itertools.count():
    file.append({**ROWS[0], "replica": replica, "reason": "x" * 5000})
    print(replica, flush=True)
"""


def test_a_row_survives_a_kill_as_soon_as_it_is_appended(path):
    """Oracle: what the process said was appended before it was killed."""
    child = subprocess.Popen(
        [sys.executable, "-c", APPENDER, path],
        env=environment(),
        stdout=subprocess.PIPE,
        text=True,
    )
    for _ in range(5):
        child.stdout.readline()
    child.send_signal(signal.SIGKILL)
    said = 5 + len(child.stdout.readlines())
    child.wait()
    child.stdout.close()
    rows = TrialsFile(path, IDENTITY).rows()
    assert [row["replica"] for row in rows] == list(range(len(rows)))
    assert said <= len(rows) <= said + 1
