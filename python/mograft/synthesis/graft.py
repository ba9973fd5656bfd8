"""Grafting: new motions from a library and a base motion."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import inf, pi
from numbers import Real
from weakref import WeakValueDictionary

from mograft._util.arrays import IntArray
from mograft._util.containers import LazySequence
from mograft._util.memory import check_memory
from mograft._util.validate import as_integer, check_type
from mograft.config import variety_of_scale
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.scenario import Scenario
from mograft.search.constraints import Constraint, Violation
from mograft.search.trellis import DonorSequences
from mograft.solve.donor_repair import restrict_to_violations
from mograft.solve.finish import find_kept_violations
from mograft.solve.plan import GraftPlan, grafted_groups
from mograft.solve.search_problem import SearchProblem, check_frames
from mograft.synthesis.graft_building import build_graft
from mograft.synthesis.graft_result import Graft, GraftRequest
from mograft.synthesis.newness import grafted_joints, mean_angle

MAX_SIGMA_SCALE = 4.0
"""At four times the spread of all segments one cluster contains them all."""

_DRAWN_PER_MOTION = 4
"""Number of motions that are drawn for each that is wanted, if they must be distinct."""

MEMORY_FACTOR = 6
"""Memory of a graft, in addition to library and base, as a multiple of the arrays of the base."""


@dataclass(frozen=True, eq=False)
class Grafts(LazySequence[Graft]):
    """Several grafts of one base motion.

    A graft is built when it is first accessed, and kept only as long as something else refers to
    it, because a motion is large: then every access returns the same object.
    """

    _plan: GraftPlan
    _donors: tuple[DonorSequences, ...]
    _seed: int
    notes: tuple[str, ...] = ()
    """How often the clusters were enlarged, one sentence each."""
    _request: GraftRequest = field(default_factory=GraftRequest)
    _built: WeakValueDictionary[int, Graft] = field(
        default_factory=WeakValueDictionary, init=False, repr=False
    )

    def __reduce__(self) -> tuple[type["Grafts"], tuple[object, ...]]:
        return Grafts, (self._plan, self._donors, self._seed, self.notes, self._request)

    def __len__(self) -> int:
        return len(self._donors)

    def __repr__(self) -> str:
        return f"Grafts({len(self)} on {self._plan.problem.base.name}, seed {self._seed})"

    def item(self, index: int) -> Graft:
        """Build a graft, or return the one that was built and is still referred to."""
        graft = self._built.get(index)
        if graft is None:
            graft = build_graft(self._plan, self._donors[index], self._seed, index, self._request)
            self._built[index] = graft
        return graft


def graft(
    library: Library,
    base: Motion | str | None = None,
    *,
    constraints: Sequence[Constraint] = (),
    swap: Sequence[str] | None = None,
    seed: int = 0,
    scenario: Sequence[int] | IntArray | Scenario | None = None,
) -> Graft:
    """Make a new motion: in a base motion, replace joint groups by those of other segments.

    Parameters
    ----------
    library : Library
        The library whose segments are the donors.
    base : Motion or str, optional
        The motion whose base group is kept, or its name in the library. A motion outside the
        library is segmented and embedded with the library's parameters. Default: the first
        clip.
    constraints : sequence of Constraint, optional
        Hard and soft constraints: see `mograft.constraints`.
    swap : sequence of str, optional
        The joint groups to replace. Default: all but the base group.
    seed : int
        Seed of the random choice, with ``Config(choice="sample")`` and "random". The same seed
        gives the same motion.
    scenario : sequence of int or Scenario, optional
        Segments of the library, in any order, that form the base instead of a clip; or a result
        of `mograft.scenario`. Each segment starts at the position and heading at which the
        previous one ends.

    Returns
    -------
    Graft
        The new motion and the donor of every segment. A segment without a donor within the
        limits keeps its captured motion; `Graft.report` counts these segments.
        `Graft.violations` lists the hard constraints that the best motion found violates.

    Raises
    ------
    SkeletonMismatchError
        If the base has another hierarchy than the library.
    TypeError
        If an item of `constraints` is not a constraint.
    MemoryBudgetError
        If the graft needs more memory than is available; see `docs/reliability.md`.
    ValueError
        If `swap` names an unknown group or the base group; if a constraint names a joint, clip
        or frame that does not exist; if `scenario` names an unknown segment or is given
        together with `base`.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> new = graft(library, seed=7)
    >>> new.motion.n_frames == library.clips[0].n_frames
    True
    """
    return graft_many(
        library, base, 1, constraints=constraints, swap=swap, seed=seed, scenario=scenario
    )[0]


def graft_many(
    library: Library,
    base: Motion | str | None = None,
    count: int = 1,
    *,
    constraints: Sequence[Constraint] = (),
    swap: Sequence[str] | None = None,
    seed: int = 0,
    scenario: Sequence[int] | IntArray | Scenario | None = None,
    widen: bool = True,
    distinct: float = 0.0,
) -> Grafts:
    """Make several different new motions from one base motion; see `graft`.

    Parameters
    ----------
    library, base, constraints, swap, seed, scenario
        As for `graft`, which returns the first of these motions.
    count : int
        Greatest number of motions.
    widen : bool
        Whether `Config.sigma_scale` is multiplied by 4/3 until the donors allow `count` different
        motions or it would exceed 4. `Grafts.notes` describes each step. If they never do, the
        result is that of the step with the most motions.
    distinct : float
        Smallest mean angle, in radians, between the exchanged joints of any two of the motions.
        Motions that are nearer to an earlier one are left out. Each motion is then built once
        more when it is accessed.

    Returns
    -------
    Grafts
        The motions, each built when it is accessed. There are fewer than `count` if no more
        different ones exist; random choices stop after 100 consecutive draws that repeat
        earlier ones. Donors of earlier motions cost `Config.diversity` more in later ones,
        except with ``Config(choice="random")``. With "viterbi" the first motion is
        the cheapest. In a small library `Config.self_repair` can make two motions equal.

    Raises
    ------
    ValueError
        As for `graft`, and if `count` is below 1, `seed` is negative or not an integer, or
        `distinct` is not from 0 to π.

    Warns
    -----
    UserWarning
        Before the last search, if the candidates of all segments allow fewer combinations.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> grafts = graft_many(library, count=3, seed=7)
    >>> len(grafts), [graft.motion.name for graft in grafts]
    (3, ['dance_graft0', 'dance_graft1', 'dance_graft2'])
    """
    count, seed = as_integer("count", count, 1), as_integer("seed", seed)
    _check_base(library, base)
    if isinstance(distinct, bool) or not isinstance(distinct, Real) or not 0 <= distinct <= pi:
        raise ValueError(f"`distinct` must be an angle from 0 to π, in radians, got {distinct!r}")
    if scenario is None:
        _check_memory(library, base)
    notes: list[str] = []
    best: Grafts | None = None
    while True:
        plan = GraftPlan.build(library, base, swap, constraints, scenario)
        is_last = not widen or _next_scale(library) > MAX_SIGMA_SCALE
        if is_last and (n := plan.n_combinations) < count:
            warnings.warn(f"at most {n} different motions exist, not {count}", stacklevel=2)
        donors = _choose_donors(plan, count, seed, float(distinct))
        if best is None or len(donors) >= len(best):
            best = Grafts(plan, donors, seed, _request=_request(plan, base, swap))
        if is_last or len(donors) >= count:
            break
        wider = _widened(library)
        scales = [variety_of_scale(own.config.sigma_scale) for own in (library, wider)]
        notes.append(
            f"only {len(donors)} different motions with a variety of {scales[0]:.2f}; trying "
            f"{scales[1]:.2f}, which allows less similar donors"
        )
        library = wider
    if best._plan is not plan:
        notes.append(f"the attempt with {len(best)} motions is kept")
    return replace(best, notes=tuple(notes))


def _choose_donors(
    plan: GraftPlan, count: int, seed: int, distinct: float
) -> tuple[DonorSequences, ...]:
    """Return the donors of `count` motions that differ by `distinct`; fewer if there are none.

    Motions are taken in the order of the choice; those too near to one taken before are left out.
    """
    if not distinct:
        return tuple(plan.choose_donors(count, seed))
    chosen: list[tuple[DonorSequences, Motion]] = []
    for donors in plan.choose_donors(_DRAWN_PER_MOTION * count, seed):
        own = build_graft(plan, donors, seed, len(chosen))
        joints = grafted_joints(own)
        if all(mean_angle(own.motion, other, joints) >= distinct for _, other in chosen):
            chosen.append((donors, own.motion))
        if len(chosen) == count:
            break
    return tuple(donors for donors, _ in chosen)


def repair(
    library: Library,
    base: Motion | str | None = None,
    *,
    constraints: Sequence[Constraint],
    swap: Sequence[str] | None = None,
    widest: float = MAX_SIGMA_SCALE,
) -> Graft:
    """Change a captured motion only near violations of hard constraints (paper, 5.2).

    Parameters
    ----------
    library, base, constraints, swap
        As for `graft`.
    widest : float
        Largest `Config.sigma_scale` to try. The clusters are enlarged step by step as long as
        violations remain that donors can remove. The scale that was used is
        ``library.config.sigma_scale`` of the returned graft.

    Returns
    -------
    Graft
        The motion with other donors for the violating segments of the violating group, and for
        their neighbours if that is cheaper. Seam treatment changes `Config.seam_blend` seconds
        more on either side. Inverse kinematics moves a hand or foot near the target of a
        `Reach` even if it was within the tolerance; see `Config.reach_ik`. Everything else is bit
        for bit as captured; but if a grafted group contains the root, all frames after a change are
        moved rigidly over the floor. `Graft.violations` lists the remaining violations.

    Raises
    ------
    SkeletonMismatchError, TypeError, ValueError
        As for `graft`. ValueError also if `widest` is not finite or not above 0.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> from mograft.search.obstacles import Sphere
    >>> from mograft.search.pose_constraints import Avoid
    >>> motion = dance(strides=1).motion
    >>> far = Avoid(Sphere((0.0, 900.0, 0.0), 5.0))
    >>> any(not s.is_own for s in repair(Library.build(motion), constraints=[far]).substitutions)
    False
    """
    _check_base(library, base)
    if isinstance(widest, bool) or not isinstance(widest, Real) or not 0 < widest < inf:
        raise ValueError(f"`widest` must be a finite number above 0, got {widest!r}")
    # Without novelty the captured parts are the cheapest.
    config = replace(library.config, novelty=0.0, choice="viterbi", self_repair=False)
    library = replace(library, config=config)
    best: Graft | None = None
    donors: DonorSequences | None = None
    while True:
        plan = GraftPlan.build(library, base, swap, constraints)
        # Donors found with smaller clusters stay.
        donors = plan.problem.captured_donors if donors is None else donors
        plan = replace(plan, problem=restrict_to_violations(plan.problem, donors))
        donors = plan.repair(donors)
        request = replace(_request(plan, base, swap), method="repair")
        graft = build_graft(plan, donors, 0, 0, request)
        best = graft if best is None else min(best, graft, key=total_excess)
        if not can_be_removed(best, plan.problem) or _next_scale(library) > widest:
            return best
        library = _widened(library)


def kept_violations(
    library: Library,
    base: Motion | str | None = None,
    *,
    constraints: Sequence[Constraint],
    swap: Sequence[str] | None = None,
) -> list[Violation]:
    """Return the violations of hard constraints that no donor can remove.

    They are by joints that are not exchanged. The search need not run if there are any. The
    arguments are those of `graft`.
    """
    if not constraints:
        return []
    groups = grafted_groups(library, swap)
    library, clip = library.resolve_base(base)
    check_frames(constraints, library.clips[clip])
    return find_kept_violations(library, library.clips[clip], groups, constraints)


def _request(
    plan: GraftPlan, base: Motion | str | None, swap: Sequence[str] | None
) -> GraftRequest:
    return GraftRequest(
        base=None if base is None else plan.problem.base.name,
        swap=None if swap is None else tuple(swap),
        constraints=plan.problem.constraints,
        scenario=plan.scenario,
    )


def _next_scale(library: Library) -> float:
    """Return the `Config.sigma_scale` of the next larger clusters."""
    return library.config.sigma_scale * 4 / 3


def _widened(library: Library) -> Library:
    """Return a library with the next larger clusters."""
    return library.relabelled(replace(library.config, sigma_scale=_next_scale(library)))


def can_be_removed(graft: Graft, problem: SearchProblem) -> bool:
    """Return whether a graft has a violation by a joint that donors move."""
    base, groups = problem.base, list(problem.pools)
    kept = find_kept_violations(problem.library, base, groups, problem.constraints)
    known = {(own.frames, own.worst, own.joint) for own in kept}
    return any((own.frames, own.worst, own.joint) not in known for own in graft.violations)


def total_excess(graft: Graft) -> float:
    """Return by how much a graft violates its constraints."""
    return sum(violation.error - 1.0 for violation in graft.violations)


def _check_base(library: object, base: object) -> None:
    check_type("library", library, Library)
    if base is not None and not isinstance(base, str):
        check_type("base", base, Motion)


def _check_memory(library: Library, base: Motion | str | None) -> None:
    """Raise MemoryBudgetError if a graft on the base needs more memory than is available."""
    if isinstance(base, Motion):
        name, n_frames = base.name, base.n_frames
    else:
        clip = library.names.index(base) if base in library.names else 0
        name, n_frames = library.names[clip], library.entries[clip].n_frames
    n_numbers = 7 * library.skeleton.n_joints + library.skeleton.n_channels
    check_memory(
        f"a graft on {name} with {n_frames} frames",
        MEMORY_FACTOR * 8 * n_numbers * n_frames,
        "divide the base into parts, such as motion[:100000], or use a computer with more memory",
    )
