"""Laws of constraints: what they measure, what a graft does about them, and what it tells."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mograft as mg
from mograft.body.capsules import capsules
from mograft.dancer import dance
from mograft.search.constraints import find_violations
from mograft.search.donor_choice import cost_model
from mograft.synthesis.assembly import assemble, donor_excess, donor_excesses
from mograft.synthesis.donor_poses import candidate_poses
from mograft.synthesis.donor_repair import repair_donors
from mograft.synthesis.donor_trellis import build_trellis, candidate_violations
from mograft.synthesis.search_problem import SearchProblem
from tests.oracles.capsules import capsule_distances
from tests.strategies import SEEDS, vectors

HAND = "LeftHand"


@pytest.fixture(scope="module")
def motion():
    return dance(seed=1, strides=2).motion


@pytest.fixture(scope="module")
def library(motion):
    return mg.Library.build([motion[:900], replace(motion[900:], name="second")])


@pytest.fixture(scope="module")
def poses(motion):
    return mg.Poses.from_motion(motion[:200])


def problem_of(library, constraints, groups=("upper",)):
    scenario = library.segments.of_clip(0)
    cut = library.segments[scenario]
    return SearchProblem.build(library, library.clips[0], scenario, cut, list(groups), constraints)


def donors_of(graft, group="upper"):
    return np.array([s.donor for s in graft.substitutions if s.group == group])


# What they measure


def dense_depth(poses, center, radius):
    """Return the penetration depth of a sphere, by points along the capsule axes."""
    share = np.linspace(0, 1, 60)[:, None]
    starts, stops = poses.ends[:, :, 0], poses.ends[:, :, 1]
    points = starts[:, :, None] * (1 - share) + stops[:, :, None] * share
    apart = np.linalg.norm(points - center, axis=-1).min(axis=2)
    return (poses.capsules.radii + radius - apart).max(axis=1)


@settings(max_examples=25, deadline=None)
@given(vectors((), 100.0), st.floats(1.0, 60.0))
def test_obstacle_distances_match_dense_points(poses, center, radius):
    center = center + np.array([0, 100, 0])
    expected = np.maximum(dense_depth(poses, center, radius), 0) / poses.height
    error, joint = mg.Avoid(mg.Sphere(tuple(center), radius)).errors(poses)
    np.testing.assert_allclose(error * 0.005, expected, atol=2e-3)
    assert (joint >= 0).all()
    pole = mg.Capsule(tuple(center), tuple(center), radius)
    np.testing.assert_allclose(mg.Avoid(pole).errors(poses)[0], error)
    wide, _ = mg.Avoid(mg.Sphere(tuple(center), radius), margin=0.1).errors(poses)
    deeper = np.where(error > 0, error + 0.1 / 0.005, wide)
    np.testing.assert_allclose(wide, deeper, rtol=1e-9)


def test_half_space_and_large_box_agree(poses):
    hip = poses.positions[0, 0]
    wall = mg.HalfSpace(tuple(hip), (0, 0, -2.0))
    block = mg.Box(tuple(hip + np.array([0, 0, 5000.0])), (9000, 9000, 5000))
    ours, _ = mg.Avoid(wall).errors(poses)
    theirs, _ = mg.Avoid(block).errors(poses)
    np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-4)
    turned = mg.Box(
        tuple(hip + np.array([0, 0, 5000.0])), (5000, 9000, 9000), (0, 0.5**0.5, 0, 0.5**0.5)
    )
    np.testing.assert_allclose(mg.Avoid(turned).errors(poses)[0], theirs, rtol=1e-6, atol=1e-4)


def test_character_distance_follows_its_motion(motion, poses):
    near = mg.Character(motion[:200], offset=(50.0, 0, 0))
    error, _ = mg.Avoid(near).errors(poses)
    flesh = poses.capsules
    for frame in (0, 77, 199):
        gaps = []
        for a in range(len(flesh)):
            for b in range(len(flesh)):
                one, other = poses.ends[frame, a], poses.ends[frame, b] + [50.0, 0, 0]
                s, t = np.meshgrid(np.linspace(0, 1, 40), np.linspace(0, 1, 40))
                points = one[0] + s[..., None] * (one[1] - one[0])
                others = other[0] + t[..., None] * (other[1] - other[0])
                apart = np.linalg.norm(points - others, axis=-1).min()
                gaps.append(apart - flesh.radii[a] - flesh.radii[b])
        depth = max(-min(gaps), 0) / poses.height
        assert error[frame] * 0.005 == pytest.approx(depth, abs=2e-3)
    late = mg.Avoid(mg.Character(motion[:200], (50.0, 0, 0), delay=1.0)).errors(poses)[0]
    shifted = mg.Poses.from_motion(motion[:200])
    first = mg.Avoid(mg.Character(motion[:1], (50.0, 0, 0))).errors(shifted)[0]
    np.testing.assert_array_equal(late[:30], first[:30])
    turned = mg.Avoid(mg.Character(motion[:200], yaw=2 * np.pi)).errors(poses)[0]
    np.testing.assert_allclose(turned, mg.Avoid(mg.Character(motion[:200])).errors(poses)[0])


def test_reach_and_keep_out_measure_joint_positions(poses):
    place = poses.joint_positions(HAND)[40]
    aside = tuple(place + np.array([0.06 * poses.height, 0, 0]))
    error, joint = mg.Reach(HAND, aside, 40).errors(poses)
    assert error[40] == pytest.approx(2.0)
    assert error.sum() == error[40]
    assert poses.skeleton.names[joint[40]] == HAND
    ball = mg.Sphere(tuple(place), 0.02 * poses.height)
    assert mg.KeepOut(HAND, ball, frames=(40, 40)).errors(poses)[0][40] == pytest.approx(4.0)
    inside = mg.KeepOut(HAND, mg.Sphere(aside, 0.02 * poses.height), inside=True, frames=(40, 40))
    assert inside.errors(poses)[0][40] == pytest.approx(8.0)


def test_face_rest_pose_looks_forward():
    skeleton = dance(strides=1).motion.skeleton
    rest = mg.Motion(
        skeleton, 1 / 30, np.tile([0, 0, 0, 1.0], (2, skeleton.n_joints, 1)), [skeleton.offsets] * 2
    )
    head = rest.world_positions()[0, skeleton.index("Head")]
    for target, angle in (((0, 0, 900), 0.0), ((900, 0, 0), 90.0), ((0, 0, -900), 180.0)):
        face = mg.Face(tuple(head + target))
        assert np.degrees(
            face.errors(mg.Poses.from_motion(rest))[0][0] * face.tolerance
        ) == pytest.approx(angle, abs=1e-6)


def test_avoid_self_captured_motion_satisfies_it(poses):
    constraint = mg.AvoidSelf()
    depth = constraint.self_collision_depth(poses)
    captured = mg.AvoidSelf(captured=depth)
    assert captured.errors(poses)[0].max() <= 1e-9
    # A hand put into the chest is felt.
    flesh, placed = poses.capsules, poses.positions.copy()
    skeleton = poses.skeleton
    placed[5, skeleton.index(HAND)] = placed[5, skeleton.index("Spine")] + [0, 15.0, 0]
    bent = poses.with_poses(poses.frames, poses.rotations, placed)
    error, joint = captured.errors(bent)
    assert error[5] > 1
    assert skeleton.names[joint[5]] == HAND
    assert len(flesh) == len(capsules(skeleton))


def scattered(poses, rng, frames=8):
    """Return poses with displaced limbs that are likely to overlap."""
    rows = rng.choice(len(poses), frames)
    moved = poses.positions[rows] + rng.normal(size=(frames, poses.skeleton.n_joints, 3)) * 8.0
    return poses.with_poses(poses.frames[rows], poses.rotations[rows], moved)


@settings(max_examples=10, deadline=None)
@given(SEEDS)
def test_avoid_self_depth_is_that_of_deepest_pair(poses, seed):
    some = scattered(poses, np.random.default_rng(seed))
    flesh = some.capsules
    parts, sides = np.array(flesh.parts), np.array(flesh.sides)
    arm, rest = (
        np.isin(parts, names)
        for names in (["hand", "forearm"], ["pelvis", "trunk", "head", "thigh"])
    )
    kept = arm[:, None] & (rest | (arm & (sides[:, None] != sides)))
    apart = capsule_distances(some.ends, flesh.radii, some.ends, flesh.radii)
    deepest = -np.where(kept, apart, np.inf).min(axis=(1, 2)) / some.height
    constraint = mg.AvoidSelf(captured=0.01)
    error, _ = constraint.errors(some)
    np.testing.assert_allclose(
        error * constraint.tolerance, np.maximum(deepest - 0.01, 0), atol=1e-6
    )


@settings(max_examples=25, deadline=None)
@given(SEEDS)
def test_constraint_errors_are_maximum_over_joints(poses, seed):
    rng = np.random.default_rng(seed)
    some, mask = scattered(poses, rng), rng.random(poses.skeleton.n_joints) < 0.5
    place = tuple(rng.normal(size=3) * 30 + np.array([0, 100, 0]))
    for constraint in (
        mg.Avoid(mg.Sphere(place, 40.0)),
        mg.Avoid(mg.Capsule((0.0, 0.0, 0.0), place, 20.0)),
        mg.AvoidSelf(),
    ):
        whole, _ = constraint.errors(some)
        parts = [constraint.errors(some, joints) for joints in (mask, ~mask)]
        np.testing.assert_array_equal(whole, np.maximum(parts[0][0], parts[1][0]))
        for joints, (_, blamed) in zip((mask, ~mask), parts, strict=True):
            assert joints[blamed[blamed >= 0]].all()


def test_find_violations_reports_runs_with_worst_frame(poses):
    heights = poses.joint_positions(HAND)[:, 1]
    limit = float(np.median(heights))
    low = mg.KeepOut(HAND, mg.HalfSpace((0, limit, 0), (0, 1.0, 0)))
    found = find_violations([low], poses)
    below = (limit - heights) > 0.005 * poses.height
    covered = np.zeros(len(poses), bool)
    for violation in found:
        first, last = violation.frames
        covered[first : last + 1] = True
        assert violation.worst == first + heights[first : last + 1].argmin()
        assert violation.joint == HAND
        assert "heights inside, tolerance 0.005" in violation.message
    np.testing.assert_array_equal(covered, below)
    assert find_violations([replace(low, weight=1.0)], poses) == []


# What a graft does about them


def test_candidate_poses_match_assembled_motion(library):
    """Without seams the candidate poses equal those of the assembled motion."""
    problem = problem_of(library, [])
    own = problem.scenario[:6]
    poses = candidate_poses(problem, "upper", np.arange(6), own)
    world = library.clips[0].world_positions()
    np.testing.assert_allclose(poses.positions, world[poses.frames], atol=1e-9)


def test_candidate_errors_match_single_evaluation(library):
    ball = mg.Avoid(mg.Sphere((30.0, 130.0, 40.0), 40.0))
    soft = mg.Reach(HAND, (0.0, 150.0, 0.0), 50, weight=2.0)
    problem = problem_of(library, [ball, soft])
    found = candidate_violations(problem, "upper", {})
    joints = problem.driven_joints["upper"]
    for position in (0, 3, 9):
        for at, donor in enumerate(problem.candidates["upper"][position]):
            poses = candidate_poses(problem, "upper", np.array([position]), np.array([donor]))
            assert found[position].hard[at] == ball.errors(poses, joints)[0].max()
            expected = 2.0 * soft.errors(poses, joints)[0].max() ** 2
            assert found[position].soft[at] == pytest.approx(expected)


def test_excess_of_a_range_matches_whole_motion(library):
    problem = problem_of(library, [mg.KeepOut(HAND, mg.HalfSpace((0, 900, 0), (0, 1, 0)))])
    row = build_trellis(problem, "upper", {})
    rng = np.random.default_rng(0)
    for _ in range(5):
        donors = {"upper": np.array([rng.choice(own) for own in row.candidates])}
        whole = donor_excess(problem, donors)["upper"]
        first = int(rng.integers(0, len(problem.base_segments) - 4))
        some = donor_excess(problem, donors, first, first + 3)["upper"]
        begin, end = problem.base_segments.start[first], problem.base_segments.stop[first + 2]
        assert some.min() > 0
        np.testing.assert_allclose(some, whole[begin : end + 1], atol=1e-9)


def test_batch_assembly_matches_single_assembly(library):
    problem = problem_of(library, [mg.KeepOut(HAND, mg.HalfSpace((0, 900, 0), (0, 1, 0)))])
    row = build_trellis(problem, "upper", {})
    rng = np.random.default_rng(1)
    several = [{"upper": np.array([rng.choice(own) for own in row.candidates])} for _ in range(4)]
    together = donor_excesses(problem, several, 3, 9)["upper"]
    for donors, found in zip(several, together, strict=True):
        np.testing.assert_allclose(found, donor_excess(problem, donors, 3, 9)["upper"], atol=1e-9)


@pytest.mark.parametrize("choice", ["viterbi", "sample", "nearest", "random"])
def test_donor_constraints_exclude_donors_for_every_choice(library, choice):
    chosen = replace(library, config=replace(library.config, choice=choice))
    segments = library.segments
    for constraint in (mg.NotFrom("second"), mg.OnlyFrom("second"), mg.MaxStretch(0.0)):
        for graft in mg.graft_many(chosen, count=2, constraints=[constraint]):
            donors = donors_of(graft)
            other = donors != segments.of_clip(0)
            if isinstance(constraint, mg.MaxStretch):
                lengths = segments.lengths
                assert (lengths[donors] == lengths[segments.of_clip(0)]).all()
            else:
                wanted = 1 if isinstance(constraint, mg.OnlyFrom) else 0
                assert (segments.clip[donors[other]] == wanted).all()
            assert other.any()
            assert not graft.violations


def test_clip_frames_and_base_frames_are_independent(library):
    only = mg.OnlyFrom("second", clip_frames=(100, 400))
    graft = mg.graft(library, constraints=[only, mg.KeepOriginal(frames=(200, 500))])
    for s in graft.substitutions:
        if s.start <= 500 and s.stop >= 200:
            assert s.is_own
        elif not s.is_own:
            assert s.clip == "second"
            assert 100 <= s.donor_start < s.donor_stop <= 400
    assert sum(not s.is_own for s in graft.substitutions) > 5
    never = mg.NotFrom("second", clip_frames=(100, 400), frames=(0, 300))
    graft = mg.graft(library, constraints=[never])
    for s in graft.substitutions:
        if s.clip == "second" and s.start <= 300:
            assert s.donor_stop < 100 or s.donor_start > 400


def test_not_from_partial_overlap_excludes_donor():
    own = mg.Segments([0] * 4, [10] * 4)
    donors = mg.Segments([10, 15, 25, 31], [20, 30, 35, 40], [1] * 4)
    clips = [SimpleNamespace(name="base", tags=()), SimpleNamespace(name="other", tags=("x", "y"))]
    never, only = {"clip_frames": (20, 30)}, {"clip_frames": (12, 36)}
    for constraint in (mg.NotFrom("other", **never), mg.NotFrom(tags="x", **never)):
        miss = constraint.donor_errors(own, donors, clips)
        np.testing.assert_array_equal(miss > 1, [True, True, True, False])
    for constraint in (mg.OnlyFrom("oth*", **only), mg.OnlyFrom(tags={"y"}, **only)):
        miss = constraint.donor_errors(own, donors, clips)
        np.testing.assert_array_equal(miss > 1, [True, False, False, True])


@given(
    st.lists(st.sets(st.sampled_from("abc")), min_size=1, max_size=6),
    st.sets(st.sampled_from("abc")),
    st.sets(st.integers(0, 5)),
)
def test_only_from_selects_clips_by_name_or_tag(tags, wanted, named):
    clips = [SimpleNamespace(name=f"{i}", tags=tuple(own)) for i, own in enumerate(tags)]
    named = {i for i in named if i < len(clips)}
    wanted &= set().union(*tags)
    if not wanted and not named:
        return
    n = len(clips)
    own, donors = mg.Segments([0] * n, [9] * n, [n] * n), mg.Segments([5] * n, [9] * n, range(n))
    meant = [i in named or bool(wanted & tags[i]) for i in range(n)]
    names = sorted(map(str, named))
    never = mg.NotFrom(names, tags=wanted).donor_errors(own, donors, clips)
    np.testing.assert_array_equal(never > 1, meant)
    only = mg.OnlyFrom(names, tags=wanted).donor_errors(own, donors, clips)
    np.testing.assert_array_equal(only > 1, np.logical_not(meant))


def test_max_angle_limits_seam_angles(library):
    limit = np.radians(12)
    graft = mg.graft(library, constraints=[mg.MaxAngle(limit)])
    pool, donors = library.pool("upper"), donors_of(graft)
    assert np.diag(pool.seam_angles(donors[:-1], donors[1:])).max() <= limit
    assert not graft.violations


def reachable_target(problem, rng):
    """Return a hand position that the donor of one segment reaches."""
    while True:
        position = int(rng.integers(len(problem.base_segments)))
        others = problem.candidates["upper"][position]
        others = others[others != problem.scenario[position]]
        if len(others):
            break
    donors = problem.captured_donors
    donors["upper"][position] = rng.choice(others)
    frame = int(
        rng.integers(
            problem.base_segments.start[position], problem.base_segments.stop[position] + 1
        )
    )
    motion = assemble(problem, donors)
    return tuple(motion.world_positions()[frame, motion.skeleton.index(HAND)]), frame


def test_reach_reachable_target_is_met(library):
    problem, rng = problem_of(library, []), np.random.default_rng(5)
    met = 0
    for _ in range(10):
        target, frame = reachable_target(problem, rng)
        graft = mg.graft(library, constraints=[mg.Reach(HAND, target, frame)])
        at = graft.motion.world_positions()[frame, graft.motion.skeleton.index(HAND)]
        apart = np.linalg.norm(at - target) / problem.base_poses.height
        assert (apart <= 0.03) == (not graft.violations)
        met += apart <= 0.03
    assert met >= 9


def test_reach_unreachable_target_reports_smallest_violation(library):
    height = mg.Poses.from_motion(library.clips[0]).height
    graft = mg.graft(library, constraints=[mg.Reach(HAND, (0.0, 9 * height, 0.0), 100)])
    (violation,) = graft.violations
    assert violation.frames == (100, 100)
    assert violation.joint == HAND
    place = graft.motion.world_positions()[100, graft.motion.skeleton.index(HAND)]
    apart = np.linalg.norm(place - [0, 9 * height, 0]) / height
    assert violation.error == pytest.approx(apart / 0.03)
    assert f"{apart:.3f} heights" in violation.message
    assert violation.message in graft.report()
    assert graft.as_dict()["violations"][0]["worst_frame"] == 100


def in_the_way(library):
    """Return a sphere at the hand position of frame 300, away from the legs."""
    place = library.clips[0].world_positions()[300, library.clips[0].skeleton.index(HAND)]
    return mg.Avoid(mg.Sphere(tuple(place + np.array([0.0, 6.0, 0.0])), 6.0), frames=(270, 330))


def test_repair_changes_only_violating_segments_and_neighbours(library):
    base = library.clips[0]
    avoid = in_the_way(library)
    before, _ = avoid.errors(mg.Poses.from_motion(base))
    assert (before > 1).any()
    graft = mg.repair(library, constraints=[avoid])
    assert not graft.violations
    after, _ = avoid.errors(mg.Poses.from_motion(graft.motion))
    assert after.max() <= 1.0
    segments = library.segments
    touched = np.zeros(base.n_frames, bool)
    collides = np.zeros(len(segments.of_clip(0)), bool)
    for at in segments.of_clip(0):
        start, stop = segments.start[at], segments.stop[at]
        collides[at] = (before[start : stop + 1] > 1).any()
    changed = np.array([not s.is_own for s in graft.substitutions])
    assert changed.any()
    near = np.convolve(collides, np.ones(5), "same") > 0
    assert not (changed & ~near).any()
    reach = round(library.config.seam_blend * library.rate)
    for at in np.flatnonzero(changed):
        touched[max(segments.start[at] - reach, 0) : segments.stop[at] + reach + 1] = True
    kept = ~touched
    old, new = base.channel_numbers(), graft.motion.channel_numbers()
    np.testing.assert_array_equal(new[kept], old[kept])
    np.testing.assert_array_equal(graft.motion.rotations[kept], base.rotations[kept])
    legs = library.joints("lower")
    np.testing.assert_array_equal(graft.motion.rotations[:, legs], base.rotations[:, legs])


def test_avoid_is_satisfied_for_every_choice(library):
    avoid = in_the_way(library)
    for choice in ("viterbi", "sample", "random"):
        chosen = replace(library, config=replace(library.config, choice=choice))
        for graft in mg.graft_many(chosen, count=2, constraints=[avoid]):
            after, _ = avoid.errors(mg.Poses.from_motion(graft.motion))
            assert (after.max() <= 1.0) == (not graft.violations)
            assert after.max() <= 1.0


def test_repair_search_is_local(library):
    problem = problem_of(library, [in_the_way(library)])
    rows = {"upper": build_trellis(problem, "upper", {})}
    rng = np.random.default_rng(3)
    raw = {"upper": np.array([rng.choice(own) for own in rows["upper"].candidates])}
    settled = repair_donors(problem, raw, rows)
    near = (problem.base_segments.stop >= 270 - 60) & (problem.base_segments.start <= 330 + 60)
    np.testing.assert_array_equal(settled["upper"][~near], raw["upper"][~near])
    before, after = (donor_excess(problem, donors)["upper"].sum() for donors in (raw, settled))
    assert after <= before


def test_repair_without_violation_returns_captured_motion(library):
    graft = mg.repair(library, constraints=[mg.Avoid(mg.Sphere((0.0, 9000.0, 0.0), 5.0))])
    base = library.clips[0]
    np.testing.assert_array_equal(graft.motion.channel_numbers(), base.channel_numbers())


@pytest.mark.parametrize("changes", [{"torso": "world"}, {"alignment": "dtw"}])
def test_violations_describe_the_finished_motion(library, changes):
    """Candidates are judged without seams; violations describe the finished motion."""
    other = replace(library, config=replace(library.config, **changes))
    avoid = in_the_way(library)
    worst = []
    for graft in (mg.repair(other, constraints=[avoid]), mg.graft(other, constraints=[avoid])):
        after, _ = avoid.errors(mg.Poses.from_motion(graft.motion))
        assert (after.max() > 1.0) == bool(graft.violations)
        assert any(not s.is_own for s in graft.substitutions)
        worst.append(after.max())
    before, _ = avoid.errors(mg.Poses.from_motion(library.clips[0]))
    assert worst[0] < before.max()
    far = mg.Reach(HAND, (0.0, 9000.0, 0.0), 300)
    graft = mg.graft(other, constraints=[far])
    (violation,) = graft.violations
    error, _ = far.errors(mg.Poses.from_motion(graft.motion))
    assert violation.error == pytest.approx(error.max())


def test_soft_constraints_lower_error_without_violation(library):
    target = (60.0, 170.0, 30.0)
    soft = mg.Reach(HAND, target, 300, weight=5.0)

    def apart(graft):
        motion = graft.motion
        place = motion.world_positions()[300, motion.skeleton.index(HAND)]
        return np.linalg.norm(place - target)

    pulled = mg.graft(library, constraints=[soft])
    assert not pulled.violations
    assert apart(pulled) <= apart(mg.graft(library))


def test_custom_function_receives_every_pose(library):
    def low(poses):
        return np.where(poses.joint_positions(HAND)[:, 1] > 140.0, 3.0, 0.0)

    own = mg.Custom(low, name="hands down", joint=HAND, frames=(250, 350))
    graft = mg.graft(library, constraints=[own])
    world = graft.motion.world_positions()[250:351, graft.motion.skeleton.index(HAND), 1]
    assert (world.max() <= 140.0) == (not graft.violations)
    bad = mg.Custom(lambda _: np.zeros(3), name="short")
    with pytest.raises(ValueError, match="the result of short must have shape"):
        mg.graft(library, constraints=[bad])


def test_errors_of_joints_below_a_group_belong_to_it(motion):
    library = mg.Library.build(motion, "lower_torso_larm_rarm")
    names = library.groups.names
    problem = problem_of(library, [], groups=[names[1]])
    hand = motion.skeleton.index(HAND)
    assert problem.driven_joints[names[1]][hand]
    problem = problem_of(library, [], groups=names[1:])
    owners = [name for name, joints in problem.driven_joints.items() if joints[hand]]
    assert len(owners) == 1
    assert hand in library.joints(owners[0])


def test_candidates_refused_names_constraint_and_amount(library):
    place = library.clips[0].world_positions()[300, library.clips[0].skeleton.index(HAND)]
    reach = mg.Reach(HAND, tuple(place), 300)
    segment = int((library.segments.stop[library.segments.of_clip(0)] < 300).sum())
    free = library.candidates(segment, "upper")
    judged = library.candidates(segment, "upper", [reach, mg.NotFrom("second")])
    assert judged.allowed[0].segment == segment
    problem = problem_of(library, [reach])
    for candidate in (*judged.allowed, *judged.refused):
        poses = candidate_poses(
            problem, "upper", np.array([segment]), np.array([candidate.segment])
        )
        missed = reach.errors(poses)[0].max()
        assert ("Reach: LeftHand is " in candidate.refused) == (missed > 1)
        if missed > 1:
            assert f"{missed * 0.03:.3f} heights" in candidate.refused
        assert ("NotFrom: from second" in candidate.refused) == (candidate.clip == 1)
    assert len(judged.allowed) + len(judged.refused) == len(free.allowed) + len(free.refused)


def test_report_lists_every_substitution(library):
    graft = mg.graft(library)
    lines = graft.report(each=True).splitlines()
    pool, donors = library.pool("upper"), donors_of(graft)
    model = cost_model(library.config, pool)
    for at, s in enumerate(graft.substitutions):
        expected = pool.unary_costs(np.array([s.segment]), np.array([s.donor]), model)[0]
        assert s.cost == expected
        if at:
            gap = pool.seam_angles(donors[at - 1 : at], donors[at : at + 1])[0, 0]
            assert s.gap_before == graft.substitutions[at - 1].gap_after == gap
        taken = f"{s.clip} {s.donor_start}-{s.donor_stop}"
        told = f"    {s.start}-{s.stop} from {taken}: cost {s.cost:.2f}"
        assert any(line.startswith(told) for line in lines) == (not s.is_own)
    assert len(graft.report().splitlines()) < len(lines)


# What they refuse


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: mg.Sphere((0, 0, 0), -1), "radius must not be negative, got -1"),
        (lambda: mg.Sphere((0, 0), 1), "center must have shape"),
        (lambda: mg.Box((0, 0, 0), (1, 1, 1), (0, 0, 0, 2)), "rotation must be a unit quaternion"),
        (lambda: mg.HalfSpace((0, 0, 0), (0, 0, 0)), "normal must not be zero"),
        (lambda: mg.Avoid(mg.Sphere((0, 0, 0), 1), tolerance=0), "tolerance must be above 0"),
        (lambda: mg.Reach(HAND, (0, 0, 0), -1), "frame must be a whole number from 0, got -1"),
        (lambda: mg.NotFrom("a", weight=-1), "weight must not be negative, got -1"),
        (lambda: mg.NotFrom(), "clips or tags must select clips, got neither"),
        (
            lambda: mg.KeepOriginal(frames=(5, 2)),
            "frames must be a first and a last frame, ascending",
        ),
        (lambda: mg.MaxAngle(0.1, weight=1.0), "MaxAngle accepts neither weight nor frames"),
    ],
)
def test_constraint_invalid_arguments_raise(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    ("constraint", "error", "message"),
    [
        ("no constraint", TypeError, "constraints must be mograft constraints, got 'no"),
        (mg.Reach("Wing", (0, 0, 0), 5), ValueError, "no joint is named 'Wing'"),
        (mg.Reach(HAND, (0, 0, 0), 99_999), ValueError, "frames of Reach must be within 0 to"),
        (mg.NotFrom("waltz*"), ValueError, r"clips must match names of .*; got 'waltz\*'"),
        (mg.OnlyFrom(tags="happy"), ValueError, "tags exist on no clip; got 'happy'"),
    ],
)
def test_constraint_unknown_names_raise_before_search(library, constraint, error, message):
    with pytest.raises(error, match=message):
        mg.graft(library, constraints=[constraint])
