"""`Skeleton`: joints, their hierarchy, rest offsets and channels."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from mograft._util import arrays
from mograft._util.arrays import BoolArray, FloatArray, IntArray, ReadOnlyArrays
from mograft.errors import SkeletonMismatchError, join_names, suggest_name
from mograft.motion.hinges import Hinges
from mograft.motion.limits import MAX_COORDINATE, check_hierarchy, check_names

CHANNELS = ("Xposition", "Yposition", "Zposition", "Xrotation", "Yrotation", "Zrotation")


def usual_channels(has_position: Iterable[bool]) -> tuple[tuple[str, ...], ...]:
    """Return Z, X and Y rotation as the channels of each joint, after positions if it has any."""
    turns = ("Zrotation", "Xrotation", "Yrotation")
    return tuple((*CHANNELS[:3], *turns) if own else turns for own in has_position)


@dataclass(frozen=True, eq=False)
class EndSite(ReadOnlyArrays):
    """The end of a bone that has no joint, such as a fingertip: an ``End Site`` of BVH.

    Parameters
    ----------
    parent : int
        Index of the parent joint.
    offset : array_like, shape (3,)
        Position relative to the parent joint, in the unit of the file.
    before : int
        Number of child joints of the parent that precede the end site in the file.
    name : str
        The name after ``End Site``, if the file has one.
    """

    parent: int
    offset: FloatArray
    before: int = 0
    name: str = ""

    def __post_init__(self) -> None:
        offset = arrays.as_floats("offset", self.offset, (3,), MAX_COORDINATE).copy()
        arrays.set_fields(self, {"offset": offset})


@dataclass(frozen=True, eq=False)
class Skeleton(ReadOnlyArrays):
    """Joints, their hierarchy, rest offsets and channels.

    Joints are identified by index; names may repeat. Joints are in the order of the file, in which
    every parent precedes its children.

    Parameters
    ----------
    names : sequence of str
        One name per joint.
    parents : array_like of int, shape (n_joints,)
        Index of each joint's parent; -1 at the root.
    offsets : array_like, shape (n_joints, 3)
        Rest position of each joint relative to its parent, in the unit of the file.
    channels : sequence of sequence of str, optional
        The channels of each joint in the order of the file, with names such as ``Xposition`` and
        ``Zrotation``. Default: positions, then Z, X and Y rotation for the root; Z, X and Y
        rotation for the other joints.
    end_sites : sequence of EndSite, optional
        Ends of bones without a joint.
    hinges : Hinges, optional
        The joints of a robot that turn about one axis; see `mograft.formats.read_model`.

    Raises
    ------
    ValueError
        If there is no joint, arguments have different lengths, a parent does not precede its child,
        a channel name is unknown or occurs twice in a joint, the parent of an end site does not
        exist, or there are more than 65,536 joints, 2,048 levels or 65,535 characters in a name.

    Examples
    --------
    >>> skeleton = Skeleton(["Hips", "Spine"], [-1, 0], [[0, 0, 0], [0, 12, 0]])
    >>> skeleton
    Skeleton(2 joints, 9 channels, root Hips)
    """

    names: tuple[str, ...]
    parents: IntArray
    offsets: FloatArray
    channels: tuple[tuple[str, ...], ...] = ()
    end_sites: tuple[EndSite, ...] = ()
    hinges: Hinges | None = None

    def __post_init__(self) -> None:
        names = tuple(self.names)
        n_joints = len(names)
        if not n_joints:
            raise ValueError("`names` must hold at least one joint, got none")
        parents = arrays.as_indices("parents", self.parents, (n_joints,)).copy()
        for joint in np.flatnonzero(parents >= np.arange(n_joints)).tolist():
            label = f"joint {joint} ({names[joint]})"
            raise ValueError(f"the parent of {label} must have a smaller index")
        if parents[0] != -1 or (parents[1:] < 0).any():
            raise ValueError("`parents` must be -1 at joint 0, the root, and nowhere else")
        check_hierarchy(names, parents.tolist())
        check_names(site.name for site in self.end_sites)
        offsets = arrays.as_floats("offsets", self.offsets, (n_joints, 3), MAX_COORDINATE).copy()
        channels = tuple(tuple(names) for names in self.channels) or usual_channels(parents < 0)
        if len(channels) != n_joints:
            expected = f"{n_joints} entries, one per joint"
            raise ValueError(f"`channels` must have {expected}, got {len(channels)}")
        for joint_channels in dict.fromkeys(channels):
            distinct = set(joint_channels)
            if not distinct <= set(CHANNELS) or len(distinct) != len(joint_channels):
                name = names[channels.index(joint_channels)]
                expected = f"different names among {', '.join(CHANNELS)}"
                raise ValueError(f"the channels of {name} must be {expected}, got {joint_channels}")
        for site in self.end_sites:
            if not 0 <= site.parent < n_joints:
                expected = f"the index of a joint, 0 to {n_joints - 1}, got {site.parent}"
                raise ValueError(f"the parent of an end site must be {expected}")
        checked = {"names": names, "parents": parents, "offsets": offsets, "channels": channels}
        arrays.set_fields(self, checked | {"end_sites": tuple(self.end_sites)})

    def __repr__(self) -> str:
        return f"Skeleton({self.n_joints} joints, {self.n_channels} channels, root {self.names[0]})"

    @property
    def n_joints(self) -> int:
        """Number of joints, without end sites."""
        return len(self.names)

    @property
    def n_channels(self) -> int:
        """Number of channels of all joints."""
        return sum(map(len, self.channels))

    @cached_property
    def children(self) -> tuple[tuple[int, ...], ...]:
        """Indices of each joint's child joints, in the order of the file."""
        children: list[list[int]] = [[] for _ in self.names]
        for joint, parent in enumerate(self.parents[1:].tolist(), start=1):
            children[parent].append(joint)
        return tuple(map(tuple, children))

    @cached_property
    def children_and_sites(self) -> "tuple[tuple[int | EndSite, ...], ...]":
        """Child joints (as indices) and end sites of each joint, in the order of the file."""
        ordered: list[tuple[int | EndSite, ...]] = list(self.children)
        sites: dict[int, list[EndSite]] = {}
        for site in self.end_sites:
            sites.setdefault(site.parent, []).append(site)
        for joint, own in sites.items():
            children = self.children[joint]
            # An end site precedes the child of the same rank.
            entries: list[tuple[int, int, int | EndSite]]
            entries = [(rank, 1, child) for rank, child in enumerate(children)]
            entries += [(min(site.before, len(children)), 0, site) for site in own]
            ordered[joint] = tuple(item for *_, item in sorted(entries, key=lambda e: e[:2]))
        return tuple(ordered)

    @cached_property
    def channel_columns(self) -> tuple[range, ...]:
        """Range of the columns of each joint's channels in `Motion.channel_values`."""
        ends = np.cumsum([0, *map(len, self.channels)]).tolist()
        return tuple(range(start, end) for start, end in pairwise(ends))

    @cached_property
    def rotation_columns(self) -> tuple[list[int], ...]:
        """Columns of each joint's rotation channels in `Motion.channel_values`."""
        pairs = zip(self.channel_columns, self.channels, strict=True)
        return tuple(
            [column for column, name in zip(*own, strict=True) if name.endswith("rotation")]
            for own in pairs
        )

    def rotation_order(self, joint: int) -> str:
        """Return the axes of a joint's rotation channels in file order, such as ``"ZXY"``."""
        return "".join(name[0] for name in self.channels[joint] if name.endswith("rotation"))

    def ancestors(self, joint: int) -> list[int]:
        """Return the indices of the ancestors of a joint, from its parent to the root."""
        found = []
        while (joint := int(self.parents[joint])) >= 0:
            found.append(joint)
        return found

    def common_ancestor(self, joints: Sequence[int]) -> int:
        """Return the index of the lowest common ancestor of `joints`; 0 if there are no joints.

        Each joint counts as an ancestor of itself.
        """
        if not joints:
            return 0
        common = [joints[0], *self.ancestors(joints[0])]
        for joint in joints[1:]:
            line = {joint, *self.ancestors(joint)}
            common = [other for other in common if other in line]
        return common[0]

    def index(self, name: str) -> int:
        """Return the index of the joint named `name`.

        Raises ValueError if no joint has the name, or more than one has it.
        """
        found = [joint for joint, known in enumerate(self.names) if known == name]
        if not found:
            hint = suggest_name(name, self.names) or f" in {join_names(self.names)}"
            raise ValueError(f"no joint is named {name!r}{hint}")
        if len(found) > 1:
            raise ValueError(f"expected one joint named {name!r}, got joints {found}")
        return found[0]

    def subtree_mask(self, tops: Iterable[int]) -> BoolArray:
        """Return whether each joint is one of `tops` or below one of them, shape (n_joints,)."""
        is_inside = np.zeros(self.n_joints, dtype=bool)
        is_inside[list(tops)] = True
        for joint, parent in enumerate(self.parents.tolist()):
            is_inside[joint] |= parent >= 0 and is_inside[parent]
        return is_inside

    def rest_positions(self) -> FloatArray:
        """Return the world positions of the joints if no joint is rotated, shape (n_joints, 3)."""
        positions = self.offsets.copy()
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                positions[joint] += positions[parent]
        return positions

    def with_offsets(self, offsets: npt.ArrayLike) -> "Skeleton":
        """Return the skeleton with the given rest offsets, shape (n_joints, 3)."""
        return replace(self, offsets=arrays.as_floats("offsets", offsets, ("n_joints", 3)))

    def has_same_hierarchy(self, other: "Skeleton") -> bool:
        """Return whether another skeleton has the same joint names and parents."""
        return self.names == other.names and np.array_equal(self.parents, other.parents)

    def check_same_hierarchy(self, other: "Skeleton", name: str = "the other skeleton") -> None:
        """Raise SkeletonMismatchError unless another skeleton has the same joint names and parents.

        Offsets and channels may differ. The message lists the joints that differ and calls the
        other skeleton `name`.
        """
        if self.has_same_hierarchy(other):
            return
        missing = [joint for joint in self.names if joint not in other.names]
        extra = [joint for joint in other.names if joint not in self.names]
        if missing or extra:
            parts = [f"lacks {join_names(missing)}"] if missing else []
            parts += [f"also has {join_names(extra)}"] if extra else []
            raise SkeletonMismatchError(f"{name} {' and '.join(parts)}")
        if self.names != other.names:
            ours, theirs = (join_names(one.names) for one in (self, other))
            raise SkeletonMismatchError(f"{name} must have the joints {ours}, got {theirs}")
        joint = int(np.flatnonzero(self.parents != other.parents)[0])
        above = [skeleton.names[skeleton.parents[joint]] for skeleton in (self, other)]
        place = f"the parent of {self.names[joint]} in {name}"
        raise SkeletonMismatchError(f"{place} must be {above[0]}, got {above[1]}")
