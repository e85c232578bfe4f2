"""Compiles the geometry; all else is in pyproject.toml."""

import os
import shutil
import subprocess
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

MATH = "nadia_balance.core.math"
SOURCE = "nadia_balance/core/math/geometry.c"
# Products are not fused with sums, and no instructions of this very processor
# are used: results are the same on every one.
FLAGS = ["-O2", "-std=c99", "-ffp-contract=off", "-fPIC", "-shared"]

NO_COMPILER = "nadia_balance needs a C compiler: apt-get install gcc libc6-dev"


class SharedLibrary(build_ext):
    """Compiles a library that ctypes loads: it needs no headers of Python."""

    def get_ext_filename(self, fullname: str) -> str:
        """The library's path: no name that Python takes for a module's."""
        return os.path.join(*fullname.split(".")) + ".so.1"

    def build_extension(self, ext: Extension) -> None:
        """Compiles, or says in one line what to install."""
        compilers = filter(shutil.which, ("cc", "gcc", "clang"))
        compiler = os.environ.get("CC") or next(compilers, None)
        if compiler is None or not shutil.which(compiler.split()[0]):
            raise SystemExit(NO_COMPILER)
        path = Path(self.get_ext_fullpath(ext.name))
        path.parent.mkdir(parents=True, exist_ok=True)
        command = [*compiler.split(), *FLAGS, "-o", path, *ext.sources, "-lm"]
        if subprocess.run(command).returncode:  # such as without math.h
            raise SystemExit(NO_COMPILER)


setup(
    ext_modules=[Extension(f"{MATH}.libgeometry", [SOURCE])],
    cmdclass={"build_ext": SharedLibrary},
)
