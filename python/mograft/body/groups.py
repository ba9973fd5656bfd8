"""`JointGroups`: the joint groups that are kept or exchanged as a whole."""

import os
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from mograft._util.arrays import IntArray
from mograft._util.documents import parse_document
from mograft._util.validate import check_type
from mograft.body.anatomy import anatomy, suggest_joint
from mograft.body.group_entries import Entry, Subtree, is_joint, read_entry, toml_value
from mograft.body.joint_names import ARM, part_of_words, read_names
from mograft.errors import join_names, suggest_name
from mograft.motion.skeleton import Skeleton

# Groups of each preset. The first is the base: the hips, their ancestors and the legs.
PRESETS: Mapping[str, tuple[str, ...]] = {
    "lower_upper": ("lower", "upper"),
    "lower_torso_arms": ("lower", "torso", "arms"),
    "lower_torso_larm_rarm": ("lower", "torso", "larm", "rarm"),
    "lower_torso_head_larm_rarm": ("lower", "torso", "head", "larm", "rarm"),
}


OTHER_BASE = (
    "to exchange it, set another base in the file that mograft groups FILE -o g.toml writes, and "
    "use `groups=g.toml`"
)
"""What a message says of the base group or its joints, which keep their motion."""


def suggest_groups(name: object, groups: Collection[str]) -> str:
    """Return the preset that has the group `name`, or the most similar one of `groups`, as text."""
    close = suggest_name(name, groups)
    presets = [own for own, members in PRESETS.items() if name in members]
    presets = presets or [own for own, members in PRESETS.items() if suggest_name(name, members)]
    presets = presets or [own for own, members in PRESETS.items() if _group_of(name) in members]
    if close or name in groups or not presets:
        return close
    return f"; `groups={presets[0]}` has the groups {', '.join(PRESETS[presets[0]])}"


def _group_of(name: object) -> str:
    """Return the group of a preset that has the body part `name`, such as "left hand", or ""."""
    (words,), (side,) = read_names((str(name).removesuffix("s"),))
    return _group_of_part(part_of_words(words), side, [own for p in PRESETS.values() for own in p])


def _group_of_part(part: str, side: str, groups: Collection[str]) -> str:
    """Return the group that has a part of the upper body: of its possible ones, the smallest."""
    possible: tuple[str, ...] = ()
    if part in (*ARM, "shoulder"):
        possible = f"{side[:1]}arm", "arms", "torso", "upper"
    elif part in ("neck", "head"):
        possible = "head", "torso", "upper"
    elif part == "trunk":
        possible = "torso", "upper"
    return next((group for group in possible if group in groups), "")


_LABELS = {"upper": "upper body", "torso": "torso", "head": "neck or head", "arms": "arms"}
_LABELS |= {"larm": "left arm", "rarm": "right arm"}


def _channels_of_joint(joint: int, skeleton: Skeleton) -> list[tuple[int, str]]:
    """Return a pair (joint, axis) for each rotation channel of a joint with three of them.

    Other joints cannot be divided; they have the single pair (joint, "").
    """
    order = skeleton.rotation_order(joint)
    return [(joint, axis) for axis in order] if len(order) == 3 else [(joint, "")]


def _channels_of_entry(entry: Entry, skeleton: Skeleton, group: str) -> set[tuple[int, str]]:
    """Return what a group entry selects: pairs (joint, axis), or (joint, "") for whole joints.

    `group` is the name of the group, for messages. Raises ValueError if a joint does not exist or
    cannot be divided.
    """
    found = re.fullmatch(r"(.+)\.([XYZ])rotation", entry) if isinstance(entry, str) else None
    if found is None or entry in skeleton.names:
        return {(joint, "") for joint in _joints_of_entry(entry, skeleton, group)}
    joints = _joints_of_entry(found[1], skeleton, group)
    for joint in sorted(joints):
        label = f"group {group!r}: {_joint_label(skeleton, joint)}"
        if (joint, found[2]) not in _channels_of_joint(joint, skeleton):
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


def _joint_label(skeleton: Skeleton, joint: int, axis: str = "") -> str:
    """Return the name of a joint, or of its rotation channel about `axis`, for messages.

    If several joints have the name, the index of the joint is added.
    """
    name = skeleton.names[joint]
    label = name if skeleton.names.count(name) == 1 else f"{name} (index {joint})"
    return f"{label}.{axis}rotation" if axis else label


@dataclass(frozen=True)
class JointGroups:
    """Disjoint groups that together contain all joints of a skeleton.

    Parameters
    ----------
    groups : mapping of str to sequence
        Entries of each group: joint names, globs (``"Left*Arm"``), indices, and `subtree` of one
        of these. A name selects all joints of that name; it is a glob only if no joint has that
        name. The suffix ``".Xrotation"`` (or Y, Z) selects one channel, so that a joint can be
        divided between groups.
    base : str
        The group that is kept when the others are exchanged.

    Raises
    ------
    ValueError
        If there are fewer than two groups, a group is empty or `base` is not one of them.
    TypeError
        If a group is not a sequence of such entries.

    See Also
    --------
    JointGroups.preset : Groups by body part.
    mograft.discover_groups : Groups of joints that move together.

    Examples
    --------
    >>> from mograft import subtree
    >>> skeleton = Skeleton(
    ...     ["Hips", "Spine", "Head", "Leg"], [-1, 0, 1, 0], [[0, 0, 0]] * 4
    ... )
    >>> groups = JointGroups({"lower": ["Hips", "L*g"], "upper": [subtree("Spine")]})
    >>> groups.resolve(skeleton)
    {'lower': array([0, 3]), 'upper': array([1, 2])}
    """

    groups: Mapping[str, tuple[Entry, ...]]
    base: str = "lower"

    def __post_init__(self) -> None:
        if not isinstance(self.groups, Mapping):
            raise TypeError(f"`groups` must map group names to joints, got {self.groups!r}")
        groups = {}
        for name, entries in self.groups.items():
            if not isinstance(name, str):
                raise TypeError(f"group names must be str, got {name!r}")
            if isinstance(entries, str | Subtree | Mapping) or not isinstance(entries, Iterable):
                raise TypeError(f"group {name!r} must be a list of joints, got {entries!r}")
            own = groups[name] = tuple(int(e) if isinstance(e, np.integer) else e for e in entries)
            wrong = [e for e in own if not is_joint(e.joint if isinstance(e, Subtree) else e)]
            if wrong:
                expected = "names, indices or subtree(...)"
                raise TypeError(f"group {name!r} must contain {expected}, got {wrong[0]!r}")
            if not own:
                raise ValueError(f"group {name!r} must have at least one joint, got none")
        if len(groups) < 2:
            expected = "at least two entries, a base and one to exchange"
            raise ValueError(f"`groups` must have {expected}, got {list(groups)}")
        if not isinstance(self.base, str) or self.base not in groups:
            raise ValueError(f"`base` must be one of {', '.join(groups)}, got {self.base!r}")
        object.__setattr__(self, "groups", groups)

    def __repr__(self) -> str:
        shown = ""
        for name, entries in self.groups.items():
            shown += f"{name}: {' '.join(e if isinstance(e, str) else repr(e) for e in entries)}; "
        return f"JointGroups({shown}base {self.base})"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the groups, in order."""
        return tuple(self.groups)

    @classmethod
    def preset(cls, name: str, skeleton: Skeleton) -> "JointGroups":
        """Return groups of the joints of a skeleton by body part.

        Parameters
        ----------
        name : str
            ``"lower_upper"``, ``"lower_torso_arms"``, ``"lower_torso_larm_rarm"`` or
            ``"lower_torso_head_larm_rarm"``; underscores separate the names of the groups.
        skeleton : Skeleton
            The skeleton. The result is valid for all skeletons of the same hierarchy.

        Returns
        -------
        JointGroups
            With base ``"lower"``: the root, the legs and their ancestors. Arms begin at the
            clavicle. Without a group ``"head"`` the head belongs to the torso. A tail and
            joints without a body part belong to the group of their parent.

        Raises
        ------
        ValueError
            If the preset is unknown or the skeleton lacks a body part; the message names it.

        Examples
        --------
        >>> skeleton = Skeleton(["Hips", "LeftHip", "Chest"], [-1, 0, 0], [[0, 0, 0]] * 3)
        >>> JointGroups.preset("lower_upper", skeleton)
        JointGroups(lower: Hips LeftHip; upper: Chest; base lower)
        """
        check_type("skeleton", skeleton, Skeleton)
        if not isinstance(name, str) or name not in PRESETS:
            hint = suggest_name(name, PRESETS)
            raise ValueError(f"`preset` must be one of {', '.join(PRESETS)}, got {name!r}{hint}")
        found: dict[str, list[int]] = {group: [] for group in PRESETS[name]}
        for joint, group in enumerate(_assign(skeleton, PRESETS[name])):
            found[group].append(joint)
        _check_parts(name, skeleton, found)
        return groups_of_joints(skeleton, found, "lower")

    def resolve(self, skeleton: Skeleton) -> dict[str, IntArray]:
        """Return the joints of each group.

        Parameters
        ----------
        skeleton : Skeleton
            Skeleton in which the entries are looked up.

        Returns
        -------
        dict of str to ndarray of int
            Joint indices of each group, ascending. A divided joint is in every group that has
            one of its channels; see `divided_channels`.

        Raises
        ------
        ValueError
            If an entry matches no joint, groups overlap, or a joint or channel is in no group.
            The message names them.
        """
        return {
            name: np.array(sorted({joint for joint, _ in channels}), dtype=np.int64)
            for name, channels in self._shares(skeleton).items()
        }

    def divided_channels(self, skeleton: Skeleton) -> dict[str, dict[int, str]]:
        """Return the channels of joints that are divided between groups.

        Parameters
        ----------
        skeleton : Skeleton
            Skeleton in which the entries are looked up.

        Returns
        -------
        dict of str to dict of int to str
            For each group and divided joint, the axes of the group's channels, in file order.

        Raises
        ------
        ValueError
            As for `resolve`.

        Examples
        --------
        >>> skeleton = Skeleton(["Hips", "Arm"], [-1, 0], [[0, 0, 0]] * 2)
        >>> groups = JointGroups(
        ...     {"lower": ["Hips", "Arm.Zrotation", "Arm.Xrotation"], "roll": ["Arm.Yrotation"]}
        ... )
        >>> groups.divided_channels(skeleton)
        {'lower': {1: 'ZX'}, 'roll': {1: 'Y'}}
        """
        found: dict[str, dict[int, str]] = {}
        for name, channels in self._shares(skeleton).items():
            found[name] = {}
            for joint in sorted({joint for joint, axis in channels if axis}):
                order = skeleton.rotation_order(joint)
                axes = "".join(axis for axis in order if (joint, axis) in channels)
                if len(axes) < 3:  # a group that has all three channels has the whole joint
                    found[name][joint] = axes
        return found

    def _shares(self, skeleton: Skeleton) -> dict[str, set[tuple[int, str]]]:
        """Return the content of each group: pairs (joint, axis), axis "" for a whole joint."""
        check_type("skeleton", skeleton, Skeleton)
        owner: dict[tuple[int, str], str] = {}
        shares: dict[str, set[tuple[int, str]]] = {}
        for name, entries in self.groups.items():
            channels = {c for e in entries for c in _channels_of_entry(e, skeleton, name)}
            divided = {joint for joint, axis in channels if axis}
            for joint in sorted(divided & {joint for joint, axis in channels if not axis}):
                label = _joint_label(skeleton, joint)
                expected = f"contain joint {label} as a whole or by channels"
                raise ValueError(f"group {name!r} must {expected}, got both")
            for joint, axis in sorted(channels):
                for key in [(joint, axis)] if axis else _channels_of_joint(joint, skeleton):
                    if key in owner:
                        label = _joint_label(skeleton, joint, axis)
                        got = f"{owner[key]!r} and {name!r}"
                        raise ValueError(f"joint {label} must be in one group, got {got}")
                    owner[key] = name
            shares[name] = channels
        missing: list[str] = []
        for joint in range(skeleton.n_joints):
            lacking = [c for c in _channels_of_joint(joint, skeleton) if c not in owner]
            is_whole = len(lacking) == len(_channels_of_joint(joint, skeleton))
            axes = [""] if is_whole else [axis for _, axis in lacking]
            missing += [_joint_label(skeleton, joint, axis) for axis in axes if lacking]
        if missing:
            shown = ", ".join(dict.fromkeys(missing))
            raise ValueError(f"every joint must be in a group, got none for {shown}")
        return shares

    def to_toml(self) -> str:
        """Return the groups as TOML text for `from_toml`.

        Examples
        --------
        >>> from mograft import subtree
        >>> groups = JointGroups({"lower": ["Hips"], "upper": [subtree("Spine")]})
        >>> print(groups.to_toml(), end="")
        base = "lower"
        <BLANKLINE>
        [groups]
        "lower" = [
            "Hips",
        ]
        "upper" = [
            {subtree = "Spine"},
        ]
        """
        lines = [f"base = {toml_value(self.base)}", "", "[groups]"]
        for name, entries in self.groups.items():
            values = [f"    {toml_value(entry)}," for entry in entries]
            lines += [f"{toml_value(name)} = [", *values, "]"]
        return "\n".join(lines) + "\n"

    @classmethod
    def from_toml(cls, source: str | os.PathLike[str]) -> "JointGroups":
        """Read groups from TOML.

        Parameters
        ----------
        source : str or path
            Path of a file, or TOML text: a string with a line break.

        Returns
        -------
        JointGroups
            The groups. A missing ``base`` is ``"lower"``.

        Raises
        ------
        ValueError
            If the text is not valid TOML, or does not have the form that `to_toml` writes. The
            message names the file.
        OSError
            If the file cannot be read.
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
            expected = "a table [groups] and optionally base"
            raise ValueError(f"{place}: must contain {expected}, got {got}")
        groups: dict[str, Any] = {
            name: [*map(read_entry, entries)] if isinstance(entries, list) else entries
            for name, entries in table["groups"].items()
        }
        try:
            return cls(groups, base=table.get("base", "lower"))
        except (TypeError, ValueError) as error:
            raise ValueError(f"{place}: {error}") from error


def groups_of_joints(
    skeleton: Skeleton, members: Mapping[str, Iterable[int]], base: str
) -> JointGroups:
    """Return groups with the joints `members`; entries are names where these are unique."""
    count = Counter(skeleton.names)
    labels: list[str | int] = list(skeleton.names)
    for joint, name in enumerate(skeleton.names):
        if count[name] > 1 or re.search("[\ud800-\udfff]", name):  # not encodable as UTF-8
            labels[joint] = joint
    groups = {group: tuple(labels[j] for j in sorted(joints)) for group, joints in members.items()}
    return JointGroups(groups, base=base)


def _assign(skeleton: Skeleton, group_names: tuple[str, ...]) -> list[str]:
    """Return the name of each joint's group, by its body part.

    Tails and joints without a body part have the group of their parent.
    """
    known = anatomy(skeleton)
    groups: list[str] = []
    for part, side, parent in zip(known.parts, known.sides, skeleton.parents.tolist(), strict=True):
        follows = part in ("tail", "other") and parent >= 0
        above = groups[parent] if follows else "lower"
        groups.append(_group_of_part(part, side, group_names) or above)
    return groups


def _check_parts(preset: str, skeleton: Skeleton, found: Mapping[str, list[int]]) -> None:
    """Raise ValueError if the skeleton lacks a body part of the preset.

    `found` holds the joints of each group.
    """
    known = anatomy(skeleton)
    missing = [] if known.joints("thigh", "shank", "foot") else ["legs"]
    missing += [label for group, label in _LABELS.items() if not found.get(group, [True])]
    if missing:
        needs = f"preset {preset!r} needs {' and '.join(missing)}"
        found_in = f"found none among the joints {join_names(skeleton.names)}"
        raise ValueError(f"{needs}, {found_in}; define the groups with JointGroups instead")
