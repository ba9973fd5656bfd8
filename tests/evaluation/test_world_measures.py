"""World-space measures: of copies, of planted changes, and against direct computation."""

import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lab.donors.methods import ByCost, Captured
from mograft import JointGroups, Library, Motion, graft
from mograft.body.contacts import Ground
from mograft.body.contacts import skating_share as foot_skate
from mograft.evaluation import grafts_by
from mograft.evaluation.balance import dynamic_balance
from mograft.evaluation.body_tracks import BodyTracks, FrameBlocks, bone_ends, jerk, landmarks
from mograft.evaluation.world_measures import UNDER_FLOOR, world_measures, world_quality
from tests.evaluation.planted import add_jitter
from tests.hierarchies import human
from tests.strategies import SEEDS, few_examples, smooth_rotations, transform_motion

transform = pytest.importorskip("scipy.spatial.transform", reason="SciPy is not installed")


@pytest.fixture(scope="module")
def new(library):
    return graft(library, seed=3)


def test_world_measures_captured_motion_has_no_difference_and_is_within_ranges(library):
    for clip in library.clips:
        found = world_measures(grafts_by(Captured(), library, clip.name)[0])
        assert (found.head_jerk, found.chest_jerk, found.hands_jerk) == (1.0, 1.0, 1.0)
        assert (found.floor_depth, found.under_floor, found.skate, found.balance) == (0, 0, 0, 0)
        assert found.frames == 0
        assert set(found.ranges) <= {*vars(found)} - {"frames", "ranges"}
        assert {"head_jerk", "hands_jerk", "skate"} <= set(found.ranges)
        for name, (low, high) in found.ranges.items():
            assert low <= getattr(found, name) <= high
        assert all("(within " in text for text in found.columns().values() if text != "none")


def test_world_measures_ranges_are_quartiles_of_parts_and_the_whole_base(new):
    found, base = world_measures(new), new.base
    track = jerk(bone_ends(base, landmarks(base.skeleton)["head"]), base.rate)
    edges = np.linspace(0, base.n_frames, max(round(base.duration / 5.0), 4) + 1).astype(int)
    ratios = [np.median(track[a:b]) / np.median(track) for a, b in pairwise(edges)]
    low, high = np.percentile(ratios, (25, 75))
    assert found.ranges["head_jerk"] == pytest.approx((min(low, 1.0), max(high, 1.0)))
    ground = Ground.of(base)
    shares = [foot_skate(base[a:b], ground) for a, b in pairwise(edges)]
    low, high = np.percentile(shares, (25, 75)) - foot_skate(base, ground)
    assert found.ranges["skate"] == pytest.approx((min(low, 0.0), max(high, 0.0)))
    assert found.ranges["floor_depth"][1] == 0.0  # no part is deeper than the whole base


def test_world_measures_jitter_raises_jerk_above_its_range(new):
    (chest,) = landmarks(new.motion.skeleton)["chest"]
    before, found = world_measures(new), world_measures(add_jitter(new, chest))
    assert found.head_jerk > 1.5 * before.head_jerk
    assert found.hands_jerk > 1.1 * before.hands_jerk
    assert found.floor_depth == before.floor_depth == 0
    text = found.columns()["head jerk, ratio"]
    low, high = found.ranges["head_jerk"]
    assert found.head_jerk > high
    assert text == f"{found.head_jerk:.2f} (above {low:.2f} to {high:.2f})"
    assert found.ranges == before.ranges


def test_world_measures_jerk_ratio_equals_direct_computation(library, new):
    joint = library.skeleton.index("Head")
    sites = [site.offset for site in library.skeleton.end_sites if site.parent == joint]
    assert len(sites) == 1

    def head_jerk(motion):
        height = Ground.of(motion).height
        quats, positions = motion.world_transforms()
        turns = transform.Rotation.from_quat(quats[:, joint].copy())
        ends = positions[:, joint] + turns.apply(sites[0].copy())
        found = np.zeros(len(ends))
        found[1:-2] = np.linalg.norm(np.diff(ends, 3, axis=0), axis=1) * motion.rate**3 / height
        return found

    assert round(library.rate) == 30
    clips = {clip.name: head_jerk(clip) for clip in library.clips}
    new_jerk, base_jerk = head_jerk(new.motion), clips[new.base.name]
    rows = {}
    for s in new.substitutions:
        for frame in range(s.start, s.stop + 1):
            share = (frame - s.start) / (s.stop - s.start)
            donor = round(s.donor_start + share * (s.donor_stop - s.donor_start))
            rows[frame] = (new_jerk[frame], base_jerk[frame], clips[s.clip][donor], s.is_own)
    n = new.motion.n_frames
    used = np.array([row[:3] for f, row in rows.items() if not row[3] and 2 <= f < n - 2])
    medians = np.median(used, axis=0)
    expected = medians[0] / math.sqrt(medians[1] * medians[2])
    assert world_measures(new).head_jerk == pytest.approx(expected, rel=1e-9)


@given(st.floats(-5.0, 5.0), st.sampled_from([24.0, 30.0, 60.0, 120.0]), SEEDS)
def test_jerk_cubic_path_is_its_third_derivative(coefficient, rate, seed):
    time = np.arange(60) / rate
    lower = np.random.default_rng(seed).normal(size=(3, 3))
    path = np.polynomial.polynomial.polyval(time, lower).T
    path[:, 1] += coefficient * time**3
    found = jerk(path[:, None], rate)[:, 0]
    stride = max(round(rate / 30), 1)
    inner = found[stride : len(found) - 2 * stride]
    assert inner == pytest.approx(np.full(len(inner), 6 * abs(coefficient)), abs=1e-6)
    assert not found[:stride].any()
    assert not found[len(found) - 2 * stride :].any()


@given(SEEDS, st.floats(0.001, 0.2))
@few_examples(20)
def test_world_measures_lowered_frames_have_their_depth(captured, seed, depth):
    motion, ground = captured.motion, Ground.of(captured.motion)
    frame = int(np.random.default_rng(seed).integers(motion.n_frames))
    positions = motion.positions.copy()
    positions[frame, 0, 1] -= depth * ground.height
    moved = replace(motion, positions=positions, channel_values=None)
    found = world_measures(replace(captured, motion=moved))
    depths = -ground.above(ground.points(motion)) / ground.height
    lowered = depths[frame] + depth
    expected = max(depths.max(), lowered.max(), 0.0) - max(depths.max(), 0.0)
    assert found.floor_depth == pytest.approx(expected, abs=1e-9)
    count = (lowered > UNDER_FLOOR).sum() - (depths[frame] > UNDER_FLOOR).sum()
    assert found.under_floor == pytest.approx(count / depths.size, abs=1e-12)


@pytest.fixture(scope="module")
def captured(library):
    return grafts_by(Captured(), library)[0]


def test_world_measures_transformed_recordings_give_same_measures(library, new):
    clips = [transform_motion(c, 0.01, 0.7, (2.0, 0.0, -1.0)) for c in library.clips]
    moved = Library.build(clips)
    expected = world_measures(new)
    motion = transform_motion(new.motion, 0.01, 0.7, (2.0, 0.0, -1.0))
    other = replace(new, library=moved, motion=motion, base=moved.clips[0])
    found = world_measures(other)
    assert list(found.ranges) == list(expected.ranges)
    values, others = ({**vars(own), **own.ranges} for own in (expected, found))
    for name in values.keys() - {"ranges"}:
        assert others[name] == pytest.approx(values[name], rel=1e-6, abs=1e-9), name


@pytest.fixture(scope="module")
def leg_graft(library):
    """Return a graft whose donors hold the legs and the root."""
    return graft(Library.build(library.clips, JointGroups(library.groups.groups, base="upper")))


@pytest.mark.parametrize("fixture", ["new", "leg_graft"])
def test_world_measures_balance_equals_shares_of_frames(fixture, request):
    own = request.getfixturevalue(fixture)
    found = world_measures(own)
    before = dynamic_balance(own.base)
    after = dynamic_balance(own.motion, floor_reference=own.base)
    is_exchanged = np.zeros(own.motion.n_frames, bool)
    for s in own.substitutions:
        is_exchanged[s.start : s.stop + 1] = not s.is_own
    used = is_exchanged & before.grounded & after.grounded
    shares = [(balance.distance[used] > 0).mean() for balance in (after, before)]
    assert found.balance == pytest.approx(shares[0] - shares[1])
    assert found.frames == is_exchanged.sum()


@given(st.lists(st.integers(1, 2000), min_size=1, max_size=4), st.sampled_from([24.0, 30.0, 120.0]))
def test_frame_blocks_have_equal_lengths_near_five_seconds(lengths, rate):
    entries = [SimpleNamespace(n_frames=n) for n in lengths]
    blocks = FrameBlocks.of(SimpleNamespace(entries=entries, rate=rate))
    clip, frame = blocks.clip_of(np.arange(sum(lengths)))
    np.testing.assert_array_equal(clip, np.repeat(np.arange(len(lengths)), lengths))
    np.testing.assert_array_equal(frame, np.concatenate([np.arange(n) for n in lengths]))
    assert set(np.diff(blocks.block)) <= {0, 1}
    used = set()
    for index, n in enumerate(lengths):
        own, sizes = np.unique(blocks.block[clip == index], return_counts=True)
        assert used.isdisjoint(own)
        used.update(own)
        assert sizes.max() - sizes.min() <= 1
        assert len(own) == max(round(n / rate / 5), 1)


@given(SEEDS, st.floats(-3.0, 3.0))
@few_examples(20)
def test_body_tracks_turned_motion_has_same_points_facing_forward(seed, yaw):
    rng = np.random.default_rng(seed)
    skeleton = human()
    quats = smooth_rotations(rng, 40, skeleton.n_joints, speed=0.1)
    quats[:, 0] = [0.0, 0.0, 0.0, 1.0]
    motion = Motion(skeleton, 1 / 30, quats, np.tile(skeleton.offsets, (40, 1, 1)))
    turned = transform_motion(motion, 2.0, yaw, (1.0, 0.0, -4.0))
    frames = np.array([5, 20])
    expected, found = (
        t.facing_forward(t.points[frames], frames)
        for t in (BodyTracks.of(motion), BodyTracks.of(turned))
    )
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_world_quality_is_mean_of_grafts(library):
    grafts = [list(grafts_by(ByCost(), library, clip.name, 2, seed=1)) for clip in library.clips]
    found = world_quality("x", grafts)
    measured = [world_measures(g) for several in grafts for g in several]
    for name in ("head_jerk", "chest_jerk", "hands_jerk", "balance", "floor_depth", "skate"):
        own = getattr(found, name)
        assert own.value == pytest.approx(np.mean([getattr(m, name) for m in measured])), name
        assert own.n == 4
    assert found.runs == 2
