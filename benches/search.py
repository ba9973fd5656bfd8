"""Measure the search: its speed, and its seams and satisfied constraints against random choice.

Run as ``python benches/search.py FILE.bvh...``; speeds and stream need no file. It prints

- ``speeds``: medians, and the ratios to the oracles in `tests/oracles`;
- ``stream``: the time in which a stream decides a segment;
- ``gains``: for every file the mean seam gap of the cheapest donor sequence, of ten draws by cost
  and of ten uniform draws;
- ``reach``: how many of twenty reachable targets are reached;
- ``lead``: if donors hold the root, how many of twenty constraints of each kind are satisfied.

``--only NAME`` prints one of these.
"""

import argparse
import platform
import statistics
import sys
import tempfile
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
import mograft.constraints as mc
from benches._common import run, tiny_motion
from mograft import _core
from mograft.body.capsules import clearance
from mograft.dancer import dance
from mograft.search.boundary_states import BoundaryStates
from mograft.search.donor_choice import cost_model
from mograft.search.segment_pool import SegmentPool
from mograft.search.trellis import DonorTrellis, Trellis, viterbi
from mograft.solve.assembly import assemble
from mograft.solve.search_problem import SearchProblem
from tests.oracles import capsules as capsules_oracle
from tests.oracles import search as search_oracle

CONFIG = mg.Config()
CLUSTERS = mg.Config(neighbourhood="cluster")  # random points have no neighbours
HANDS = ("LeftHand", "Hand_L", "LeftWrist", "lHand")


def upper_body_library(motion):
    """A library whose base group is the upper body."""
    parts = mg.JointGroups.preset("lower_upper", motion.skeleton).resolve(motion.skeleton)
    members = {group: [int(joint) for joint in joints] for group, joints in parts.items()}
    return mg.Library.build(motion, mg.JointGroups(members, base="upper"))


def median_seconds(function, repeats):
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def print_times(name, ours, oracle):
    print(f"{name:58} {ours * 1e3:9.2f} ms {oracle * 1e3:11.1f} ms {oracle / ours:8.1f}")


def make_pool(n, rng):
    """Return n random segments in clusters of about thirty."""
    lengths = rng.integers(4, 20, n)
    stops = np.cumsum(lengths)
    quats = rng.normal(size=(n + 1, 11, 4))
    quats /= np.linalg.norm(quats, axis=-1, keepdims=True)
    velocities = rng.normal(size=(n + 1, 11, 3))
    labels = rng.integers(0, max(n // 30, 1), n)
    segments = mg.Segments(stops - lengths, stops)
    points = rng.normal(size=(n, 10))
    boundary = BoundaryStates(
        first=quats[:-1],
        last=quats[1:],
        first_velocity=velocities[:-1],
        last_velocity=velocities[1:],
    )
    return SegmentPool(segments, labels, np.ones(n, bool), boundary, 30.0, points, 5.0)


def speeds(repeats, n_segments=10_000, n_positions=900):
    rng = np.random.default_rng(0)
    print(f"{'':58} {'mograft':>12} {'oracle':>14} {'ratio':>8}")
    pools = [make_pool(n_segments, rng) for _ in range(3)]
    scenario = np.arange(n_segments)

    def list_candidates():
        for pool in pools:
            lists = pool.candidate_lists(scenario, CLUSTERS)
            counts = [len(candidates) for candidates in lists]
            model = cost_model(CLUSTERS, pool)
            pool.unary_costs(np.repeat(scenario, counts), np.concatenate(lists), model)

    def run_oracle():
        for pool in pools:
            search_oracle.candidates(pool.labels, pool.segments.lengths, 30.0, CLUSTERS)

    print_times(
        "candidates of 10,000 segments, 3 groups",
        median_seconds(list_candidates, repeats),
        median_seconds(run_oracle, 1),
    )

    unary = [rng.normal(size=30) for _ in range(n_positions)]
    seams = [rng.normal(size=(30, 30)) for _ in range(n_positions - 1)]
    trellis = Trellis(tuple(unary), tuple(seams))
    ours = median_seconds(lambda: viterbi(trellis), repeats)
    print_times(
        "Viterbi, 900 positions of 30",
        ours,
        median_seconds(lambda: search_oracle.cheapest_sequence(unary, seams), 3),
    )

    lists = pools[0].candidate_lists(scenario[:n_positions], CLUSTERS)

    def build_trellis():
        model = cost_model(CLUSTERS, pools[0])
        DonorTrellis.build(pools[0], scenario[:n_positions], lists, model)

    ours = median_seconds(build_trellis, repeats)

    def run_seam_oracle():
        for left, right in pairwise(lists[:100]):
            for a in left:
                for b in right:
                    search_oracle.seam_angle(pools[0].boundary.last[a], pools[0].boundary.first[b])

    print_times(
        "seam costs of 900 positions (oracle: times 9)",
        ours,
        9 * median_seconds(run_seam_oracle, 1),
    )

    ends, others = rng.normal(size=(240, 11, 2, 3)), rng.normal(size=(240, 11, 2, 3))
    radii = np.full(11, 0.05)
    pairs = np.argwhere(np.ones((11, 11)))
    ours = median_seconds(lambda: clearance(ends, radii, others, radii, None, pairs), 20 * repeats)
    theirs = median_seconds(
        lambda: capsules_oracle.capsule_distances(ends, radii, others, radii), repeats
    )
    print_times("collision, 30 candidates x 8 frames x 11 x 11 capsules", ours, theirs)


def stream(n_dances=13, n_frames=None):
    """Time the decisions of a stream that receives frame by frame, on a library in a folder."""
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/dances.mograft"
        mg.Library.build([dance(seed=seed).motion[:n_frames] for seed in range(n_dances)]).save(
            path
        )
        library = mg.Library.open(path)
        base = dance(seed=99).motion[:n_frames]
        sphere = mc.Avoid(mc.Sphere((30.0, 130.0, 40.0), 30.0))
        print(f"\nstream on {library}\n{'':44} {'median':>9} {'99 %':>9} {'maximum':>9}")
        for name, constraints in (
            ("decide a segment", []),
            ("decide a segment, avoiding a sphere", [sphere]),
            ("the same, and self-collision", [sphere, mc.AvoidSelf()]),
        ):
            live = mg.Stream(library, constraints=constraints)
            decision_times, push_times = [], []
            for frame in range(base.n_frames):
                start = time.perf_counter()
                live.push(base[frame : frame + 1])
                push_times.append(time.perf_counter() - start)
                while True:
                    start = time.perf_counter()
                    piece = live.advance()
                    spent = time.perf_counter() - start
                    if piece is None:
                        break
                    decision_times.append(spent)
            quantiles = np.percentile(decision_times, [50, 99, 100]) * 1e3
            print(f"{name:44} " + " ".join(f"{q:6.2f} ms" for q in quantiles), len(decision_times))
        for horizon in (1, 8):
            live = mg.Stream(library, horizon=horizon)
            delays = []
            for frame in range(base.n_frames):
                live.push(base[frame : frame + 1])
                delays += [frame - piece.stop for piece in live.pieces()]
            seconds = np.percentile(delays, [50, 100]) / library.rate
            print(
                f"delay with a horizon of {horizon}: median {seconds[0]:.2f} s, "
                f"maximum {seconds[1]:.2f} s"
            )
        quantiles = np.percentile(push_times, [50, 99, 100]) * 1e3
        print(f"{'push a frame':44} " + " ".join(f"{q:6.2f} ms" for q in quantiles))


def read_at_30_fps(path):
    motion = mg.read_bvh(path)
    return motion.resample(30.0) if motion.rate > 35 else motion


def seam_gaps(library, choice, seeds):
    """Return the seam gaps in degrees of each graft on all clips, and the exchanged share."""
    config = replace(CONFIG, choice=choice, balance_weight=0.0, novelty=6.0)
    library = replace(library, config=config)
    grafts = [mg.graft(library, clip, seed=seed) for clip in library.clips for seed in seeds]
    seams = [[np.degrees(seam.gap) for seam in graft.seams] for graft in grafts]
    return seams, np.mean([not s.is_own for graft in grafts for s in graft.substitutions])


def compare_seams(name, width, library):
    """Print the mean seam gaps of three choices; return the reduction by the cheapest sequence."""
    gaps, shares = [], []
    for choice, seeds in (("random", range(10)), ("sample", range(10)), ("viterbi", [0])):
        seams, share = seam_gaps(library, choice, seeds)
        gaps.append(np.mean(np.concatenate(seams)) if any(seams) else 0.0)
        shares.append(share)
    random, sampled, best = gaps
    if not random:
        print(f"{name:{width}} no segment has another candidate: {len(library.segments)} segments")
        return None
    reduction = 1 - best / random
    print(
        f"{name:{width}} {random:7.2f}° {sampled:7.2f}° {best:7.2f}° {1 - sampled / random:5.0%} "
        f"{reduction:5.0%}   {' '.join(f'{s:4.0%}' for s in shares)} of {len(library.segments)}"
    )
    if reduction < 0.1:
        seams, _ = seam_gaps(library, "random", range(100))
        least = min(np.mean(gaps) for gaps in seams if gaps)
        n_different = len({tuple(np.round(gaps, 9)) for gaps in seams})
        print(f"{'':{width}} narrowest of {n_different} sequences from 100 draws: {least:.2f}°")
    return reduction


def count_from_tenth(reductions):
    return sum(reduction >= 0.1 for reduction in reductions)


def gains(paths):
    """Compare seams in a library per clip, and in one per folder and skeleton."""
    motions = {Path(path): read_at_30_fps(path) for path in paths}
    width = max([len(path.name) for path in motions] + [len(p.parent.name) for p in motions]) + 10
    print(f"\n{'mean seam gap':{width}} {'random':>8} {'sample':>8} {'viterbi':>8}   exchanged")
    found = [
        compare_seams(path.name, width, mg.Library.build(motion))
        for path, motion in motions.items()
    ]
    reductions = [reduction for reduction in found if reduction is not None]
    print(
        f"at least 10 % below random: {count_from_tenth(reductions)} of {len(reductions)} clips\n"
    )
    sources = {}
    for path, motion in motions.items():
        sources.setdefault((path.parent.name, motion.skeleton.names), []).append(motion)
    found = [
        compare_seams(f"{folder}, {len(clips)}", width, mg.Library.build(clips))
        for (folder, _), clips in sources.items()
        if len(clips) > 1
    ]
    reductions = [reduction for reduction in found if reduction is not None]
    print(
        f"at least 10 % below random: {count_from_tenth(reductions)} of {len(reductions)} libraries"
    )


def reach(paths, count=20):
    """Graft with the left hand's position after a random substitution as the target."""
    print()
    for path in paths:
        library = mg.Library.build(read_at_30_fps(path), config=replace(CONFIG, reach_ik=0.0))
        rng = np.random.default_rng(0)
        base, scenario = library.clips[0], library.segments.of_clip(0)
        segments = library.segments[scenario]
        problem = SearchProblem.build(library, base, scenario, segments, ["upper"], [])
        hand = next((name for name in HANDS if name in base.skeleton.names), None)
        counts = [len(candidates) for candidates in problem.candidates["upper"]]
        if hand is None or max(counts) < 2:
            print(f"{Path(path).name}: no left hand with a known name, or no other candidate")
            continue
        n_reached = 0
        for _ in range(count):
            position = int(rng.choice(np.flatnonzero(np.array(counts) > 1)))
            donors = problem.captured_donors
            others = problem.candidates["upper"][position]
            donors["upper"][position] = rng.choice(others[others != scenario[position]])
            frame = int(rng.integers(segments.start[position], segments.stop[position] + 1))
            motion = assemble(problem, donors)
            target = tuple(motion.world_positions()[frame, base.skeleton.index(hand)])
            graft = mg.graft(library, constraints=[mc.Reach(hand, target, frame)])
            n_reached += not graft.violations
        print(f"{Path(path).name}: reached {n_reached} of {count} targets")


def satisfiable_constraints(library, kind, count=20):
    """Return constraints that a graft violates and one of twenty random grafts satisfies.

    A target of the hips or the left hand in the random graft, a wall across the path of the hips,
    or a pole on the path of the body.
    """
    rng = np.random.default_rng(0)
    random_library = replace(library, config=replace(library.config, choice="random"))
    cheapest, *others = (
        mg.Poses.from_motion(graft.motion)
        for graft in (mg.graft(library), *mg.graft_many(random_library, count=20))
    )
    names, is_level = cheapest.skeleton.names, np.arange(3) != library.up
    hips = names[library.root]
    hand = next(name for name in HANDS if name in names)
    start, found = cheapest.joint_positions(hips)[0] * is_level, []
    for _ in range(400):
        frame, other = int(rng.integers(len(cheapest))), others[rng.integers(len(others))]
        point = cheapest.joint_positions(hips)[frame] * is_level
        if len(found) == count or (point == start).all():
            continue
        if kind == "Reach":
            joint = (hips, hand)[len(found) % 2]
            constraint = mc.Reach(joint, tuple(other.joint_positions(joint)[frame]), frame)
        elif kind == "KeepOut":
            constraint = mc.KeepOut(hips, mc.HalfSpace(tuple(point), tuple(start - point)))
        else:
            top = np.where(is_level, point, 2 * cheapest.height)
            constraint = mc.Avoid(mc.Capsule(tuple(point), tuple(top), 0.05 * cheapest.height))
        if constraint.errors(cheapest)[0].max() > 1 and constraint.errors(other)[0].max() <= 1:
            found.append(constraint)
    return found


def lead(paths, count=20):
    """Count the constraints that are satisfied if donors hold legs and root."""
    print()
    for path in paths:
        library = upper_body_library(read_at_30_fps(path))
        for kind in ("Reach", "KeepOut", "Avoid"):
            times, n_satisfied = [0.0], 0
            constraints = satisfiable_constraints(library, kind, count)
            for constraint in constraints:
                begin = time.perf_counter()
                n_satisfied += not mg.graft(library, constraints=[constraint]).violations
                times.append(time.perf_counter() - begin)
            print(
                f"{Path(path).name}, {len(library.segments)} segments: {kind} satisfied "
                f"{n_satisfied} of {len(constraints)}; median "
                f"{statistics.median(times[1:] or times):.1f} s, maximum {max(times):.1f} s"
            )


def report_tiny():
    speeds(repeats=1, n_segments=300, n_positions=30)
    stream(n_dances=1, n_frames=240)
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{seed}.bvh" for seed in (1, 2)]
        for seed, path in enumerate(paths):
            mg.write_bvh(tiny_motion(seed, 120), path)
        gains(paths)
        reach(paths[:1], count=1)
        lead(paths[:1], count=1)


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*")
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--only", choices=["speeds", "stream", "gains", "reach", "lead"])
    run(parser, report, argv, is_timing=True)


def report(options):
    if options.tiny:
        report_tiny()
        return
    print(f"{platform.machine()} {platform.processor()}, Python {platform.python_version()}, ")
    print(f"NumPy {np.__version__}, {_core.BUILD_PROFILE} build\n")
    if options.only in (None, "speeds"):
        speeds(options.repeats)
    if options.only in (None, "stream"):
        stream()
    if options.files and options.only in (None, "gains"):
        gains(options.files)
    if options.files and options.only in (None, "reach"):
        reach(options.files)
    if options.files and options.only in (None, "lead"):
        lead(options.files)


if __name__ == "__main__":
    main()
