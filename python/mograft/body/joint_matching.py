"""Joints of two skeletons that correspond to each other by anatomy, whatever their names."""

import re
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import IntArray
from mograft.body.anatomy import Anatomy, anatomy
from mograft.body.joint_names import ARM
from mograft.errors import SkeletonMismatchError, join_names
from mograft.motion.skeleton import Skeleton

_LIMB_PARTS = ("thigh", "shank", "foot", "upper_arm", "forearm", "hand")
"""Parts of which at least half of the joints must have a counterpart."""

_FINGERS = ("thumb", "index", "mid", "ring", "pink|little")
"""Patterns of the names of the fingers."""


@dataclass(frozen=True, eq=False)
class JointMatch:
    """The joints of another skeleton that correspond to those of a skeleton."""

    sources: IntArray  # index of the other joint for each joint, or -1, shape (n_joints,)
    absent: tuple[str, ...]  # joints without a counterpart in the other skeleton
    dropped: tuple[str, ...]  # joints of the other skeleton without a counterpart

    def describe(self) -> str:
        """Return one line that lists the joints without a counterpart; "" if there are none."""
        parts = [f"kept at rest: {join_names(self.absent)}"] if self.absent else []
        parts += [f"dropped: {join_names(self.dropped)}"] if self.dropped else []
        return "; ".join(parts)


def match_joints(skeleton: Skeleton, other: Skeleton, name: str = "a skeleton") -> JointMatch:
    """Match the joints of two skeletons by body part, side and order along the limb.

    The joints of a body part form a chain. If the chains of the two skeletons have different
    lengths, their first joints match, their last joints match, and joints between match by relative
    rank. A chain of a single joint matches the last joint of a trunk or neck, and the first joint
    of other parts, which roll joints may follow. Fingers match by finger; joints of the face,
    markers and props by name; ancestors of the hips from the hips upwards. A joint never matches
    one that is not below the match of its own nearest matched ancestor. Raises
    SkeletonMismatchError, which calls the other skeleton `name`, if fewer than half of the joints
    of arms and legs have a counterpart.
    """
    own, other_chains = anatomy(skeleton), _chains(other, anatomy(other))
    sources = np.full(skeleton.n_joints, -1)
    for key, chain in _chains(skeleton, own).items():
        for joint, source in _pair(chain, other_chains.get(key, []), key):
            sources[joint] = source
    _drop_reversed(skeleton, other, sources)
    absent = [skeleton.names[joint] for joint in np.flatnonzero(sources < 0)]
    unused = np.setdiff1d(np.arange(other.n_joints), sources)
    limbs = [joint for joint, part in enumerate(own.parts) if part in _LIMB_PARTS]
    matched = int((sources[limbs] >= 0).sum())
    if not limbs or 2 * matched < len(limbs):
        unmatched = [skeleton.names[joint] for joint in limbs if sources[joint] < 0]
        reason = f"no joints that correspond to {join_names(unmatched) or 'arms or legs'}"
        raise SkeletonMismatchError(f"{name} cannot be matched by anatomy: it has {reason}")
    return JointMatch(sources, tuple(absent), tuple(other.names[joint] for joint in unused))


def _chains(skeleton: Skeleton, known: Anatomy) -> dict[Hashable, list[int]]:
    """Return, for each body part and side, its joints on one path down the hierarchy.

    Each joint of the face and each joint outside the body is a chain of its own.
    """
    above_hips, upper = skeleton.ancestors(known.hips), known.joints(*ARM, "neck", "head")
    carried = {above for joint in upper for above in skeleton.ancestors(joint)}
    chains: dict[Hashable, list[int]] = {"above the hips": list(above_hips), "hips": [known.hips]}
    for joint, (part, side) in enumerate(zip(known.parts, known.sides, strict=True)):
        if joint in above_hips or joint == known.hips:
            continue
        if part == "other" or joint in known.details:
            chains.setdefault(("named", _plain_name(skeleton.names[joint])), [joint])
            continue
        if part == "trunk" and carried and joint not in carried:
            continue  # beside the spine
        finger = _finger(skeleton.names[joint]) if part == "finger" else ""
        chain = chains.setdefault((part, side, finger), [])
        if not chain or chain[-1] in skeleton.ancestors(joint):
            chain.append(joint)
    return chains


def _pair(chain: Sequence[int], other: Sequence[int], key: Hashable) -> list[tuple[int, int]]:
    """Return pairs of corresponding joints of two chains; see `match_joints`."""
    if not chain or not other:
        return []
    if key == "above the hips":
        return list(zip(chain, other, strict=False))
    short, long = sorted((chain, other), key=len)
    if len(short) == 1:
        is_trunk = isinstance(key, tuple) and key[0] in ("trunk", "neck")
        ranks = [len(long) - 1 if is_trunk else 0]
    else:
        ranks = [round(rank * (len(long) - 1) / (len(short) - 1)) for rank in range(len(short))]
    pairs = [(joint, long[rank]) for joint, rank in zip(short, ranks, strict=True)]
    return pairs if chain is short else [(b, a) for a, b in pairs]


def _drop_reversed(skeleton: Skeleton, other: Skeleton, sources: IntArray) -> None:
    """Remove matches whose other joint is not below that of the nearest matched ancestor."""
    for joint in range(skeleton.n_joints):
        above = next((a for a in skeleton.ancestors(joint) if sources[a] >= 0), None)
        source = int(sources[joint])
        if above is not None and source >= 0 and sources[above] not in other.ancestors(source):
            sources[joint] = -1


def _finger(name: str) -> str:
    """Return the pattern of the finger that a name means, or ""."""
    return next((pattern for pattern in _FINGERS if re.search(pattern, name.casefold())), "")


def _plain_name(name: str) -> str:
    """Return a name without namespace, case, separators and the suffix of face joints of SMPL-X."""
    bare = re.split(r"[:|]", name)[-1].casefold().removesuffix("_smplhf")
    return re.sub(r"[\W_]+", "", bare)
