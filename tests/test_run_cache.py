"""Nothing is simulated twice, and nothing that is not the same is shared."""

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests import run_cache


@pytest.fixture
def once(tmp_path, monkeypatch):
    """Asks as if for the first time, and returns what was made, and read."""
    monkeypatch.setattr(run_cache, "folder", tmp_path / "kept")
    made = []

    def make():
        time.sleep(0.1)
        made.append(len(made))
        return made[-1]

    def ask(given="{}"):
        monkeypatch.setattr(run_cache, "_made", {})
        return run_cache.once("tests", given, make)

    return ask


def test_whoever_comes_second_waits_and_reads(once):
    """Oracle: made once, for two at a time."""
    with ThreadPoolExecutor() as pool:
        assert list(pool.map(once, ["{}"] * 2)) == [0, 0]
    assert [once(), once("other"), once()] == [0, 1, 0]


def test_what_other_sources_made_is_gone(once, monkeypatch):
    """Oracle: made again; one folder."""
    assert once() == 0
    monkeypatch.setattr(run_cache, "sources", lambda: "others")
    assert [once(), once()] == [1, 1]
    assert [path.name for path in run_cache.folder.iterdir()] == ["others"]


@pytest.mark.parametrize("spoil", [b"", b"0" * 1000, None])
def test_a_spoiled_file_is_made_anew(once, spoil):
    """Oracle: made again, and then kept."""
    assert once() == 0
    files = filter(Path.is_file, run_cache.folder.rglob("*"))
    (path,) = (path for path in files if not path.suffix)
    path.write_bytes(path.read_bytes()[:-1] if spoil is None else spoil)
    assert [once(), once()] == [1, 1]
