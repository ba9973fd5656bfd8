"""Transplant, recombination and splice: kept numbers, oracles, windows, trunk orientation."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mograft import Config
from mograft.blend.recombine import MAX_ANGLE, recombine, splice
from mograft.blend.seam_treatments import SEAM_TREATMENTS
from mograft.blend.transplant import GraftedGroup, transplant
from mograft.motion import rotations
from tests.oracles import blend as oracle
from tests.strategies import (
    SEEDS,
    SEGMENT_LENGTHS,
    assert_same_rotations,
    few_examples,
    person,
    random_star_clip,
    tile_segments,
    turn_motion,
)

CONFIGS = st.sampled_from([Config(seam=seam) for seam in tuple(SEAM_TREATMENTS)])
PLAIN = st.builds(
    Config,
    seam=st.sampled_from(["offset", "paper", "displacement"]),
    torso=st.just("pelvis"),
    seam_window=st.sampled_from([1 / 30, 1 / 6, 2 / 3]),
)


JOINTS = np.array([1, 3])
GROUP = GraftedGroup(JOINTS)


def random_graft(lengths, seed, config, moving=()):
    """A clip, its segments, the donor of each, and the exchanged part."""
    rng, cut = np.random.default_rng(seed), tile_segments(lengths)
    base = random_star_clip(rng, cut, moving=moving)
    chosen = rng.integers(0, len(cut), len(cut))
    return base, cut, chosen, transplant(base, cut, cut[chosen], [base], GROUP, config)


@few_examples(40)
@given(SEGMENT_LENGTHS, SEEDS, CONFIGS, st.integers(0, 1))
def test_transplant_segments_onto_themselves_or_a_copy_change_no_bit(lengths, seed, config, clip):
    cut = tile_segments(lengths)
    base = random_star_clip(np.random.default_rng(seed), cut, moving=(3,))
    own = replace(cut, clip=np.full(len(cut), clip))
    part = transplant(base, cut, own, [base, base], GROUP, config)
    new = recombine(base, [part], "same")
    np.testing.assert_array_equal(new.rotations, base.rotations)
    np.testing.assert_array_equal(new.positions, base.positions)
    np.testing.assert_array_equal(new.channel_numbers(), base.channel_values)
    assert not len(part.seams)


@few_examples(40)
@given(SEGMENT_LENGTHS, SEEDS, CONFIGS)
def test_recombine_other_joints_keep_every_number(lengths, seed, config):
    base, _, _, part = random_graft(lengths, seed, config, moving=(3,))
    new = recombine(base, [part], "new")
    assert new.n_frames == base.n_frames
    others = [0, 2]
    np.testing.assert_array_equal(new.rotations[:, others], base.rotations[:, others])
    np.testing.assert_array_equal(new.positions[:, others], base.positions[:, others])
    columns = [c for j in others for c in base.skeleton.channel_columns[j]]
    np.testing.assert_array_equal(
        new.channel_numbers()[:, columns], base.channel_values[:, columns]
    )
    np.testing.assert_allclose(np.linalg.norm(new.rotations, axis=-1), 1.0, atol=1e-12)
    # Channel values agree with the rotations.
    for joint in JOINTS:
        order = base.skeleton.rotation_order(joint)
        own = base.skeleton.rotation_columns[joint]
        written = rotations.from_euler(np.radians(new.channel_numbers()[:, own]), order)
        assert_same_rotations(written, new.rotations[:, joint], 1e-9)


@few_examples(40)
@given(SEGMENT_LENGTHS, SEEDS, CONFIGS, st.integers(-3, 3))
def test_recombine_unchanged_frames_keep_channel_values_and_new_ones_continue_them(
    lengths, seed, config, turns
):
    """Files may hold angles beyond a full turn: there is no jump at the start of a graft."""
    rng = np.random.default_rng(seed)
    cut = tile_segments(np.array([9, *lengths]))
    base = random_star_clip(rng, cut)
    base = replace(base, channel_values=base.channel_values + 360.0 * turns)
    chosen = np.where(rng.random(len(cut)) < 0.7, np.arange(len(cut)), rng.integers(len(cut)))
    chosen[0] = 0
    part = transplant(base, cut, cut[chosen], [base], GROUP, config)
    numbers = recombine(base, [part], "new").channel_numbers()
    for column, joint in enumerate(JOINTS):
        same = (part.rotations[:, column] == base.rotations[:, joint]).all(axis=-1)
        own = list(base.skeleton.channel_columns[joint])
        np.testing.assert_array_equal(numbers[same][:, own], base.channel_values[same][:, own])
        begins = np.flatnonzero(~same[1:] & same[:-1])
        steps = numbers[begins + 1][:, own] - numbers[begins][:, own]
        assert (np.abs(steps) <= 180.0 + 1e-9).all()


@few_examples(20)
@given(SEGMENT_LENGTHS, SEEDS, PLAIN)
def test_transplant_rotations_match_oracle(lengths, seed, config):
    base, cut, chosen, part = random_graft(lengths, seed, config)
    bounds = np.array([0, *cut.stop])
    expected = oracle.transplant(base.rotations[:, JOINTS], bounds, chosen, base.rate, config)
    # The oracle of "offset" differentiates numerically.
    assert_same_rotations(part.rotations, expected, 1e-7 if config.seam == "offset" else 1e-9)


@few_examples(40)
@given(SEGMENT_LENGTHS, SEEDS)
def test_transplant_constant_translations_keep_bone_lengths_of_base(lengths, seed):
    rng = np.random.default_rng(seed)
    cut = tile_segments(lengths)
    base = random_star_clip(rng, cut)
    skeleton = base.skeleton.with_offsets(base.skeleton.offsets * 2)
    grown = replace(random_star_clip(rng, cut), skeleton=skeleton, positions=base.positions * 2)
    donors = replace(cut, clip=np.ones(len(cut), int))
    part = transplant(base, cut, donors, [base, grown], GROUP, Config())
    assert part.positions is None  # those of the base


def test_recombine_invalid_part_raises_value_error():
    base, _, _, part = random_graft(np.array([5, 6]), 1, Config(), moving=(3,))
    for name, factor, message in (
        ("rotations", np.nan, "`rotations` must be finite, got nan"),
        ("rotations", 0.5, "`rotations` must be unit quaternions"),
        ("positions", np.inf, "`positions` must be"),
    ):
        wrong = getattr(part, name).copy()
        wrong[3, 1] = factor * wrong[3, 1]
        with pytest.raises(ValueError, match=message):
            recombine(base, [replace(part, **{name: wrong})], "new")


UPPER = GraftedGroup(np.arange(7, 18))  # the chest and all joints below it


@few_examples(20)
@given(SEEDS, SEEDS)
def test_transplant_torso_world_only_turns_donor_trunk_about_up(a, b):
    base, donor = person(a), person(b)
    cut = tile_segments(np.array([39]))
    part = transplant(base, cut, cut, [donor], UPPER, Config(torso="world"))
    new = recombine(base, [part], "new")
    chest = 7
    turns = rotations.multiply(
        new.world_transforms()[0][:, chest],
        rotations.inverse(donor.world_transforms()[0][:, chest]),
    )
    np.testing.assert_allclose(turns[:, [0, 2]], 0.0, atol=1e-9)
    # Joints below the chest have the donor's local rotations.
    np.testing.assert_array_equal(new.rotations[:, 8:], donor.rotations[:, 8:])
    np.testing.assert_array_equal(new.rotations[:, :7], base.rotations[:, :7])
    # With torso="pelvis" the local rotation is the donor's.
    plain_part = transplant(base, cut, cut, [donor], UPPER, Config(torso="pelvis"))
    np.testing.assert_array_equal(plain_part.rotations, donor.rotations[:, UPPER.joints])


def with_hip_axes(motion, turn):
    """The same motion of a skeleton whose hips have other axes at rest."""
    turned = motion.rotations.copy()
    turned[:, 0] = rotations.multiply(turned[:, 0], turn)
    turned[:, UPPER.joints[0]] = rotations.multiply(
        rotations.inverse(turn), turned[:, UPPER.joints[0]]
    )
    return replace(motion, rotations=turned, channel_values=None)


@few_examples(20)
@given(SEEDS, SEEDS, st.lists(st.integers(0, 2), max_size=3), st.floats(-3, 3))
def test_transplant_torso_world_ignores_hip_axes_and_donor_heading(a, b, quarter_turns, yaw):
    """The hips may have any coordinate axis up at rest."""
    turn = rotations.IDENTITY
    for axis in quarter_turns:
        turn = rotations.multiply(rotations.from_axis_angle(np.eye(3)[axis], np.pi / 2), turn)
    base, donor = person(a), person(b)
    cut, config = tile_segments(np.array([12, 27])), Config(torso="world")
    part = transplant(base, cut, cut, [donor], UPPER, config)
    other = with_hip_axes(turn_motion(donor, rotations.exp(np.array([0.0, yaw, 0.0]))), turn)
    other = transplant(with_hip_axes(base, turn), cut, cut, [other], UPPER, config)
    turned = rotations.multiply(turn, other.rotations[:, 0])
    assert_same_rotations(turned, part.rotations[:, 0], 1e-6)


@few_examples(40)
@given(SEGMENT_LENGTHS, SEEDS, CONFIGS)
def test_transplant_lean_of_base_onto_itself_changes_no_bit(lengths, seed, config):
    config = replace(config, torso="world")
    cut = tile_segments(lengths)
    base = person(seed, int(lengths.sum()) + 1)
    part = transplant(base, cut, cut, [base], UPPER, config)
    np.testing.assert_array_equal(part.rotations, base.rotations[:, UPPER.joints])
    # One substitution gives unit quaternions in all frames.
    if len(lengths) > 2:
        chosen = np.arange(len(lengths))
        chosen[0] = len(lengths) - 1
        part = transplant(base, cut, cut[chosen], [base], UPPER, config)
        np.testing.assert_allclose(np.linalg.norm(part.rotations, axis=-1), 1.0, atol=1e-12)


def test_transplant_leans_change_only_trunks_on_other_groups():
    """Arms keep their rotation relative to the trunk, legs that relative to the pelvis."""
    base, donor = person(1), person(2)
    cut = tile_segments(np.array([39]))
    for joints in (np.arange(1, 4), np.arange(8, 12), np.arange(18)):
        own, *others = (
            transplant(base, cut, cut, [donor], GraftedGroup(joints, root=0), Config(torso=torso))
            for torso in ("pelvis", "world")
        )
        for other in others:
            np.testing.assert_array_equal(own.rotations, other.rotations)


@few_examples(20)
@given(SEGMENT_LENGTHS, SEEDS, CONFIGS, st.booleans(), st.integers(1, 400))
def test_transplant_any_number_of_joints_at_a_time_gives_same_bits(
    lengths, seed, config, has_root, n_values
):
    group = GraftedGroup(np.arange(18), root=0) if has_root else UPPER
    rng, cut = np.random.default_rng(seed), tile_segments(lengths)
    base = person(seed, int(lengths.sum()) + 1)
    # The root also has seams between the clips, which differ in its position only.
    clips = [base, replace(base, positions=base.positions + 1.0)]
    order = np.arange(len(cut)) if seed % 2 else rng.permutation(len(cut))
    donors = replace(cut[order], clip=rng.integers(0, 2, len(cut)))
    expected = transplant(base, cut, donors, clips, group, config)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mograft.blend.transplant._MAX_BLOCK_VALUES", n_values)
        found = transplant(base, cut, donors, clips, group, config)
    np.testing.assert_array_equal(found.rotations, expected.rotations)
    np.testing.assert_array_equal(found.seams, expected.seams)
    assert (expected.positions is not None) == has_root
    if has_root:
        np.testing.assert_array_equal(found.positions, expected.positions)


HEIGHT = 10.0
ROOT = frozenset({0})


def versions(seed, n_frames=40):
    """Two motions that differ by clear steps or by far less than the limits, and frames asked."""
    rng = np.random.default_rng(seed)
    before = random_star_clip(rng, tile_segments(np.array([n_frames - 1])), moving=(3,))
    is_off = np.repeat(rng.random(n_frames // 4) < 0.4, 4)
    joint = int(rng.integers(1, 4))
    # Just on one side of the limit or just on the other.
    angle = MAX_ANGLE * np.where(is_off, 1.02, 0.98)
    quats, positions = before.rotations.copy(), before.positions.copy()
    if rng.random() < 0.5:
        turn = rotations.from_axis_angle(np.eye(3)[rng.integers(3)], angle)
        quats[:, joint] = rotations.multiply(turn, quats[:, joint])
    else:
        positions[:, 3, rng.integers(3)] += 1e-4 * HEIGHT * np.where(is_off, 1.02, 0.98)
    quats *= rng.choice([-1.0, 1.0], (1, before.n_joints, 1))
    after = replace(before, rotations=quats, positions=positions, name="after", channel_values=None)
    return before, after, is_off, rng.random(n_frames) < rng.choice([0.0, 0.1])


def grow_frame_by_frame(is_new, is_off):
    """Add frames beside a new frame in which the motions differ until there are none (oracle)."""
    grown = is_new.copy()
    while True:
        beside = np.zeros_like(grown)
        beside[1:] |= grown[:-1]
        beside[:-1] |= grown[1:]
        more = grown | (beside & is_off)
        if (more == grown).all():
            return grown
        grown = more


@few_examples(60)
@given(SEEDS)
def test_splice_takes_exactly_frames_up_to_where_motions_agree(seed):
    before, after, is_off, is_new = versions(seed)
    spliced = splice(before, after, is_new, HEIGHT, ())
    assert spliced.name == after.name
    grown = grow_frame_by_frame(is_new, is_off)
    np.testing.assert_array_equal(spliced.rotations[~grown], before.rotations[~grown])
    np.testing.assert_array_equal(spliced.positions[~grown], before.positions[~grown])
    np.testing.assert_array_equal(spliced.channel_numbers()[~grown], before.channel_values[~grown])
    np.testing.assert_array_equal(spliced.positions[grown], after.positions[grown])
    assert_same_rotations(spliced.rotations[grown], after.rotations[grown], 1e-15)
    # Quaternions do not change sign where a range begins.
    for frame in np.flatnonzero(grown[1:] & ~grown[:-1]) + 1:
        assert ((spliced.rotations[frame] * before.rotations[frame]).sum(axis=1) > 0).all()


@few_examples(30)
@given(SEEDS, st.integers(0, 39))
def test_splice_takes_moving_joints_from_first_new_frame_on(seed, first):
    before, after, _, _ = versions(seed)
    shift = np.zeros_like(after.positions)
    shift[:, 0] = [0.3 * HEIGHT, 0.0, 0.0]
    after = replace(after, positions=before.positions + shift, rotations=before.rotations)
    is_new = np.arange(before.n_frames) == first
    spliced = splice(before, after, is_new, HEIGHT, ROOT)
    np.testing.assert_array_equal(spliced.positions[:first], before.positions[:first])
    np.testing.assert_array_equal(spliced.positions[first:, 0], after.positions[first:, 0])
    np.testing.assert_array_equal(spliced.positions[:, 1:], before.positions[:, 1:])
