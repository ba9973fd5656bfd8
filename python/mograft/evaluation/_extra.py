"""Imports of the packages that the extra `evaluate` installs."""

from importlib import import_module
from typing import Any

_PACKAGES = {"sklearn": "scikit-learn", "scipy": "SciPy"}


def import_extra(name: str) -> Any:  # noqa: ANN401 - a module of another package
    """Import a module of a package that the extra `evaluate` installs.

    Raises ImportError if the package is not installed; the message names the package and the extra.
    """
    try:
        return import_module(name)
    except ImportError as error:
        top_level = name.split(".", maxsplit=1)[0]
        package = _PACKAGES.get(top_level, top_level)
        raise ImportError(
            f"this measure needs {package}: pip install 'mograft[evaluate]'", name=error.name
        ) from error
