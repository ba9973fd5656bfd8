"""Clips that a library leaves out."""

from collections.abc import Mapping

from mograft.errors import join_names
from mograft.io.addresses import split_address

_MAX_NAMES = 3
"""Clips that a line names."""


def describe_excluded(excluded: Mapping[str, str]) -> list[str]:
    """Return the lines that report excluded clips.

    `excluded` has the reason of each exclusion, by the address of the clip. Clips of one file share
    a line if their reasons differ in nothing but the names of the clips.
    """
    lines: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for address, reason in excluded.items():
        path, clip = split_address(address)
        alike = reason.removeprefix(address).removeprefix(clip or "")
        line = reason if reason.startswith(path) else f"{address}: {reason}"
        lines.setdefault((path, alike), []).append((clip or "", line))
    found = []
    for (path, _), members in lines.items():
        _, line = members[0]
        if len(members) > 1:
            names = join_names([clip for clip, _ in members], _MAX_NAMES)
            line = f"{path}: {len(members)} clips ({names}), such as {line}"
        found.append(f"excluded: {line}")
    return found
