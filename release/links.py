"""Make the links of README.md absolute, so that package indexes show them.

``python -m release.links https://HOST/OWNER/REPOSITORY REVISION``: the workflows run it before
they build distributions.
"""

import re
import sys

from release.distributions import ROOT

_RELATIVE = re.compile(r"^(\[[\w-]+\]: )(?!https?:)(\S+)$", re.MULTILINE)
_PICTURES = (".gif", ".png", ".svg")


def make_absolute(text: str, repository: str, revision: str) -> str:
    """Return a text whose link definitions lead to the files of a repository at a revision."""

    def lead(match: re.Match[str]) -> str:
        kind = "raw" if match[2].endswith(_PICTURES) else "blob"
        return f"{match[1]}{repository}/{kind}/{revision}/{match[2]}"

    return _RELATIVE.sub(lead, text)


def main(arguments: list[str]) -> int:
    """Rewrite README.md."""
    repository, revision = arguments
    path = ROOT / "README.md"
    text = make_absolute(path.read_text(encoding="utf-8"), repository, revision)
    path.write_text(text, encoding="utf-8", newline="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
