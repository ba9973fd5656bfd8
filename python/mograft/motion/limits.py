"""Limits of skeletons and motions, the same for files of all formats, libraries and arrays.

They are far above what any figure needs. They bound the time and memory that reading a file takes.
"""

from collections.abc import Iterable, Sequence

MAX_JOINTS = 1 << 16

MAX_LEVELS = 2_048
"""Joints from the root to the deepest joint, both included."""

MAX_FRAMES = 1 << 24
"""Frames of a motion: 39 hours at 120 frames per second."""

MIN_FRAME_TIME, MAX_FRAME_TIME = 1e-5, 1e3
"""Seconds from one frame to the next."""

MIN_CLIP_FRAME_TIME, MAX_CLIP_FRAME_TIME = 1e-4, 1.0
"""Seconds from one frame to the next in clips that are segmented. The memory of smoothing is
inversely proportional to it."""

MAX_COORDINATE = 1e100
"""In the unit of the file: products of three coordinates are finite."""

MAX_NAME_CHARACTERS = (1 << 16) - 1


def check_joints(n_joints: int) -> None:
    """Raise ValueError if a skeleton has too many joints."""
    _check_maximum(MAX_JOINTS, "joints", n_joints)


def check_levels(n_levels: int) -> None:
    """Raise ValueError if a hierarchy is too deep."""
    _check_maximum(MAX_LEVELS, "levels of joints", n_levels)


def check_frames(n_frames: float) -> None:
    """Raise ValueError if a motion has too many frames."""
    _check_maximum(MAX_FRAMES, "frames", n_frames)


def _check_maximum(maximum: int, name: str, got: float) -> None:
    if got > maximum:
        raise ValueError(f"expected at most {maximum} {name}, got {got:.16g}")


def check_frame_time(seconds: float, name: str = "a frame time") -> None:
    """Raise ValueError if a frame time is out of range; `name` describes it in the message."""
    if not MIN_FRAME_TIME <= seconds <= MAX_FRAME_TIME:
        expected = f"{name} of {MIN_FRAME_TIME:g} to {MAX_FRAME_TIME:g} seconds"
        raise ValueError(f"expected {expected}, got {seconds:.6g}")


def check_hierarchy(names: Sequence[str], parents: Iterable[int]) -> None:
    """Raise ValueError if a skeleton has too many joints or levels, or a name is too long.

    `parents` holds for each joint the index of its parent, which is smaller; -1 at the root.
    """
    check_joints(len(names))
    check_names(names)
    levels: list[int] = []
    for parent in parents:
        levels.append(levels[parent] + 1 if parent >= 0 else 1)
    check_levels(max(levels, default=0))


def check_names(names: Iterable[str]) -> None:
    """Raise ValueError if the name of a joint or of an end site is too long."""
    longest = max(map(len, names), default=0)
    if longest > MAX_NAME_CHARACTERS:
        expected = f"names of at most {MAX_NAME_CHARACTERS} characters"
        raise ValueError(f"expected {expected}, got one of {longest}")
