"""Nothing is simulated twice, and nothing that is not the same is shared."""

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests import run_cache

CODE = {
    "runs.py": '"""Runs."""\nfrom core.sums import total\n',
    "core/sums.py": "from core import numbers\n\n\ndef total(): return 1\n",
    "core/numbers.py": "ONE = 1\n",
    "plots.py": "from core import numbers\n",
}


@pytest.fixture(autouse=True)
def empty(tmp_path, monkeypatch):
    """A cache of which nobody knows."""
    monkeypatch.setattr(run_cache, "folder", tmp_path / "kept")
    monkeypatch.setattr(run_cache, "_made", {})


@pytest.fixture
def once(monkeypatch):
    """Asks as if for the first time, and returns what was made, and read."""
    made = []

    def make():
        time.sleep(0.1)
        made.append(len(made))
        return made[-1]

    def ask(given="{}"):
        monkeypatch.setattr(run_cache, "_made", {})
        return run_cache.once(("tests.source_files",), given, make)

    return ask


def code_of(folder, **changes):
    """The fingerprint of runs.py, with other contents of some files."""
    for name, text in {**CODE, **changes}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return run_cache.code_of("runs", places=(folder,))


@pytest.mark.parametrize(
    ("file", "text", "is_same"),
    [
        ("core/numbers.py", "ONE = 2\n", False),
        ("core/numbers.py", "ONE = 1  # the first\n", True),
        ("runs.py", CODE["runs.py"].replace("Runs", "What runs"), True),
        ("plots.py", "print()\n", True),
        ("docs.md", "Words.\n", True),
    ],
)
def test_the_code_is_all_that_is_imported_but_for_its_words(
    file, text, is_same, tmp_path
):
    """Oracle: by hand."""
    before = code_of(tmp_path / "before")
    after = code_of(tmp_path / "after", **{file: text})
    assert (before == after) == is_same


def test_whoever_comes_second_waits_and_reads(once):
    """Oracle: made once, for two at a time."""
    with ThreadPoolExecutor() as pool:
        assert list(pool.map(once, ["{}"] * 2)) == [0, 0]
    assert [once(), once("other"), once()] == [0, 1, 0]


@pytest.mark.parametrize("spoil", [b"", b"0" * 1000, None])
def test_a_spoiled_file_is_made_anew(once, spoil):
    """Oracle: made again, and then kept."""
    assert once() == 0
    files = filter(Path.is_file, run_cache.folder.rglob("*"))
    (path,) = (path for path in files if not path.suffix)
    path.write_bytes(path.read_bytes()[:-1] if spoil is None else spoil)
    assert [once(), once()] == [1, 1]
