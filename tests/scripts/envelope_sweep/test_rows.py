"""What is in the database stays there, and nothing else gets in."""

import platform
import random
import signal
import sqlite3

import pytest

from nadia_balance.scripts.envelope_sweep.fingerprint import code_hash
from nadia_balance.scripts.envelope_sweep.rows import (
    DATABASE,
    KEY,
    Rows,
    opened,
)
from nadia_balance.scripts.envelope_sweep.search import SearchParams
from tests.scripts.envelope_sweep.made_up import (
    identity_of,
    made_up_rows,
    paper_times,
)
from tests.scripts.running import python
from tests.source_files import ROOT

SEARCH = SearchParams(resolution=0.1, stride=2, replicas=2)
IDENTITY = identity_of(SEARCH)
PUBLISHED = ROOT / "docs" / "results" / "fig10"
ROWS = made_up_rows(paper_times(1.0), SEARCH)[:60]


def assert_refused(message, folder, identity=None):
    with pytest.raises(ValueError, match=message):
        with opened(folder, identity):
            raise AssertionError("accepted")


def test_has_every_row_that_was_added(tmp_path):
    """Oracle: the rows themselves; their order is forgotten."""
    with opened(tmp_path, IDENTITY) as rows:
        for row in random.Random(1).sample(ROWS, len(ROWS)):
            rows.add(row)
        with pytest.raises(OSError, match="UNIQUE"):
            rows.add(ROWS[7])
    with opened(tmp_path) as rows:
        assert rows.identity == IDENTITY
        assert rows.all() == sorted(ROWS, key=lambda r: [r[n] for n in KEY])


@pytest.mark.parametrize(
    ("name", "value"),
    [("protocol", 6), ("resolution", 0.2), ("plant", "lipm"), ("code", "0")],
)
def test_refuses_the_rows_of_another_sweep(tmp_path, name, value):
    with opened(tmp_path, IDENTITY):
        pass
    before = (tmp_path / DATABASE).read_bytes()
    message = f"^{name} = {value}: must be "
    assert_refused(message, tmp_path, {**IDENTITY, name: value})
    assert (tmp_path / DATABASE).read_bytes() == before


@pytest.mark.parametrize("content", [b"a,b\n1,2\n", b"\x89PNG\r\n\xff"])
def test_another_kind_of_file_is_refused_and_kept(tmp_path, content):
    (tmp_path / DATABASE).write_bytes(content)
    assert_refused(f"trials = .*{DATABASE}", tmp_path)
    assert (tmp_path / DATABASE).read_bytes() == content


def test_a_full_disk_is_told_and_nothing_is_lost(tmp_path):
    """Oracle: SQLite's own limit of a file's size."""
    with opened(tmp_path, IDENTITY) as rows:
        rows.add(ROWS[0])
        rows._database.execute("PRAGMA max_page_count = 1")
        with pytest.raises(OSError, match="full"):
            rows.add({**ROWS[1], "reason": "x" * 100_000})
        assert rows.all() == ROWS[:1]


WRITER = """
import itertools, sys
from pathlib import Path
from nadia_balance.scripts.envelope_sweep.rows import opened
from tests.scripts.envelope_sweep.test_rows import IDENTITY, ROWS
with opened(Path(sys.argv[1]), IDENTITY) as rows:
    for replica in itertools.count():
        rows.add({**ROWS[0], "replica": replica, "reason": "x" * 5000})
        print(replica, flush=True)
"""


def test_one_process_at_a_time_and_its_rows_survive_a_kill(tmp_path):
    """Oracle: what the process said was added before it was killed."""
    child = python("-c", WRITER, tmp_path, stderr=None)
    for _ in range(5):
        child.stdout.readline()
    assert_refused("^folder = .*in use by no other", tmp_path, IDENTITY)
    child.send_signal(signal.SIGKILL)
    said = 5 + len(child.stdout.readlines())
    child.wait()
    child.stdout.close()
    with opened(tmp_path, IDENTITY) as rows:
        replicas = [row["replica"] for row in rows.all()]
    assert replicas == list(range(len(replicas)))
    assert said <= len(replicas) <= said + 1


def test_the_page_says_of_which_code_its_rows_are():
    """Oracle: the rows, and the fingerprint of this code."""
    path = f"file:{PUBLISHED / DATABASE}?immutable=1"  # asks for no lock
    source = sqlite3.connect(path, uri=True)
    rows = Rows(PUBLISHED / DATABASE, source)
    page = (PUBLISHED.parent / "README.md").read_text(encoding="utf-8")
    assert f"code `{rows.identity['code']}`" in page
    assert f"{len(rows.all())} trials" in page
    same_python = rows.identity["python"] == platform.python_version()
    if same_python and rows.identity["code"] != code_hash():
        assert "Newer code" in page
    source.close()
