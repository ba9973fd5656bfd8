"""Names of body parts, and the parts and sides recognised from joint names."""

import re
from collections import Counter
from functools import lru_cache

# Ordered from the trunk outwards: a part of a limb is never the child of a later one.
ARM = ("clavicle", "upper_arm", "forearm", "hand", "finger")
LEG = ("thigh", "shank", "foot", "toe")
PARTS = ("pelvis", "trunk", "neck", "head", *ARM, *LEG, "tail", "other")
OPPOSITE_SIDE = {"left": "right", "right": "left", "": ""}


def _words_of(text: str) -> frozenset[str]:
    """Split a text into words."""
    return frozenset(text.split())


# The first row that contains a word of the name decides: `torso_head` is the head and
# `LeftHandThumb1` a finger. `fore+arm` requires both words. "leg", "shoulder" and "hip" are
# ambiguous; `anatomy` resolves them by the neighbouring joints.
_WORDS_OF_PART = (
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
    ("head", "head skull cranium face jaw eye eyes eyeball eyelid brow ear ears nose mouth lip"),
    ("head", "lips tongue teeth chin cheek hair muzzle snout beak"),
    ("neck", "neck atlas"),
    ("trunk", "spine chest torso abdomen back waist belly stomach thorax rib ribs ribcage"),
    ("trunk", "sternum lumbar breast pectoral pectorals pec"),
    ("pelvis", "hips pelvis buttock sacrum"),
    ("hip", "hip"),
)
# These mean a finger only alone or together with "hand": SpineMid and BrowMid contain one too.
_FINGER_WORDS = _words_of("index middle mid ring pinky pinkie little")
# Rig controls and props: such a joint is not the body part in its name.
_CONTROL_WORDS = _words_of("ik pole target ctrl control prop weapon")
ANIMAL_WORDS = _words_of("paw hoof tail")
_SIDE_OF_WORD = {"left": "left", "l": "left", "right": "right", "r": "right"}
_PHRASES_OF_PART = tuple(
    (part, tuple(frozenset(phrase.split("+")) for phrase in phrases.split()))
    for part, phrases in _WORDS_OF_PART
)
_PART_WORDS = frozenset().union(*(phrase for _, phrases in _PHRASES_OF_PART for phrase in phrases))
# Includes words without a body part that occur in compound names such as `lefttoebase`.
_VOCABULARY = (
    _PART_WORDS
    | _FINGER_WORDS
    | _CONTROL_WORDS
    | ANIMAL_WORDS
    | _words_of("left right upper up base joint roll twist bend in big small tip top end nub root")
)
_VERTEBRA = re.compile(r"([clt])(\d{1,2})")
_CAMEL = re.compile(r"(?<=[^\W\d_A-Z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")


def read_names(names: tuple[str, ...]) -> tuple[list[tuple[str, ...]], list[str]]:
    """Return the known words in each joint name, in lower case, and the side that the name states.

    `names` are all joint names of a skeleton. A side is ``"left"``, ``"right"`` or ``""``.
    """
    prefix = _common_prefix(names)
    read = []
    for name in names:
        words = _words(name)
        if not part_of_words(words) and name.casefold().startswith(prefix):
            words = _words(name[len(prefix) :])
        read.append(words)
    vertebrae = {j: part for j, name in enumerate(names) if (part := _vertebra(name))}
    # `c1` to `c7` are vertebrae only if another name contains a known body part.
    if any(part_of_words(words) for words in read):
        for joint, part in vertebrae.items():
            if not part_of_words(read[joint]):
                read[joint] = (part,)
    sides = []
    for words in read:
        named_sides = {_SIDE_OF_WORD[word] for word in words if word in _SIDE_OF_WORD}
        sides.append(named_sides.pop() if len(named_sides) == 1 else "")
    return read, sides


def _common_prefix(names: tuple[str, ...]) -> str:
    """Return the longest prefix shared by at least 90 % of the names, in lower case."""
    folded = [name.casefold() for name in names]
    prefix = ""
    for length in range(1, min(map(len, folded))):
        start, count = Counter(name[:length] for name in folded).most_common(1)[0]
        if count < 0.9 * len(names):
            break
        prefix = start
    return prefix


def _words(name: str) -> tuple[str, ...]:
    """Return the known words of a name in lower case; ``LThumb1`` gives ``("l", "thumb")``."""
    bare = re.split(r"[:|]", name)[-1]
    found: list[str] = []
    for run in re.findall(r"[^\W\d_]+", bare):
        pieces = [_split(piece.casefold()) for piece in _CAMEL.split(run)]
        # Capitals separate words (rEar), unless they are misplaced (HEad).
        whole = () if all(pieces) else _split(run.casefold())
        found += whole or (word for piece in pieces for word in piece)
    return tuple(found)


@lru_cache(maxsize=4096)
def _split(run: str) -> tuple[str, ...]:
    """Split a run of letters into known words; the first or last letter may be a side.

    The result is empty if this is impossible.
    """
    if run in _SIDE_OF_WORD:
        return (run,)
    if words := _cover(run):
        return words
    if run[0] in _SIDE_OF_WORD and (words := _cover(run[1:])):
        return (run[0], *words)
    if run[-1] in _SIDE_OF_WORD and (words := _cover(run[:-1])):
        return (*words, run[-1])
    return ()


def _cover(text: str) -> tuple[str, ...] | None:
    """Split text into known words, longer words first; None if this is impossible."""
    if not text:
        return ()
    for size in range(len(text), 1, -1):
        if text[:size] in _VOCABULARY:
            rest = _cover(text[size:])
            if rest is not None:
                return (text[:size], *rest)
    return None


def _vertebra(name: str) -> str:
    """Return "neck" or "spine" for the name of a vertebra such as `J_T12`, else ""."""
    for run in re.split(r"[\W_]+", name.casefold()):
        match = _VERTEBRA.fullmatch(run)
        if match:
            letter, number = match[1], int(match[2])
            if 1 <= number <= {"c": 7, "t": 12, "l": 5}[letter]:
                return "neck" if letter == "c" else "spine"
    return ""


@lru_cache(maxsize=4096)
def part_of_words(words: tuple[str, ...]) -> str:
    """Return the body part that the words of a name mean, or "" if they mean none.

    Ambiguous words give "leg", "shoulder" or "hip", which are not body parts.
    """
    known = set(words)
    if known & _CONTROL_WORDS:
        return ""
    parts = (part for part, phrases in _PHRASES_OF_PART if any(own <= known for own in phrases))
    found = next(parts, "")
    if known & _FINGER_WORDS:
        found = {"": "finger", "hand": "finger", "foot": "toe"}.get(found, found)
    if found == "shoulder" and "spine" in known:
        return "trunk"
    return found
