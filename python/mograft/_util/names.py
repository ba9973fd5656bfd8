"""Names: unique ones of clips, of files on every system, and of discovered joint groups."""

import re
from collections.abc import Collection, Iterable, Sequence
from fnmatch import fnmatchcase

from mograft.errors import join_names, suggest_name

# Surrogates from U+DC80 to U+DCFF are bytes of names on Linux that are not UTF-8.
_UNUSABLE = re.compile(r'[<>:"/\\|?*\x00-\x1f\x7f\ud800-\udc7f\udd00-\udfff]')
_DEVICES = {"con", "prn", "aux", "nul", "conin$", "conout$"} | {
    f"{port}{digit}" for port in ("com", "lpt") for digit in "0123456789\u00b9\u00b2\u00b3"
}
_MAX_BYTES = 220
"""File systems accept 255 bytes; an ending and a number are added to names."""


def portable_stem(name: str) -> str:
    """Return a name as the start of a file name that Linux, macOS and Windows accept.

    Forbidden and control characters and unpaired surrogates become ``_``, spaces and dots at the
    end are removed, and the names of devices such as ``CON`` and ``nul.tar`` get ``_`` appended to
    their first part. The result has at most 220 bytes in UTF-8. A name that all systems accept is
    returned unchanged.

    >>> portable_stem("walk: left"), portable_stem("CON"), portable_stem("...")
    ('walk_ left', 'CON_', '_')
    """
    stem = _UNUSABLE.sub("_", name)
    if len(encoded := stem.encode("utf-8", "surrogateescape")) > _MAX_BYTES:
        stem = encoded[:_MAX_BYTES].decode("utf-8", "ignore")
    first, dot, rest = stem.rstrip(" .").partition(".")
    if first.rstrip().casefold() in _DEVICES:
        first = f"{first.rstrip()}_"
    return f"{first}{dot}{rest}" or "_"


def as_words(name: str, words: object) -> str | Collection[str]:
    """Return a string, or several strings in any iterable, as a string or a collection of strings.

    A list, tuple or set of strings is returned as it is, another iterable as a tuple. Raises
    TypeError, which calls the argument `name`, for anything else.
    """
    if isinstance(words, str):
        return words
    # Arrays without axes are iterable by type only.
    if isinstance(words, Iterable) and getattr(words, "ndim", None) != 0:
        several = words if isinstance(words, list | tuple | set | frozenset) else tuple(words)
        if all(isinstance(word, str) for word in several):
            return several
    raise TypeError(f"`{name}` must be a name or several names, got {words!r}")


def find_matches(argument: str, patterns: str | Iterable[str], names: Sequence[str]) -> list[int]:
    """Return the indices of the names that are one of `patterns`, or match one such as ``walk*``.

    A pattern that is a name selects only this name. Others match names, or the part of names after
    the last ``|``: Blender writes names such as ``Rig|Walk``. Raises ValueError, which calls the
    argument `argument`, for a pattern that selects no name.
    """
    several = [patterns] if isinstance(patterns, str) else list(patterns)
    places: dict[str, list[int]] = {pattern: [] for pattern in several}
    for index, name in enumerate(names):
        if name in places:
            places[name].append(index)
    found: set[int] = set()
    for pattern in several:
        own = places[pattern] or [
            index
            for index, name in enumerate(names)
            if fnmatchcase(name, pattern) or fnmatchcase(name.rpartition("|")[2], pattern)
        ]
        if not own:
            hint = "" if set(pattern) & set("*?[") else suggest_name(pattern, names)
            expected = f"at least one of {join_names(names)}"
            raise ValueError(f"`{argument}` must match {expected}; got {pattern!r}{hint}")
        found.update(own)
    return sorted(found)


def unique_names(names: Sequence[str]) -> list[str]:
    """Return names made unique: repeated names get ``~2``, ``~3``... appended.

    An empty name becomes ``clip`` and its index in `names`.
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


AUTOMATIC = "auto"
"""Name that selects discovered groups; ``auto:3`` also gives their number."""


def is_automatic(name: str) -> bool:
    """Return whether the name of joint groups is ``auto`` or begins with ``auto:``."""
    return name.partition(":")[0] == AUTOMATIC


def automatic_number(name: str) -> int | None:
    """Return the number of groups in a name such as ``auto:3``; None for ``auto``.

    Raises ValueError if it is not a whole number of at least 2.
    """
    _, colon, number = name.partition(":")
    if colon and not (number.isascii() and number.isdigit() and int(number) >= 2):
        expected = "auto or auto:N with a whole number N of at least 2"
        raise ValueError(f"`groups` must be {expected}, got {name!r}")
    return int(number) if colon else None
