"""Which joints move together: the groups that are kept and grafted as one."""

import difflib
import json
import os
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np

from mograft._util.arrays import IntArray
from mograft.body.anatomy import anatomy
from mograft.body.body_parts import ARM
from mograft.motion.skeleton import Skeleton

__all__ = ["PRESETS", "JointGroups", "Subtree", "subtree"]

# The groups of each preset, as the parts of the body that they need; the first one is the base
# and holds the hips, the legs and what stands above them.
PRESETS: Mapping[str, tuple[str, ...]] = {
    "lower_upper": ("lower", "upper"),
    "lower_torso_arms": ("lower", "torso", "arms"),
    "lower_torso_larm_rarm": ("lower", "torso", "larm", "rarm"),
    "lower_torso_head_larm_rarm": ("lower", "torso", "head", "larm", "rarm"),
}


@dataclass(frozen=True)
class Subtree:
    """A joint and all that hang on it; made by `subtree`."""

    joint: str | int

    def __repr__(self) -> str:
        return f"subtree({self.joint!r})"


def subtree(joint: str | int) -> Subtree:
    """Name a joint and all that hang on it, as an entry of `JointGroups`.

    Parameters
    ----------
    joint : str or int
        Its name, a glob of it, or its index.

    Returns
    -------
    Subtree
        The entry.

    Examples
    --------
    >>> JointGroups({"lower": ["Hips", subtree("*UpLeg")], "upper": [subtree("Spine")]})
    JointGroups(lower: Hips subtree('*UpLeg'); upper: subtree('Spine'); base lower)
    """
    if not isinstance(joint, str | int) or isinstance(joint, bool):
        raise TypeError(f"joint must be a name or an index, got {joint!r}")
    return Subtree(joint)


Entry = str | int | Subtree


@dataclass(frozen=True)
class JointGroups:
    """Disjoint groups of joints that together cover a skeleton.

    Parameters
    ----------
    groups : mapping of str to sequence
        The entries of each group: names of joints, globs (``"Left*Arm"``), indices, and
        `subtree` of any of these. A name stands for all joints that have it; it is taken as
        a glob only if no joint has it. With ``".Xrotation"`` (or Y, Z) behind it, for that
        channel alone: a joint may be divided between groups.
    base : str
        The group that is kept while others are grafted.

    Raises
    ------
    ValueError
        If there are fewer than two groups, one is empty, or the base is none of them.
    TypeError
        If a group is no sequence of such entries.

    See Also
    --------
    JointGroups.preset : Groups of a skeleton by what its joints are.

    Examples
    --------
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
            raise TypeError(f"groups must map names to joints, got {self.groups!r}")
        groups = {}
        for name, entries in self.groups.items():
            if not isinstance(name, str):
                raise TypeError(f"names of groups must be str, got {name!r}")
            if isinstance(entries, str | Subtree) or not isinstance(entries, Iterable):
                raise TypeError(f"group {name!r} must be a list of joints, got {entries!r}")
            own = tuple(int(entry) if isinstance(entry, np.integer) else entry for entry in entries)
            for entry in own:
                if not isinstance(entry, str | int | Subtree) or isinstance(entry, bool):
                    raise TypeError(
                        f"group {name!r} must hold names, indices or subtree(...), got {entry!r}"
                    )
            if not own:
                raise ValueError(f"group {name!r} must hold at least one joint, got none")
            groups[name] = own
        if len(groups) < 2:
            raise ValueError(
                f"groups must be two or more, one to keep and one to graft, got {list(groups)}"
            )
        if self.base not in groups:
            raise ValueError(f"base must be one of {', '.join(groups)}, got {self.base!r}")
        object.__setattr__(self, "groups", groups)

    def __repr__(self) -> str:
        shown = [
            f"{name}: {' '.join(e if isinstance(e, str) else repr(e) for e in entries)}"
            for name, entries in self.groups.items()
        ]
        return f"JointGroups({'; '.join(shown)}; base {self.base})"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the groups in order."""
        return tuple(self.groups)

    @classmethod
    def preset(cls, name: str, skeleton: Skeleton) -> "JointGroups":
        """Return the groups of a skeleton by what its joints are, as `anatomy` tells.

        Parameters
        ----------
        name : str
            ``"lower_upper"``, ``"lower_torso_arms"``, ``"lower_torso_larm_rarm"`` or
            ``"lower_torso_head_larm_rarm"``; the groups have the names between the lines.
        skeleton : Skeleton
            What to group. The result fits all skeletons of that hierarchy.

        Returns
        -------
        JointGroups
            With base ``"lower"``: the root, the hips and all that the legs hang on, and the
            legs. Arms begin at the collar. Without a group of its own the head belongs to the
            torso. A tail, and joints that are no part of a body, go with their parent.

        Raises
        ------
        ValueError
            If there is no such preset, or the skeleton has not all the parts; names them.

        Examples
        --------
        >>> skeleton = Skeleton(
        ...     ["Hips", "LeftHip", "RightHip", "Chest", "Head"],
        ...     [-1, 0, 0, 0, 3],
        ...     [[0, 0, 0]] * 5,
        ... )
        >>> JointGroups.preset("lower_upper", skeleton)
        JointGroups(lower: Hips LeftHip RightHip; upper: Chest Head; base lower)
        """
        if name not in PRESETS:
            raise ValueError(f"preset must be one of {', '.join(PRESETS)}, got {name!r}")
        wanted = PRESETS[name]
        assigned = _assign(skeleton, wanted)
        found: dict[str, list[int]] = {group: [] for group in wanted}
        for joint, group in enumerate(assigned):
            found[group].append(joint)
        _check_parts(name, skeleton, found)
        count = {own: skeleton.names.count(own) for own in skeleton.names}
        entries = {
            group: tuple(
                skeleton.names[joint]
                if count[skeleton.names[joint]] == 1 and _is_text(skeleton.names[joint])
                else joint
                for joint in joints
            )
            for group, joints in found.items()
        }
        return cls(entries, base="lower")

    def resolve(self, skeleton: Skeleton) -> dict[str, IntArray]:
        """Return the joints of each group.

        Parameters
        ----------
        skeleton : Skeleton
            What to look the entries up in.

        Returns
        -------
        dict of str to ndarray of int
            Indices of joints, ascending; the groups in their order. A joint that is divided is
            in all groups that hold a channel of it; see `held`.

        Raises
        ------
        ValueError
            If an entry fits no joint, groups overlap, or a joint or channel is in no group;
            names them.
        """
        shares = self._shares(skeleton)
        return {
            name: np.array(sorted({joint for joint, _ in own}), dtype=np.int64)
            for name, own in shares.items()
        }

    def held(self, skeleton: Skeleton) -> dict[str, dict[int, str]]:
        """Return what each group holds of joints that are divided between groups.

        Parameters
        ----------
        skeleton : Skeleton
            What to look the entries up in.

        Returns
        -------
        dict of str to dict of int to str
            For each group and divided joint the axes of its channels, in the file's order.

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
        >>> groups.held(skeleton)
        {'lower': {1: 'ZX'}, 'roll': {1: 'Y'}}
        """
        found: dict[str, dict[int, str]] = {}
        for name, own in self._shares(skeleton).items():
            axes: dict[int, str] = {}
            for joint, axis in sorted(own):
                if axis:
                    axes[joint] = axes.get(joint, "") + axis
            found[name] = {
                joint: "".join(axis for axis in order if axis in own_axes)
                for joint, own_axes in axes.items()
                if set(order := skeleton.rotation_order(joint)) != set(own_axes)
            }
        return found

    def _shares(self, skeleton: Skeleton) -> dict[str, set[tuple[int, str]]]:
        """Return what each group holds: a joint and no axis, or a joint and one of its axes."""
        owner: dict[tuple[int, str], str] = {}
        shares: dict[str, set[tuple[int, str]]] = {}
        for name, entries in self.groups.items():
            own: set[tuple[int, str]] = set()
            for entry in entries:
                own |= _channels(entry, skeleton, name)
            divided = {joint for joint, axis in own if axis}
            for joint in sorted(j for j, axis in own if not axis and j in divided):
                raise ValueError(
                    f"group {name!r} must hold joint {_label(skeleton, joint)} whole or by "
                    "channels, got both"
                )
            for joint, axis in sorted(own):
                for key in [(joint, axis)] if axis else _all_of(joint, skeleton):
                    if key in owner:
                        what = _label(skeleton, joint) + (f".{axis}rotation" if axis else "")
                        raise ValueError(
                            f"joint {what} must be in one group, got {owner[key]!r} and {name!r}"
                        )
                    owner[key] = name
            shares[name] = own
        missing = [
            _label(skeleton, joint) + (f".{axis}rotation" if any(k in owner for k in every) else "")
            for joint in range(skeleton.n_joints)
            for every in [_all_of(joint, skeleton)]
            for _, axis in every
            if (joint, axis) not in owner
        ]
        if missing:
            shown = ", ".join(dict.fromkeys(missing))
            raise ValueError(f"every joint must be in a group, got none for {shown}")
        return shares

    def to_toml(self) -> str:
        """Return the groups as TOML, as `from_toml` reads it.

        Examples
        --------
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
        lines = [f"base = {_quoted(self.base)}", "", "[groups]"]
        for name, entries in self.groups.items():
            lines.append(f"{_quoted(name)} = [")
            for entry in entries:
                if isinstance(entry, Subtree):
                    lines.append(f"    {{subtree = {_quoted(entry.joint)}}},")
                else:
                    lines.append(f"    {_quoted(entry)},")
            lines.append("]")
        return "\n".join(lines) + "\n"

    @classmethod
    def from_toml(cls, source: str | os.PathLike[str]) -> "JointGroups":
        """Read groups from TOML.

        Parameters
        ----------
        source : str or path
            A file, or the text itself: a string of more than one line.

        Returns
        -------
        JointGroups
            As `to_toml` wrote them. ``base`` may be left out: ``"lower"``.

        Raises
        ------
        ValueError
            If it is no TOML, or not of that form; names the file.
        OSError
            If the file cannot be read.
        """
        text, place = str(source), "groups"
        if not isinstance(source, str) or "\n" not in source:
            place = str(source)
            try:
                text = Path(source).read_text(encoding="utf-8")
            except UnicodeDecodeError as error:
                raise ValueError(f"{place}: no UTF-8: {error}") from error
        try:
            table = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise ValueError(f"{place}: no TOML: {error}") from error
        unknown = sorted(set(table) - {"base", "groups"})
        if unknown or not isinstance(table.get("groups"), dict):
            got = ", ".join(table) or "nothing"
            raise ValueError(f"{place}: must hold base and a table [groups], got {got}")
        groups = {}
        for name, entries in table["groups"].items():
            if not isinstance(entries, list):
                raise ValueError(f"{place}: group {name!r} must be a list, got {entries!r}")
            groups[name] = tuple(_read_entry(place, name, entry) for entry in entries)
        try:
            return cls(groups, base=table.get("base", "lower"))
        except (TypeError, ValueError) as error:
            raise ValueError(f"{place}: {error}") from error


def _assign(skeleton: Skeleton, wanted: tuple[str, ...]) -> list[str]:
    """Return the group of each joint by its part; other joints go with their parent."""
    known = anatomy(skeleton)
    torso = "torso" if "torso" in wanted else "upper"
    head = "head" if "head" in wanted else torso
    arms = dict.fromkeys(("left", "right", ""), "arms" if "arms" in wanted else torso)
    if "larm" in wanted:
        arms |= {"left": "larm", "right": "rarm"}
    groups: list[str] = []
    for joint, (part, side) in enumerate(zip(known.parts, known.sides, strict=True)):
        parent = int(skeleton.parents[joint])
        if part in ARM:
            group = arms[side]
        elif part in ("neck", "head"):
            group = head
        elif part == "trunk":
            group = torso
        elif part in ("tail", "other") and parent >= 0:
            group = groups[parent]
        else:
            group = "lower"
        groups.append(group)
    return groups


def _check_parts(preset: str, skeleton: Skeleton, found: Mapping[str, list[int]]) -> None:
    """Refuse a preset that wants parts of the body which a skeleton has not."""
    known = anatomy(skeleton)
    missing = [] if known.joints("thigh", "shank", "foot") else ["legs"]
    needs = {
        "upper": "upper body",
        "torso": "torso",
        "head": "neck or head",
        "arms": "arms",
        "larm": "left arm",
        "rarm": "right arm",
    }
    missing += [what for group, what in needs.items() if group in found and not found[group]]
    if missing:
        shown = ", ".join(skeleton.names[:12]) + (", ..." if skeleton.n_joints > 12 else "")
        raise ValueError(
            f"preset {preset!r} needs a body with {' and '.join(missing)}, found none "
            f"among the joints {shown}; give JointGroups of your own"
        )


def _all_of(joint: int, skeleton: Skeleton) -> list[tuple[int, str]]:
    """Return a joint's channels; of one that cannot be divided a single entry."""
    order = skeleton.rotation_order(joint)
    return [(joint, axis) for axis in order] if len(order) == 3 else [(joint, "")]


def _channels(entry: Entry, skeleton: Skeleton, group: str) -> set[tuple[int, str]]:
    """Return what an entry of a group means: joints without an axis, or with one."""
    found = re.fullmatch(r"(.+)\.([XYZ])rotation", entry) if isinstance(entry, str) else None
    if found is None or entry in skeleton.names:
        return {(joint, "") for joint in _joints(entry, skeleton, group)}
    joints = _joints(found[1], skeleton, group)
    for joint in sorted(joints):
        if (joint, found[2]) not in _all_of(joint, skeleton):
            raise ValueError(
                f"group {group!r}: {_label(skeleton, joint)} must have three rotation channels "
                f"to be divided, got {' '.join(skeleton.channels[joint]) or 'none'}"
            )
        if skeleton.parents[joint] < 0:
            raise ValueError(
                f"group {group!r}: {_label(skeleton, joint)} must be held whole: the root is "
                "turned and shifted as one"
            )
    return {(joint, found[2]) for joint in joints}


def _joints(entry: Entry, skeleton: Skeleton, group: str) -> set[int]:
    """Return the joints that an entry of a group means."""
    if isinstance(entry, Subtree):
        inside = _joints(entry.joint, skeleton, group)
        for joint, parent in enumerate(skeleton.parents):
            if int(parent) in inside:
                inside.add(joint)
        return inside
    if isinstance(entry, int):
        if not 0 <= entry < skeleton.n_joints:
            raise ValueError(
                f"group {group!r}: index must be 0 to {skeleton.n_joints - 1}, got {entry}"
            )
        return {entry}
    names = skeleton.names
    found = {joint for joint, own in enumerate(names) if own == entry}
    found = found or {joint for joint, own in enumerate(names) if fnmatchcase(own, entry)}
    if not found:
        close = difflib.get_close_matches(entry, names, n=3)
        hint = f"did you mean {' or '.join(map(repr, close))}?" if close else "joints are "
        hint += "" if close else ", ".join(names)
        raise ValueError(f"group {group!r}: no joint is named {entry!r}; {hint}")
    return found


def _label(skeleton: Skeleton, joint: int) -> str:
    """Return a joint's name, with its index where the name is not its alone."""
    name = skeleton.names[joint]
    return name if skeleton.names.count(name) == 1 else f"{name} (index {joint})"


def _is_text(name: str) -> bool:
    """Whether a name can be written to a file; half a surrogate pair cannot."""
    return not any("\ud800" <= letter <= "\udfff" for letter in name)


def _quoted(value: str | int) -> str:
    """Return a value as TOML: its strings are those of JSON, and DEL is escaped as well."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _read_entry(place: str, group: str, entry: object) -> Entry:
    if isinstance(entry, dict) and set(entry) == {"subtree"}:
        entry = entry["subtree"]
        if isinstance(entry, str | int) and not isinstance(entry, bool):
            return subtree(entry)
    elif isinstance(entry, str | int) and not isinstance(entry, bool):
        return entry
    raise ValueError(
        f'{place}: group {group!r} must hold names, indices or {{subtree = "name"}}, got {entry!r}'
    )
