"""What a run says of the code that made it.  Oracle: git itself."""

import re
import subprocess

from nadia_balance.results.versions import commit_of, versions


def git(folder, *arguments):
    """Git's answer, in a repository without the user's settings."""
    who = ["-c", "user.name=a", "-c", "user.email=a@b"]
    command = ["git", "-C", str(folder), *who, *arguments]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return done.stdout.strip()


def test_the_commit_tells_changes_that_are_not_committed(tmp_path):
    """But not those of a page; changed back, it is the same again."""
    of_now = commit_of.__wrapped__
    (tmp_path / "models").mkdir()
    robot, page = tmp_path / "models" / "robot.yaml", tmp_path / "README.md"
    for path in robot, page:
        path.write_text("one")
    assert of_now(tmp_path) == ""
    git(tmp_path, "init")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-m", "one")
    head = git(tmp_path, "rev-parse", "HEAD")[:10]
    page.write_text("two")
    assert of_now(tmp_path) == head
    robot.write_text("two")
    assert re.fullmatch(rf"{head}\+[0-9a-f]{{10}}", of_now(tmp_path))
    robot.write_text("one")
    assert of_now(tmp_path) == head
    assert of_now(tmp_path / "models") == ""


def test_versions_are_of_this_process():
    """Oracle: Python and the packages themselves."""
    import numpy

    present = versions("mujoco")
    assert present["numpy"] == numpy.__version__
    assert {"python", "nadia_balance", "drake", "daqp", "mujoco"} <= {*present}
    assert versions("none")["none"] == "not installed"
