"""Self-repair: donors at defects are replaced, and nothing else changes."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import uniform_filter1d

import mograft as mg
import mograft.constraints as mc
from mograft.body.anatomy import feature_joints
from mograft.body.contacts import Ground
from mograft.body.mass import mass_model
from mograft.dancer import dance
from mograft.motion import rotations
from mograft.solve import defects
from mograft.solve.assembly import Assembly, Excerpt
from mograft.solve.plan import GraftPlan
from mograft.solve.self_repair import self_repair
from tests.strategies import few_examples, with_config

HALF_WIDTH = 4  # frames at 30 frames per second
LIMITS = np.array([defects.MAX_SEAM_RATIO, defects.MAX_SEAM_RATIO, defects.MAX_JERK_RATIO, 1.0])


@pytest.fixture(scope="module")
def library():
    """Two clips with a treatment that leaves some seams rough; "gradient" leaves none of them."""
    motion = dance(seed=1, strides=2).motion
    clips = [motion[:900], replace(motion[900:], name="second")]
    return mg.Library.build(clips, config=mg.Config(seam="offset"))


@pytest.fixture(scope="module")
def libraries(library, root_library):
    """One or several exchanged groups, or one that drives the root."""
    four_groups = mg.Library.build(dance(seed=1, strides=2).motion, "lower_torso_larm_rarm")
    return library, four_groups, root_library


def build_plan(library, seed, constraints=()):
    """Return a plan and the assembly of its first donor sequences."""
    plan = GraftPlan.build(library, None, None, constraints)
    return plan, Assembly.build(plan.problem, plan.choose_donors(1, seed)[0], "")


def amounts_of(assembly):
    """Return the amounts at each position of an assembly, by group."""
    whole = [Excerpt(assembly.donors, 0, len(assembly.problem.base_segments))]
    measures = {group: defects.DefectMeasure(assembly.problem, group) for group in assembly.donors}
    return {group: own.amounts(assembly.motion, whole)[0] for group, own in measures.items()}


def angular_rates(motion, joints):
    """Return the greatest angular acceleration and jerk of joints in each frame, per frame."""
    quats, rates = motion.rotations[:, joints], np.zeros((2, motion.n_frames))
    steps = rotations.log(rotations.multiply(rotations.inverse(quats[:-1]), quats[1:]))
    rates[0, 1:-1] = np.linalg.norm(np.diff(steps, axis=0), axis=-1).max(axis=1)
    rates[1, 1:-2] = np.linalg.norm(np.diff(steps, n=2, axis=0), axis=-1).max(axis=1)
    return rates


def seam_ratios(assembly):
    """Return acceleration and jerk relative to base and donors at each exchanged seam."""
    problem, donors = assembly.problem, assembly.donors["upper"]
    library, taken = problem.library, problem.library.segments[donors]
    joints = feature_joints(library.skeleton, library.joints("upper"))
    motions = [assembly.motion, problem.base, *library.clips]
    rates = [angular_rates(own, joints) for own in motions]

    def peak(which, frame):
        return rates[which][:, max(frame - HALF_WIDTH, 0) : frame + HALF_WIDTH + 1].max(axis=1)

    found = {}
    is_new = donors != problem.scenario
    for at in np.flatnonzero(is_new[:-1] | is_new[1:]).tolist():
        frame = problem.base_segments.stop[at]
        known = [
            peak(1, frame),
            peak(2 + taken.clip[at], taken.stop[at]),
            peak(2 + taken.clip[at + 1], taken.start[at + 1]),
        ]
        found[at] = peak(0, frame) / np.maximum(np.max(known, axis=0), 1e-6)
    return found


@few_examples(2)
@given(st.integers(0, 1000))
def test_defect_amounts_above_limit_equal_ratios_to_base_and_donors(library, seed):
    """Up to the limit, an amount may be the greater ratio to the base alone."""
    _, first = build_plan(with_config(library, seam="gradient", choice="nearest"), seed)
    amounts = amounts_of(first)["upper"][:, :2] * LIMITS[:2]
    expected = np.zeros_like(amounts)
    for position, ratios in seam_ratios(first).items():
        for side in (position, position + 1):
            expected[side] = np.maximum(expected[side], ratios)
    is_high = np.maximum(amounts, expected) > 1.02 * defects.MAX_SEAM_RATIO
    assert is_high.any()
    np.testing.assert_allclose(amounts[is_high], expected[is_high], rtol=0.02)
    assert (amounts >= 0.98 * expected).all()


def jerk_magnitudes(motion, joints):
    """Return world jerk from positions, assigned to the second of four frames; 0 at the ends."""
    found = np.zeros((motion.n_frames, len(joints)))
    steps = np.diff(motion.world_positions()[:, joints], n=3, axis=0)
    found[1:-2] = np.linalg.norm(steps, axis=-1)
    return found


def smooth(motion):
    """Return a motion whose rotations and positions are averages of five frames."""
    quats = uniform_filter1d(rotations.continuous_signs(motion.rotations), 5, axis=0)
    quats /= np.linalg.norm(quats, axis=-1, keepdims=True)
    places = uniform_filter1d(motion.positions, 5, axis=0)
    return replace(motion, rotations=quats, positions=places, channel_values=None, name="smooth")


@few_examples(1)
@given(st.integers(0, 1000))
def test_jerk_amounts_above_limit_equal_ratios_to_base_and_rest_of_donor_clips(library, seed):
    own = mg.Library.build([smooth(library.clips[0]), library.clips[1]])
    plan, first = build_plan(own, seed)
    amounts, cut = amounts_of(first)["upper"][:, 2], plan.problem.base_segments
    joints = np.flatnonzero(plan.problem.driven_joints["upper"])
    joints = feature_joints(own.skeleton, joints)
    jerks = [jerk_magnitudes(clip, joints) for clip in own.clips]
    reached, own_limits = jerk_magnitudes(first.motion, joints), np.percentile(jerks[0], 99.9, 0)
    n_excused = 0
    # Where amounts are 0, nothing is exchanged.
    for position in np.flatnonzero(amounts[1:-1]) + 1:
        frames = slice(cut.start[position], cut.stop[position])
        by_base = np.maximum(defects.MAX_JERK_RATIO * own_limits, jerks[0][frames])
        limits = by_base
        for donor in first.donors["upper"][position - 1 : position + 2]:
            segment = own.segments[donor : donor + 1]
            inside = np.arange(int(segment.start[0]) - 2, int(segment.stop[0]) + 2)
            rest = np.delete(jerks[segment.clip[0]], inside[inside >= 0], axis=0)
            limits = np.maximum(limits, defects.MAX_JERK_RATIO * np.percentile(rest, 99.9, axis=0))
        expected = (reached[frames] / limits).max()
        if max(expected, amounts[position]) > 1.0:
            assert amounts[position] == pytest.approx(expected, rel=1e-6)
        n_excused += expected <= 1.0 < (reached[frames] / by_base).max()
    assert n_excused


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


@few_examples(3)
@given(st.integers(0, 1000))
def test_defect_amounts_of_floor_depth_equal_ratios_to_the_percentile_in_the_base(
    root_library, seed
):
    plan, first = build_plan(root_library, seed)
    base, cut = plan.problem.base, plan.problem.base_segments
    captured = depths_below_floor(base, base)
    limits = np.percentile(captured, 99.9, axis=0).clip(min=0.0) + defects.MAX_ADDED_DEPTH
    ratios = depths_below_floor(first.motion, base) / np.maximum(limits, captured)
    expected = np.maximum.reduceat(ratios.max(axis=1).clip(min=0.0), cut.start)
    changed = first.donors["lower"] != plan.problem.scenario
    beside = np.convolve(changed, np.ones(3), "same") > 0
    amounts = amounts_of(first)["lower"][:, 3]
    np.testing.assert_allclose(amounts, expected * beside, rtol=1e-9, atol=1e-12)
    assert amounts.max() > 0.0


@few_examples(12)
@given(
    st.integers(0, 2),
    st.integers(0, 1000),
    st.sampled_from(["sample", "viterbi", "nearest"]),
    st.sampled_from([1.0, 0.5, 0.25]),
)
def test_self_repair_reduces_defects_in_the_windows_that_it_reports(
    libraries, which, seed, choice, share
):
    """Also if the limit of the seam angle excludes most donors."""
    library = libraries[which]
    max_angle = share * library.config.max_angle
    plan, first = build_plan(with_config(library, choice=choice, max_angle=max_angle), seed)
    new, windows = self_repair(first, plan.trellises, lambda _: [])
    worst, new_worst = (
        max(own.max() for own in amounts_of(each).values()) for each in (first, new)
    )
    assert new_worst <= max(worst, 1.0)
    assert all(own.before > 1.0 for own in windows)
    # Donors that drive the root also move what follows the window.
    assert which == 2 or all(own.after <= own.before for own in windows)
    cut = plan.problem.base_segments
    for group, pool in plan.pools.items():
        is_changed = new.donors[group] != first.donors[group]
        for own in windows:
            if own.group == group and own.after < own.before:
                is_changed &= (cut.start < own.start) | (cut.stop > own.stop)
        assert not is_changed.any()
        old, angles = (pool.seam_angles_along(each.donors[group]) for each in (first, new))
        assert (angles <= np.maximum(old, max_angle) + 1e-12).all()


def test_self_repair_reduces_floor_depth_of_donors_that_drive_the_root(root_library):
    windows = [own for seed in range(6) for own in mg.graft(root_library, seed=seed).self_repairs]
    depths = [own for own in windows if own.measure == "floor depth"]
    assert any(own.after <= 1.0 < own.before for own in depths)


@few_examples(3)
@given(st.integers(0, 1000))
def test_self_repair_violates_no_constraint_more_than_before(library, seed):
    """A smaller violation of another constraint does not compensate."""
    sky = mc.HalfSpace((0.0, 900.0, 0.0), (0.0, 1.0, 0.0))
    starts = range(0, 840, 60)
    constraints = [mc.KeepOut("LeftHand", sky, frames=(at, at + 50)) for at in starts]
    plan = GraftPlan.build(library, None, None, constraints)
    first = build_plan(library, seed)[1].donors
    first = Assembly.build(plan.problem, first, "")
    new, windows = self_repair(first, plan.trellises, plan._violations)
    assert any(own.after < own.before for own in windows)
    before, after = (
        {own.constraint.frames: own.error for own in plan._violations(each)}
        for each in (first, new)
    )
    assert before.keys() == after.keys() == {own.frames for own in constraints}
    assert all(after[frames] <= before[frames] + 1e-9 for frames in before)


def test_self_repair_is_reported_as_text_and_json_unless_it_is_off(library):
    graft = next(own for seed in range(50) if (own := mg.graft(library, seed=seed)).self_repairs)
    window = graft.self_repairs[0]
    records = json.loads(json.dumps(mg.graft_record(graft)))["self_repair"]
    assert records[0]["frames"] == [window.start, window.stop]
    assert records[0]["before"] > 1.0 >= records[0]["after"]
    assert f"frames {window.start}-{window.stop}: {window.measure}" in graft.report()
    off = mg.graft(with_config(library, self_repair=False), seed=graft.seed)
    assert not off.self_repairs
    assert off.substitutions != graft.substitutions


def test_self_repair_is_off_in_paper_preset_and_in_random_draws(library):
    assert not mg.Config.paper().self_repair
    off, on = (with_config(library, choice="random", self_repair=own) for own in (False, True))
    graft = mg.graft(on, seed=1)
    assert graft.substitutions == mg.graft(off, seed=1).substitutions
    assert not graft.self_repairs
