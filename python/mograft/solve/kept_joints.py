"""Violations by joints that no donor moves: other donors cannot remove them."""

from collections.abc import Sequence

import numpy as np

from mograft.body.world_poses import Poses
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.search.constraints import Constraint, Violation, find_violations
from mograft.search.pose_constraints import Avoid, Face, KeepOut, Reach
from mograft.solve.search_problem import driven_joints

_KINDS_OF_SINGLE_JOINTS = (Avoid, Face, KeepOut, Reach)
"""Constraints whose errors are those of single joints; others, such as `AvoidSelf`, relate two."""


def find_kept_violations(
    library: Library, base: Motion, groups: Sequence[str], constraints: Sequence[Constraint]
) -> list[Violation]:
    """Return the violations of hard constraints on single joints by joints that no donor moves.

    `groups` are the grafted groups. If one of them contains the root, donors move every joint, and
    the list is empty.
    """
    hard = [own for own in constraints if own.is_hard and isinstance(own, _KINDS_OF_SINGLE_JOINTS)]
    members = {group: library.joints(group) for group in groups}
    if not hard or any(library.root in joints for joints in members.values()):
        return []
    moved = np.any(list(driven_joints(library.skeleton, members).values()), axis=0)
    return find_violations(hard, Poses.from_motion(base), ~moved)
