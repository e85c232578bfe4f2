"""The versions of all that determines a run, and the commit of this code."""

import functools
import json
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[2]


def versions(engine: str = "drake") -> dict[str, str]:
    """Returns the versions of Python, of this code, and of what it uses.

    Args:
        engine: name of the package that moves the robot.

    Returns:
        A version by name, "not installed" if there is none; in a checkout
        with git, `commit` is the present one (see commit_of).
    """
    commit = commit_of()
    return {
        "python": platform.python_version(),
        **{
            package: version_of(package)
            for package in ("nadia_balance", "drake", "daqp", "numpy", engine)
        },
        **({"commit": commit} if commit else {}),
    }


def version_of(package: str) -> str:
    """Returns the version of a package.

    Args:
        package: its name.

    Returns:
        Its version, "not installed" if there is none.
    """
    try:
        return version(package)
    except PackageNotFoundError:  # run from a checkout
        return "not installed"


def other_version(run: Path) -> str:
    """Returns what to say of the folder of a run that cannot be read.

    Args:
        run: the folder.

    Returns:
        The versions of the code that wrote it, and of this code; "" if they are
        one, or nobody knows.
    """
    try:
        summary = json.loads((run / "summary.json").read_text("utf-8"))
        written = summary["versions"]["nadia_balance"]
    except (OSError, LookupError, TypeError, ValueError):
        return ""
    present = version_of("nadia_balance")
    words = f"; nadia_balance {written} wrote it, this is {present}"
    return "" if written == present else words


@functools.cache  # of this process: the files may change later
def commit_of(checkout: Path = CHECKOUT) -> str:
    """Returns the commit of the code in a checkout, by 10 hex digits.

    With changes that are not committed, these follow after a "+", as 10 hex
    digits of their own.

    Args:
        checkout: folder of the repository, by default that of this package.

    Returns:
        Such as "0123456789", or "0123456789+abcdef0123"; "" if the folder is
        no checkout of its own, as after an installation, or git is missing.
    """
    try:
        if _git(checkout, "rev-parse", "--show-toplevel") != str(checkout):
            return ""
        head = _git(checkout, "rev-parse", "--short=10", "HEAD")
        changes = _git(
            checkout,
            "diff",
            "HEAD",
            "--",
            "nadia_balance",
            "diagrams",
            "models",
            "scripts",
        )
        if not changes:
            return head
        digest = _git(checkout, "hash-object", "--stdin", text=changes)
        return f"{head}+{digest[:10]}"
    except (OSError, subprocess.CalledProcessError):
        return ""


def _git(folder: Path, *arguments: str, text: str = "") -> str:
    return subprocess.run(
        ["git", "-C", str(folder), *arguments],
        input=text,
        capture_output=True,
        check=True,
        encoding="utf-8",
        errors="replace",
    ).stdout.strip()
