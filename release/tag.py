"""Compare a tag with the versions that the repository states: ``python -m release.tag v0.1.0``."""

import re
import sys
from pathlib import Path

from release.distributions import ROOT

_STATEMENTS = {
    "Cargo.toml": '^version = "{version}"$',
    "python-fbx/Cargo.toml": '^version = "{version}"$',
    "conda/recipe.yaml": '^  version: "{version}"$',
    "CHANGELOG.md": "^## {version}\\b",
}
"""Patterns of the lines that state the version, by file."""


def find_other_versions(tag: str, root: Path = ROOT) -> list[str]:
    """Return the files of a repository that do not state the version of a tag such as ``v0.1.0``.

    Raises ValueError if the tag is no version.
    """
    match = re.fullmatch(r"v(\d+\.\d+\.\d+)", tag)
    if match is None:
        raise ValueError(f"tag must be vMAJOR.MINOR.PATCH, got {tag}")
    patterns = {
        name: text.format(version=re.escape(match[1])) for name, text in _STATEMENTS.items()
    }
    return [
        name
        for name, pattern in patterns.items()
        if not re.search(pattern, (root / name).read_text(encoding="utf-8"), re.MULTILINE)
    ]


def main(arguments: list[str]) -> int:
    """Print the files that state another version; return 1 if there are any."""
    (tag,) = arguments
    try:
        other = find_other_versions(tag)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 2
    for name in other:
        print(f"{name} does not state the version of the tag {tag}", file=sys.stderr)
    return 1 if other else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
