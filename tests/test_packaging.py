"""What is installed works from any directory, without the checkout."""

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest

from tests.source_files import ROOT, imports, python_files, syntax_tree

FOLDERS = ("nadia_balance", "diagrams", "models", "scripts")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
# The import names that differ from the names of their distributions.
DISTRIBUTIONS = {"pydrake": "drake", "yaml": "pyyaml"}


def run(*command: str | Path, cwd: Path) -> str:
    """Runs `command` as if no checkout were near; returns what it prints."""
    env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [str(word) for word in command],
        cwd=cwd,
        env=env,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert done.returncode == 0, done.stdout
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """The wheel, built in a copy: setuptools leaves its work in the tree."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    junk = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for name in FOLDERS:
        shutil.copytree(ROOT / name, source / name, ignore=junk)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    run(
        *(sys.executable, "-m", "build", "--wheel", "--no-isolation"),
        *("--outdir", folder),
        cwd=source,
    )
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installation(wheel, tmp_path_factory) -> Path:
    """A new environment with the wheel; it borrows what the wheel needs.

    The folder of the running environment comes last on the new one's path,
    and its own .pth files, an editable install among them, are not read.
    """
    folder = tmp_path_factory.mktemp("environment")
    python = folder / "bin" / "python"
    run(sys.executable, "-m", "venv", "--without-pip", folder, cwd=folder)
    purelib = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site_packages = Path(run(python, "-c", purelib, cwd=folder).strip())
    borrowed = sysconfig.get_path("purelib")
    (site_packages / "borrowed.pth").write_text(f"{borrowed}\n")
    run(
        *(sys.executable, "-m", "pip", "--python", python, "install"),
        *("--no-index", "--no-deps", wheel),
        cwd=folder,
    )
    return folder


def test_the_wheel_carries_every_file(wheel):
    """Oracle: the files in the checkout."""
    ours = {
        path.relative_to(ROOT).as_posix()
        for folder in FOLDERS
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    with zipfile.ZipFile(wheel) as archive:
        packed = {n for n in archive.namelist() if ".dist-info/" not in n}
    assert packed == ours


def test_imports_come_from_the_installation(installation, tmp_path):
    modules = ("nadia_balance.core.walking", "diagrams.scenario")
    for module in modules:
        code = f"import {module}; print({module}.__file__)"
        found = run(installation / "bin" / "python", "-c", code, cwd=tmp_path)
        assert Path(found.strip()).is_relative_to(installation)


def test_runs_a_scenario_from_another_directory(installation, tmp_path):
    """The installed command, its models and scenarios, and no checkout."""
    printed = run(
        *(installation / "bin" / "nadia-simulate", "--scenario_name", "stand"),
        *("--duration", "0.1", "--no-meshcat", "--out", tmp_path / "run"),
        cwd=tmp_path,
    )
    assert str(ROOT) not in printed
    assert (tmp_path / "run" / "summary.json").is_file()


def test_measures_from_another_directory(installation, tmp_path):
    """Oracle: the keys agreed on; the parts are modules of the wheel."""
    command = installation / "bin" / "nadia-benchmark"
    printed = run(command, "--json", "--seconds", "0.1", cwd=tmp_path)
    assert set(json.loads(printed)) == {"plant_alone", "closed_loop", "blocks"}


def third_party_imports(*folders: str) -> set[str]:
    """The distributions that the Python files in `folders` import."""
    imported = {
        name.split(".")[0]
        for path in python_files(*folders)
        for name in imports(syntax_tree(path))
    }
    imported -= sys.stdlib_module_names | {*FOLDERS, "tests"}
    return {DISTRIBUTIONS.get(name, name) for name in imported}


def names(requirements: list[str]) -> set[str]:
    return {re.split("[<>=]", requirement)[0] for requirement in requirements}


def test_declares_what_it_imports():
    """Oracle: the imports in the syntax trees of all files."""
    needed = names(PROJECT["dependencies"])
    extras = PROJECT["optional-dependencies"]
    more = names(extras["docs"]) | names(extras["cluster"])
    extra = names(extras["test"])
    assert third_party_imports(*FOLDERS) == needed | more
    assert more <= extra, "whoever tests can run all that is tested"
    assert third_party_imports("tests") <= needed | extra


def test_every_command_is_the_main_of_a_script():
    """Oracle: the files in scripts/."""
    assert PROJECT["scripts"] == {
        f"nadia-{path.stem.replace('_', '-')}": f"scripts.{path.stem}:main"
        for path in python_files("scripts")
    }
