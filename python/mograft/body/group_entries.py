"""Entries of joint groups: joint names, globs, indices, subtrees and single channels."""

import difflib
import re
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import TypeGuard

import numpy as np

from mograft.body.hierarchy import subtree_mask
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
        if (joint, found[2]) not in channels_of_joint(joint, skeleton):
            raise ValueError(
                f"group {group!r}: {joint_label(skeleton, joint)} must have three rotation "
                f"channels to be divided, got {' '.join(skeleton.channels[joint]) or 'none'}"
            )
        if skeleton.parents[joint] < 0:
            raise ValueError(
                f"group {group!r}: {joint_label(skeleton, joint)} must be in one group as a whole, "
                "because it is the root"
            )
    return {(joint, found[2]) for joint in joints}


def _joints_of_entry(entry: Entry, skeleton: Skeleton, group: str) -> set[int]:
    """Return the joints of a group entry."""
    if isinstance(entry, Subtree):
        tops = _joints_of_entry(entry.joint, skeleton, group)
        return set(np.flatnonzero(subtree_mask(skeleton, tops)).tolist())
    if isinstance(entry, int):
        if not 0 <= entry < skeleton.n_joints:
            raise ValueError(
                f"group {group!r}: joint index must be 0 to {skeleton.n_joints - 1}, got {entry}"
            )
        return {entry}
    names = skeleton.names
    found = {joint for joint, name in enumerate(names) if name == entry}
    found = found or {joint for joint, name in enumerate(names) if fnmatchcase(name, entry)}
    if not found:
        close = difflib.get_close_matches(entry, names, n=3)
        guess = f"did you mean {' or '.join(map(repr, close))}?"
        hint = guess if close else f"joints are {', '.join(names)}"
        raise ValueError(f"group {group!r}: no joint is named {entry!r}; {hint}")
    return found


def joint_label(skeleton: Skeleton, joint: int, axis: str = "") -> str:
    """Return the name of a joint, or of its rotation channel about `axis`, for messages.

    If several joints have the name, the index of the joint is added.
    """
    name = skeleton.names[joint]
    label = name if skeleton.names.count(name) == 1 else f"{name} (index {joint})"
    return f"{label}.{axis}rotation" if axis else label
