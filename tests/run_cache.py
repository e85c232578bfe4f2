"""What the tests have simulated, on disk: nothing is simulated twice.

A run follows from the code and the versions of what it uses, and from what the
code is given; the name of its file is a fingerprint of them all.
"""

import ast
import contextlib
import fcntl
import functools
import hashlib
import json
import pickle
import platform
import shutil
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from tests.source_files import ROOT, imports

STARTED = time.time()
PACKAGES = ("drake", "numpy", "scipy", "mujoco", "daqp", "trimesh")
PLACES = (ROOT / "nadia_balance", ROOT)  # of our modules

folder: Path | None = None  # None: what is made is not kept on disk
_made: dict[str, Any] = {}


def once(modules: tuple[str, ...], given: str, make: Callable[[], Any]) -> Any:
    """Returns what `make` returns, on this disk only once; do not change it.

    `modules` are those of ours that `make` is of, or calls; the first name,
    which may be any, is of the folder.  `given` tells apart what they make.
    """
    name = _digest(given)
    if (key := f"{code_of(*modules)}/{name}") not in _made:
        _made[key] = _kept(modules, name, make) if folder else make()
    return _made[key]


@functools.cache
def data() -> str:
    """All robots and scenarios of the package, for who may look at any."""
    paths = (*ROOT.glob("models/*/*"), *ROOT.glob("diagrams/*/*.yaml"))
    return "\n".join(path.read_text("utf-8") for path in sorted(paths))


def _kept(modules: tuple[str, ...], name: str, make: Callable) -> Any:
    """Whoever comes second waits for the first, and reads."""
    path = _folder_of(modules) / name
    with open(path.with_suffix(".lock"), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if _is_as_imported(modules) and path.is_file():
            digest, _, found = path.read_bytes().partition(b"\n")
            if digest == _digest(found).encode():
                return pickle.loads(found)
        made = make()
        if _is_as_imported(modules):
            found = pickle.dumps(made)
            half = path.with_suffix(".half")
            with contextlib.suppress(FileNotFoundError):  # see _folder_of
                half.write_bytes(_digest(found).encode() + b"\n" + found)
                half.replace(path)
    return made


def _folder_of(modules: tuple[str, ...]) -> Path:
    """The folder of this code's results; those of other code are removed."""
    code, whose = code_of(*modules), folder / modules[0]
    (whose / code).mkdir(parents=True, exist_ok=True)
    for old in set(whose.iterdir()) - {whose / code}:
        shutil.rmtree(old, ignore_errors=True)
    return whose / code


@functools.cache
def code_of(*modules: str, places: tuple[Path, ...] = PLACES) -> str:
    """A fingerprint of these modules, of what they import, and of what runs it.

    Comments and docstrings are not in it.
    """
    texts = [json.dumps(np.show_config("dicts")), platform.python_version()]
    texts += [f"{package} {version(package)}" for package in PACKAGES]
    for path in _files(*modules, places=places):
        texts += [path.name, _read(path)[0]]
    return _digest("\n".join(texts))


@functools.cache
def _files(*modules: str, places: tuple[Path, ...] = PLACES) -> list[Path]:
    """The files of the modules, and of all of ours that they import."""
    files, names = {}, list(modules)
    while names:
        if (name := names.pop()) in files:
            continue
        inside = name.removeprefix("nadia_balance.").replace(".", "/")
        found = (place / f"{inside}.py" for place in places)
        files[name] = next(filter(Path.is_file, found), None)
        if files[name]:
            files[name] = files[name].resolve()  # folders may be links
            for full in _read(files[name])[1]:  # of a module, or a name in it
                names += [full, full.rpartition(".")[0]]
    return sorted(filter(None, files.values()))


@functools.cache
def _read(path: Path) -> tuple[str, tuple[str, ...]]:
    """A fingerprint of what this file does, and what it imports."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return _digest(ast.dump(_without_words(tree))), tuple(imports(tree))


def _without_words(tree: ast.Module) -> ast.Module:
    kinds = ast.Module, ast.ClassDef, ast.FunctionDef
    for node in ast.walk(tree):
        if isinstance(node, kinds) and ast.get_docstring(node) is not None:
            del node.body[0]
    return tree


def _is_as_imported(modules: tuple[str, ...]) -> bool:
    """Whether nobody has changed a file since it may have been imported."""
    changed = (path.stat().st_ctime for path in _files(*modules))
    return max(changed) < STARTED


def _digest(text: str | bytes) -> str:
    whole = text.encode() if isinstance(text, str) else text
    return hashlib.sha256(whole).hexdigest()[:32]
