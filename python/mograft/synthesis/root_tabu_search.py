"""Lead a root that donors carry to where constraints are met.

Where a grafted group holds the root, its donors carry the body over the floor, one after the
other. Another donor in one place is felt there, and leads all that follows elsewhere: turned
about up and shifted over the floor, as it is. So every exchange in the row is judged by where it
would lead the motion, and the most promising are put together.
"""

from collections.abc import Callable, Mapping

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.blend.rigid_alignment import AlignmentTransform, RootTransforms
from mograft.motion.motion import Motion
from mograft.search.candidates import INFEASIBLE_PENALTY, DonorTrellis
from mograft.search.viterbi import Trellis
from mograft.synthesis.search_problem import DonorSequences, SearchProblem

__all__ = ["rank_substitutions", "tabu_search"]

_TURNS = 64
"""Exchanges that are made, at most."""
_PATIENCE = 16
"""Of which so many in a row may be of no help."""
_TENURE = 6
"""Turns that the place of an exchange is left alone, at most."""
_FEW = 2
"""Exchanges of which one is made: so many are put together."""

_POSES = 200_000
"""Poses by which all exchanges are judged, about; where there are more, every so many-th."""
_CHUNK = 20_000
"""Poses that are looked at at a time."""


def tabu_search(
    problem: SearchProblem,
    donors: DonorSequences,
    rows: Mapping[str, DonorTrellis],
    finish: Callable[[Motion, DonorSequences], Motion],
) -> DonorSequences:
    """Exchange donors that carry the root, one at a time, until hard constraints are met.

    Parameters
    ----------
    problem : SearchProblem
        What is demanded.
    donors : dict of str to ndarray of int
        The choice so far.
    rows : mapping of str to DonorTrellis
        The donors that are looked at.
    finish : callable
        What is done to a motion of some donors once it is put together, such as planting its
        feet.

    Returns
    -------
    dict of str to ndarray of int
        Of all choices that were finished the one that misses least, and of those the first.
        Where no group holds the root, or nothing is missed, `donors`.

    Notes
    -----
    Where no exchange helps, one is made all the same, and its place left alone for a while, so
    that others lead on from there (tabu search: Glover, ORSA J. Computing 1, 1989).
    """
    group = problem.root_group
    if group is None or group not in rows or not problem.applies.any():
        return donors
    row = DonorTrellis.build(
        problem.pools[group], problem.scenario, rows[group].candidates, problem.config
    )
    tenure = min(_TENURE, sum(len(own) > 1 for own in row.candidates) // 2)

    def made(choice: DonorSequences) -> tuple[float, DonorSequences, Motion]:
        motion = finish(problem.assembled(choice), choice)
        poses = problem.poses.with_poses(np.arange(motion.n_frames), *motion.world_transforms())
        return float(problem.over(poses).sum()), choice, motion

    now = made(donors)
    least, kept = now[:2]
    free, idle = np.zeros(len(problem.base_segments), np.int64), 0
    for turn in range(_TURNS):
        if least == 0 or idle == _PATIENCE:
            break
        at, given, _ = rank_substitutions(problem, row, now[1], now[2], free <= turn)
        tried = []
        for position, donor in zip(at[:_FEW].tolist(), given[:_FEW].tolist(), strict=True):
            own = now[1][group].copy()
            own[position] = donor
            tried.append((*made({**now[1], group: own}), position))
            if tried[-1][0] < least:
                break
        if not tried:
            break
        nearest = min(tried, key=lambda one: one[0])
        now, where = nearest[:3], nearest[3]
        free[where] = turn + 1 + tenure
        idle += 1
        if now[0] < least:
            least, kept, idle = now[0], now[1], 0
    return kept


def rank_substitutions(
    problem: SearchProblem,
    row: DonorTrellis,
    chosen: DonorSequences,
    motion: Motion,
    free: BoolArray,
) -> tuple[IntArray, IntArray, FloatArray]:
    """Return single exchanges of donors that carry the root, the most promising first.

    Parameters
    ----------
    problem : SearchProblem
        What is demanded.
    row : DonorTrellis
        What donors cost by themselves.
    chosen : dict of str to ndarray of int
        The choice so far.
    motion : Motion
        The motion of that choice; it must miss something.
    free : ndarray of bool, shape (n_positions,)
        Where donors may be exchanged.

    Returns
    -------
    at, given : ndarray of int, shape (n,)
        Positions before the last frame that misses something, and donors for them. None adds
        a limit that its seams miss.
    missed : ndarray, shape (n,)
        What the motion would miss in all, in tolerances: of equals the cheaper comes first.
        Seams are not closed anew, and of many poses only every so many-th is looked at.
    """
    group, cut = problem.root_group, problem.base_segments
    assert group is not None
    poses = problem.poses.with_poses(np.arange(motion.n_frames), *motion.world_transforms())
    root = RootTransforms.from_motion(motion, problem.library.root)
    over = problem.over(poses)
    at, which, cost = _within(row, row.path(chosen[group]))
    sensible = (free & (cut.start < np.flatnonzero(over)[-1]))[at]
    at, which, cost = at[sensible], which[sensible], cost[sensible]
    given = np.array([row.candidates[p][c] for p, c in zip(at, which, strict=True)], np.int64)
    begins, ends = cut.start[at], cut.stop[at]
    # Before it all stays as it is; in its own place
    missed = np.concatenate([[0.0], np.cumsum(over)])[begins]
    come = root[begins]
    looks = np.flatnonzero(problem.active[at])
    counts = cut.lengths[at] + 1
    for some in _chunks(looks, counts[looks]):
        own = problem.candidate_poses(group, at[some], given[some], motion, come[some])
        missed[some] += np.add.reduceat(problem.over(own), np.cumsum(counts[some]) - counts[some])
    # and after it all is moved as it is.
    goes = AlignmentTransform.from_roots(root[ends], problem.led(given, come), problem.library.up)
    frames = np.flatnonzero(problem.applies)
    every = max(1, int(np.ceil(len(frames) * len(at) / (2 * _POSES))))
    frames = frames[::every]
    index, later = np.nonzero(frames > ends[:, None])
    for some in _chunks(np.arange(len(index)), np.ones(len(index), np.int64)):
        moments = frames[later[some]]
        there = poses.with_poses(moments, poses.rotations[moments], poses.positions[moments])
        moved = problem.over(goes[index[some]].apply_to_poses(there))
        missed += every * np.bincount(index[some], moved, len(at))
    order = np.lexsort([cost, missed])
    return at[order], given[order], missed[order]


def _within(row: DonorTrellis, choices: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Return positions, other choices there that add no limit missed, and what they add."""
    costs = _alone(row.costs, choices)
    more = [own - own[choice] for own, choice in zip(costs, choices.tolist(), strict=True)]
    at = np.repeat(np.arange(len(more)), [len(own) for own in more])
    which = np.concatenate([np.arange(len(own)) for own in more])
    cost = np.concatenate(more)
    other = (which != choices[at]) & (cost < INFEASIBLE_PENALTY / 2)
    return at[other], which[other], cost[other]


def _alone(chain: Trellis, choices: IntArray) -> list[FloatArray]:
    """Return what each choice costs with its neighbours as chosen."""
    costs = list(chain.unary)
    for position, after in enumerate(chain.pairwise):
        costs[position] = costs[position] + after[:, choices[position + 1]]
        costs[position + 1] = costs[position + 1] + after[choices[position]]
    return costs


def _chunks(some: IntArray, counts: IntArray) -> list[IntArray]:
    """Return some in turns, so that what they count in one is never too much at once."""
    turn = np.cumsum(counts) // _CHUNK
    return np.split(some, np.flatnonzero(np.diff(turn)) + 1) if len(some) else []
