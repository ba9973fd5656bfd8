"""Entries of joint groups: names, globs, indices, subtrees and single channels, also in TOML."""

import json
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np


@dataclass(frozen=True)
class Subtree:
    """A joint and all joints below it; created by `subtree`."""

    joint: str | int

    def __repr__(self) -> str:
        return f"subtree({self.joint!r})"


def subtree(joint: str | int) -> Subtree:
    """Return an entry of `JointGroups` for a joint and all joints below it.

    Parameters
    ----------
    joint : str or int
        Name of the joint, a glob or an index.

    Returns
    -------
    Subtree
        The entry.

    Examples
    --------
    >>> from mograft import JointGroups
    >>> JointGroups({"lower": ["Hips", subtree("*UpLeg")], "upper": [subtree("Spine")]})
    JointGroups(lower: Hips subtree('*UpLeg'); upper: subtree('Spine'); base lower)
    """
    if isinstance(joint, np.integer):
        joint = int(joint)
    if not is_joint(joint):
        raise TypeError(f"`joint` must be a name or an index, got {joint!r}")
    return Subtree(joint)


Entry = str | int | Subtree


def is_joint(entry: object) -> TypeGuard[str | int]:
    """Return whether an entry of a joint group is a string (name, glob or channel) or an index."""
    return isinstance(entry, str | int) and not isinstance(entry, bool)


def toml_value(value: Entry) -> str:
    """Return an entry in TOML syntax: strings are escaped as in JSON, and DEL in addition."""
    if isinstance(value, Subtree):
        return f"{{subtree = {toml_value(value.joint)}}}"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def read_entry(entry: object) -> object:
    """Return an entry of a TOML list, with a table ``{subtree = ...}`` as a `Subtree`."""
    if isinstance(entry, dict) and set(entry) == {"subtree"}:
        return Subtree(entry["subtree"])
    return entry
