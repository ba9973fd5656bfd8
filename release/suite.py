"""The tests that an installed wheel must pass on other Pythons: those of the library itself."""

import tomllib

from release.distributions import ROOT

FOLDERS = (
    "_util",
    "analysis",
    "blend",
    "body",
    "cli",
    "dancer",
    "io",
    "library",
    "linkage",
    "motion",
    "scenario",
    "search",
    "synthesis",
)
"""Folders of ``tests``. The others need a browser, plots or the repository."""

_PACKAGES = ("hypothesis", "pybvh", "pytest", "scikit-learn", "scipy")  # pytest-xdist, too
_NOT_OF_WHEELS = ("tests/linkage/test_distribution.py",)  # builds a wheel from the repository


def list_requirements() -> list[str]:
    """Return the packages of the extra `test` that the tests in `FOLDERS` do not skip without."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = project["optional-dependencies"]["test"]
    return [line for line in wanted if line.startswith(_PACKAGES)]


def list_words(*, few_examples: bool = False) -> list[str]:
    """Return the arguments of Python, to be run in the folder of the repository.

    `few_examples` is for a Python whose kernels another one has tested: 10 examples per property.
    """
    words = ["-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not thorough and not browser"]
    words += ["-n", "auto", "--maxprocesses", "4", "--dist", "loadfile"]
    if few_examples:
        words += ["--hypothesis-profile", "few"]
    words += [word for path in _NOT_OF_WHEELS for word in ("--ignore", path)]
    return [*words, *(f"tests/{name}" for name in FOLDERS)]
