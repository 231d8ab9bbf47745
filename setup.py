"""Stops the building of a wheel with one line; `pip install -e .` passes (CONTRIBUTING.md)."""

from setuptools import setup
from setuptools.command.bdist_wheel import bdist_wheel


class NoWheel(bdist_wheel):
    """Editable installs do not run this command; `pip install .`, `pip wheel .` and `build` do."""

    def run(self) -> None:
        raise SystemExit(
            "error: structural-model-zoo runs from its clone and has no wheel; "
            "in the clone: pip install -c constraints.txt -e ."
        )


setup(cmdclass={"bdist_wheel": NoWheel})
