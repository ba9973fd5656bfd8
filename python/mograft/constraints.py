"""Constraints on grafts, and the obstacles that they name.

`graft`, `graft_many`, `repair`, `edit` and `candidates` take them as ``constraints`` or edits.
"""

from mograft.search.constraints import Constraint, Violation
from mograft.search.donor_constraints import (
    Ban,
    KeepOriginal,
    MaxAngle,
    MaxStretch,
    NotFrom,
    OnlyFrom,
    Use,
)
from mograft.search.figure_position import FigurePosition
from mograft.search.obstacles import Box, Capsule, Character, HalfSpace, Sphere
from mograft.search.pose_constraints import Avoid, AvoidSelf, Custom, Face, KeepOut, Reach

__all__ = [
    "Avoid",
    "AvoidSelf",
    "Ban",
    "Box",
    "Capsule",
    "Character",
    "Constraint",
    "Custom",
    "Face",
    "FigurePosition",
    "HalfSpace",
    "KeepOriginal",
    "KeepOut",
    "MaxAngle",
    "MaxStretch",
    "NotFrom",
    "OnlyFrom",
    "Reach",
    "Sphere",
    "Use",
    "Violation",
]
