"""What the tests have simulated, on disk: nothing is simulated twice.

A run follows from the modules that it imports, the models, the versions of what
they use, and what it is given: who changes another test, or a plot, simulates
nothing anew.  The results of other sources are removed.
"""

import contextlib
import fcntl
import functools
import hashlib
import json
import os
import pickle
import platform
import shutil
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from tests.source_files import ROOT, reached

PACKAGES = ("drake", "numpy", "scipy", "mujoco", "daqp", "trimesh")
FOLDERS = ("nadia_balance", "diagrams", "models", "scripts")  # have data

folder: Path | None = None  # None: what is made is not kept on disk
_made: dict[str, Any] = {}


def once(name: str, given: str, make: Callable[[], Any]) -> Any:
    """Returns what `make` returns, on this disk only once; do not change it.

    `name` is that of the module that makes it: what this one imports is read.
    `given` tells apart what it makes, and has all else that it reads.
    """
    if (key := _digest(f"{name} {given}")) not in _made:
        _made[key] = _kept(name, key, make) if folder else make()
    return _made[key]


def _kept(name: str, key: str, make: Callable) -> Any:
    """Whoever comes second waits for the first, and reads."""
    ours = folder / name / sources(name)
    ours.mkdir(parents=True, exist_ok=True)
    for old in {*ours.parent.iterdir()} - {ours}:
        shutil.rmtree(old, ignore_errors=True)
    path = ours / key
    with open(path.with_suffix(".lock"), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if path.is_file():
            digest, _, found = path.read_bytes().partition(b"\n")
            if digest == _digest(found).encode():
                return pickle.loads(found)
        made = make()
        found = pickle.dumps(made)
        half = path.with_suffix(".half")
        with contextlib.suppress(FileNotFoundError):  # by other sources
            half.write_bytes(_digest(found).encode() + b"\n" + found)
            half.replace(path)
    return made


def sources(name: str) -> str:
    """A fingerprint of all that a module of this name runs, and reads."""
    return _fingerprint(frozenset(reached(name)))


@functools.cache
def _fingerprint(modules: frozenset[Path]) -> str:
    texts = [_machine_and_data()]
    for path in sorted(modules):
        texts += [str(path), _digest((ROOT / path).read_bytes())]
    return _digest("\n".join(texts))


@functools.cache
def _machine_and_data() -> str:
    """What runs the modules, and our files that are no modules."""
    texts = [json.dumps(np.show_config("dicts")), platform.python_version()]
    # With the processor, above, what chooses the kernels of BLAS: their last
    # bits differ.
    texts.append(os.environ.get("OPENBLAS_CORETYPE", ""))
    texts += [f"{package} {version(package)}" for package in PACKAGES]
    paths = {path for name in FOLDERS for path in (ROOT / name).rglob("*.*")}
    for path in sorted(filter(Path.is_file, paths)):
        if path.suffix not in (".py", ".pyc"):
            texts += [str(path), _digest(path.read_bytes())]
    return _digest("\n".join(texts))


def _digest(text: str | bytes) -> str:
    whole = text.encode() if isinstance(text, str) else text
    return hashlib.sha256(whole).hexdigest()[:32]
