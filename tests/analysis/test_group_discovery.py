"""Discovered joint groups: laws of linkage and dependence, planted couplings, and recordings."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import mograft as mg
from mograft import Config, Library, Motion, discover_groups, write_bvh
from mograft._standalone.mograft_linkage.dendrogram import labels_after_merges
from mograft.analysis.group_discovery import connected_linkage, joint_dependence
from mograft.body.joint_chains import support_shares
from mograft.body.mirroring import partners
from mograft.clustering import linkage_condensed
from mograft.dancer import dance
from mograft.library.build import spread_evenly
from mograft.motion import rotations
from tests.hierarchies import DATA, human
from tests.strategies import SEEDS, few_examples, person, turn_motion

CHAINS = {
    "base": "Hips LeftHip LeftKnee LeftAnkle RightHip RightKnee RightAnkle",
    "torso": "Chest",
    "head": "Neck Head",
    "arms": "LeftCollar LeftShoulder LeftElbow LeftWrist"
    " RightCollar RightShoulder RightElbow RightWrist",
}
"""The joints of each chain of `human`."""


def smooth_noise(rng, n_frames, n_signals):
    """Independent smooth signals of unit size, shape (n_frames, n_signals)."""
    noise = np.fft.rfft(rng.normal(size=(n_frames + 60, n_signals)), axis=0)
    noise[n_frames // 15 :] = 0.0
    signals = np.fft.irfft(noise, n_frames + 60, axis=0)[:n_frames]
    return signals / signals.std(axis=0)


def coupled_motion(seed, leaders, n_frames=400, own=0.05):
    """A motion of `human` in which the chains of `leaders` repeat the motion of other chains.

    All joints of a chain have the same rotation, apart from a share `own` of independent noise.
    """
    rng = np.random.default_rng(seed)
    skeleton = human()
    signals = {chain: smooth_noise(rng, n_frames, 3) for chain in CHAINS}
    quats = np.empty((n_frames, skeleton.n_joints, 4))
    for chain, names in CHAINS.items():
        for name in names.split():
            vectors = signals[leaders.get(chain, chain)] + own * smooth_noise(rng, n_frames, 3)
            # Legs that hardly move carry the body throughout.
            quats[:, skeleton.index(name)] = rotations.exp(
                (0.02 if chain == "base" else 0.2) * vectors
            )
    positions = np.tile(skeleton.offsets, (n_frames, 1, 1))
    return Motion(skeleton, 1 / 30, rotations.continuous_signs(quats), positions, name="coupled")


def names_of(skeleton, groups):
    return {
        frozenset(skeleton.names[joint] for joint in joints)
        for joints in groups.resolve(skeleton).values()
    }


@st.composite
def graphs(draw, max_points=9):
    """Distances of points, and a connected graph of neighbours."""
    n = draw(st.integers(1, max_points))
    rng = np.random.default_rng(draw(SEEDS))
    distances = rng.integers(1, draw(st.sampled_from([3, 1000])), (n, n)) / 8.0
    distances = np.maximum(distances, distances.T)
    np.fill_diagonal(distances, 0.0)
    is_neighbour = rng.random((n, n)) < 0.2
    for point in range(1, n):
        is_neighbour[point, rng.integers(point)] = True
    return distances, (is_neighbour | is_neighbour.T) & ~np.eye(n, dtype=bool)


@given(graphs())
def test_connected_linkage_complete_graph_equals_linkage_condensed(graph):
    distances, _ = graph
    n = len(distances)
    tree = connected_linkage(distances, ~np.eye(n, dtype=bool))
    assert tree.shape == (n - 1, 4)
    if n > 1:
        np.testing.assert_array_equal(tree, linkage_condensed(distances[np.triu_indices(n, 1)]))


@given(graphs())
def test_connected_linkage_clusters_are_connected_and_heights_are_diameters(graph):
    distances, is_neighbour = graph
    tree = connected_linkage(distances, is_neighbour)
    assert (np.diff(tree[:, 2]) >= 0).all()
    for n_merges in range(len(tree) + 1):
        labels = labels_after_merges(tree, n_merges)
        assert labels.max() + 1 == len(distances) - n_merges
        diameters = []
        for label in range(labels.max() + 1):
            points = np.flatnonzero(labels == label)
            reached = {points[0]}
            for _ in points:
                reached |= {p for p in points if is_neighbour[p, list(reached)].any()}
            assert reached == set(points)
            diameters.append(distances[np.ix_(points, points)].max())
        assert max(diameters) == (tree[:n_merges, 2].max() if n_merges else 0.0)


def velocities_of(seed, n=40, m=9, n_joints=4):
    return np.random.default_rng(seed).normal(size=(n, m, n_joints, 3))


@given(SEEDS)
def test_joint_dependence_of_independent_joints_is_small_and_of_linear_maps_is_1(seed):
    values = velocities_of(seed)
    mix = np.random.default_rng(seed).normal(size=(3, 3))
    mix += 3.0 * np.sign(np.linalg.det(mix)) * np.eye(3) / max(np.abs(mix).max(), 1.0)
    left, sizes, right = np.linalg.svd(mix)
    values[:, :, 1] = values[:, :, 0] @ (left @ np.diag(np.maximum(sizes, 0.3 * sizes[0])) @ right)
    found = joint_dependence(values, 0)
    np.testing.assert_allclose(found, found.T)
    assert found[0, 1] > 0.999
    others = found[np.ix_([0, 2, 3], [0, 2, 3])][np.triu_indices(3, 1)]
    assert (others >= 0).all()
    assert (others < 0.1).all()


@given(SEEDS)
def test_joint_dependence_of_independent_joints_has_no_bias_from_few_segments(seed):
    # Velocities are constant within the 20 segments, so chance alone gives r² of 3 / 19.
    values = np.repeat(velocities_of(seed, n=20, m=1, n_joints=10), 9, axis=1)
    found = joint_dependence(values, 0)
    assert found[np.triu_indices(10, 1)].mean() < 0.1


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("leaders", "pair", "alone"),
    [({"head": "torso"}, "head", "arms"), ({"arms": "torso"}, "arms", "head")],
)
def test_discover_planted_coupling_joins_coupled_chains(seed, leaders, pair, alone):
    motion = coupled_motion(seed, leaders)
    groups = mg.discover_groups(motion, 3).groups
    together = CHAINS["torso"].split() + CHAINS[pair].split()
    assert names_of(motion.skeleton, groups) == {
        frozenset(CHAINS["base"].split()),
        frozenset(together),
        frozenset(CHAINS[alone].split()),
    }
    # Three chains move alike, of which two are neighbours at most of the gap.
    assert mg.discover_groups(motion).groups == groups


LEADERS = st.dictionaries(
    st.sampled_from(["torso", "head", "arms"]), st.sampled_from(list(CHAINS)), max_size=2
)


@few_examples(12)
@given(SEEDS, LEADERS, st.integers(2, 4))
@example(0, {"head": "arms"}, 3)  # these two move alike, but the torso is between them
def test_discover_groups_are_connected_directly_or_by_the_base(seed, leaders, n):
    motion = coupled_motion(seed, leaders, 200)
    parents, pair = motion.skeleton.parents.tolist(), partners(motion.skeleton)
    groups = mg.discover_groups(motion, n).groups.resolve(motion.skeleton)
    base = set(groups.pop("lower").tolist())
    for joints in map(np.ndarray.tolist, groups.values()):
        reached = {joints[0]}  # left and right count as one
        for _ in joints:
            reached |= {parents[joint] for joint in reached} & set(joints)
            reached |= {j for j in joints if {parents[j], int(pair[j])} & reached}
        assert reached == set(joints) or {parents[j] for j in joints} <= base | set(joints)


@few_examples(5)
@given(SEEDS)
def test_discover_groups_are_complete_nested_and_left_right_consistent(seed):
    motion = person(seed, 200)
    skeleton, pair = motion.skeleton, partners(motion.skeleton)
    finer = None
    for n in (4, 3, 2):
        groups = mg.discover_groups(motion, n).groups
        assert len(groups.names) == n
        members = groups.resolve(skeleton)
        assert sorted(np.concatenate(list(members.values()))) == list(range(skeleton.n_joints))
        group_of = {joint: name for name, joints in members.items() for joint in joints.tolist()}
        assert all(group_of[joint] == group_of[int(pair[joint])] for joint in group_of)
        assert group_of[0] == groups.base == groups.names[0]
        if finer is not None:
            assert len({(finer[joint], group_of[joint]) for joint in group_of}) == n + 1
        finer = group_of


def test_discover_dependence_of_chains_is_that_of_their_least_dependent_joints():
    motion = coupled_motion(4, {"arms": "torso"})
    quats = motion.rotations.copy()
    rng = np.random.default_rng(99)
    elbows = [motion.skeleton.index(f"{side}Elbow") for side in ("Left", "Right")]
    for elbow in elbows:
        quats[:, elbow] = rotations.exp(0.2 * smooth_noise(rng, motion.n_frames, 3))
    torso, arms = 1, 2
    coupled = discover_groups(motion, 3).dependence
    found = discover_groups(replace(motion, rotations=quats), 3).dependence
    assert coupled[torso, arms] > 0.8
    assert found[torso, arms] < 0.3
    assert found[arms, arms] < 0.3  # within the chain, too


@pytest.mark.parametrize(("still", "above"), [("head", "torso"), ("torso", "base")])
def test_discover_chain_that_does_not_move_belongs_to_the_chain_above(still, above):
    motion = coupled_motion(0, {})
    quats = motion.rotations.copy()
    joints = [motion.skeleton.index(name) for name in CHAINS[still].split()]
    quats[:, joints] = quats[:1, joints]
    groups = mg.discover_groups(replace(motion, rotations=quats), 3).groups.resolve(motion.skeleton)
    expected = CHAINS[above].split() + CHAINS[still].split()
    found = {frozenset(motion.skeleton.names[j] for j in own) for own in groups.values()}
    assert frozenset(expected) in found


def test_discover_chain_that_carries_the_body_is_in_base():
    motion = coupled_motion(0, {})
    # In a handstand, the hands are the lowest points.
    skeleton, quats, axis = motion.skeleton, motion.rotations.copy(), np.eye(3)[2]
    quats[:, 0] = rotations.multiply(rotations.from_axis_angle(axis, np.array(np.pi)), quats[:, 0])
    arms = [skeleton.index(name) for name in CHAINS["arms"].split()]
    quats[:, arms] = rotations.IDENTITY
    for name, angle in (("LeftShoulder", 90), ("RightShoulder", -90)):
        quats[:, skeleton.index(name)] = rotations.from_axis_angle(axis, np.radians(angle))
    handstand = replace(motion, rotations=rotations.continuous_signs(quats))
    base = mg.discover_groups(handstand).groups.resolve(skeleton)["lower"]
    assert set(arms) <= set(base.tolist())


def test_support_shares_do_not_depend_on_the_up_direction():
    """-z and -x are up. With -y up, the rest pose would describe a handstand."""
    motion = dance(strides=1).motion
    for axis, angle in ((0, -np.pi / 2), (2, np.pi / 2)):
        turned = turn_motion(motion, rotations.exp(angle * np.eye(3)[axis]))
        np.testing.assert_allclose(support_shares(turned), support_shares(motion), atol=0.01)


def test_discover_tree_cut_at_number_gives_labels():
    found = discover_groups(coupled_motion(1, {"head": "torso"}), 3)
    assert found.labels.tolist() == [0, 1, 2, 1]
    np.testing.assert_allclose(found.tree[0, 2], 1.0 - found.dependence[1, 3])
    assert found.tree[-1, 2] == 1.0
    assert [len(unit) for unit in found.units] == [7, 1, 8, 2]
    assert found.pose.n_frames == 1


def test_discover_left_and_right_of_a_chain_may_move_independently():
    rng = np.random.default_rng(3)
    motion = coupled_motion(3, {})
    quats = motion.rotations.copy()
    for side in ("Left", "Right"):
        shared = smooth_noise(rng, motion.n_frames, 3)
        for name in CHAINS["arms"].split():
            if name.startswith(side):
                own = shared + 0.05 * smooth_noise(rng, motion.n_frames, 3)
                quats[:, motion.skeleton.index(name)] = rotations.exp(0.2 * own)
    found = discover_groups(replace(motion, rotations=rotations.continuous_signs(quats)), 3)
    # Pairs of joints on both sides do not count; else this would be about a half.
    assert found.dependence[2, 2] > 0.8


def test_discover_invalid_arguments_raise_value_error():
    motion = coupled_motion(0, {})
    still = replace(motion, rotations=np.repeat(motion.rotations[:1], motion.n_frames, axis=0))
    at_200 = Config(segmentation={"coupled": [200]})
    for clips, options, message in (
        (motion, {"n": True}, "`n` must be a whole number of at least 2, got True"),
        (motion, {"n": 1}, "`n` must be a whole number of at least 2, got 1"),
        (motion, {"n": 5}, "`n` must be a number of groups from 2 to 4 for these clips, got 5"),
        (motion, {"seed": 1.5}, "`seed` must be a whole number of at least 0"),
        (motion[:4], {}, "needs at least 3 segments, got 1"),
        (motion, {"config": at_200}, "needs at least 3 segments, got 2"),
        (still, {}, "no joint moves except those of the base group"),
        ([], {}, "at least one clip, got none"),
    ):
        with pytest.raises(ValueError, match=message):
            discover_groups(clips, **options)
    for groups in ("auto:x", "auto:1", "auto:", "auto:2.0", "auto:-3"):
        with pytest.raises(ValueError, match="must be auto or auto:N"):
            Library.build(motion, groups)


def test_libraries_discover_the_same_groups_and_remember_them(tmp_path):
    clips = [coupled_motion(seed, {"arms": "torso"}, 200) for seed in range(3)]
    (tmp_path / "clips").mkdir()
    for number, motion in enumerate(clips[:2]):
        write_bvh(motion, tmp_path / "clips" / f"{number}.bvh")
    paths = [str(tmp_path / "clips" / f"{number}.bvh") for number in range(2)]
    expected = mg.discover_groups(paths, 3).groups
    assert Library.build(paths, "auto:3").groups == expected
    indexed = Library.index(paths, tmp_path / "library", "auto:3")
    assert indexed.groups == expected
    assert set(indexed.labels) == set(expected.names)
    # Other clips do not change the groups of a library.
    write_bvh(coupled_motion(7, {"head": "torso"}, 600), tmp_path / "clips" / "2.bvh")
    added = Library.open(tmp_path / "library").add(tmp_path / "clips" / "2.bvh")
    assert len(added.clips) == 3
    assert added.groups == expected
    assert mg.discover_groups(tmp_path / "clips", 3).groups != expected


@given(st.integers(0, 500))
def test_spread_evenly_keeps_order_ends_and_limit(n):
    chosen = spread_evenly(range(n))
    assert chosen == sorted(set(chosen))
    assert len(chosen) == min(n, 64)
    assert n == 0 or (chosen[0], chosen[-1]) == (0, n - 1)


ANIMAL = {"torso": "Spine1 Spine2 Chest", "head": "Neck Head Jaw", "tail": "Tail1 Tail2 Tail3"}


def test_discover_animal_has_legs_trunk_head_and_tail():
    path = DATA / "synthetic_quadruped" / "quadruped_trot.bvh"
    if not path.exists():
        pytest.skip(f"the recording {path.name} is missing")
    motion = mg.read_bvh(path)
    groups, names = mg.discover_groups(motion, 4).groups, motion.skeleton.names
    members = groups.resolve(motion.skeleton).items()
    found = {group: " ".join(names[joint] for joint in joints) for group, joints in members}
    assert groups.base == "legs"
    assert found.pop("legs")
    assert found == ANIMAL
