"""What a type checker says of a user's program, outside of the checkout."""

import subprocess
import sys
from pathlib import Path

from tests.source_files import ROOT


def errors_of(code: str, folder: Path, python: str | Path) -> list[str]:
    """The errors that mypy, strict, finds in `code`.

    `folder` has nothing of ours; `python` is the interpreter whose packages
    are seen.  What mypy knows of them is kept there for the next one.
    """
    (folder / "program.py").write_text(code)
    mypy = [sys.executable, "-m", "mypy", "--strict", "--python-executable"]
    done = subprocess.run(
        [*mypy, str(python), "--cache-dir", ".mypy_cache", "program.py"],
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert not done.stderr, done.stderr
    return [line for line in done.stdout.splitlines() if ": error: " in line]


def readme() -> str:
    """The Python of the README, and a misspelt name on its last line."""
    text = (ROOT / "README.md").read_text("utf-8")
    code = text.partition("```python\n")[2].partition("```")[0]
    assert "import nadia_balance as nb" in code
    return f"{code}nb.simulat\n"


def only_the_typo_is_found(folder: Path, python: str | Path) -> bool:
    """True if mypy knows all names of the README, and misses the last one."""
    found = errors_of(readme(), folder, python)
    return len(found) == 1 and 'no attribute "simulat"' in found[0]
