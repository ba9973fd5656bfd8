"""What looks wrong in a motion."""

from dataclasses import dataclass

from mograft.motion import Motion

__all__ = ["Fault", "find_faults"]


@dataclass(frozen=True)
class Fault:
    """Something that looks wrong."""

    frames: tuple[int, int]
    message: str
    spoils: bool


def find_faults(motion: Motion) -> tuple[Fault, ...]:
    """Return what looks wrong in a motion; nothing is looked for yet."""
    del motion
    return ()
