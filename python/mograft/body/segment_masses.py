"""Segment masses of a human after de Leva (1996), and uniform rods for other skeletons."""

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray
from mograft.body.anatomy import Anatomy

# de Leva 1996, with hips and neck as the proximal ends of trunk and head. Mass in % of body mass,
# then centre of mass from the proximal end and transverse radius of gyration, both in % of
# segment length; each (male, female).
_DE_LEVA = {
    "head": ((6.94, 6.68), (50.0, 51.6), (31.5, 29.5)),
    "trunk": ((43.46, 42.57), (48.6, 50.4), (30.6, 29.2)),
    "upper_arm": ((2.71, 2.55), (57.7, 57.5), (26.9, 26.0)),
    "forearm": ((1.62, 1.38), (45.7, 45.6), (26.5, 25.7)),
    "hand": ((0.61, 0.56), (36.2, 34.3), (23.5, 20.8)),
    "thigh": ((14.16, 14.78), (41.0, 36.1), (32.9, 36.4)),
    "shank": ((4.33, 4.81), (44.0, 43.5), (24.6, 26.3)),
    "foot": ((1.37, 1.29), (44.2, 40.1), (24.5, 27.9)),
}
# The segment to which the mass of a segment without joints is added.
_FALLBACK_SEGMENT = {
    "head": "trunk",
    "hand": "forearm",
    "forearm": "upper_arm",
    "upper_arm": "trunk",
    "foot": "shank",
    "shank": "thigh",
    "thigh": "trunk",
}
_SEGMENT_OF_PART = {
    "pelvis": "trunk",
    "clavicle": "trunk",
    "tail": "trunk",
    "neck": "head",
    "finger": "hand",
    "toe": "foot",
}
# Uniform rod about its middle: radius of gyration 1 / sqrt(12).
_ROD_CENTER, _ROD_GYRATION = 0.5, 0.289
# Columns of the table that are averaged.
COLUMNS_OF_SEX = {"male": [0], "female": [1], "mean": [0, 1]}


def rod_masses(
    lengths: FloatArray, has_mass: BoolArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mass, centre of mass and radius of gyration of each bone as a uniform rod.

    Masses are proportional to the lengths and sum to 1; if all lengths are 0, they are equal.
    Joints without `has_mass` have mass 0. Centres, from the joint, and radii are in bone lengths.
    """
    weights = np.where(has_mass, lengths, 0.0)
    total = float(weights.sum())
    mass = weights / total if total > 0 else has_mass / max(int(has_mass.sum()), 1)
    return mass, np.full(len(lengths), _ROD_CENTER), np.full(len(lengths), _ROD_GYRATION)


def de_leva_masses(
    known: Anatomy, lengths: FloatArray, has_mass: BoolArray, columns: list[int]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mass, centre of mass and radius of gyration of each bone from de Leva's table.

    The arrays have the form of those that `rod_masses` returns. If a body segment has several
    bones, its mass is divided in proportion to their lengths, and their centres and radii are those
    of uniform rods. `columns`, a value of `COLUMNS_OF_SEX`, selects the columns of the table that
    are averaged.
    """
    n_joints = len(lengths)
    members: dict[tuple[str, str], list[int]] = {}
    for joint, (part, side) in enumerate(zip(known.parts, known.sides, strict=True)):
        if has_mass[joint]:
            segment = _SEGMENT_OF_PART.get(part, part)
            is_central = segment in ("head", "trunk")
            members.setdefault((segment, "" if is_central else side), []).append(joint)
    segment_mass = dict.fromkeys(members, 0.0)
    for segment, (mass_percent, _, _) in _DE_LEVA.items():
        for side in ("",) if segment in ("head", "trunk") else ("left", "right"):
            receiver = segment
            while (receiver, "" if receiver == "trunk" else side) not in members:
                receiver = _FALLBACK_SEGMENT[receiver]
            key = (receiver, "" if receiver == "trunk" else side)
            segment_mass[key] += float(np.mean([mass_percent[column] for column in columns]))
    mass = np.zeros(n_joints)
    _, center, gyration = rod_masses(lengths, has_mass)
    for (segment, side), joints in members.items():
        is_member = np.zeros(n_joints, dtype=bool)
        is_member[joints] = True
        mass += segment_mass[segment, side] * rod_masses(lengths, is_member)[0]
        bones = [joint for joint in joints if lengths[joint] > 0]
        if len(bones) == 1:
            _, centers, gyrations = _DE_LEVA[segment]
            center[bones[0]] = np.mean([centers[column] for column in columns]) / 100
            gyration[bones[0]] = np.mean([gyrations[column] for column in columns]) / 100
    return mass / mass.sum(), center, gyration
