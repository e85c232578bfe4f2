"""What is installed works from any directory, whatever else is installed."""

import ast
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
DISTRIBUTIONS = {"PIL": "pillow", "pydrake": "drake", "yaml": "pyyaml"}
# What our imports load by themselves: trimesh reads .dae with it.
PLUGINS = {"pycollada"}


def run(*command: str | Path, cwd: Path, path: str = "") -> str:
    """Runs `command` as if no checkout were near; returns what it prints.

    `path` is Python's search path, before what is installed.
    """
    done = subprocess.run(
        [str(word) for word in command],
        cwd=cwd,
        env=os.environ | {"PYTHONPATH": path},
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
def bin_folder(wheel, tmp_path_factory) -> Path:
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
    return folder / "bin"


def test_the_wheel_carries_every_file_in_one_package(wheel):
    """Oracle: the files in the checkout."""
    ours = {
        path.relative_to(ROOT).as_posix()
        for folder in FOLDERS
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    packed_as = {
        name if name.startswith("nadia_balance/") else f"nadia_balance/{name}"
        for name in ours
    }
    with zipfile.ZipFile(wheel) as archive:
        packed = {n for n in archive.namelist() if ".dist-info/" not in n}
    assert packed == packed_as


def test_commands_run_from_another_directory(bin_folder, tmp_path):
    """And with packages on the path whose names are those of our folders."""
    for name in ("diagrams", "models", "scripts", "results"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise ImportError")
    here = {"cwd": tmp_path, "path": str(tmp_path)}
    python = bin_folder / "python"
    mains = "\n".join(
        f"with suppress(SystemExit): load('{main}')(['--help'])"
        for main in PROJECT["scripts"].values()
    )
    code = f"""
from contextlib import suppress
from pkgutil import resolve_name as load
{mains}"""
    helps = run(python, "-c", code, **here)
    assert helps.count("usage: ") == len(PROJECT["scripts"])
    assert all((bin_folder / name).is_file() for name in PROJECT["scripts"])
    printed = run(
        *(bin_folder / "nadia-push", "--plant", "lipm", "--no-meshcat"),
        *("--out", tmp_path / "run"),
        **here,
    )
    assert str(ROOT) not in printed
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["recovered"]


def third_party_imports(*folders: str) -> set[str]:
    """The distributions that the Python files in `folders` import."""
    trees = map(syntax_tree, python_files(*folders))
    imported = {n.split(".")[0] for tree in trees for n in imports(tree)}
    figures = {path.stem for path in python_files("docs/figures")}
    imported -= sys.stdlib_module_names | figures | {"nadia_balance", "tests"}
    return {DISTRIBUTIONS.get(name, name) for name in imported}


def names(requirements: list[str]) -> set[str]:
    return {re.split("[<>=]", requirement)[0] for requirement in requirements}


def test_declares_what_it_imports():
    """Oracle: the imports in the syntax trees of all files."""
    needed = names(PROJECT["dependencies"])
    extras = PROJECT["optional-dependencies"]
    names_of = ("docs", "mujoco", "policies", "robots")
    more = set().union(*(names(extras[extra]) for extra in names_of))
    extra = names(extras["test"])
    assert (
        third_party_imports(*FOLDERS, "docs/figures")
        == (needed | more) - PLUGINS
    )
    assert third_party_imports(*FOLDERS) >= needed
    assert more <= extra, "whoever tests can run all that is tested"
    assert third_party_imports("tests") <= needed | extra


def test_every_command_is_the_main_of_a_script():
    """Oracle: the files in scripts/ that define one."""
    mains = [
        path.stem
        for path in (ROOT / "scripts").glob("*.py")
        if any(
            isinstance(node, ast.FunctionDef) and node.name == "main"
            for node in syntax_tree(path).body
        )
    ]
    assert PROJECT["scripts"] == {
        f"nadia-{name.replace('_', '-')}": f"nadia_balance.scripts.{name}:main"
        for name in mains
    }
