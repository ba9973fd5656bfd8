"""The differences between two versions that are intended, each with its reason."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Rule:
    """A changed rule, and the files in which it shows."""

    case: str  # glob of cases
    file: str  # glob of files
    reason: str
    keys: tuple[str, ...] = ()  # of JSON files: globs of the values that may differ


EXPECTED: tuple[Rule, ...] = (
    *(
        Rule("*", file, "segments and labels of libraries are in arrays, not in the database", keys)
        for file, keys in (
            ("*/catalog.sqlite", ()),
            ("*.mograft/manifest.json", ("checksum", "files.*/catalog.sqlite.*")),
        )
    ),
    Rule(
        "*",
        "*.json",
        "the provenance records the command, and fields of the configuration are set by --set",
        ("request.command*", "motions.*.request.command*"),
    ),
    *(
        Rule("*", file, "films and strips are drawn by one projector, from the figure's front")
        for file in ("*.gif", "strip.svg", "groups.svg")
    ),
)
