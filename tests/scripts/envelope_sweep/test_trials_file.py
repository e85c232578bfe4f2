"""What is in trials.csv stays there, and nothing else gets in."""

import csv
import json
import platform
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from nadia_balance.scripts.envelope_sweep.plan import code_hash
from nadia_balance.scripts.envelope_sweep.search import SearchParams
from nadia_balance.scripts.envelope_sweep.trials_file import (
    COLUMNS,
    TrialsFile,
    alone_in,
    key_of,
    line_of,
    parse_cells,
    read_trials,
)
from tests.scripts.envelope_sweep.made_up import (
    identity_of,
    made_up_rows,
    paper_times,
)
from tests.scripts.running import environment
from tests.source_files import ROOT

SEARCH = SearchParams(resolution=0.1, stride=2, replicas=2)
IDENTITY = identity_of(SEARCH)
PUBLISHED = ROOT / "docs" / "results" / "fig10"
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


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("resolution", 0.2, "resolution = 0.2: must be 0.1 as in "),
        ("protocol", 1, "protocol = 1: must be 5 as in "),
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
    "content", [b"", b"a,b\n1,2\n", b"# []\na,b\n", b"\x89PNG\r\n\xff"]
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
        ("a,b\n", "line 4: must have 29 cells, has 2"),
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
        ("resolution", None, "search: resolution = None: must be "),
        ("stride", 2.5, "search: stride = 2.5: must be "),
        ("replicas", "two", "search: replicas = 'two': must be "),
        ("largest", 1e3, "largest = 1000.0: must be in [resolution = 0.1, "),
        ("protocol", 99, "protocol = 99: must be 5 (limits are "),
    ],
)
def test_names_what_is_wrong_in_the_first_line(path, name, value, told):
    """Oracle: one field of a good line, changed or not there at all."""
    bad = {key: IDENTITY[key] for key in IDENTITY if key != name}
    TrialsFile(path, bad | ({} if value is None else {name: value}))
    with pytest.raises(ValueError) as refused:
        read_trials(path)
    assert str(refused.value).startswith(f"trials = {path}: line 1: {told}")


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("mechanisms", "luck", "mechanisms = 'luck': must be one of icp_only"),
        ("at", "noon", "at = 'noon': must be like \"right swing 25 %\""),
        ("direction_deg", None, "direction_deg = None: must be in [0, 360]"),
        ("delta_v", "nan", "delta_v = nan: must be in [0, 3]"),
        ("outcome", "bogus", "outcome = 'bogus': must be one of recovered, "),
        ("steps_after_push", -1, "steps_after_push = -1: must be in [0, "),
        ("max_torque_ratio", "nan", "max_torque_ratio = nan: must be in [0, "),
        ("predicted_at_push", -2, "predicted_at_touchdowns = -2: must be in ["),
        ("predicted_at_touchdowns", "1;x", "predicted_at_touchdowns = nan: "),
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


def test_rows_of_another_protocol_are_not_gone_on_with(path):
    """Oracle: the published sweep, as if it were of an older program."""
    identity, rows = read_trials(PUBLISHED / "trials.csv")
    path.write_bytes((PUBLISHED / "trials.csv").read_bytes())
    assert {row["at"] for row in rows} == {"right swing 25 %"}
    with pytest.raises(ValueError) as refused:
        TrialsFile(path, identity | {"protocol": 6})
    assert str(refused.value).startswith(
        f"protocol = 6: must be {identity['protocol']} as in {path}"
    )
    assert path.read_bytes() == (PUBLISHED / "trials.csv").read_bytes()


def test_the_page_says_of_which_code_its_rows_are():
    """Oracle: the rows, and the fingerprint of this code."""
    identity, rows = read_trials(PUBLISHED / "trials.csv")
    page = (PUBLISHED.parent / "README.md").read_text(encoding="utf-8")
    assert f"code `{identity['code']}`" in page
    assert f"{len(rows)} trials" in page
    same_python = identity["python"] == platform.python_version()
    if same_python and identity["code"] != code_hash():
        assert "Newer code" in page


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
from nadia_balance.scripts.envelope_sweep.trials_file import TrialsFile
from tests.scripts.envelope_sweep.test_trials_file import IDENTITY, ROWS
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


# A row is a line and a line is a row; the oracle is the way back.


def row_of(line):
    (cells,) = csv.reader([line], strict=True)
    return parse_cells(cells)


def test_every_row_comes_back_as_it_was():
    for row in made_up_rows(paper_times(1.0))[::7]:
        row = {**row, "max_icp_error_m": 0.1 + 0.2, "max_torque_ratio": None}
        assert row_of(line_of(row)) == row
    row = row_of(line_of({"predicted_at_touchdowns": [2, -1]}))
    assert (row["predicted_at_touchdowns"], row["replica"]) == ("2;-1", None)


@pytest.mark.parametrize("text", ["a\nb", "a\r\nb", "a\u2028b", "a\x0bb"])
def test_a_row_is_one_line_whatever_is_said(text):
    """Oracle: every way that Python knows to end a line."""
    line = line_of({"reason": f'"{text}", said it'})
    assert len(line.splitlines()) == 1
    assert line.endswith("\n")
    assert row_of(line)["reason"] == '"a b", said it'


HOLDER = """
import sys
from pathlib import Path
from nadia_balance.scripts.envelope_sweep.trials_file import alone_in
with alone_in(Path(sys.argv[1])):
    print("in", flush=True)
    sys.stdin.read()
"""


@pytest.mark.parametrize("end", [signal.SIGKILL, None])
def test_one_at_a_time_is_in_a_folder(tmp_path, end):
    """Oracle: another process, however it ends."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, tmp_path],
        env=environment(),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as holder:
        assert holder.stdout.readline() == "in\n"
        with pytest.raises(ValueError) as refused, alone_in(tmp_path):
            raise AssertionError("both are in")
        if end:
            holder.send_signal(end)
    assert str(refused.value) == (
        f"out = {str(tmp_path)!r}: must not be in use by another sweep"
    )
    with alone_in(tmp_path):
        assert list(tmp_path.iterdir()) == [], "it leaves nothing behind"
