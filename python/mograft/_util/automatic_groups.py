"""Names that select discovered joint groups: ``auto`` and ``auto:N``."""

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
    if not colon:
        return None
    if not (number.isascii() and number.isdigit() and int(number) >= 2):
        raise ValueError(
            f"`groups` must be auto or auto:N with a whole number N of at least 2, got {name!r}"
        )
    return int(number)
