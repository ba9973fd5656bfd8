"""Joint groups from the data: joints that move together form a group."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mograft._standalone.mograft_linkage.dendrogram import labels_after_merges
from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft._util.linalg import eigenvectors, product
from mograft._util.names import unique_names
from mograft._util.validate import as_integer
from mograft.analysis.embedding import normalise
from mograft.body.anatomy import anatomy
from mograft.body.groups import JointGroups, groups_of_joints
from mograft.body.joint_chains import MIN_SUPPORT_SHARE, JointChains, support_shares
from mograft.body.joint_names import ARM, LEG
from mograft.body.mass import mass_model, up_axis
from mograft.config import FRAME, Config
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.motion.segments import Segments
from mograft.motion.skeleton import Skeleton

MAX_CLIPS = 64
"""Maximum number of clips from which groups are discovered."""
N_PERMUTATIONS = 20
"""Number of permutations of segments from which the floor of the dependence is computed."""
_MIN_SPEED = np.radians(0.5)
"""Root mean square angular velocity, in radians per second, below which a joint does not move."""
_MIN_AXIS_SHARE = 0.05
"""Minimum speed about an axis of a joint, as a share of the speed about its main axis."""
_MAX_SEGMENTS = 2000
_MIN_SEGMENTS = 3
_KIND_OF_PART = {
    "trunk": "torso",
    "neck": "head",
    "head": "head",
    "tail": "tail",
    **dict.fromkeys(ARM, "arms"),
    **dict.fromkeys(LEG, "legs"),
}
"""Name of a group of joints of each body part."""


@dataclass(frozen=True, eq=False)
class GroupDiscovery:
    """Joint groups that were discovered in clips, and the measures behind them.

    Attributes
    ----------
    groups : JointGroups
        The groups; the base group is the first.
    units : tuple of ndarray of int
        The joints of each unit, ascending; the base is the first unit. A unit is a chain of joints
        between two branchings of the hierarchy, left and right together.
    dependence : ndarray, shape (n_units, n_units)
        The smallest dependence between a joint of one unit and a joint of the other, from 0 to 1.
        The dependence of two joints measures how well the motion of one predicts that of the
        other; `docs/groups.md` defines it.
    tree : ndarray, shape (n_units - 1, 4)
        The linkage tree of the units in SciPy's format. Heights are 1 minus the dependence; the
        last merge, at height 1, is that of the base with all others.
    labels : ndarray of int, shape (n_units,)
        The index of the group of each unit.
    pose : Motion
        The middle frame of the first clip, for pictures.
    """

    groups: JointGroups
    units: tuple[IntArray, ...]
    dependence: FloatArray
    tree: FloatArray
    labels: IntArray
    pose: Motion


def discover_in_segments(
    clips: Iterable[tuple[Motion, Segments]], n: int | None, config: Config, seed: int = 0
) -> GroupDiscovery:
    """Discover joint groups in segmented motions of one hierarchy; see `discover_groups`."""
    n, seed = None if n is None else as_integer("n", n, 2), as_integer("seed", seed)
    chains, velocities, shares, pose = None, [], [], None
    for motion, segments in clips:
        if chains is None:
            chains = JointChains.from_skeleton(motion.skeleton)
            pose = motion[motion.n_frames // 2 :][:1]
        joints = np.array([joint for node in chains.nodes for joint in node])
        velocities.append(angular_velocities(motion, segments, joints, config))
        shares.append(support_shares(motion))
    if chains is None or pose is None:
        raise ValueError("`clips` must have at least one clip, got none")
    moved = np.concatenate(velocities)
    if len(moved) < _MIN_SEGMENTS:
        raise ValueError(
            f"discovery of joint groups needs at least {_MIN_SEGMENTS} segments, got {len(moved)}; "
            "use a preset, or longer clips"
        )
    rows = np.unique(np.linspace(0, len(moved) - 1, _MAX_SEGMENTS).round().astype(int))
    dependence = _fold(chains, joint_dependence(moved[rows], seed))
    supports: BoolArray = np.stack(shares).mean(axis=0) >= MIN_SUPPORT_SHARE
    is_static: BoolArray = np.asarray(np.isnan(dependence).all(axis=1))
    unit_of_node = _units(chains, chains.base_chains(supports), is_static)
    return _divide(chains, unit_of_node, dependence, n, pose)


def _fold(chains: JointChains, dependence: FloatArray) -> FloatArray:
    """Return the dependence of each pair of nodes, shape (n_nodes, n_nodes).

    It is the mean of `dependence`, that of joints, over the pairs of a joint of one node and a
    joint of the other that are not on opposite sides of the body. It is NaN for nodes that do not
    move, and on the diagonal.
    """
    sides = anatomy(chains.skeleton).sides
    joints = [joint for node in chains.nodes for joint in node]
    is_left = np.array([sides[joint] == "left" for joint in joints])
    is_right = np.array([sides[joint] == "right" for joint in joints])
    is_opposite = np.logical_and.outer(is_left, is_right)
    is_used = ~(is_opposite | is_opposite.T | np.isnan(dependence))
    owners = np.repeat(np.arange(len(chains.nodes)), [len(node) for node in chains.nodes])
    indicator = np.equal.outer(np.arange(len(chains.nodes)), owners).astype(np.float64)
    counts = indicator @ is_used @ indicator.T
    sums = indicator @ np.where(is_used, dependence, 0.0) @ indicator.T
    folded: FloatArray = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
    np.fill_diagonal(folded, np.nan)
    return folded


def _units(chains: JointChains, is_base: BoolArray, is_static: BoolArray) -> IntArray:
    """Return the unit of each node: 0 for the base, other chains in their order.

    `is_base` holds the chains of the base, `is_static` the nodes that do not move. A chain of which
    no node moves belongs to the unit of the chain above it.
    """
    unit_of_chain: dict[int, int] = {}
    units = np.zeros(len(chains.nodes), np.int64)
    for node, (chain, parent) in enumerate(zip(chains.chains, chains.parents, strict=True)):
        if chain not in unit_of_chain:
            if is_base[chain]:
                unit_of_chain[chain] = 0
            elif is_static[chains.chains == chain].all():
                unit_of_chain[chain] = int(units[parent])
            else:
                unit_of_chain[chain] = max(unit_of_chain.values(), default=0) + 1
        units[node] = unit_of_chain[chain]
    return units


def _divide(
    chains: JointChains, unit_of_node: IntArray, dependence: FloatArray, n: int | None, pose: Motion
) -> GroupDiscovery:
    """Merge units to `n` groups; None means the number of `number_at_largest_gap`.

    `pose` is stored in the result.
    """
    n_units = int(unit_of_node.max()) + 1
    if n_units < 2:
        raise ValueError(
            "no joint moves except those of the base group, which carries the body; define the "
            "groups with a preset or a TOML file"
        )
    if n is not None and n > n_units:
        raise ValueError(
            f"`n` must be a number of groups from 2 to {n_units} for these clips, got {n}: groups "
            "consist of whole chains of joints between branchings of the hierarchy"
        )
    smallest = np.full((n_units, n_units), np.nan)
    np.fmin.at(smallest, np.ix_(unit_of_node, unit_of_node), dependence)  # NaN is unknown
    smallest = np.where(np.isnan(smallest), np.eye(n_units), smallest)
    inner = connected_linkage(1.0 - smallest[1:, 1:], _neighbours(chains, unit_of_node)[1:, 1:])
    # The base is unit 0, which is merged last, at height 1.
    last = [0.0, 1.0 if n_units == 2 else 2.0 * n_units - 3.0, 1.0, float(n_units)]
    tree = np.vstack([inner + np.array([1, 1, 0, 0]), last])
    if n is None:
        n = number_at_largest_gap(tree, 1.0 - np.diag(smallest)[1:])
    labels = labels_after_merges(tree, n_units - n)
    units = tuple(np.flatnonzero(unit_of_node[chains.node_of_joint] == u) for u in range(n_units))
    names = _group_names(chains.skeleton, units, labels)
    members = {
        name: np.concatenate([units[u] for u in np.flatnonzero(labels == label)])
        for label, name in enumerate(names)
    }
    return GroupDiscovery(
        groups=groups_of_joints(chains.skeleton, members, names[0]),
        units=units,
        dependence=smallest,
        tree=tree,
        labels=labels,
        pose=pose,
    )


def _neighbours(chains: JointChains, unit_of_node: IntArray) -> BoolArray:
    """Return which units are connected in the hierarchy, directly or only through the base."""
    n_units = int(unit_of_node.max()) + 1
    found = np.zeros((n_units, n_units), bool)
    found[unit_of_node[chains.parents[1:]], unit_of_node[1:]] = True
    found |= found.T
    attached = np.flatnonzero(found[0])
    found[np.ix_(attached, attached)] = True
    found[np.diag_indices(n_units)] = False
    return found


def number_at_largest_gap(tree: FloatArray, diameters: FloatArray) -> int:
    """Return the number of groups between the two successive merges of largest height difference.

    `diameters` has for each unit of `GroupDiscovery` the largest distance within it. The largest of
    them, but at most the height of the first merge, counts as a height before the first merge. Of
    equal differences, the one that gives more groups decides.
    """
    heights = tree[:, 2]
    first = min(float(diameters.max()), float(heights[0]))
    gaps = np.diff(np.concatenate([[first], heights]))
    return len(tree) + 1 - int(np.argmax(gaps))


def _group_names(
    skeleton: Skeleton, units: tuple[IntArray, ...], labels: IntArray
) -> tuple[str, ...]:
    """Return unique names of the groups, after their body parts, as those of the presets."""
    known = anatomy(skeleton)
    kinds = [
        Counter(_KIND_OF_PART.get(known.parts[joint], "other") for joint in unit.tolist())
        for unit in units
    ]
    names = []
    for label in range(int(labels.max()) + 1):
        own = [kinds[unit] for unit in np.flatnonzero(labels == label).tolist()]
        if label == 0:
            has_legs = any("legs" in counts for counts in own)
            names.append("lower" if known.human else "legs" if has_legs else "base")
            continue
        found = {counts.most_common(1)[0][0] for counts in own}
        is_upper = {"torso", "arms"} <= found
        order = ("torso", "arms", "legs", "head", "tail", "other")
        names.append("upper" if is_upper else next(kind for kind in order if kind in found))
    return tuple(unique_names(names))


def angular_velocities(
    motion: Motion, segments: Segments, joints: IntArray, config: Config
) -> FloatArray:
    """Return angular velocities in radians per second, (n_segments, samples - 1, n_joints, 3).

    Segments are resampled to `config.samples` frames. The velocity of the hips is relative to the
    world, that of other joints to their parents; all are in the axes of the joint.
    """
    skeleton = motion.skeleton
    samples = normalise(
        [motion],
        segments,
        config,
        root=anatomy(skeleton).hips,
        up=up_axis(motion),
        heights=[mass_model(skeleton).height],
    )
    quats = np.asarray(samples.rotations, np.float64)[:, :, joints]
    seconds = samples.displacements_and_length[:, -1] * FRAME / (config.samples - 1)
    steps = rotations.multiply(rotations.inverse(quats[:, :-1]), quats[:, 1:])
    return rotations.log(steps) / seconds[:, None, None, None]


def joint_dependence(velocities: FloatArray, seed: int) -> FloatArray:
    """Return the dependence of each pair of joints, shape (n_joints, n_joints), from 0 to 1.

    `velocities` has shape (n_segments, n_samples, n_joints, 3). The dependence of two joints is the
    mean r² of the squared canonical correlations of their angular velocities, corrected for chance:
    (r² - f) / (1 - f), and 0 if this is negative. The floor f is the mean of r² over
    `N_PERMUTATIONS` permutations, drawn with `seed`, of the segments of one of the two joints. The
    dependence is NaN if one of the joints does not move.
    """
    n, m, n_joints = velocities.shape[:3]
    axes = [_whiten(velocities[:, :, joint].reshape(n * m, 3)) for joint in range(n_joints)]
    widths = np.array([whitened.shape[1] for whitened in axes])
    stacked = np.concatenate(axes, axis=1)
    owners = np.repeat(np.arange(n_joints), widths)
    rng = np.random.default_rng(seed)
    floor = np.zeros((n_joints, n_joints))
    for _ in range(N_PERMUTATIONS):
        permuted = stacked.reshape(n, m, -1)[rng.permutation(n)].reshape(n * m, -1)
        floor += _mean_squares(product(permuted.T, stacked), owners, widths) / N_PERMUTATIONS
    floor = np.minimum(0.5 * (floor + floor.T), 1.0 - 1e-9)
    measured = _mean_squares(product(stacked.T, stacked), owners, widths)
    dependence: FloatArray = np.clip((measured - floor) / (1.0 - floor), 0.0, 1.0)
    dependence[widths == 0] = np.nan
    dependence[:, widths == 0] = np.nan
    return dependence


def _whiten(values: FloatArray) -> FloatArray:
    """Return the principal component scores of vectors, scaled to columns of norm 1.

    `values` has shape (n, 3), the result (n, n_components). Components with a deviation below
    `_MIN_AXIS_SHARE` of the largest one are left out. There are no columns if the root mean square
    length of the vectors is below `_MIN_SPEED`.
    """
    size = float(np.sqrt((values**2).sum(axis=1).mean()))
    if size < _MIN_SPEED:
        return values[:, :0]
    centred = (values - values.mean(axis=0)) / (size * np.sqrt(len(values)))
    variances, vectors = eigenvectors(product(centred.T, centred), 3)
    is_kept = variances > max(_MIN_AXIS_SHARE**2 * variances[0], 1e-9)
    return product(centred, vectors)[:, is_kept] / np.sqrt(variances[is_kept])


def _mean_squares(products: FloatArray, owners: IntArray, widths: IntArray) -> FloatArray:
    """Return the mean squared canonical correlation of each pair of joints.

    `products` has the inner products of the columns that `_whiten` returns for all joints.
    `owners` has the joint of each column, and `widths` the number of columns of each joint.
    """
    indicator = np.equal.outer(np.arange(len(widths)), owners).astype(np.float64)
    sums = indicator @ products**2 @ indicator.T
    return sums / np.maximum(np.minimum.outer(widths, widths), 1)


def connected_linkage(distances: FloatArray, is_neighbour: BoolArray) -> FloatArray:
    """Cluster by complete linkage; two clusters merge only if some of their points are neighbours.

    `distances` and `is_neighbour` have shape (n, n) and are symmetric, and the graph of neighbours
    is connected. The result is a tree in SciPy's format, shape (n - 1, 4). Heights never decrease:
    a merge adds neighbours to a cluster, but none is closer than the merged clusters were.
    Merges of equal distance are ordered by the lowest points of the two clusters, as in
    `mograft_linkage.linkage`, whose tree results if all points are neighbours.
    """
    n = len(distances)
    members = {point: [point] for point in range(n)}
    rows = []
    for step in range(n - 1):
        distance, _, _, first, second = min(
            (float(distances[np.ix_(left, right)].max()), left[0], right[0], first, second)
            for first, left in members.items()
            for second, right in members.items()
            if left[0] < right[0] and is_neighbour[np.ix_(left, right)].any()
        )
        merged = sorted(members.pop(first) + members.pop(second))
        members[n + step] = merged
        rows.append([min(first, second), max(first, second), distance, len(merged)])
    return np.array(rows, np.float64).reshape(-1, 4)
