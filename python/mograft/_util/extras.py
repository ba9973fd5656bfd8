"""Packages that only an extra of mograft installs."""

from importlib import import_module
from typing import Any


def import_extra(module: str, need: str, extra: str) -> Any:  # noqa: ANN401 - of another package
    """Import a module of a package that an extra installs.

    Raises ModuleNotFoundError if it is not installed: `need`, such as "plots need matplotlib", and
    the command that installs the extra.
    """
    try:
        return import_module(module)
    except ImportError as error:
        name = module.partition(".")[0]
        raise ModuleNotFoundError(f"{need}: pip install 'mograft[{extra}]'", name=name) from error
