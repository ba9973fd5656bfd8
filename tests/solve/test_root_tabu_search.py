"""Properties of the tabu search over donors that drive the root."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

import mograft as mg
import mograft.constraints as mc
from mograft.blend.rigid_alignment import AlignmentTransform, RootTransforms
from mograft.solve.assembly import assemble, donor_excess, donor_excesses, pose_excess
from mograft.solve.donor_repair import rank_substitutions, tabu_search
from mograft.solve.donor_trellis import build_trellis, candidate_poses
from mograft.solve.plan import GraftPlan
from mograft.synthesis.graft_building import build_graft
from tests.grafting_fixtures import make_problem
from tests.strategies import SEEDS, few_examples

HAND, HIPS = "LeftHand", "Hips"


@settings(max_examples=2, deadline=None)
@given(SEEDS)
def test_rank_substitutions_predicted_violation_matches_each_moved_motion(root_library, seed):
    rng, root = np.random.default_rng(seed), root_library.root
    # Every pose violates the wall, by the distance of the hips along x.
    wall = mc.KeepOut(HIPS, mc.HalfSpace((900.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    problem = make_problem(root_library, [wall, mc.Reach(HAND, (0.0, 900.0, 0.0), 400)])
    segments = problem.base_segments
    trellis = build_trellis(problem, "lower", {})
    is_free = rng.random(len(segments)) < 0.1
    chosen = {"lower": np.array([rng.choice(own) for own in trellis.candidates])}
    motion = assemble(problem, chosen)
    positions, donors, predicted = rank_substitutions(problem, trellis, chosen, motion, is_free)
    assert (np.diff(predicted) >= 0).all()
    assert is_free[positions].all()
    assert (donors != chosen["lower"][positions]).all()
    poses = problem.base_poses.with_poses(np.arange(900), *motion.world_transforms())
    roots = RootTransforms.from_motion(motion, root)
    excess = pose_excess(problem, poses)
    for i in rng.permutation(len(positions))[:4]:
        position, donor = positions[i : i + 1], donors[i : i + 1]
        start, stop = int(segments.start[position[0]]), int(segments.stop[position[0]])
        own = candidate_poses(problem, "lower", position, donor, motion)
        end = RootTransforms(own.rotations[-1:, root], own.positions[-1:, root])
        move = AlignmentTransform.from_roots(roots[np.array([stop])], end, root_library.up)
        later = np.arange(stop + 1, 900)
        rest = poses.with_poses(later, poses.rotations[later], poses.positions[later])
        moved = move[np.zeros(len(later), int)].apply_to_poses(rest)
        expected = excess[:start].sum() + pose_excess(problem, own).sum()
        assert predicted[i] == pytest.approx(expected + pose_excess(problem, moved).sum())


@pytest.mark.parametrize("group", ["lower", "upper"])
@few_examples(2)
@given(SEEDS)
def test_donor_excesses_in_a_range_are_those_of_the_grafts(root_library, two_dances, group, seed):
    library = {"lower": root_library, "upper": two_dances}[group]
    library = replace(library, config=replace(library.config, self_repair=False))
    sky = mc.KeepOut(HAND, mc.HalfSpace((0.0, 900.0, 0.0), (0.0, 1.0, 0.0)))
    problem = make_problem(library, [sky], [group])
    rng, candidates = np.random.default_rng(seed), problem.candidates[group]
    first = int(rng.integers(len(candidates) - 4))
    alternatives = [{group: np.array([rng.choice(own) for own in candidates])} for _ in range(3)]
    excesses = donor_excesses(problem, alternatives, first, first + 4)[group]
    begin, end = problem.base_segments.start[first], problem.base_segments.stop[first + 3]
    for donors, excess in zip(alternatives, excesses, strict=True):
        motion = build_graft(GraftPlan(problem), donors, 0, 0).motion
        error = sky.errors(mg.Poses.from_motion(motion))[0][begin : end + 1]
        assert error.min() > 1.0
        # Seams far away have a small influence: see `seam_reach`.
        np.testing.assert_allclose(excess, error - 1.0, rtol=1e-4)


def test_tabu_search_unreachable_target_returns_the_best_evaluated_sequence(root_library, wall):
    problem = make_problem(root_library, [wall])
    trellises = {"lower": build_trellis(problem, "lower", {})}
    unreachable = replace(problem, constraints=(mc.Reach(HIPS, (500.0, 900.0, 0.0), 500),))
    seen = []

    def total(donors):
        return donor_excess(unreachable, donors)["lower"].sum()

    def record(motion, donors):
        seen.append(total(donors))
        return motion

    found = tabu_search(unreachable, problem.captured_donors, trellises, record)
    assert seen[0] > total(found) == min(seen) > 0


def test_tabu_search_evaluates_the_finished_motion(root_library, wall):
    problem, root = make_problem(root_library, [wall]), root_library.root
    trellises = {"lower": build_trellis(problem, "lower", {})}
    donors = tabu_search(problem, problem.captured_donors, trellises, lambda motion, _: motion)
    outward = np.array(wall.region.normal) / np.linalg.norm(wall.region.normal)
    hips = assemble(problem, donors).world_positions()[:, root]
    clearance = ((hips - wall.region.point) @ outward).min()
    shift = -outward * (clearance + 0.01 * problem.base_poses.height)

    def push_into_wall(motion, donors):
        del donors
        positions = motion.positions.copy()
        positions[300:, root] += shift
        return replace(motion, positions=positions, channel_values=None)

    def largest_error(donors):
        motion = push_into_wall(assemble(problem, donors), donors)
        return wall.errors(mg.Poses.from_motion(motion))[0].max()

    assert largest_error(donors) > 1.0
    assert largest_error(tabu_search(problem, donors, trellises, push_into_wall)) <= 1.0


@pytest.mark.parametrize("choice", ["viterbi", "sample", "random"])
def test_graft_with_a_wall_keeps_the_hips_on_one_side(root_library, wall, choice):
    library = replace(root_library, config=replace(root_library.config, choice=choice, feet="auto"))
    error, _ = wall.errors(mg.Poses.from_motion(mg.graft(root_library).motion))
    assert error.max() > 1.0
    graft = mg.graft(library, constraints=[wall])
    error, _ = wall.errors(mg.Poses.from_motion(graft.motion))
    assert error.max() <= 1.0
    assert not graft.violations
