"""Entries of joint groups: names, globs, indices, subtrees, single channels; groups as TOML."""

import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, TypeGuard

import numpy as np

from mograft._util.documents import parse_document
from mograft.body.anatomy import suggest_joint
from mograft.errors import join_names
from mograft.motion.skeleton import Skeleton


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


def channels_of_joint(joint: int, skeleton: Skeleton) -> list[tuple[int, str]]:
    """Return a pair (joint, axis) for each rotation channel of a joint with three of them.

    Other joints cannot be divided; they have the single pair (joint, "").
    """
    order = skeleton.rotation_order(joint)
    return [(joint, axis) for axis in order] if len(order) == 3 else [(joint, "")]


def channels_of_entry(entry: Entry, skeleton: Skeleton, group: str) -> set[tuple[int, str]]:
    """Return what a group entry selects: pairs (joint, axis), or (joint, "") for whole joints.

    `group` is the name of the group, for messages. Raises ValueError if a joint does not exist or
    cannot be divided.
    """
    found = re.fullmatch(r"(.+)\.([XYZ])rotation", entry) if isinstance(entry, str) else None
    if found is None or entry in skeleton.names:
        return {(joint, "") for joint in _joints_of_entry(entry, skeleton, group)}
    joints = _joints_of_entry(found[1], skeleton, group)
    for joint in sorted(joints):
        label = f"group {group!r}: {joint_label(skeleton, joint)}"
        if (joint, found[2]) not in channels_of_joint(joint, skeleton):
            got = " ".join(skeleton.channels[joint]) or "none"
            raise ValueError(f"{label} must have three rotation channels to be divided, got {got}")
        if skeleton.parents[joint] < 0:
            raise ValueError(f"{label} must be in one group as a whole, because it is the root")
    return {(joint, found[2]) for joint in joints}


def _joints_of_entry(entry: Entry, skeleton: Skeleton, group: str) -> set[int]:
    """Return the joints of a group entry."""
    if isinstance(entry, Subtree):
        tops = _joints_of_entry(entry.joint, skeleton, group)
        return set(np.flatnonzero(skeleton.subtree_mask(tops)).tolist())
    if isinstance(entry, int):
        if not 0 <= entry < (n := skeleton.n_joints):
            raise ValueError(f"group {group!r}: joint index must be 0 to {n - 1}, got {entry}")
        return {entry}
    names = skeleton.names
    matches = entry.__eq__ if entry in names else lambda name: fnmatchcase(name, entry)
    found = {joint for joint, name in enumerate(names) if matches(name)}
    if not found:
        hint = suggest_joint(skeleton, entry) or f"; joints are {join_names(names)}"
        raise ValueError(f"group {group!r}: no joint is named {entry!r}{hint}")
    return found


def joint_label(skeleton: Skeleton, joint: int, axis: str = "") -> str:
    """Return the name of a joint, or of its rotation channel about `axis`, for messages.

    If several joints have the name, the index of the joint is added.
    """
    name = skeleton.names[joint]
    label = name if skeleton.names.count(name) == 1 else f"{name} (index {joint})"
    return f"{label}.{axis}rotation" if axis else label


def groups_to_toml(groups: Mapping[str, tuple[Entry, ...]], base: str) -> str:
    """Return joint groups as TOML text; see `JointGroups.to_toml`."""
    lines = [f"base = {_toml_value(base)}", "", "[groups]"]
    for name, entries in groups.items():
        values = [f"    {_toml_value(entry)}," for entry in entries]
        lines += [f"{_toml_value(name)} = [", *values, "]"]
    return "\n".join(lines) + "\n"


def read_groups(source: str | os.PathLike[str]) -> tuple[dict[str, Any], Any, str]:
    """Read groups and base from TOML, and name the source for messages; see `from_toml`.

    `JointGroups` checks the entries and the base.
    """
    is_text = isinstance(source, str) and "\n" in source
    place = "groups" if is_text else str(source)
    try:
        text = str(source) if is_text else Path(source).read_text(encoding="utf-8")
        table = parse_document(text, "TOML")
    except UnicodeDecodeError as error:
        raise ValueError(f"{place}: not UTF-8: {error}") from error
    except ValueError as error:
        raise ValueError(f"{place}: not valid TOML: {error}") from error
    if set(table) - {"base", "groups"} or not isinstance(table.get("groups"), dict):
        got = ", ".join(table) or "nothing"
        raise ValueError(f"{place}: must contain a table [groups] and optionally base, got {got}")
    groups = {
        name: [*map(_read_entry, entries)] if isinstance(entries, list) else entries
        for name, entries in table["groups"].items()
    }
    return groups, table.get("base", "lower"), place


def _toml_value(value: Entry) -> str:
    """Return an entry in TOML syntax: strings are escaped as in JSON, and DEL in addition."""
    if isinstance(value, Subtree):
        return f"{{subtree = {_toml_value(value.joint)}}}"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _read_entry(entry: object) -> object:
    """Return an entry of a TOML list, with a table ``{subtree = ...}`` as a `Subtree`."""
    if isinstance(entry, dict) and set(entry) == {"subtree"}:
        return Subtree(entry["subtree"])
    return entry
