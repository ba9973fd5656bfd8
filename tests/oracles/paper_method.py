"""The method of the paper in plain NumPy, written from its description and not from mograft.

The chain up to the sets of donors: energy, boundaries, groups, features, principal components,
complete linkage (that of SciPy), threshold, candidates and gaps. It shares no code with mograft;
rotations, curves and standard steps are those of the other oracles.
One reading was chosen after a comparison: mean rotations are those over the samples of all
segments, not over all frames; with the other, a few pairs of segments change clusters.
"""

import re
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tests.oracles import analysis
from tests.oracles.rotations import inverse, log, multiply, resample, resample_positions

SAMPLES = 10
COMPONENTS = 10
LENGTH_RATIO = 0.15
SIGMA = 2.0 / 30.0
"""Seconds: two frames of a recording at 30 frames per second."""

# Mass, centre of mass from the proximal end and transverse radius of gyration in percent, means of
# men and women (de Leva 1996).
BODY = {
    "head": (6.81, 50.8, 30.5),
    "trunk": (43.015, 49.5, 29.9),
    "upper arm": (2.63, 57.6, 26.45),
    "forearm": (1.5, 45.65, 26.1),
    "hand": (0.585, 35.25, 22.15),
    "thigh": (14.47, 38.55, 34.65),
    "shank": (4.57, 43.75, 25.45),
    "foot": (1.33, 42.15, 26.2),
}
NAMES = {
    "trunk": "hipjoint|hips|^hip$|pelvis|spine|chest|torso|abdomen|collar|clavicle|shoulder|back",
    "forearm": "forearm|lowerarm|elbow",
    "hand": "hand|wrist|finger|thumb|index|middle|ring|pinky",
    "upper arm": "upperarm|arm|shldr",
    "foot": "foot|ankle|toe|ball",
    "thigh": "upleg|upperleg|thigh|femur|hip",
    "shank": "lowerleg|knee|shin|calf|leg",
    "head": "head|neck",
}
LEGS = ("thigh", "shank", "foot")
NOT_COMPARED = re.compile("finger|thumb|index|middle|ring|pinky|toe|ball")


@dataclass(frozen=True, kw_only=True)
class Clip:
    """A recording. The first joint is the root; rotations are local, with the scalar last."""

    names: list[str]
    parents: list[int]
    offsets: np.ndarray  # (J, 3)
    tips: np.ndarray  # (J, 3): offset of the end site of a leaf, else zero
    rotations: np.ndarray  # (F, J, 4)
    positions: np.ndarray  # (F, 3): the root
    rate: float


def part_of(name):
    short = name.split(":")[-1].casefold()
    return next(part for part, pattern in NAMES.items() if re.search(pattern, short))


def side_of(name):
    short = name.split(":")[-1]
    found = re.match("(?i:left|l_)|[lL](?=[A-Z])|((?i:right|r_)|[rR](?=[A-Z]))", short)
    return "" if found is None else "right" if found[1] else "left"


def inertias(clip):
    """Return moments about the proximal joints.

    A part of several joints is rods that share its mass by length.
    """
    count = len(clip.names)
    children = [[c for c in range(count) if clip.parents[c] == j] for j in range(count)]
    below = [1] * count
    for j in reversed(range(1, count)):
        below[clip.parents[j]] += below[j]
    parts = [(part_of(name), side_of(name) * (part_of(name) != "trunk")) for name in clip.names]
    bones = np.zeros((count, 3))
    for j in range(count):
        if not children[j]:
            bones[j] = clip.tips[j]
        elif parts[j][0] == "trunk":
            bones[j] = np.mean([clip.offsets[c] for c in children[j]], axis=0)
        else:
            bones[j] = clip.offsets[max(children[j], key=lambda c: below[c])]
    lengths = np.linalg.norm(bones, axis=1)
    result = np.zeros(count)
    for j in range(count):
        same = [k for k in range(count) if parts[k] == parts[j]]
        mass, centre, radius = BODY[parts[j][0]]
        if len(same) > 1:
            mass, centre, radius = mass * lengths[j] / max(lengths[same].sum(), 1e-300), 50.0, 28.9
        result[j] = mass * lengths[j] ** 2 * (centre**2 + radius**2)
    return result


def boundaries(clip):
    """First and last frame, and the extrema of the smoothed energy; of a plateau, the middle."""
    energy = analysis.kinetic_energy(clip.parents, clip.rotations, inertias(clip), 1.0 / clip.rate)
    curve = gaussian_filter1d(energy, SIGMA * clip.rate)
    return [0, *analysis.turning_points(curve), len(curve) - 1]


def groups(clip):
    """The two groups of the paper: the root and the legs, and the rest."""
    legs = {j for j, name in enumerate(clip.names) if part_of(name) in LEGS}
    lower = sorted({0} | legs | {clip.parents[j] for j in legs})
    return {"lower": lower, "upper": [j for j in range(len(clip.names)) if j not in lower]}


def features(clips, segments, joints):
    """Return for each segment rotation vectors, steps of the root, and the length.

    Rotations are relative to the mean of the joint over the samples of all segments.
    """
    joints = np.array(joints)
    compared = [j for j in joints if not NOT_COMPARED.search(clips[0].names[j].casefold())]
    pieces = [(clips[c], slice(first, last + 1)) for c, first, last in segments]
    turns = np.array([resample(c.rotations[own][:, compared], SAMPLES) for c, own in pieces])
    products = np.einsum("nmja,nmjb->jab", turns, turns)
    vectors = log(multiply(inverse(np.linalg.eigh(products)[1][..., -1]), turns))
    columns = [vectors.reshape(len(segments), -1)]
    if 0 in joints:
        paths = [resample_positions(c.positions[own], SAMPLES) for c, own in pieces]
        columns.append(np.diff(paths, axis=1).reshape(len(segments), -1))
    lengths = [last - first for _, first, last in segments]
    return np.column_stack([*columns, lengths])


def scores(rows):
    """Principal components of the correlation matrix."""
    config = SimpleNamespace(rotation_floor=0.0, position_floor=0.0, length_floor=0.0)
    config.components = min(COMPONENTS, len(rows) - 1)
    return analysis.embed(rows, 0, config)


def threshold(points):
    """The paper's equation 14 as printed: the root of the mean distance from the mean."""
    return np.sqrt(np.linalg.norm(points - points.mean(axis=0), axis=1).mean())


def clusters(points):
    return analysis.cluster(points, threshold(points))


def candidates(labels, lengths):
    """Return for each segment those in its cluster with a length within 15 percent, strictly."""
    lengths = np.asarray(lengths)
    fits = np.abs(lengths - lengths[:, None]) / lengths[:, None] < LENGTH_RATIO
    return [set(np.flatnonzero(row).tolist()) for row in fits & (labels == labels[:, None])]


def gap(clips, before, after, joints):
    """Return the mean angle in degrees between the last pose of a segment and the next's first."""
    a = clips[before[0]].rotations[before[2], joints]
    b = clips[after[0]].rotations[after[1], joints]
    return np.rad2deg(np.linalg.norm(log(multiply(inverse(a), b)), axis=-1).mean())
