"""Unique names for clips."""

from collections.abc import Sequence


def unique_names(names: Sequence[str]) -> list[str]:
    """Return names made unique: repeated names get ``~2``, ``~3``... appended.

    An empty name becomes ``clip`` with the index of the clip.
    """
    taken: set[str] = set()
    distinct = []
    for index, given in enumerate(names):
        name = stem = given or f"clip{index}"
        count = 1
        while name in taken:
            count += 1
            name = f"{stem}~{count}"
        taken.add(name)
        distinct.append(name)
    return distinct
