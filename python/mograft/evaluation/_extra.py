"""Packages that only some measures need."""

from importlib import import_module
from typing import Any

__all__ = ["needed"]


def needed(name: str) -> Any:  # noqa: ANN401 - a module of another package
    """Import a module of the extra `evaluate`.

    Parameters
    ----------
    name : str
        The module.

    Returns
    -------
    module
        The module.

    Raises
    ------
    ImportError
        If its package is not installed; names the extra.
    """
    try:
        return import_module(name)
    except ImportError as error:
        package = {"sklearn": "scikit-learn", "scipy": "SciPy"}.get(
            name.split(".")[0], name.split(".")[0]
        )
        raise ImportError(
            f"this measure needs {package}: pip install 'mograft[evaluate]'", name=error.name
        ) from error
