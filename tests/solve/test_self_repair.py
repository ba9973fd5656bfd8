"""Self-repair: donors at defects are replaced, and nothing else changes."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mograft as mg
import mograft.constraints as mc
from mograft.body.anatomy import feature_joints
from mograft.body.contacts import Ground
from mograft.body.faults import find_faults
from mograft.body.mass import mass_model
from mograft.dancer import dance
from mograft.motion import rotations
from mograft.solve import defects
from mograft.solve.assembly import Assembly, Excerpt
from mograft.solve.plan import GraftPlan
from mograft.solve.self_repair import self_repair
from mograft.synthesis.graft_building import build_graft
from tests.strategies import few_examples

HALF_WIDTH = 4  # frames at 30 frames per second
GLITCH_DEGREES = 20.0
LIMITS = np.array([defects.MAX_SEAM_RATIO, defects.MAX_SEAM_RATIO, defects.MAX_JERK_RATIO, 1.0])


@pytest.fixture(scope="module")
def library():
    """Two clips with a treatment that leaves some seams rough; "gradient" leaves none of them."""
    motion = dance(seed=1, strides=2).motion
    clips = [motion[:900], replace(motion[900:], name="second")]
    return mg.Library.build(clips, config=mg.Config(seam="offset"))


@pytest.fixture(scope="module")
def four_groups():
    return mg.Library.build(dance(seed=1, strides=2).motion, "lower_torso_larm_rarm")


def with_config(library, **changes):
    return replace(library, config=replace(library.config, **changes))


def graft_pair(library, **arguments):
    """Return a graft without and with self-repair."""
    libraries = [with_config(library, self_repair=is_on) for is_on in (False, True)]
    return [mg.graft(own, **arguments) for own in libraries]


def peaks(motion, joints, frame):
    """Return the greatest angular acceleration and jerk of joints about a frame, per frame."""
    accelerations, jerks = [0.0], [0.0]
    for at in range(frame - HALF_WIDTH, frame + HALF_WIDTH + 1):
        if at < 1 or at > motion.n_frames - 2:
            continue
        quats = motion.rotations[at - 1 : at + 3, joints]
        steps = rotations.log(rotations.multiply(rotations.inverse(quats[:-1]), quats[1:]))
        accelerations.append(np.linalg.norm(steps[1] - steps[0], axis=-1).max())
        if len(steps) == 3:
            jerk = steps[2] - 2 * steps[1] + steps[0]
            jerks.append(np.linalg.norm(jerk, axis=-1).max())
    return np.array([max(accelerations), max(jerks)])


def seam_ratios(graft):
    """Return acceleration and jerk at seams relative to base and donors, by loops over frames."""
    library = graft.library
    clips = {entry.name: clip for entry, clip in zip(library.entries, library.clips, strict=True)}
    joints = feature_joints(library.skeleton, library.joints("upper"))
    own = [s for s in graft.substitutions if s.group == "upper"]
    found = {}
    for before, after in itertools.pairwise(own):
        if before.is_own and after.is_own:
            continue
        known = [
            peaks(graft.base, joints, before.stop),
            peaks(clips[before.clip], joints, before.donor_stop),
            peaks(clips[after.clip], joints, after.donor_start),
        ]
        reached = peaks(graft.motion, joints, before.stop)
        found[before.stop] = reached / np.maximum(np.max(known, axis=0), 1e-6)
    return found


@few_examples(2)
@given(st.integers(0, 1000))
def test_defect_amounts_above_limit_equal_ratios_of_loops_over_frames(library, seed):
    """Up to the limit, an amount may be the greater ratio to the base alone."""
    rough = with_config(library, self_repair=False, seam="gradient", choice="nearest")
    plan = GraftPlan.build(rough, None, None, ())
    donors = plan.choose_donors(1, seed)[0]
    graft = build_graft(plan, donors, seed, 0)
    problem = plan.problem
    whole = [Excerpt(donors, 0, len(problem.base_segments))]
    amounts = defects.DefectMeasure(problem, "upper").amounts(graft.motion, whole)[0] * LIMITS
    expected = np.zeros((len(amounts), 2))
    for frame, ratios in seam_ratios(graft).items():
        position = int(np.flatnonzero(problem.base_segments.stop == frame)[0])
        for side in (position, position + 1):
            expected[side] = np.maximum(expected[side], ratios)
    is_high = (expected > 1.02 * defects.MAX_SEAM_RATIO) | (
        amounts[:, :2] > 1.02 * defects.MAX_SEAM_RATIO
    )
    assert is_high.any()
    np.testing.assert_allclose(amounts[:, :2][is_high], expected[is_high], rtol=0.02)
    assert (amounts[:, :2] >= 0.98 * expected).all()


@few_examples(2)
@given(st.integers(0, 1000), st.sampled_from(["sample", "viterbi", "nearest"]))
def test_self_repair_never_increases_the_greatest_seam_ratio(library, seed, choice):
    before, after = graft_pair(with_config(library, choice=choice), seed=seed)
    before, after = (np.array([*seam_ratios(own).values()]) for own in (before, after))
    worst = max(before.max(initial=0.0), defects.MAX_SEAM_RATIO)
    assert after.max(initial=0.0) <= 1.01 * worst


@few_examples(4)
@given(st.integers(0, 1000))
def test_self_repair_changes_only_windows_that_it_reports(library, seed):
    before, after = graft_pair(library, seed=seed)
    assert not before.self_repairs
    if not after.self_repairs:
        assert before.motion.rotations.tobytes() == after.motion.rotations.tobytes()
        assert before.motion.positions.tobytes() == after.motion.positions.tobytes()
    for old, new in zip(before.substitutions, after.substitutions, strict=True):
        reported = any(
            own.after < own.before and own.start <= new.start and new.stop <= own.stop
            for own in after.self_repairs
        )
        assert reported or old == new or old.donor == new.donor
    assert all(own.after <= own.before and own.before > 1.0 for own in after.self_repairs)


def with_glitch(motion, frame, joints, degrees):
    """Return a motion in which joints are turned in a single frame."""
    quats = motion.rotations.copy()
    turn = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), np.radians([degrees]))
    quats[frame, joints] = rotations.multiply(quats[frame, joints], turn)
    return replace(motion, rotations=quats, channel_values=None, name="second")


def smooth(motion):
    """Return a motion whose rotations and positions are averages of five frames."""
    around = np.arange(motion.n_frames)[:, None] + np.arange(-2, 3)
    around = around.clip(0, motion.n_frames - 1)
    quats = motion.rotations[around] * np.sign(
        (motion.rotations[around] * motion.rotations[:, None]).sum(-1, keepdims=True)
    )
    mean = quats.mean(axis=1)
    mean /= np.linalg.norm(mean, axis=-1, keepdims=True)
    places = motion.positions[around].mean(axis=1)
    return replace(motion, rotations=mean, positions=places, channel_values=None, name="smooth")


def jerk_magnitudes(motion, joints):
    """Return world jerk from positions, assigned to the second of four frames; NaN at the ends."""
    found = np.full((motion.n_frames, len(joints)), np.nan)
    steps = np.diff(motion.world_positions()[:, joints], n=3, axis=0)
    found[1:-2] = np.linalg.norm(steps, axis=-1)
    return found


@few_examples(1)
@given(st.integers(0, 1000))
def test_jerk_amounts_above_limit_equal_ratios_to_base_and_rest_of_donor_clips(library, seed):
    base = smooth(library.clips[0])
    own = mg.Library.build([base, library.clips[1]])
    plan = GraftPlan.build(with_config(own, self_repair=False), None, None, ())
    donors = plan.choose_donors(1, seed)[0]
    motion = build_graft(plan, donors, seed, 0).motion
    segments, cut = own.segments, plan.problem.base_segments
    whole = [Excerpt(donors, 0, len(cut))]
    amounts = defects.DefectMeasure(plan.problem, "upper").amounts(motion, whole)[0][:, 2]
    joints = feature_joints(base.skeleton, np.flatnonzero(plan.problem.driven_joints["upper"]))
    reached, known = jerk_magnitudes(motion, joints), jerk_magnitudes(base, joints)
    own_limits = defects.MAX_JERK_RATIO * np.percentile(np.nan_to_num(known), 99.9, axis=0)
    n_excused = 0
    for position in range(1, len(cut) - 1):
        frames = slice(cut.start[position], cut.stop[position])
        by_base = np.fmax(own_limits, known[frames])
        limits = by_base.copy()
        for donor in donors["upper"][position - 1 : position + 2]:
            jerk = np.nan_to_num(jerk_magnitudes(own.clips[segments.clip[donor]], joints))
            is_rest = np.ones(len(jerk), bool)
            is_rest[max(segments.start[donor] - 2, 0) : segments.stop[donor] + 2] = False
            percentiles = np.percentile(jerk[is_rest], 99.9, axis=0)
            limits = np.maximum(limits, defects.MAX_JERK_RATIO * percentiles)
        expected = np.nanmax(reached[frames] / limits)
        if amounts[position] == 0.0:  # nothing is exchanged here
            continue
        if expected > 1.0 or amounts[position] > 1.0:
            assert amounts[position] == pytest.approx(expected, rel=1e-6)
        n_excused += expected <= 1.0 < np.nanmax(reached[frames] / by_base)
    assert n_excused


def test_self_repair_donor_with_glitch_is_replaced_if_another_candidate_exists(library):
    """The glitch is below the threshold of the fault detector, so its segment remains a donor."""
    arms = [library.skeleton.index(name) for name in ("LeftArm", "RightArm")]
    n_planted = 0
    for seed in range(6):
        chosen = mg.graft(with_config(library, self_repair=False), seed=seed)
        position, donor = next(
            (position, own)
            for position, own in enumerate(chosen.substitutions)
            if own.clip == "second" and own.stop - own.start > 6
        )
        middle = (donor.donor_start + donor.donor_stop) // 2
        glitched = with_glitch(library.clips[1], middle, arms, GLITCH_DEGREES)
        assert not find_faults(glitched)
        plan = GraftPlan.build(replace(library, clips=(library.clips[0], glitched)), None, None, ())
        if len(plan.trellises["upper"].candidates[position]) < 2:
            continue
        n_planted += 1
        repaired = build_graft(plan, chosen.donors, seed, 0)
        assert repaired.donors["upper"][position] != donor.donor
        assert any(own.start <= donor.start <= own.stop for own in repaired.self_repairs)
    assert n_planted >= 4


@few_examples(4)
@given(st.integers(0, 1000), st.sampled_from([0.5, 0.25]))
def test_self_repair_no_seam_exceeds_max_angle_by_more_than_before(four_groups, seed, share):
    """The law holds at each frame and also if the limit excludes most donors."""
    max_angle = share * four_groups.config.max_angle
    before, after = graft_pair(with_config(four_groups, max_angle=max_angle), seed=seed)
    first = {(seam.group, seam.frame): seam.gap for seam in before.seams}
    for seam in after.seams:
        old = first.get((seam.group, seam.frame), 0.0)
        assert seam.gap <= max(max_angle, old) + 1e-12


def build_plan(library, seed, constraints=()):
    """Return a plan and the assembly of its first donor sequences."""
    plan = GraftPlan.build(library, None, None, constraints)
    return plan, Assembly.build(plan.problem, plan.choose_donors(1, seed)[0], "")


@pytest.mark.parametrize("first_error", [0.0, 3.0])
def test_self_repair_window_that_violates_a_constraint_more_keeps_its_donors(library, first_error):
    """A smaller violation of another constraint does not compensate."""
    constraints = (mc.MaxAngle(1.0), mc.MaxAngle(2.0))
    plan, first = build_plan(with_config(library, choice="sample"), 1, constraints)
    free, windows = self_repair(first, plan.trellises, lambda _: [])
    positions = np.flatnonzero(free.donors["upper"] != first.donors["upper"])
    frame = int(plan.problem.base_segments.start[positions[0]])

    def violations(assembly):
        is_first = (assembly.donors["upper"] == first.donors["upper"])[positions[0]]
        errors = (9.0, first_error) if is_first else (2.0, 4.0)
        return [
            mc.Violation(own, (frame, frame), frame, error, "", "")
            for own, error in zip(constraints, errors, strict=True)
            if error
        ]

    new, _ = self_repair(first, plan.trellises, violations)
    is_inside = [own.start <= frame < own.stop for own in windows]
    assert sum(is_inside) == 1 < len(windows)
    assert new.donors["upper"][positions[0]] == first.donors["upper"][positions[0]]
    for own, is_reverted in zip(windows, is_inside, strict=True):
        inside = plan.problem.base_segments.start >= own.start
        inside &= plan.problem.base_segments.stop <= own.stop
        expected = first if is_reverted else free
        np.testing.assert_array_equal(new.donors["upper"][inside], expected.donors["upper"][inside])


def test_self_repair_is_reported_as_text_and_json(library):
    graft = next(own for seed in range(50) if (own := mg.graft(library, seed=seed)).self_repairs)
    window = graft.self_repairs[0]
    records = json.loads(json.dumps(mg.graft_record(graft)))["self_repair"]
    assert records[0]["frames"] == [window.start, window.stop]
    assert records[0]["before"] > 1.0 >= records[0]["after"]
    assert f"frames {window.start}-{window.stop}: {window.measure}" in graft.report()


def test_self_repair_is_off_in_paper_preset_and_in_random_draws(library):
    assert not mg.Config.paper().self_repair
    for choice in ("random",):
        before, after = graft_pair(with_config(library, choice=choice), seed=1)
        np.testing.assert_array_equal(before.donors["upper"], after.donors["upper"])
        assert not after.self_repairs


def depths_below_floor(motion, floor_reference):
    """Return the depths of heels, toes, wrists and ends of hands, one column per point."""
    ground, model = Ground.of(floor_reference), mass_model(motion.skeleton)
    depths = [-ground.above(ground.points(motion)).reshape(motion.n_frames, -1)]
    quats, positions = motion.world_transforms()
    for name in ("LeftHand", "RightHand"):
        hand = motion.skeleton.index(name)
        end = positions[:, hand] + rotations.rotate(quats[:, hand], model.bone[hand])
        for point in (positions[:, hand], end):
            depths.append((ground.floors.min() - point @ ground.up)[:, None])
    return np.concatenate(depths, axis=1) / model.height


def floor_ratios(graft_motion, base, segments):
    """Return for each base segment the greatest depth relative to its limit."""
    captured = depths_below_floor(base, base)
    limits = np.percentile(captured, 99.9, axis=0).clip(min=0.0) + defects.MAX_ADDED_DEPTH
    depths = depths_below_floor(graft_motion, base) / np.maximum(limits, captured)
    ranges = zip(segments.start.tolist(), segments.stop.tolist(), strict=True)
    return np.array([max(depths[first:last].max(), 0.0) for first, last in ranges])


@few_examples(3)
@given(st.integers(0, 1000))
def test_defect_amounts_of_floor_depth_equal_ratios_to_the_percentile_in_the_base(
    root_library, seed
):
    plan, first = build_plan(root_library, seed)
    segments = plan.problem.base_segments
    whole = [Excerpt(first.donors, 0, len(segments))]
    amounts = defects.DefectMeasure(plan.problem, "lower").amounts(first.motion, whole)[0][:, 3]
    expected = floor_ratios(first.motion, plan.problem.base, segments)
    changed = first.donors["lower"] != plan.problem.scenario
    beside = np.convolve(changed, np.ones(3), "same") > 0
    # The last frame of a excerpt belongs to its last position.
    np.testing.assert_allclose(amounts[:-1], (expected * beside)[:-1], rtol=1e-9, atol=1e-12)
    assert amounts.max() > 0.0


def test_self_repair_of_donors_that_drive_the_root_reduces_floor_depth(root_library):
    grafts = [mg.graft(root_library, seed=seed) for seed in range(6)]
    segments = root_library.segments[root_library.segments.of_clip(0)]
    windows = [w for own in grafts for w in own.self_repairs if w.measure == "floor depth"]
    assert any(own.after <= 1.0 < own.before for own in windows)
    for graft, seed in zip(grafts, range(6), strict=True):
        first = mg.graft(with_config(root_library, self_repair=False), seed=seed)
        before, after = (floor_ratios(own.motion, own.base, segments) for own in (first, graft))
        assert after.max() <= max(before.max(), 1.0) + 1e-9
