"""Nothing is simulated twice, and nothing that is not the same is shared."""

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests import run_cache
from tests.source_files import ROOT, reached


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
        return run_cache.once(__name__, given, make)

    return ask


def test_whoever_comes_second_waits_and_reads(once):
    """Oracle: made once, for two at a time."""
    with ThreadPoolExecutor() as pool:
        assert list(pool.map(once, ["{}"] * 2)) == [0, 0]
    assert [once(), once("other"), once()] == [0, 1, 0]


def test_what_other_sources_made_is_gone(once, monkeypatch):
    """Oracle: made again; one folder, that of this module."""
    assert once() == 0
    monkeypatch.setattr(run_cache, "sources", lambda _: "others")
    assert [once(), once()] == [1, 1]
    assert [*run_cache.folder.glob("*/*")] == [
        run_cache.folder / __name__ / "others"
    ]


def test_a_run_reads_what_is_imported_and_nothing_else():
    """Oracle: by hand; for what Python loads in a run, see test_humanoid."""
    files = {str(path) for path in reached("tests.diagrams.simulated")}
    assert {
        "tests/diagrams/simulated.py",
        "diagrams/simulation.py",
        "nadia_balance/core/walking/push.py",  # by way of a scenario
    } < files
    assert not {file for file in files if file.startswith("tests/test_")}
    assert not {file for file in files if "/plots/" in file}
    front_door = {str(path) for path in reached("nadia_balance")}
    assert "nadia_balance/policy/controller.py" in front_door
    of_pages = {str(path) for path in reached("tests.test_docs")}
    assert front_door | {"docs/figures/reference.py"} < of_pages


@pytest.mark.parametrize("changed", [True, False])
def test_who_changes_a_file_makes_anew_what_reads_it(
    tmp_path, monkeypatch, changed
):
    """Oracle: the fingerprints before and after, of copies of our files."""
    name = "nadia_balance.core.math.lipm"
    files = {path: (ROOT / path).read_bytes() for path in reached(name)}
    for path, data in files.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_bytes(data)
    monkeypatch.setattr(run_cache, "ROOT", tmp_path)

    def fingerprint():
        run_cache._fingerprint.cache_clear()
        return run_cache.sources(name)

    before = fingerprint()
    file = "nadia_balance/core/math/lipm.py" if changed else "tests/new.py"
    (tmp_path / file).parent.mkdir(exist_ok=True)
    with (tmp_path / file).open("a", encoding="utf-8") as text:
        text.write("# changed\n")
    assert (fingerprint() != before) is changed
    run_cache._fingerprint.cache_clear()


@pytest.mark.parametrize("spoil", [b"", b"0" * 1000, None])
def test_a_spoiled_file_is_made_anew(once, spoil):
    """Oracle: made again, and then kept."""
    assert once() == 0
    files = filter(Path.is_file, run_cache.folder.rglob("*"))
    (path,) = (path for path in files if not path.suffix)
    path.write_bytes(path.read_bytes()[:-1] if spoil is None else spoil)
    assert [once(), once()] == [1, 1]
