"""Parts of the hierarchy of a skeleton."""

from collections.abc import Iterable, Sequence

import numpy as np

from mograft._util.arrays import BoolArray
from mograft.motion.skeleton import Skeleton


def subtree_mask(skeleton: Skeleton, tops: Iterable[int]) -> BoolArray:
    """Return whether each joint is one of `tops` or below one of them, shape (n_joints,)."""
    is_inside = np.zeros(skeleton.n_joints, dtype=bool)
    is_inside[list(tops)] = True
    for joint, parent in enumerate(skeleton.parents.tolist()):
        is_inside[joint] |= parent >= 0 and is_inside[parent]
    return is_inside


def unbranched_chain(skeleton: Skeleton, first: int) -> list[int]:
    """Return the joints from `first` down to the first leaf or joint with several children."""
    chain = [first]
    while len(skeleton.children[chain[-1]]) == 1:
        chain += skeleton.children[chain[-1]]
    return chain


def highest_of_part(skeleton: Skeleton, parts: Sequence[str], joint: int) -> int:
    """Return the highest joint that is reached from `joint` upwards through joints of its part.

    This skips roll joints. If the parent has another part, the result is `joint` itself.
    """
    while skeleton.parents[joint] >= 0 and parts[skeleton.parents[joint]] == parts[joint]:
        joint = int(skeleton.parents[joint])
    return joint
