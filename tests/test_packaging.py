"""What is installed works from any directory, whatever else is installed."""

import hashlib
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

from tests import run_cache
from tests.source_files import ROOT, imports, python_files, syntax_tree
from tests.type_checked import only_the_typo_is_found

FOLDERS = ("nadia_balance", "diagrams", "models", "scripts")
FILES = {
    path.relative_to(ROOT).as_posix(): path
    for folder in FOLDERS
    for path in sorted((ROOT / folder).rglob("*"))
    if path.is_file()
    and "__pycache__" not in path.parts
    and not path.name.endswith(".so.1")
}
LIBRARY = "nadia_balance/core/math/libgeometry.so.1"
MORE = ("pyproject.toml", "setup.py", "README.md", "LICENSE")
WHAT_IS_INSTALLED = [
    (name, hashlib.sha256(path.read_bytes()).hexdigest())
    for name, path in (FILES | {name: ROOT / name for name in MORE}).items()
]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
# The import names that differ from the names of their distributions.
DISTRIBUTIONS = {"PIL": "pillow", "pydrake": "drake", "yaml": "pyyaml"}
DISTRIBUTIONS |= {"foxglove": "foxglove-sdk", "google": "protobuf"}
DISTRIBUTIONS |= {"unitree_sdk2py": "unitree-sdk2py-dimos"}
# What a normal installation lacks: `--help` needs none of them.
EXTRAS = ("cyclonedds", "foxglove", "mujoco", "onnxruntime", "trimesh")
# What our imports load by themselves: readers of .dae and notebooks, a theme;
# and what is imported by a name, as it has no types.
PLUGINS = {"pycollada", "myst-nb", "furo", "gaitkeeper"}


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


def copied(source: Path) -> list[str]:
    """Copies what is built: setuptools leaves its work in the tree.

    Returns the command that builds the wheel there.
    """
    junk = shutil.ignore_patterns("__pycache__", "*.egg-info", "*.so.1")
    for name in FOLDERS:
        shutil.copytree(ROOT / name, source / name, ignore=junk)
    for name in MORE:
        shutil.copy(ROOT / name, source)
    return [sys.executable, *"-m build --wheel --no-isolation".split()]


def wheel(folder: Path) -> Path:
    """The wheel."""
    source = folder / "source"
    run(*copied(source), "--outdir", folder, cwd=source)
    (built,) = folder.glob("*.whl")
    return built


def installed(folder: Path, wheel: Path) -> Path:
    """The commands of a new environment; it borrows what the wheel needs.

    The folder of the running environment comes last on the new one's path,
    and its own .pth files, an editable install among them, are not read.
    """
    python = folder / "bin" / "python"
    run(sys.executable, "-m", "venv", "--without-pip", folder, cwd=folder)
    purelib = "import sysconfig; print(sysconfig.get_path('purelib'))"
    site_packages = Path(run(python, "-c", purelib, cwd=folder).strip())
    borrowed = sysconfig.get_path("purelib")
    (site_packages / "borrowed.pth").write_text(f"{borrowed}\n")
    install = "install", "--no-index", "--no-deps", wheel
    run(sys.executable, "-m", "pip", "--python", python, *install, cwd=folder)
    return folder / "bin"


def tried_elsewhere(bin_folder: Path, cwd: Path) -> tuple:
    """What the commands say, and the summary of a run.

    There are packages on the path whose names are those of our folders.
    """
    for name in ("diagrams", "models", "scripts", "results"):
        (cwd / name).mkdir()
        (cwd / name / "__init__.py").write_text("raise ImportError")
    here = {"cwd": cwd, "path": str(cwd)}
    mains = "\n".join(
        f"with suppress(SystemExit): load('{main}')(['--help'])"
        for main in PROJECT["scripts"].values()
    )
    code = f"""
import sys
from contextlib import suppress
from pkgutil import resolve_name as load
sys.modules.update(dict.fromkeys({EXTRAS}))
{mains}"""
    helps = run(bin_folder / "python", "-c", code, **here)
    assert all((bin_folder / name).is_file() for name in PROJECT["scripts"])
    argv = "--plant", "lipm", "--no-meshcat", "--out", cwd / "run"
    printed = run(bin_folder / "nadia-push", *argv, **here)
    return helps, printed, (cwd / "run" / "summary.json").read_text()


@pytest.fixture(scope="module")
def outcome(tmp_path_factory) -> tuple:
    """What is in the wheel, and comes of it; made once, see run_cache."""

    def make() -> tuple:
        folder = tmp_path_factory.mktemp("wheel")
        built = wheel(folder)
        with zipfile.ZipFile(built) as archive:
            names = archive.namelist()
        bin_folder = installed(tmp_path_factory.mktemp("environment"), built)
        elsewhere = tmp_path_factory.mktemp("elsewhere")
        typed = [
            only_the_typo_is_found(elsewhere, python)
            for python in (sys.executable, bin_folder / "python")
        ]
        return names, typed, *tried_elsewhere(bin_folder, elsewhere)

    return run_cache.once(__name__, f"{WHAT_IS_INSTALLED}", make)


def test_the_wheel_carries_every_file_in_one_package(outcome):
    """Oracle: the files in the checkout, and the geometry, compiled."""
    packed_as = {
        name if name.startswith("nadia_balance/") else f"nadia_balance/{name}"
        for name in FILES
    }
    assert {n for n in outcome[0] if ".dist-info/" not in n} == {
        *packed_as,
        LIBRARY,
    }


def test_the_wheel_and_an_editable_install_are_typed(outcome):
    """Oracle: mypy, on the README's Python and a misspelt name."""
    assert outcome[1] == [True, True]


def test_commands_run_from_another_directory(outcome):
    """Oracles: one help for each; the run has nothing of the checkout."""
    *_, helps, printed, summary = outcome
    assert helps.count("usage: ") == len(PROJECT["scripts"])
    assert str(ROOT) not in printed
    assert json.loads(summary)["recovered"]


@pytest.mark.parametrize("compiler", [{}, {"CC": "/nowhere/cc"}])
def test_says_what_to_install_where_there_is_no_compiler(tmp_path, compiler):
    """Oracle: one line of our own; nothing is built."""
    source, nowhere = tmp_path / "source", tmp_path / "nowhere"
    done = subprocess.run(
        copied(source),
        cwd=source,
        env={"PATH": str(nowhere), **compiler},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    message = "nadia_balance needs a C compiler: apt-get install gcc libc6-dev"
    assert done.returncode and message in done.stdout.splitlines()
    assert not [*source.rglob("*.so.1"), *source.rglob("*.whl")]


@pytest.mark.parametrize("package", ["daqp", "drake"])
def test_an_older_package_is_refused_by_its_version(tmp_path, package):
    """Oracles: made-up packages around the bound of pyproject.toml."""
    (least,) = re.findall(rf"{package}>=([\d.]+)", str(PROJECT["dependencies"]))
    major, minor = map(int, least.split("."))
    for present, is_good in (
        (f"{major}.{minor - 1}.9", False),
        (f"{major}.{minor}.0", True),
        (f"{major}.{minor + 90}.dev0", True),
        ("0.0.20261130", True),  # made last night
    ):
        folder = tmp_path / present
        info = folder / f"{package}-{present}.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Name: {package}\nVersion: {present}\n")
        done = subprocess.run(
            [sys.executable, "-c", "import nadia_balance"],
            env=os.environ | {"PYTHONPATH": f"{folder}:{ROOT}"},
            capture_output=True,
            text=True,
        )
        refusal = (
            f"ImportError: {package} = {present}: must be {least} or newer"
        )
        assert (done.returncode == 0) is is_good, done.stderr
        assert is_good or done.stderr.splitlines()[-1] == refusal


def third_party_imports(*folders: str) -> set[str]:
    """The distributions that the Python files in `folders` import."""
    trees = map(syntax_tree, python_files(*folders))
    imported = {n.split(".")[0] for tree in trees for n in imports(tree)}
    figures = {path.stem for path in python_files("docs")}
    imported -= sys.stdlib_module_names | figures | {"nadia_balance", "tests"}
    return {DISTRIBUTIONS.get(name, name) for name in imported}


def names(requirements: list[str]) -> set[str]:
    return {re.split("[<>=]", requirement)[0] for requirement in requirements}


def test_declares_what_it_imports():
    """Oracle: the imports in the syntax trees of all files."""
    needed = names(PROJECT["dependencies"])
    extras = PROJECT["optional-dependencies"]
    names_of = (
        "docs",
        "mcap",
        "mujoco",
        "policies",
        "robots",
        "site",
        "tour",
        "unitree",
    )
    more = set().union(*(names(extras[extra]) for extra in names_of))
    extra = names(extras["test"])
    imported = third_party_imports(*FOLDERS, "docs")
    assert imported == (needed | more) - PLUGINS
    assert third_party_imports(*FOLDERS) >= needed
    assert more <= extra, "whoever tests can run all that is tested"
    assert third_party_imports("tests") <= needed | extra
