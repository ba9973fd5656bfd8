"""Laws of the search where donors hold the root, and lead the body where they go."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

import mograft as mg
from mograft.blend.rigid_alignment import AlignmentTransform, RootTransforms
from mograft.dancer import dance
from mograft.search.costs import INFEASIBLE_PENALTY
from mograft.search.trellis import DonorTrellis
from mograft.search.viterbi import viterbi
from mograft.synthesis.assembly import assemble, donor_excess, donor_excesses, pose_excess
from mograft.synthesis.donor_poses import candidate_poses
from mograft.synthesis.donor_trellis import build_trellis
from mograft.synthesis.graft_plan import GraftPlan
from mograft.synthesis.root_tabu_search import rank_substitutions, tabu_search
from mograft.synthesis.search_problem import SearchProblem
from tests.strategies import SEEDS

HAND, HIPS = "LeftHand", "Hips"


@pytest.fixture(scope="module")
def library():
    motion = dance(seed=1, strides=2).motion
    parts = mg.JointGroups.preset("lower_upper", motion.skeleton).resolve(motion.skeleton)
    members = {group: [int(joint) for joint in joints] for group, joints in parts.items()}
    clips = [motion[:900], replace(motion[900:], name="second")]
    library = mg.Library.build(clips, mg.JointGroups(members, base="upper"))
    return replace(library, config=replace(library.config, feet="never"))


def problem_of(library, constraints, groups=("lower",)):
    scenario = library.segments.of_clip(0)
    cut = library.segments[scenario]
    return SearchProblem.build(library, library.clips[0], scenario, cut, list(groups), constraints)


def drawn(problem, rng):
    """Donors at random."""
    return {g: np.array([rng.choice(own) for own in c]) for g, c in problem.candidates.items()}


def wall(library, share=0.5):
    """What keeps the hips from some of the way that they go in a graft."""
    motion = mg.graft(library).motion
    way = motion.world_positions()[:, motion.skeleton.index(HIPS)] * [1, 0, 1]
    far = way[np.linalg.norm(way - way[0], axis=1).argmax()]
    there = way[0] + share * (far - way[0])
    return mg.KeepOut(HIPS, mg.HalfSpace(tuple(there), tuple(way[0] - far)))


def aside():
    """What is missed everywhere, and the more so the farther the hips are to one side."""
    return mg.KeepOut(HIPS, mg.HalfSpace((900.0, 0.0, 0.0), (1.0, 0.0, 0.0)))


def test_only_a_group_with_the_root_carries_the_body(library):
    assert problem_of(library, []).root_group == "lower"
    names = library.groups.resolve(library.skeleton)
    members = {group: [int(j) for j in joints] for group, joints in names.items()}
    other = mg.Library.build(list(library.clips), mg.JointGroups(members, base="lower"))
    assert problem_of(other, [], ["upper"]).root_group is None


def test_in_its_own_place_every_segment_is_the_base(library):
    problem = problem_of(library, [])
    at = np.arange(len(problem.base_segments))
    poses = candidate_poses(problem, "lower", at, problem.scenario)
    turned, placed = library.clips[0].world_transforms()
    np.testing.assert_array_equal(poses.rotations, turned[poses.frames])
    np.testing.assert_array_equal(poses.positions, placed[poses.frames])


@settings(max_examples=40, deadline=None)
@given(SEEDS)
def test_donors_are_their_clip_turned_about_up_and_shifted_to_where_the_root_has_come(
    library, seed
):
    """Donors of any other place and length too, when they are given the place's length."""
    rng = np.random.default_rng(seed)
    problem, segments = problem_of(library, []), library.segments
    position = int(rng.integers(len(problem.base_segments)))
    same = np.flatnonzero(segments.lengths == problem.base_segments.lengths[position])
    donor = int(rng.choice(same))
    turn = rng.normal(size=(1, 4))
    come = RootTransforms(turn / np.linalg.norm(turn), rng.normal(size=(1, 3)) * 300)
    poses = candidate_poses(
        problem, "lower", np.array([position]), np.array([donor]), library.clips[0], come
    )
    clip = library.clips[segments.clip[donor]]
    frames = slice(segments.start[donor], segments.stop[donor] + 1)
    joints = library.joints("lower")
    placed, new = clip.world_positions()[frames][:, joints], poses.positions[:, joints]
    root = int(np.flatnonzero(joints == library.root)[0])
    np.testing.assert_allclose(new[..., 1], placed[..., 1], atol=1e-9)
    np.testing.assert_allclose(new[0, root, [0, 2]], come.positions[0, [0, 2]], atol=1e-9)
    ours, theirs = ((p - p[0, root])[..., [2, 0]] @ [1, 1j] for p in (new, placed))
    x, y, z, w = clip.world_transforms()[0][frames][0, library.root] * [-1, -1, -1, 1]
    a, b, c, d = come.rotations[0]
    heading = 2 * np.arctan2(d * y - a * z + b * w + c * x, d * w - a * x - b * y - c * z)
    np.testing.assert_allclose(ours, theirs * np.exp(1j * heading), atol=1e-8)


def test_the_cheapest_row_is_judged_where_it_goes_itself(library):
    constraint = wall(library)
    problem = problem_of(library, [constraint, mg.Face((0.0, 150.0, 500.0), weight=0.5)])
    row = build_trellis(problem, "lower", {})
    free = DonorTrellis.build(
        problem.pools["lower"], problem.scenario, row.candidates, problem.cost_models["lower"]
    )
    choices = viterbi(row.costs)
    joints = problem.driven_joints["lower"]
    come = RootTransforms.from_motion(library.clips[0], library.root)[np.array([0])]
    told, missed = [], []
    for position, donor in enumerate(row.donor_sequence(choices)):
        poses = candidate_poses(
            problem, "lower", np.array([position]), np.array([donor]), None, come
        )
        hard, soft = (c.errors(poses, joints)[0].max() for c in problem.constraints)
        told.append((INFEASIBLE_PENALTY * (1 + hard) if hard > 1 else 0.0) + 0.5 * soft**2)
        at = choices[position]
        missed.append(row.costs.unary[position][at] - free.costs.unary[position][at])
        come = RootTransforms(
            poses.rotations[-1:, library.root], poses.positions[-1:, library.root]
        )
    np.testing.assert_allclose(missed, told, rtol=1e-6, atol=1e-6)
    assert np.ptp(told) > 0


@settings(max_examples=4, deadline=None)
@given(SEEDS)
def test_exchanges_are_judged_by_all_that_they_lead(library, seed):
    """Against poses put together one exchange at a time."""
    rng = np.random.default_rng(seed)
    problem = problem_of(library, [aside(), mg.Reach(HAND, (0.0, 900.0, 0.0), 400)])
    row = build_trellis(problem, "lower", {})
    free = rng.random(len(problem.base_segments)) < 0.1
    chosen = {"lower": np.array([rng.choice(own) for own in row.candidates])}
    motion = assemble(problem, chosen)
    at, given, missed = rank_substitutions(problem, row, chosen, motion, free)
    assert (np.diff(missed) >= 0).all()
    assert free[at].all()
    assert (given != chosen["lower"][at]).all()
    poses, root = (
        problem.base_poses.with_poses(np.arange(900), *motion.world_transforms()),
        RootTransforms.from_motion(motion, library.root),
    )
    over = pose_excess(problem, poses)
    for index in rng.permutation(len(at))[:4]:
        position, donor = at[index : index + 1], given[index : index + 1]
        start, stop = (
            int(problem.base_segments.start[position[0]]),
            int(problem.base_segments.stop[position[0]]),
        )
        own = candidate_poses(problem, "lower", position, donor, motion)
        end = RootTransforms(own.rotations[-1:, library.root], own.positions[-1:, library.root])
        goes = AlignmentTransform.from_roots(root[np.array([stop])], end, library.up)
        later = np.arange(stop + 1, 900)
        rest = poses.with_poses(later, poses.rotations[later], poses.positions[later])
        expected = over[:start].sum() + pose_excess(problem, own).sum()
        expected += pose_excess(problem, goes[np.zeros(len(later), int)].apply_to_poses(rest)).sum()
        assert missed[index] == pytest.approx(expected)


@settings(max_examples=4, deadline=None)
@given(SEEDS)
def test_what_is_judged_is_what_is_given_back(library, seed):
    problem = problem_of(library, [aside()])
    several = [drawn(problem, np.random.default_rng([seed, turn])) for turn in range(2)]
    plan = GraftPlan(problem)
    for donors, excess in zip(
        several, donor_excesses(problem, several, 3, 9)["lower"], strict=True
    ):
        motion = plan.build_graft(donors, 0, 0).motion
        np.testing.assert_array_equal(motion.positions, assemble(problem, donors).positions)
        error, _ = problem.constraints[0].errors(mg.Poses.from_motion(motion))
        begin, end = problem.base_segments.start[3], problem.base_segments.stop[8]
        expected = np.maximum(error[begin : end + 1] - 1.0, 0.0)
        assert expected.min() > 0
        np.testing.assert_allclose(excess, expected, atol=1e-9)


def test_leading_is_never_for_the_worse_and_touches_nothing_that_is_met(library):
    problem = problem_of(library, [wall(library)])
    rows = {"lower": build_trellis(problem, "lower", {})}
    rng = np.random.default_rng(4)

    def total(donors):
        return donor_excess(problem, donors)["lower"].sum()

    def kept(motion, donors):
        del donors
        return motion

    changed = 0
    for _ in range(2):
        raw = {"lower": np.array([rng.choice(own) for own in rows["lower"].candidates])}
        led = tabu_search(problem, raw, rows, kept)
        assert total(led) <= total(raw)
        if total(raw) == 0:
            np.testing.assert_array_equal(led["lower"], raw["lower"])
        changed += (led["lower"] != raw["lower"]).any()
    assert changed
    beyond = replace(problem, constraints=(mg.Reach(HIPS, (500.0, 900.0, 0.0), 500),))
    seen = []

    def watched(motion, donors):
        seen.append(donor_excess(beyond, donors)["lower"].sum())
        return motion

    led = tabu_search(beyond, problem.captured_donors, rows, watched)
    assert seen[0] > donor_excess(beyond, led)["lower"].sum() == min(seen) > 0
    far = replace(problem, constraints=(mg.Avoid(mg.Sphere((0.0, 9000.0, 0.0), 5.0)),))
    np.testing.assert_array_equal(tabu_search(far, raw, rows, kept)["lower"], raw["lower"])


def test_leading_looks_at_the_finished_motion(library):
    """What is done to the motion last is led around too."""
    constraint = wall(library)
    problem = problem_of(library, [constraint])
    rows = {"lower": build_trellis(problem, "lower", {})}
    donors = tabu_search(problem, problem.captured_donors, rows, lambda motion, _: motion)
    region = constraint.region
    outward = np.array(region.normal) / np.linalg.norm(region.normal)
    hips = assemble(problem, donors).world_positions()[:, library.root]
    push = -outward * (((hips - region.point) @ outward).min() + 0.01 * problem.base_poses.height)

    def pushed(motion, donors):
        del donors
        places = motion.positions.copy()
        places[300:, library.root] += push
        return replace(motion, positions=places, channel_values=None)

    def missed(donors):
        motion = pushed(assemble(problem, donors), donors)
        return constraint.errors(mg.Poses.from_motion(motion))[0].max()

    assert missed(donors) > 1.0
    assert missed(tabu_search(problem, donors, rows, pushed)) <= 1.0


@pytest.mark.parametrize("choice", ["viterbi", "sample", "random"])
def test_hips_stay_on_their_side_of_a_wall(library, choice):
    chosen = replace(library, config=replace(library.config, choice=choice, feet="auto"))
    constraint = wall(library)
    missed, _ = constraint.errors(mg.Poses.from_motion(mg.graft(library).motion))
    assert missed.max() > 1.0
    graft = mg.graft(chosen, constraints=[constraint])
    error, _ = constraint.errors(mg.Poses.from_motion(graft.motion))
    assert error.max() <= 1.0
    assert not graft.violations


def test_places_that_other_donors_lead_to_are_reached(library):
    problem, rng = problem_of(library, []), np.random.default_rng(6)
    met = 0
    for turn in range(10):
        joint = (HAND, HIPS)[turn % 2]
        at = library.skeleton.index(joint)
        motion = assemble(problem, drawn(problem, rng))
        frame = int(rng.integers(100, motion.n_frames))
        target = tuple(motion.world_positions()[frame, at])
        graft = mg.graft(library, constraints=[mg.Reach(joint, target, frame)])
        place = graft.motion.world_positions()[frame, at]
        reached = np.linalg.norm(place - target) <= 0.03 * problem.base_poses.height
        assert reached == (not graft.violations)
        met += reached
    assert met >= 9
