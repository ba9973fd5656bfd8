"""Properties of constraints: their errors, the grafts that satisfy them, and violations."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

import mograft as mg
import mograft.constraints as mc
from mograft._util.names import unique_names
from mograft.dancer import dance
from mograft.search.constraints import find_violations, overlaps
from mograft.search.donor_choice import cost_model
from mograft.solve.assembly import assemble, donor_excess
from mograft.solve.donor_repair import repair_donors
from mograft.solve.donor_trellis import build_trellis, candidate_poses
from mograft.solve.search_problem import resolve_segments
from tests.grafting_fixtures import make_problem
from tests.oracles.capsules import capsule_distances
from tests.strategies import SEEDS, few_examples, vectors

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


# Errors


@few_examples(12)
@given(vectors((2,), 100.0), st.floats(1.0, 60.0), st.floats(-0.05, 0.1))
def test_avoid_errors_are_depths_of_capsules_within_the_margin(poses, axis, radius, margin):
    axis = axis + np.array([0, 100, 0])
    for ends, obstacle in (
        (axis, mc.Capsule(*axis, radius)),
        (axis[[0, 0]], mc.Sphere(axis[0], radius)),
    ):
        others = np.broadcast_to(ends, (len(poses), 1, 2, 3))
        distances = capsule_distances(poses.ends, poses.capsules.radii, others, np.array([radius]))
        depths = margin * poses.height - distances.min(axis=(1, 2))
        error, joint = mc.Avoid(obstacle, margin=margin).errors(poses)
        assert_allclose(error * 0.005, depths.clip(min=0) / poses.height, atol=1e-9)
        assert (joint >= 0).all()


def test_half_space_and_large_box_agree(poses):
    hip = poses.positions[0, 0]
    wall = mc.HalfSpace(tuple(hip), (0, 0, -2.0))
    center = tuple(hip + np.array([0, 0, 5000.0]))
    block = mc.Box(center, (9000, 9000, 5000))
    wall_error, _ = mc.Avoid(wall).errors(poses)
    block_error, _ = mc.Avoid(block).errors(poses)
    assert_allclose(wall_error, block_error, rtol=1e-6, atol=1e-4)
    turned_box = mc.Box(center, (5000, 9000, 9000), (0, 0.5**0.5, 0, 0.5**0.5))
    assert_allclose(mc.Avoid(turned_box).errors(poses)[0], block_error, rtol=1e-6, atol=1e-4)


def test_character_distance_follows_its_motion(motion, poses):
    error, _ = mc.Avoid(mc.Character(motion[:200], offset=(50.0, 0, 0))).errors(poses)
    radii, moved = poses.capsules.radii, poses.ends + np.array([50.0, 0, 0])
    depths = -capsule_distances(poses.ends, radii, moved, radii).min(axis=(1, 2))
    assert_allclose(error * 0.005, depths.clip(min=0) / poses.height, atol=1e-9)
    late = mc.Avoid(mc.Character(motion[:200], (50.0, 0, 0), delay=1.0)).errors(poses)[0]
    first = mc.Avoid(mc.Character(motion[:1], (50.0, 0, 0))).errors(poses)[0]
    assert_array_equal(late[:30], first[:30])
    turned = mc.Character(motion[:200], (50.0, 0, 0), yaw=2 * np.pi)
    assert_allclose(mc.Avoid(turned).errors(poses)[0], error, atol=1e-6)


def test_reach_and_keep_out_measure_joint_positions(poses):
    position = poses.joint_positions(HAND)[40]
    aside = tuple(position + np.array([0.06 * poses.height, 0, 0]))
    error, joint = mc.Reach(HAND, aside, 40).errors(poses)
    assert error[40] == pytest.approx(2.0)
    assert error.sum() == error[40]
    assert poses.skeleton.names[joint[40]] == HAND
    ball = mc.Sphere(tuple(position), 0.02 * poses.height)
    assert mc.KeepOut(HAND, ball, frames=(40, 40)).errors(poses)[0][40] == pytest.approx(4.0)
    inside = mc.KeepOut(HAND, mc.Sphere(aside, 0.02 * poses.height), inside=True, frames=(40, 40))
    assert inside.errors(poses)[0][40] == pytest.approx(8.0)


def test_face_rest_pose_looks_forward():
    skeleton = dance(strides=1).motion.skeleton
    quats = np.tile([0, 0, 0, 1.0], (2, skeleton.n_joints, 1))
    rest = mg.Motion(skeleton, 1 / 30, quats, [skeleton.offsets] * 2)
    head = rest.world_positions()[0, skeleton.index("Head")]
    for target, angle in (((0, 0, 900), 0.0), ((900, 0, 0), 90.0), ((0, 0, -900), 180.0)):
        face = mc.Face(tuple(head + target))
        error = face.errors(mg.Poses.from_motion(rest))[0][0] * face.tolerance
        assert np.degrees(error) == pytest.approx(angle, abs=1e-6)


def scatter_limbs(poses, rng, frames=8):
    """Return poses with displaced limbs that are likely to overlap."""
    chosen = rng.choice(len(poses), frames)
    moved = poses.positions[chosen] + rng.normal(size=(frames, poses.skeleton.n_joints, 3)) * 8.0
    return poses.with_poses(poses.frames[chosen], poses.rotations[chosen], moved)


@settings(max_examples=10, deadline=None)
@given(SEEDS)
def test_avoid_self_depth_is_that_of_deepest_pair(poses, seed):
    subset = scatter_limbs(poses, np.random.default_rng(seed))
    body = subset.capsules
    parts, sides = np.array(body.parts), np.array(body.sides)
    arm = np.isin(parts, ["hand", "forearm"])
    rest = np.isin(parts, ["pelvis", "trunk", "head", "thigh"])
    tested_pairs = arm[:, None] & (rest | (arm & (sides[:, None] != sides)))
    distance = capsule_distances(subset.ends, body.radii, subset.ends, body.radii)
    deepest = -np.where(tested_pairs, distance, np.inf).min(axis=(1, 2)) / subset.height
    constraint = mc.AvoidSelf(captured=0.01)
    error, _ = constraint.errors(subset)
    assert_allclose(error * constraint.tolerance, np.maximum(deepest - 0.01, 0), atol=1e-6)
    deepest_of_all = constraint.self_collision_depth(subset)
    assert deepest_of_all == pytest.approx(max(deepest.max(), 0.0), abs=1e-6)


@settings(max_examples=12, deadline=None)
@given(SEEDS)
def test_constraint_errors_are_maximum_over_joints(poses, seed):
    rng = np.random.default_rng(seed)
    subset, mask = scatter_limbs(poses, rng), rng.random(poses.skeleton.n_joints) < 0.5
    position = tuple(rng.normal(size=3) * 30 + np.array([0, 100, 0]))
    for constraint in (
        mc.Avoid(mc.Sphere(position, 40.0)),
        mc.Avoid(mc.Capsule((0.0, 0.0, 0.0), position, 20.0)),
        mc.AvoidSelf(),
    ):
        full_error, _ = constraint.errors(subset)
        parts = [constraint.errors(subset, joints) for joints in (mask, ~mask)]
        assert_array_equal(full_error, np.maximum(parts[0][0], parts[1][0]))
        for joints, (_, blamed) in zip((mask, ~mask), parts, strict=True):
            assert joints[blamed[blamed >= 0]].all()


def test_find_violations_reports_runs_with_worst_frame(poses):
    heights = poses.joint_positions(HAND)[:, 1]
    limit = float(np.median(heights))
    low = mc.KeepOut(HAND, mc.HalfSpace((0, limit, 0), (0, 1.0, 0)))
    found = find_violations([low], poses)
    below = (limit - heights) > 0.005 * poses.height
    covered = np.zeros(len(poses), bool)
    for violation in found:
        first, last = violation.frames
        covered[first : last + 1] = True
        assert violation.worst == first + heights[first : last + 1].argmin()
        assert violation.joint == HAND
        assert violation.message.count(HAND) == 1
        assert "heights inside, tolerance 0.005" in violation.message
        x, y, z = poses.joint_positions(HAND)[violation.worst]
        assert violation.message.endswith(f"; the joint is at {x:.4g},{y:.4g},{z:.4g}")
    assert_array_equal(covered, below)
    assert find_violations([replace(low, weight=1.0)], poses) == []


# Grafts with constraints


CHOICES = ["viterbi", "sample", "nearest", "random"]


def random_rule(rng, library):
    """Return a random constraint on donors."""
    segments = library.segments
    position, donor = int(rng.integers(len(segments.of_clip(0)))), int(rng.integers(len(segments)))
    span = int(segments.start[position]), int(segments.stop[position])
    taken = int(segments.start[donor]), int(segments.stop[donor])
    name, frames = library.names[segments.clip[donor]], tuple(np.sort(rng.integers(0, 899, 2)))
    rules = [
        mc.Use(position, donor),
        mc.Use(frames=span, donor=(name, *taken)),
        mc.Ban(position, donor),
        mc.Ban(position),
        mc.Ban(frames=frames, donor=(name, *taken)),
        mc.OnlyFrom(name, taken, frames=span),
        mc.OnlyFrom("second", frames, frames=frames),
        mc.NotFrom("second", frames),
        mc.MaxStretch(float(rng.uniform(0.0, 0.1))),
        mc.KeepOriginal(frames=frames),
    ]
    return rules[rng.integers(len(rules))]


@few_examples(30)
@given(SEEDS, st.sampled_from(CHOICES))
def test_donors_of_every_choice_satisfy_random_constraints_or_violations_name_them(
    library, seed, choice
):
    chosen = replace(library, config=replace(library.config, choice=choice))
    rng, pool = np.random.default_rng(seed), library.pool("upper")
    angle = mc.MaxAngle(float(rng.uniform(0.1, 0.8)))
    rules = [*(random_rule(rng, library) for _ in range(3)), angle]
    problem, segments = make_problem(chosen, rules), library.segments
    graft = mg.graft(chosen, constraints=rules, seed=seed % 7)
    donors, unmet = graft.donors["upper"], set()
    lists = make_problem(chosen, []).candidates["upper"]
    for base, free in enumerate(lists):
        is_listed, is_allowed = np.zeros((2, len(segments)), bool)
        is_listed[free], is_allowed[:] = True, True
        for own in problem.constraints:
            if overlaps(problem.base_segments, own.frames)[base]:
                pairs = segments[np.full(len(segments), base)], segments
                error = own.donor_errors(*pairs, library.entries)
                is_allowed &= error <= 1.0
                is_listed |= isinstance(own, mc.Use) & (error == 0.0)
        expected = np.flatnonzero(is_listed & is_allowed).tolist()
        assert problem.candidates["upper"][base].tolist() == (expected or [base])
        assert donors[base] in (expected or [base])
        unmet |= set() if expected else {(int(segments.start[base]), int(segments.stop[base]))}
    excluded = {v.frames for v in graft.violations if "no donor of upper" in v.message}
    assert excluded == unmet
    wide = [own.frames[0] for own in graft.violations if isinstance(own.constraint, mc.MaxAngle)]
    angles = pool.seam_angles_along(donors)
    assert wide == problem.base_segments.stop[:-1][angles > angle.limit].tolist()


CLIP_KINDS = (mc.NotFrom, mc.OnlyFrom)
FILES = st.tuples(st.sampled_from("ab"), st.integers(0, 2), st.sets(st.sampled_from("xy")))
SPANS = st.tuples(st.integers(0, 30), st.integers(0, 12)).map(lambda own: (own[0], sum(own)))


@given(st.lists(FILES, min_size=1, max_size=4), st.none() | SPANS, st.data())
def test_clip_constraints_select_donors_by_name_copy_tag_and_frames(files, span, data):
    """Files of a name and content are one, 0 being none; their mirror images are others."""
    names = unique_names([name for name, *_ in files])
    contents = [f"{own}" if own else None for _, own, _ in files]
    clips, copies = [], []
    for end in ("", "_mirrored"):
        for name, content, (stem, _, tags) in zip(names, contents, files, strict=True):
            file = content and SimpleNamespace(sha256=content, clip=None)
            clips.append(SimpleNamespace(name=name + end, tags=tuple(tags), source_file=file))
            copies.append((stem, end, content))
    n = len(clips)
    wanted = data.draw(st.sets(st.integers(0, n - 1), max_size=2))
    tags = data.draw(st.sets(st.sampled_from("xy"))) & {tag for own in clips for tag in own.tags}
    assume(wanted or tags)
    copied = {copies[i] for i in wanted if clips[i].source_file}
    selected = [
        i in wanted or copies[i] in copied or not tags.isdisjoint(clips[i].tags) for i in range(n)
    ]
    starts = np.array(data.draw(st.lists(st.integers(0, 40), min_size=n, max_size=n)))
    captured = mg.Segments([0] * n, [9] * n, [n] * n)
    donors = mg.Segments(starts, starts + 5, range(n))
    frames = set(range(999)) if span is None else set(range(span[0], span[1] + 1))
    shared = np.array([len(frames & set(range(first, first + 6))) for first in starts.tolist()])
    constraints = (own([clips[i].name for i in wanted], span, tags=tags) for own in CLIP_KINDS)
    without, only = (own.donor_errors(captured, donors, clips) > 1 for own in constraints)
    assert_array_equal(without, selected & (shared >= min(2, len(frames))))
    assert_array_equal(~only, selected & (shared == 6))


@given(st.data())
def test_message_about_a_wrong_segment_names_the_one_with_most_of_the_frames(library, data):
    """The frames that it suggests are accepted."""
    clip = data.draw(st.integers(0, 1))
    own = library.segments[library.segments.of_clip(clip)]
    last = int(own.stop[-1])
    first = data.draw(st.integers(0, last + 9))
    frames = first, first + data.draw(st.integers(0, 40))
    assume(not ((own.start == frames[0]) & (own.stop == frames[1])).any())
    name = library.names[clip]
    cut = library.segments[library.segments.of_clip(0)]
    with pytest.raises(ValueError, match=r"did you mean \d+-\d+\?$") as caught:
        resolve_segments([mc.Use(0, (name, *frames))], ["upper"], cut, library)
    number, start, stop = map(
        int, re.search(r"in segment (\d+), frames (\d+)-(\d+);", str(caught.value)).groups()
    )
    assert (own.start[number], own.stop[number]) == (start, stop)
    if first > last:
        assert f"the last frame is {last}" in str(caught.value)
        assert number == len(own) - 1
    else:
        shared = np.minimum(own.stop, frames[1]) - np.maximum(own.start, frames[0])
        assert shared[number] >= shared.max() - 1  # the frame that two segments share is of one
    resolve_segments([mc.Use(0, (name, start, stop))], ["upper"], cut, library)
    message = rf"0 to {len(cut) - 1}, got {len(cut) + first}; frame .* did you mean (\d+)\?$"
    message = message if len(cut) + first < cut.stop[-1] else "; the last frame is"
    with pytest.raises(ValueError, match=message):
        resolve_segments([mc.Use(len(cut) + first, 0)], ["upper"], cut, library)


def test_use_that_another_constraint_excludes_is_a_violation_unless_it_is_soft(library):
    segments = library.segments
    frames = int(segments.start[4]), int(segments.stop[4])
    use = mc.Use(4, int(segments.of_clip(1)[7]))
    (violation,) = mg.graft(library, constraints=[use, mc.NotFrom("second")]).violations
    where = f"is violated in frames {frames[0]} to {frames[1]}: "
    assert violation.message.startswith(f"Use {where}not second, frames")
    soft = mg.graft(library, constraints=[replace(use, weight=1e6)])
    assert soft.donors["upper"][4] == segments.of_clip(1)[7]
    only = mc.OnlyFrom("second", (0, 1), frames=frames)
    (violation,) = mg.graft(library, constraints=[only]).violations
    assert violation.message == f"OnlyFrom {where}no candidate is from second, frames 0 to 1"
    assert not mg.graft(library, constraints=[replace(only, weight=1.0)]).violations


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
    cut = problem.base_segments
    frame = int(rng.integers(cut.start[position], cut.stop[position] + 1))
    motion = assemble(problem, donors)
    return tuple(motion.world_positions()[frame, motion.skeleton.index(HAND)]), frame


@few_examples(8)
@given(SEEDS)
@example(448)  # two segments share the frame
@example(772)  # seams two positions away move the hand
def test_repair_reaches_what_one_substitution_reaches(library, seed):
    rng = np.random.default_rng(seed)
    target, frame = reachable_target(make_problem(library, []), rng)
    problem = make_problem(library, [mc.Reach(HAND, target, frame)])
    trellises = {"upper": build_trellis(problem, "upper", {})}
    donors = {"upper": np.array([rng.choice(own) for own in trellises["upper"].candidates])}
    repaired = repair_donors(problem, donors, trellises)
    assert donor_excess(problem, repaired)["upper"].sum() == 0


CHANGES = [{}, {"torso": "pelvis"}, {"choice": "sample"}, {"choice": "random"}]


@pytest.mark.parametrize("changes", CHANGES)
def test_violations_describe_the_finished_motion_and_repair_changes_only_violating_segments(
    library, changes
):
    """Errors of candidates leave out the seams; violations include them."""
    other, base = replace(library, config=replace(library.config, **changes)), library.clips[0]
    position = base.world_positions()[300, base.skeleton.index(HAND)] + np.array([0.0, 6.0, 0.0])
    avoid = mc.Avoid(mc.Sphere(tuple(position), 6.0), frames=(270, 330))
    before, _ = avoid.errors(mg.Poses.from_motion(base))
    repaired = mg.repair(other, constraints=[avoid])
    for graft in (mg.graft(other, constraints=[avoid]), repaired):
        after, _ = avoid.errors(mg.Poses.from_motion(graft.motion))
        assert (after.max() > 1.0) == bool(graft.violations)
        assert any(not s.is_own for s in graft.substitutions)
        assert all(violation.message in graft.report() for violation in graft.violations)
    assert after.max() < before.max()
    assert changes or not repaired.violations
    changed = np.array([not s.is_own for s in repaired.substitutions])
    collides = [(before[s.start : s.stop + 1] > 1).any() for s in repaired.substitutions]
    assert not (changed & (np.convolve(collides, np.ones(5), "same") == 0)).any()
    reach, is_kept = round(library.config.seam_blend * library.rate), np.ones(base.n_frames, bool)
    for s in repaired.substitutions:
        if not s.is_own:
            is_kept[max(s.start - reach, 0) : s.stop + reach + 1] = False
    assert_array_equal(repaired.motion.channel_numbers()[is_kept], base.channel_numbers()[is_kept])
    assert_array_equal(repaired.motion.rotations[is_kept], base.rotations[is_kept])


def test_candidates_refused_names_constraint_and_amount(library):
    position = library.clips[0].world_positions()[300, library.clips[0].skeleton.index(HAND)]
    reach = mc.Reach(HAND, tuple(position), 300)
    segment = int((library.segments.stop[library.segments.of_clip(0)] < 300).sum())
    free = mg.candidates(library, segment, "upper")
    judged = mg.candidates(library, segment, "upper", [reach, mc.NotFrom("second")])
    assert judged.allowed[0].segment == segment
    problem = make_problem(library, [reach])
    for candidate in (*judged.allowed, *judged.refused):
        pair = np.array([segment]), np.array([candidate.segment])
        poses = candidate_poses(problem, "upper", *pair)
        missed = reach.errors(poses)[0].max()
        assert ("Reach: LeftHand is " in candidate.refused) == (missed > 1)
        if missed > 1:
            assert f"{missed * 0.03:.3f} heights" in candidate.refused
        assert ("NotFrom: from second" in candidate.refused) == (candidate.clip == 1)
    assert len(judged.allowed) + len(judged.refused) == len(free.allowed) + len(free.refused)


def test_report_lists_every_substitution_and_the_gaps_at_its_seams(library):
    graft = mg.graft(library)
    lines = graft.report(each=True).splitlines()
    assert "(limit 45°)" in graft.report()
    pool, donors = library.pool("upper"), graft.donors["upper"]
    model, gaps = cost_model(library.config, pool), {seam.frame: seam.gap for seam in graft.seams}
    for at, s in enumerate(graft.substitutions):
        expected = pool.unary_costs(np.array([s.segment]), np.array([s.donor]), model)[0]
        assert s.cost == expected
        if at:
            gap = pool.seam_angles(donors[at - 1 : at], donors[at : at + 1])[0, 0]
            assert s.gap_before == graft.substitutions[at - 1].gap_after == gap
            assert gaps.get(s.start, 0.0) == pytest.approx(gap, abs=1e-12)
            assert gap <= library.config.max_angle
        source = f"{s.clip} {s.donor_start}-{s.donor_stop}"
        line_start = f"    segment {at}, {s.start}-{s.stop} from {source}: cost {s.cost:.2f}"
        assert any(line.startswith(line_start) for line in lines) == (not s.is_own)
    assert len(graft.report().splitlines()) < len(lines)


# Invalid arguments


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: mc.Use(donor=3), "one of `segment` and `frames` must be given, got both or nei"),
        (lambda: mc.Ban(3, frames=(0, 9)), "one of `segment` and `frames` must"),
        (lambda: mc.Use(3), r"`donor` must be a segment index or \(clip, first frame, last"),
        (lambda: mc.Use(3, "second"), "`donor` must be a segment index or .*, got 'second'"),
        (lambda: mc.Ban(3, ("second", 9, 3)), "`donor` must be a first and a last frame"),
        (lambda: mc.Use(99999, 3), "`segment` of Use must be 0 to .*, got 99999"),
        (lambda: mc.Ban(3, 99999), "`donor` of Ban must be 0 to .*, got 99999"),
        (lambda: mc.Ban(3, "secnd"), "`donor` of Ban .*; got 'secnd'; did you mean 'second'"),
        (lambda: mc.Use(3, ("second", 0, 1)), "`donor` of Use .* of second, got 0-1; most of"),
        (lambda: mc.Use(frames=(0, 1), donor=3), "`frames` of Use must be a segment of the base"),
        (lambda: mc.Ban(3, ("second", 99990, 99999)), "`donor` of Ban must be a segment of second"),
        (lambda: "no constraint", "`constraints` must contain only constraints, got 'no"),
        (lambda: mc.Reach("Wing", (0, 0, 0), 5), "no joint is named 'Wing'"),
        (lambda: mc.Reach(HAND, (0, 0, 0), 99_999), "frames of `Reach` must be within 0 to"),
        (lambda: mc.NotFrom("waltz*"), r"`clips` must match .*; got 'waltz\*'"),
        (lambda: mc.OnlyFrom(tags="happy"), "`tags` must be left out, .*; got 'happy'"),
        (lambda: mc.Sphere((0, 0, 0), -1), "`radius` must not be negative, got -1"),
        (lambda: mc.Sphere((0, 0), 1), "`center` must have shape"),
        (lambda: mc.Box((0, 0, 0), (1, 1, 1), (0, 0, 0, 2)), "`rotation` must be a unit quatern"),
        (lambda: mc.HalfSpace((0, 0, 0), (0, 0, 0)), "`normal` must not be zero"),
        (lambda: mc.Avoid(mc.Sphere((0, 0, 0), 1), tolerance=0), "`tolerance` must be above 0"),
        (lambda: mc.Reach(HAND, (0, 0, 0), -1), "`frame` must be a whole number .* 0, got -1"),
        (lambda: mc.NotFrom("a", weight=-1), "`weight` must not be negative, got -1"),
        (lambda: mc.NotFrom(), "`clips` or `tags` must be given, got neither"),
        (lambda: mc.KeepOriginal(frames=(5, 2)), "`frames` must be a first and a last .*ascending"),
        (lambda: mc.MaxAngle(0.1, weight=1.0), "MaxAngle accepts neither weight nor frames"),
        (lambda: mc.AvoidSelf(captured=-1), "`captured` must not be negative, got -1"),
        (lambda: mc.Custom(5), "`function` must be callable, got 5"),
        (lambda: mc.Custom(lambda _: np.zeros(3), "short"), "`result of short` must have shape"),
        (lambda: mc.OnlyFrom(np.array("waltz")), "`clips` must be a name or several names, got"),
        (lambda: mc.OnlyFrom("a", tags=[["waltz"]]), "`tags` must be a name or several names, got"),
    ],
)
def test_constraint_invalid_arguments_raise(library, make, message):
    with pytest.raises((TypeError, ValueError), match=message):
        mg.graft(library, constraints=[make()])


@pytest.mark.parametrize("constraints", [None, 5, mc.MaxAngle(0.2), iter([mc.KeepOriginal()])])
@pytest.mark.parametrize("function", [mg.graft, mg.graft_many, mg.repair, mg.Stream])
def test_constraints_that_are_not_a_list_raise_type_error(library, function, constraints):
    """An iterator would be empty after the first pass, and its constraints would be ignored."""
    with pytest.raises(TypeError, match="`constraints` must be a list of constraints, got"):
        function(library, constraints=constraints)


@pytest.mark.parametrize("widest", [np.inf, np.nan, 0.0, -1, "2", True])
def test_repair_invalid_widest_raises_value_error(library, widest):
    """With an infinite limit, clusters would be enlarged without end."""
    far = mc.Reach(HAND, (0.0, 9999.0, 0.0), 200)
    with pytest.raises(ValueError, match="`widest` must be a finite number above 0, got"):
        mg.repair(library, constraints=[far], widest=widest)


def test_custom_errors_below_0_count_as_0(poses):
    custom = mc.Custom(lambda poses: np.linspace(-3.0, 2.0, len(poses)), weight=1.0)
    expected = np.linspace(-3.0, 2.0, len(poses)).clip(min=0.0)
    assert_array_equal(custom.errors(poses)[0], expected)


@given(st.integers(1, 3000), st.integers(1, 3000), st.sampled_from([0.0, 1e-5, 5e-4, 0.1, 2.0]))
@example(2000, 1999, 0.0)
def test_max_stretch_errors_are_above_1_for_greater_stretches_only(base, donor, limit):
    first, second = (mg.Segments(np.array([0]), np.array([n])) for n in (base, donor))
    (error,) = mc.MaxStretch(limit).donor_errors(first, second, ())
    assert (error > 1.0) == (abs(base - donor) / base > limit * (1 + 1e-9))
    assert error > 1.0 or error == 0.0
