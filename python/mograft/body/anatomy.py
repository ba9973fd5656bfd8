"""What each joint of a skeleton is: known by its name, else by its place."""

import re
from collections import Counter
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, pairwise

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray, IntArray, as_indices
from mograft.motion.skeleton import Skeleton

__all__ = ["ARM", "LEG", "PARTS", "Anatomy", "anatomy", "feature_joints"]

PARTS = (
    "pelvis",
    "trunk",
    "neck",
    "head",
    "clavicle",
    "upper_arm",
    "forearm",
    "hand",
    "finger",
    "thigh",
    "shank",
    "foot",
    "toe",
    "tail",
    "other",
)
# From the body outwards: no part of a limb hangs on one that stands after it.
ARM = ("clavicle", "upper_arm", "forearm", "hand", "finger")
LEG = ("thigh", "shank", "foot", "toe")


def _words_of(text: str) -> frozenset[str]:
    """Return the words of a row of a table."""
    return frozenset(text.split())


# The first row with a word of the name decides, so that of `torso_head` the head is moved, and
# `LeftHandThumb1` is a finger; `fore+arm` means both words. Which part a leg, a shoulder or
# a hip is only its neighbours tell: `_settle`.
_NAMES = (
    ("tail", "tail"),
    ("finger", "thumb finger fingers knuckle metacarpal metacarpals carpal fore+paw front+paw"),
    ("toe", "toe toes ball bale metatarsal metatarsals fore+foot hind+paw back+paw rear+paw"),
    ("hand", "hand wrist palm carpus"),
    ("foot", "foot ankle heel tarsus talus calcaneus"),
    ("forearm", "fore+arm lower+arm low+arm lo+arm elbow radius ulna"),
    ("upper_arm", "arm humerus bicep front+leg fore+leg"),
    ("shank", "lower+leg low+leg lo+leg knee shin shank calf tibia fibula"),
    ("thigh", "upper+leg up+leg thigh femur"),
    ("clavicle", "clavicle collar scapula"),
    ("leg", "leg"),
    ("shoulder", "shoulder shldr"),
    (
        "head",
        "head skull cranium face jaw eye eyes eyeball eyelid brow ear ears nose mouth lip lips"
        " tongue teeth chin cheek hair muzzle snout beak",
    ),
    ("neck", "neck atlas"),
    (
        "trunk",
        "spine chest torso abdomen back waist belly stomach thorax rib ribs ribcage sternum"
        " lumbar breast pectoral pectorals pec",
    ),
    ("pelvis", "hips pelvis buttock sacrum"),
    ("hip", "hip"),
)
# These are fingers only beside a hand or alone: there is also SpineMid and BrowMid.
_FINGERS = _words_of("index middle mid ring pinky pinkie little")
# Handles of an animator: such a joint is not the part that it is named after.
_HANDLES = _words_of("ik pole target ctrl control prop weapon")
_ANIMAL = _words_of("paw hoof tail")
_SIDES = {"left": "left", "l": "left", "right": "right", "r": "right"}
_ROWS = tuple(
    (part, tuple(frozenset(phrase.split("+")) for phrase in phrases.split()))
    for part, phrases in _NAMES
)
_KNOWN = frozenset().union(*(phrase for _, phrases in _ROWS for phrase in phrases))
# Words that tell nothing alone but may be run together with others: `lefttoebase`.
_VOCABULARY = (
    _KNOWN
    | _FINGERS
    | _HANDLES
    | _ANIMAL
    | _words_of("left right upper up base joint roll twist bend in big small tip top end nub root")
)
_VERTEBRA = re.compile(r"([clt])(\d{1,2})")
_CAMEL = re.compile(r"(?<=[^\W\d_A-Z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")


@dataclass(frozen=True)
class Anatomy:
    """What each joint of a skeleton is.

    Parameters
    ----------
    parts : tuple of str
        One of `PARTS` per joint: what the joint moves, so that an elbow is ``"forearm"`` and
        a knee ``"shank"``. ``"pelvis"`` is every joint that the legs hang on; ``"other"`` is
        what stands above the hips and moves the body only as a whole.
    sides : tuple of str
        ``"left"``, ``"right"`` or ``""`` per joint.
    hips : int
        The joint that all parts of the body hang on; the root, or below dummies.
    unmatched : tuple of int
        Joints known only from their place.
    details : tuple of int
        Joints that are no part of their own: on the face, markers, ends of bones.
    scheme : str
        ``"names"``, or ``"structure"`` where the names tell no arms or no legs and symmetry
        had to.
    human : bool
        Whether the names are those of a human body: two legs below hips, no tail nor paws.
    """

    parts: tuple[str, ...]
    sides: tuple[str, ...]
    hips: int
    unmatched: tuple[int, ...]
    details: tuple[int, ...]
    scheme: str
    human: bool

    def joints(self, *parts: str, side: str | None = None) -> list[int]:
        """Return the joints of any of these parts, of one side or of all."""
        unknown = set(parts) - set(PARTS)
        if unknown:
            raise ValueError(f"parts must be of {', '.join(PARTS)}, got {sorted(unknown)}")
        return [
            joint
            for joint, (part, own) in enumerate(zip(self.parts, self.sides, strict=True))
            if part in parts and side in (None, own)
        ]


def anatomy(skeleton: Skeleton) -> Anatomy:
    """Recognise what each joint of a skeleton is.

    Names decide where they are known: namespace, case, separators and a prefix that nearly
    all names share do not matter, nor does the scheme (MotionBuilder, Mixamo, 3ds Max Biped,
    CMU, Biovision, Poser and Daz, MakeHuman, Unreal, SMPL and more). The hierarchy decides
    between two readings of a name: ``LeftShoulder`` with an elbow below is the upper arm, with
    an arm below the clavicle. A joint of unknown name is of the part that it hangs on. Where
    the names tell no legs or no arms, symmetry does: of the limbs that come in mirrored pairs,
    the legs hang nearest to the root.

    Parameters
    ----------
    skeleton : Skeleton
        Human or animal.

    Returns
    -------
    Anatomy
        Part and side of each joint, in its order.

    Notes
    -----
    Sides that no name tells are taken from the rest pose: forward is where the feet point,
    or, where they point nowhere, such that left is the positive axis.

    Examples
    --------
    >>> skeleton = Skeleton(
    ...     ["Hips", "LeftHip", "LeftKnee", "LeftAnkle", "Chest", "Neck"],
    ...     [-1, 0, 1, 2, 0, 4],
    ...     [[0, 0, 0], [9, 0, 0], [0, -42, 0], [0, -41, 0], [0, 20, 0], [0, 25, 0]],
    ... )
    >>> anatomy(skeleton).parts
    ('pelvis', 'thigh', 'shank', 'foot', 'trunk', 'neck')
    """
    words, sides = _read_names(skeleton.names)
    named = _settle(skeleton, [_part_of(own) for own in words], words, sides)
    legs = any(part in LEG for part in named)
    arms = any(part in ARM for part in named)
    guess, guessed_sides = [""] * skeleton.n_joints, [""] * skeleton.n_joints
    if not (legs and arms):
        guess, guessed_sides = _structure(skeleton)
        if any(named):  # then only the limbs that the names do not tell
            wanted = (() if legs else LEG) + (() if arms else ARM)
            guess = [part if part in wanted else "" for part in guess]
    elif any(part in ARM + LEG and not side for part, side in zip(named, sides, strict=True)):
        guessed_sides = _structure(skeleton)[1]
    agree = sum(
        (1 if own == other else -1)
        for own, other in zip(sides, guessed_sides, strict=True)
        if own and other
    )
    if agree < 0:  # a side that is named tells the others
        opposite = {"left": "right", "right": "left", "": ""}
        guessed_sides = [opposite[side] for side in guessed_sides]
    known = [own or other for own, other in zip(named, guess, strict=True)]
    hips = _common_ancestor(skeleton, [joint for joint, part in enumerate(known) if part])
    parts = _fill(skeleton, known, hips)
    full_sides: list[str] = []
    for joint, parent in enumerate(skeleton.parents):
        side = sides[joint] or guessed_sides[joint]
        above = full_sides[parent] if parent >= 0 else ""
        full_sides.append(side or (above if parts[joint] in (*ARM, *LEG, "pelvis") else ""))
    structural = any(not own and other for own, other in zip(named, guess, strict=True))
    two_legs = all(
        any(p == "thigh" and s == side for p, s in zip(parts, full_sides, strict=True))
        for side in ("left", "right")
    )
    animal = any(_ANIMAL & set(own) for own in words) or "tail" in parts
    return Anatomy(
        parts=tuple(parts),
        sides=tuple(full_sides),
        hips=hips,
        unmatched=tuple(joint for joint, part in enumerate(named) if not part),
        details=_details(skeleton, parts),
        scheme="structure" if structural else "names",
        human=two_legs and parts[hips] == "pelvis" and not animal and not structural,
    )


def feature_joints(skeleton: Skeleton, joints: npt.ArrayLike) -> IntArray:
    """Return those joints of a group that tell how it moves.

    Fingers, toes, the face and markers are left out: they are many, move little or follow the
    others, and would outweigh the limbs. They are grafted with their group all the same.

    Parameters
    ----------
    skeleton : Skeleton
        What the joints belong to.
    joints : array_like of int, shape (n,)
        Indices of joints.

    Returns
    -------
    ndarray of int, shape (m,)
        In the same order. All of them if none would remain.

    Examples
    --------
    >>> skeleton = Skeleton(
    ...     ["Hips", "LeftLeg", "LeftFoot", "LeftToeBase"], [-1, 0, 1, 2], [[0, 0, 0]] * 4
    ... )
    >>> feature_joints(skeleton, [1, 2, 3])
    array([1, 2])
    """
    indices = as_indices("joints", joints, ("n",))
    known = anatomy(skeleton)
    fine = {*known.joints("finger", "toe"), *known.details}
    kept = [int(joint) for joint in indices if joint not in fine]
    return np.array(kept, dtype=np.int64) if kept else indices


def _read_names(names: tuple[str, ...]) -> tuple[list[tuple[str, ...]], list[str]]:
    """Return the known words of each name, and the side that it tells."""
    prefix = _common_prefix(names)
    read = []
    for name in names:
        words = _words(name)
        if not _part_of(words) and name.casefold().startswith(prefix):
            words = _words(name[len(prefix) :])
        read.append(words)
    vertebrae = {j: part for j, name in enumerate(names) if (part := _vertebra(name))}
    # `c1` to `c7` alone may be any numbering; beside known names they are vertebrae.
    if any(_part_of(words) for words in read):
        for joint, part in vertebrae.items():
            if not _part_of(read[joint]):
                read[joint] = (part,)
    sides = []
    for words in read:
        told = {_SIDES[word] for word in words if word in _SIDES}
        sides.append(told.pop() if len(told) == 1 else "")
    return read, sides


def _common_prefix(names: tuple[str, ...]) -> str:
    """Return what nearly all names begin with."""
    folded = [name.casefold() for name in names]
    prefix = ""
    for length in range(1, min(map(len, folded))):
        start, count = Counter(name[:length] for name in folded).most_common(1)[0]
        if count < 0.9 * len(names):
            break
        prefix = start
    return prefix


def _words(name: str) -> tuple[str, ...]:
    """Return the known words of a name, whatever its case: `LThumb1` is l thumb."""
    bare = re.split(r"[:|]", name)[-1]
    found: list[str] = []
    for run in re.findall(r"[^\W\d_]+", bare):
        pieces = [_split(piece.casefold()) for piece in _CAMEL.split(run)]
        # Capitals help where they stand right: rEar is no rear, but HEad is a head.
        whole = () if all(pieces) else _split(run.casefold())
        found += whole or (word for piece in pieces for word in piece)
    return tuple(found)


@lru_cache(maxsize=4096)
def _split(run: str) -> tuple[str, ...]:
    """Split a run of letters wholly into known words; a side's letter may be first or last."""
    if run in _SIDES:
        return (run,)
    none: tuple[str, ...] = ()
    options = [(none, run, none)]
    if run[0] in _SIDES:
        options.append(((run[0],), run[1:], none))
    if run[-1] in _SIDES:
        options.append((none, run[:-1], (run[-1],)))
    for first, stem, last in options:
        words = _cover(stem)
        if words:
            return (*first, *words, *last)
    return ()


def _cover(text: str) -> tuple[str, ...] | None:
    """Split text into words of the vocabulary, longer ones first; None if that cannot be."""
    if not text:
        return ()
    for size in range(len(text), 1, -1):
        if text[:size] in _VOCABULARY:
            rest = _cover(text[size:])
            if rest is not None:
                return (text[:size], *rest)
    return None


def _vertebra(name: str) -> str:
    """Return the region of the vertebra that a name as `J_T12` tells, as a word of the table."""
    for run in re.split(r"[\W_]+", name.casefold()):
        match = _VERTEBRA.fullmatch(run)
        if match:
            letter, number = match[1], int(match[2])
            if 1 <= number <= {"c": 7, "t": 12, "l": 5}[letter]:
                return "neck" if letter == "c" else "spine"
    return ""


def _part_of(words: tuple[str, ...]) -> str:
    """Return the part that the words of one name tell, or leg, shoulder, hip, or nothing."""
    own = set(words)
    if own & _HANDLES:
        return ""
    found = next(
        (part for part, phrases in _ROWS if any(phrase <= own for phrase in phrases)),
        "",
    )
    if own & _FINGERS and found in ("", "hand"):
        return "finger"
    if own & _FINGERS and found == "foot":
        return "toe"
    if found == "shoulder" and "spine" in own:
        return "trunk"
    return found


def _settle(
    skeleton: Skeleton, named: list[str], words: list[tuple[str, ...]], sides: list[str]
) -> list[str]:
    """Decide between two readings of a name by what stands above and below it."""
    below: list[set[str]] = [set() for _ in named]
    for joint in range(len(named) - 1, 0, -1):
        parent = skeleton.parents[joint]
        beside = any(skeleton.children[other] for other in skeleton.children[parent])
        if not skeleton.children[joint] and beside:
            continue  # a marker, whatever bone it is named after
        below[parent] |= below[joint] | {named[joint]}
        if sides[joint] and named[joint] == "hip":
            below[parent].add("thigh")
    settled = list(named)
    for joint, part in enumerate(named):
        parent = int(skeleton.parents[joint])
        nearest = next((other for other in _ancestors(skeleton, joint) if settled[other]), joint)
        above = settled[nearest]
        if part == "hip":
            # LHipJoint with a thigh below only holds it; LeftHip with a knee below is it.
            on_pelvis = not sides[joint] or "thigh" in below[joint]
            settled[joint] = "pelvis" if on_pelvis else "thigh"
        elif part == "leg":
            upper = above not in LEG or bool(below[joint] & {"thigh", "shank"})
            settled[joint] = "thigh" if upper else "shank"
        elif part == "shoulder":
            leaf = not skeleton.children[joint]
            settled[joint] = "clavicle" if leaf or "upper_arm" in below[joint] else "upper_arm"
        elif part == "foot" and above == "foot" and "ankle" in words[parent]:
            settled[joint] = "toe"
    if "head" not in settled:
        above_arms = _above_arms(skeleton, settled)
        for joint in above_arms:
            settled[joint] = "neck"
        # A neck alone may be all that is known of the head, but of two one carries it.
        if settled.count("neck") > 1:
            settled[max(joint for joint, part in enumerate(settled) if part == "neck")] = "head"
    return settled


def _above_arms(skeleton: Skeleton, settled: list[str]) -> list[int]:
    """Return the joints of a spine that goes on beyond the arms and is nowhere called neck."""
    arms = [joint for joint, part in enumerate(settled) if part in ARM]
    if not arms or "neck" in settled:
        return []
    chest = _common_ancestor(skeleton, arms)
    for child in skeleton.children[chest]:
        chain = [child]
        while len(skeleton.children[chain[-1]]) == 1:
            chain += skeleton.children[chain[-1]]
        if len(chain) > 1 and all(settled[joint] == "trunk" for joint in chain):
            return chain
    return []


def _fill(skeleton: Skeleton, known: list[str], hips: int) -> list[str]:
    """Give every joint a part: its own where it fits its place, else that of its parent."""
    carries = set()
    for joint, part in enumerate(known):
        if part in LEG:
            carries |= set(_ancestors(skeleton, joint))
    above_hips = set(_ancestors(skeleton, hips))
    parts: list[str] = []
    for joint, parent in enumerate(skeleton.parents):
        own = known[joint]
        above = parts[parent] if parent >= 0 else ""
        if joint in above_hips:
            part = "other"
        elif joint == hips and not own:
            part = "pelvis"
        elif joint in carries and own not in LEG:
            # Whatever its name: what the legs hang on moves them, and belongs to them.
            part = above if above in LEG else "pelvis"
        elif above in ("head", "finger", "toe"):
            part = above
        elif own:
            # No head on a leg, no forearm on a hand: such names are of markers.
            misplaced = own in ("neck", "head") and above in ARM + LEG
            part = above if misplaced or _comes_before(own, above) else own
        else:
            part = {"hand": "finger", "foot": "toe"}.get(above, above)
        parts.append(part)
    return parts


def _comes_before(part: str, above: str) -> bool:
    """Whether a part of a limb stands nearer to the body than the one that it hangs on."""
    return any(
        part in limb and above in limb and limb.index(part) < limb.index(above)
        for limb in (ARM, LEG)
    )


def _details(skeleton: Skeleton, parts: list[str]) -> tuple[int, ...]:
    """Return joints on the face, and leaves beside the joint that carries their part on."""
    found = []
    for joint, parent in enumerate(skeleton.parents):
        if parent < 0 or parts[joint] != parts[parent]:
            continue
        beside = len(skeleton.children[parent]) > 1 and not skeleton.children[joint]
        if parts[joint] == "head" or (beside and parts[joint] not in ("finger", "toe", "tail")):
            found.append(joint)
    return tuple(found)


def _ancestors(skeleton: Skeleton, joint: int) -> list[int]:
    """Return the joints above one, nearest first."""
    found = []
    parent = int(skeleton.parents[joint])
    while parent >= 0:
        found.append(parent)
        parent = int(skeleton.parents[parent])
    return found


def _common_ancestor(skeleton: Skeleton, joints: list[int]) -> int:
    """Return the lowest joint that all these hang on or are; the root if there are none."""
    if not joints:
        return 0
    common = [joints[0], *_ancestors(skeleton, joints[0])]
    for joint in joints[1:]:
        line = {joint, *_ancestors(skeleton, joint)}
        common = [other for other in common if other in line]
    return common[0]


# Recognition by structure: limbs come in mirrored pairs.


def _structure(skeleton: Skeleton) -> tuple[list[str], list[str]]:
    """Return a part per joint, nothing where the parent tells it, and a side per joint."""
    n_joints = skeleton.n_joints
    parts, sides = [""] * n_joints, [""] * n_joints
    shape = _Shape.of(skeleton)
    pairs, axis = _mirrored(skeleton, shape)
    longest = max((shape.length(a) for a, _ in pairs), default=0.0)
    # Eyes and breasts are pairs as well, but short ones.
    limbs = [(a, b) for a, b in pairs if shape.length(a) >= 0.4 * longest]
    limbs.sort(key=lambda pair: (shape.depth[pair[0]], -shape.length(pair[0]), pair))
    legs = limbs[0] if limbs else None
    arms = max(limbs[1:], key=lambda pair: shape.length(pair[0]), default=None)
    hips = int(skeleton.parents[legs[0]]) if legs else 0
    for joint, part in _spine(skeleton, shape, axis, legs, arms):
        parts[joint] = part
    for pair, roles, connector in ((legs, LEG, "pelvis"), (arms, ARM[1:], "clavicle")):
        for first in pair or ():
            for joint, part in _limb(shape, shape.chain(first), roles, connector):
                parts[joint] = part
    parts[hips] = "pelvis"
    left = _leftward(shape, legs)
    for a, b in pairs:
        apart = shape.middle[a] - shape.middle[b]
        a_is_left = (float(apart @ left) if left is not None else _largest(apart)) >= 0
        for joint in shape.below[a]:
            sides[joint] = "left" if a_is_left else "right"
        for joint in shape.below[b]:
            sides[joint] = "right" if a_is_left else "left"
    return parts, sides


@dataclass(frozen=True)
class _Shape:
    """Sizes of all subtrees of a skeleton."""

    skeleton: Skeleton
    places: FloatArray  # in the rest pose
    depth: list[int]
    below: list[list[int]]  # the joint itself and all that hang on it
    middle: FloatArray  # mean rest place of a subtree's joints
    reach: FloatArray  # longest way down along the bones
    tips: FloatArray  # length of the longest end site

    @classmethod
    def of(cls, skeleton: Skeleton) -> "_Shape":
        places = skeleton.rest_positions()
        lengths = np.linalg.norm(skeleton.offsets, axis=1)
        depth = [0] * skeleton.n_joints
        below: list[list[int]] = [[joint] for joint in range(skeleton.n_joints)]
        reach, tips = np.zeros(skeleton.n_joints), np.zeros(skeleton.n_joints)
        for site in skeleton.end_sites:
            tips[site.parent] = max(tips[site.parent], float(np.linalg.norm(site.offset)))
        for joint in range(skeleton.n_joints - 1, 0, -1):
            parent = skeleton.parents[joint]
            below[parent] += below[joint]
            reach[parent] = max(reach[parent], lengths[joint] + reach[joint])
        for joint in range(1, skeleton.n_joints):
            depth[joint] = depth[skeleton.parents[joint]] + 1
        middle = np.array([places[joints].mean(axis=0) for joints in below])
        return cls(skeleton, places, depth, below, middle, reach, tips)

    def length(self, joint: int) -> float:
        """Return how far a limb reaches from the joint that it hangs on."""
        return float(np.linalg.norm(self.skeleton.offsets[joint]) + self.reach[joint])

    def chain(self, joint: int) -> list[int]:
        """Return the joints of the longest way down."""
        found = [joint]
        while self.skeleton.children[found[-1]]:
            found.append(max(self.skeleton.children[found[-1]], key=self.length))
        return found

    def bone(self, chain: list[int], place: int) -> float:
        """Return the length of the bone below one joint of a chain."""
        if place + 1 < len(chain):
            return float(np.linalg.norm(self.skeleton.offsets[chain[place + 1]]))
        return float(self.tips[chain[place]])


def _mirrored(skeleton: Skeleton, shape: _Shape) -> tuple[list[tuple[int, int]], list[int]]:
    """Return the pairs of limbs that mirror each other, and the joints between them."""
    pairs: list[tuple[int, int]] = []
    axis = [0]
    for joint in axis:  # grows while it is read
        children = list(skeleton.children[joint])
        scores = sorted(
            (score, a, b)
            for a, b in combinations(children, 2)
            if (score := _unlikeness(shape, joint, a, b)) < 0.5
        )
        for _, a, b in scores:
            if a in children and b in children:
                pairs.append((a, b))
                children = [child for child in children if child not in (a, b)]
        axis += children
    return pairs, axis


def _unlikeness(shape: _Shape, joint: int, a: int, b: int) -> float:
    """Return how far two subtrees are from mirroring each other; 0 if they do."""
    sizes = len(shape.below[a]), len(shape.below[b])
    lengths = shape.length(a), shape.length(b)
    longer = max(lengths)
    score = abs(sizes[0] - sizes[1]) / max(sizes)
    if longer > 0:
        score += abs(lengths[0] - lengths[1]) / longer
        place = shape.places[joint]
        away = [float(np.linalg.norm(shape.middle[child] - place)) for child in (a, b)]
        score += abs(away[0] - away[1]) / longer
        if np.linalg.norm(shape.middle[a] - shape.middle[b]) < 0.02 * longer:
            score += 0.2  # one upon the other: odd, but in some files so are the legs
    return score


def _limb(
    shape: _Shape, chain: list[int], roles: tuple[str, ...], connector: str
) -> list[tuple[int, str]]:
    """Name the joints of a limb by which of its bones are the upper and the lower one."""
    start, upper, lower = _long_bones(shape, chain, roles)
    found = []
    for place, joint in enumerate(chain):
        if place < start:
            part = connector
        elif place <= upper:
            part = roles[0]
        elif place <= lower:
            part = roles[1]
        else:
            part = roles[2 if place == lower + 1 else 3]
        found.append((joint, part))
    return found


def _long_bones(shape: _Shape, chain: list[int], roles: tuple[str, ...]) -> tuple[int, int, int]:
    """Return where in a limb the upper part starts, and the joints of upper and lower bone."""
    lengths = [shape.bone(chain, place) for place in range(len(chain))]
    longest = max(lengths)
    # A joint without a bone of its own, as before a roll, belongs to the next one that has.
    bones = [place for place, length in enumerate(lengths) if length > 0.02 * longest]
    if longest == 0 or len(bones) < 2:
        return 0, 0, 1
    # The two stand in a row and are the longest such; but a collar may be as long as a
    # forearm and, in odd files, a foot as long as a thigh.
    pairs = [(lengths[a] + lengths[b], a, b) for a, b in pairwise(bones)]
    most = max(pairs)[0]
    if roles is LEG:
        upper, lower = next((a, b) for length, a, b in pairs if length >= 0.85 * most)
    else:
        upper, lower = next((a, b) for length, a, b in reversed(pairs) if length >= 0.9 * most)
    before = [place for place in bones if place < upper]
    return (before[-1] + 1 if before else 0), upper, lower


def _spine(
    skeleton: Skeleton,
    shape: _Shape,
    axis: list[int],
    legs: tuple[int, int] | None,
    arms: tuple[int, int] | None,
) -> list[tuple[int, str]]:
    """Name the joints between the limbs: trunk up to the arms, then neck and head, and a tail."""
    hips = int(skeleton.parents[legs[0]]) if legs else 0
    between = [child for child in axis if skeleton.parents[child] == hips]
    found: list[tuple[int, str]] = []
    if arms is None:
        spine = max(between, key=shape.length, default=None)
        chain = _unbranched(shape, spine)
        found += [(joint, "trunk") for joint in chain[:-1]]
        # Without a single limb the end of a chain may be anything.
        head = "head" if legs and len(chain) > 1 else "trunk"
        found += [(joint, head) for joint in chain[-1:]]
    else:
        chest = int(skeleton.parents[arms[0]])
        line = [chest, *_ancestors(skeleton, chest)]
        core = _common_ancestor(skeleton, [chest, hips])
        spine = next((child for child in between if child in line), None)
        found += [(joint, "trunk") for joint in line[: line.index(core)]]
        upward = [child for child in axis if skeleton.parents[child] == chest]
        if chest != core:
            chain = _unbranched(shape, max(upward, key=shape.length, default=None))
            found += [(joint, "neck") for joint in chain[:-1]]
            found += [(joint, "head") for joint in chain[-1:]]
    for child in between:
        if child != spine and len(shape.below[child]) > 1 and arms is not None:
            found += [(joint, "tail") for joint in shape.below[child]]
    return found


def _unbranched(shape: _Shape, first: int | None) -> list[int]:
    """Return the joints from one downwards as far as no second one hangs beside them."""
    if first is None:
        return []
    chain = [first]
    while len(shape.skeleton.children[chain[-1]]) == 1:
        chain += shape.skeleton.children[chain[-1]]
    return chain


def _leftward(shape: _Shape, legs: tuple[int, int] | None) -> FloatArray | None:
    """Return the direction to the body's left, by where its feet point; None if nowhere."""
    up, forward = np.zeros(3), np.zeros(3)
    for first in legs or ():
        chain = shape.chain(first)
        ankle = min(_long_bones(shape, chain, LEG)[2] + 1, len(chain) - 1)
        places = shape.places[chain]
        up += places[0] - places[ankle]
        ends = [s.offset for s in shape.skeleton.end_sites if s.parent == chain[-1]]
        tip = places[-1] + (ends[0] if ends else 0.0)
        forward += tip - places[ankle]
    height = float(np.linalg.norm(up))
    if not height:
        return None
    forward -= (forward @ up) / height**2 * up
    return np.cross(up, forward) if np.linalg.norm(forward) > 0.05 * height else None


def _largest(vector: FloatArray) -> float:
    """Return the component of largest size."""
    return float(vector[np.argmax(np.abs(vector))])
