"""Generates maneuver.v1 from ../../proto when the package is built; see pyproject.toml."""

import pathlib
import sys

from setuptools import setup
from setuptools.command.build_py import build_py

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from generate import generate  # noqa: E402


class BuildWithStubs(build_py):
    """Copies the modules, then generates maneuver.v1 beside them."""

    def run(self) -> None:
        super().run()
        generate(HERE.parent.parent / "proto", pathlib.Path(self.build_lib).resolve())


setup(cmdclass={"build_py": BuildWithStubs})
