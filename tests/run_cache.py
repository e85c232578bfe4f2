"""What the tests have simulated, on disk: nothing is simulated twice.

A run follows from the project's sources, the versions of what they use, and
what they are given.  The results of other sources are removed.
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

from tests.source_files import ROOT

PACKAGES = ("drake", "numpy", "scipy", "mujoco", "daqp", "trimesh")
FOLDERS = "nadia_balance diagrams docs/figures models scripts tests".split()

folder: Path | None = None  # None: what is made is not kept on disk
_made: dict[str, Any] = {}


def once(name: str, given: str, make: Callable[[], Any]) -> Any:
    """Returns what `make` returns, on this disk only once; do not change it.

    `name` is that of the test's module, and `given` tells apart what it makes.
    """
    if (key := _digest(f"{name} {given}")) not in _made:
        _made[key] = _kept(key, make) if folder else make()
    return _made[key]


def _kept(key: str, make: Callable) -> Any:
    """Whoever comes second waits for the first, and reads."""
    ours = folder / sources()
    ours.mkdir(parents=True, exist_ok=True)
    for old in {*folder.iterdir()} - {ours}:
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


@functools.cache
def sources() -> str:
    """A fingerprint of the project's files, and of what runs them."""
    texts = [json.dumps(np.show_config("dicts")), platform.python_version()]
    # With the processor, above, what chooses the kernels of BLAS: their last
    # bits differ.
    texts.append(os.environ.get("OPENBLAS_CORETYPE", ""))
    texts += [f"{package} {version(package)}" for package in PACKAGES]
    paths = {path for name in FOLDERS for path in (ROOT / name).rglob("*.*")}
    paths.add(ROOT / "pyproject.toml")  # of the wheel
    for path in sorted(filter(Path.is_file, paths)):
        if path.suffix != ".pyc":
            texts += [str(path), _digest(path.read_bytes())]
    return _digest("\n".join(texts))


def _digest(text: str | bytes) -> str:
    whole = text.encode() if isinstance(text, str) else text
    return hashlib.sha256(whole).hexdigest()[:32]
