"""Time the search against its plain version, and count what it gains over chance.

Run as ``python benches/search.py FILE.bvh...``; the speeds need no file. Prints machine, build
profile, medians, ratios, how long a stream takes for a segment, and for every file the mean
seam gap of the cheapest row of donors, of draws by cost and of the paper's random choice (the
means of ten seeds), how many of twenty reachable places are reached, and how many of twenty
demands on each kind are met where donors hold the root. ``--only speeds``, ``stream``, ``gains``,
``reach`` or ``lead`` prints one of these.
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
from benches._common import run, tiny_motion
from benches.feet import upper_body_library
from mograft import _core
from mograft.body.capsules import clearance
from mograft.dancer import dance
from mograft.search.boundary_states import BoundaryStates
from mograft.search.candidates import SegmentPool
from mograft.search.donor_choice import cost_model
from mograft.search.trellis import DonorTrellis
from mograft.search.viterbi import Trellis, viterbi
from mograft.synthesis.assembly import assemble
from mograft.synthesis.search_problem import SearchProblem
from tests.oracles import capsules as capsules_oracle
from tests.oracles import search as search_oracle

CONFIG = mg.Config()
HANDS = ("LeftHand", "Hand_L", "LeftWrist", "lHand")


def median(way, repeats):
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        way()
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def line(name, ours, theirs):
    told = f"{name:58} {ours * 1e3:9.2f} ms"
    print(told + ("" if theirs is None else f" {theirs * 1e3:11.1f} ms {theirs / ours:8.1f}"))


def make_pool(n, rng):
    """As many segments as wanted, in clusters of about thirty."""
    lengths = rng.integers(4, 20, n)
    stops = np.cumsum(lengths)
    quats = rng.normal(size=(n + 1, 11, 4))
    quats /= np.linalg.norm(quats, axis=-1, keepdims=True)
    speeds = rng.normal(size=(n + 1, 11, 3))
    labels = rng.integers(0, max(n // 30, 1), n)
    cut = mg.Segments(stops - lengths, stops)
    points = rng.normal(size=(n, 10))
    boundary = BoundaryStates(
        first=quats[:-1],
        last=quats[1:],
        first_velocity=speeds[:-1],
        last_velocity=speeds[1:],
    )
    return SegmentPool(cut, labels, np.ones(n, bool), boundary, 30.0, points, 5.0)


def speeds(repeats, n_segments=10_000, n_positions=900):
    rng = np.random.default_rng(0)
    print(f"{'':58} {'mograft':>12} {'plain':>14} {'ratio':>8}")
    pools = [make_pool(n_segments, rng) for _ in range(3)]
    scenario = np.arange(n_segments)

    def listed():
        for pool in pools:
            lists = pool.candidate_lists(scenario, CONFIG)
            counts = [len(own) for own in lists]
            model = cost_model(CONFIG, pool)
            pool.unary_costs(np.repeat(scenario, counts), np.concatenate(lists), model)

    def plainly():
        for pool in pools:
            search_oracle.candidates(pool.labels, pool.segments.lengths, 30.0, CONFIG)

    line("candidates of 10,000 segments, 3 groups", median(listed, repeats), median(plainly, 1))

    alone = [rng.normal(size=30) for _ in range(n_positions)]
    after = [rng.normal(size=(30, 30)) for _ in range(n_positions - 1)]
    chain = Trellis(tuple(alone), tuple(after))
    ours = median(lambda: viterbi(chain), repeats)
    line(
        "Viterbi, 900 positions of 30",
        ours,
        median(lambda: search_oracle.cheapest_sequence(alone, after), 3),
    )

    lists = pools[0].candidate_lists(scenario[:n_positions], CONFIG)

    def trellis():
        model = cost_model(CONFIG, pools[0])
        DonorTrellis.build(pools[0], scenario[:n_positions], lists, model)

    ours = median(trellis, repeats)

    def seams():
        for left, right in pairwise(lists[:100]):
            for a in left:
                for b in right:
                    search_oracle.seam_angle(pools[0].boundary.last[a], pools[0].boundary.first[b])

    line("seam costs of 900 positions (plain: times 9)", ours, 9 * median(seams, 1))

    ends, others = rng.normal(size=(240, 11, 2, 3)), rng.normal(size=(240, 11, 2, 3))
    radii = np.full(11, 0.05)
    ours = median(lambda: clearance(ends, radii, others, radii), 20 * repeats)
    theirs = median(lambda: capsules_oracle.capsule_distances(ends, radii, others, radii), repeats)
    line("collision, 30 candidates x 8 frames x 11 x 11 capsules", ours, theirs)


def stream(n_dances=13, strides=4):
    """Decide segment by segment on a library in a folder, as frames come."""
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/dances.mograft"
        mg.Library.build(
            [dance(seed=seed, strides=strides).motion for seed in range(n_dances)]
        ).save(path)
        library = mg.Library.open(path)
        base = dance(seed=99, strides=strides).motion
        ball = mg.Avoid(mg.Sphere((30.0, 130.0, 40.0), 30.0))
        print(f"\nstream on {library}\n{'':44} {'median':>9} {'99 %':>9} {'most':>9}")
        for name, constraints in (
            ("decide a segment", []),
            ("decide a segment, avoiding a ball", [ball]),
            ("decide a segment, a ball and oneself", [ball, mg.AvoidSelf()]),
        ):
            live = mg.Stream(library, constraints=constraints)
            decided, taken = [], []
            for frame in range(base.n_frames):
                start = time.perf_counter()
                live.push(base[frame : frame + 1])
                taken.append(time.perf_counter() - start)
                while True:
                    start = time.perf_counter()
                    piece = live.advance()
                    spent = time.perf_counter() - start
                    if piece is None:
                        break
                    decided.append(spent)
            quantiles = np.percentile(decided, [50, 99, 100]) * 1e3
            print(f"{name:44} " + " ".join(f"{q:6.2f} ms" for q in quantiles), len(decided))
        for horizon in (1, 8):
            live = mg.Stream(library, horizon=horizon)
            behind = []
            for frame in range(base.n_frames):
                live.push(base[frame : frame + 1])
                behind += [frame - piece.stop for piece in live.pieces()]
            seconds = np.percentile(behind, [50, 100]) / library.rate
            print(
                f"behind with a horizon of {horizon}: {seconds[0]:.2f} s, at most {seconds[1]:.2f}"
            )
        quantiles = np.percentile(taken, [50, 99, 100]) * 1e3
        print(f"{'take in a frame':44} " + " ".join(f"{q:6.2f} ms" for q in quantiles))


def opened(path):
    motion = mg.read_bvh(path)
    return motion.resample(30.0) if motion.rate > 35 else motion


def rows(library, choice, seeds):
    """Mean gap in degrees of every seam of grafts on all clips, row by row; shares exchanged."""
    chosen = replace(library, config=replace(CONFIG, choice=choice))
    grafts = [mg.graft(chosen, clip, seed=seed) for clip in library.clips for seed in seeds]
    seams = [[np.degrees(seam.gap) for seam in graft.seams] for graft in grafts]
    return seams, np.mean([not s.is_own for graft in grafts for s in graft.substitutions])


def gained(name, width, library):
    """Print what the search gains on a library; return by how much its seams are narrower."""
    gaps, shares = [], []
    for choice, seeds in (("random", range(10)), ("sample", range(10)), ("viterbi", [0])):
        seams, share = rows(library, choice, seeds)
        gaps.append(np.mean(np.concatenate(seams)) if any(seams) else 0.0)
        shares.append(share)
    random, drawn, best = gaps
    if not random:
        print(f"{name:{width}} no exchange is on offer in {len(library.segments)} segments")
        return None
    lower = 1 - best / random
    print(
        f"{name:{width}} {random:7.2f}° {drawn:7.2f}° {best:7.2f}° {1 - drawn / random:5.0%} "
        f"{lower:5.0%}   {' '.join(f'{s:4.0%}' for s in shares)} of {len(library.segments)}"
    )
    if lower < 0.1:
        seams, _ = rows(library, "random", range(100))
        least = min(np.mean(row) for row in seams if row)
        kinds = len({tuple(np.round(row, 9)) for row in seams})
        print(f"{'':{width}} narrowest of the {kinds} rows that 100 draws find: {least:.2f}°")
    return lower


def gains(paths):
    """Compare seams clip by clip, and in libraries of a folder's clips of one skeleton."""
    motions = {Path(path): opened(path) for path in paths}
    width = max([len(path.name) for path in motions] + [len(p.parent.name) for p in motions]) + 10
    print(f"\n{'mean seam gap':{width}} {'random':>8} {'sample':>8} {'viterbi':>8}   exchanged")
    found = [gained(path.name, width, mg.Library.build(own)) for path, own in motions.items()]
    told = [lower for lower in found if lower is not None]
    print(f"at least 10 % below random: {sum(own >= 0.1 for own in told)} of {len(told)} clips\n")
    sources = {}
    for path, motion in motions.items():
        sources.setdefault((path.parent.name, motion.skeleton.names), []).append(motion)
    found = [
        gained(f"{folder}, {len(own)}", width, mg.Library.build(own))
        for (folder, _), own in sources.items()
        if len(own) > 1
    ]
    told = [lower for lower in found if lower is not None]
    print(f"at least 10 % below random: {sum(own >= 0.1 for own in told)} of {len(told)} libraries")


def reach(paths, count=20):
    """Have the left hand where it is with another segment's part in place of one."""
    print()
    for path in paths:
        library = mg.Library.build(opened(path))
        rng = np.random.default_rng(0)
        base, scenario = library.clips[0], library.segments.of_clip(0)
        cut = library.segments[scenario]
        problem = SearchProblem.build(library, base, scenario, cut, ["upper"], [])
        hand = next((name for name in HANDS if name in base.skeleton.names), None)
        counts = [len(own) for own in problem.candidates["upper"]]
        if hand is None or max(counts) < 2:
            print(f"{Path(path).name}: no left hand of a known name, or no candidate")
            continue
        met = 0
        for _ in range(count):
            at = int(rng.choice(np.flatnonzero(np.array(counts) > 1)))
            donors = problem.captured_donors
            others = problem.candidates["upper"][at]
            donors["upper"][at] = rng.choice(others[others != scenario[at]])
            frame = int(rng.integers(cut.start[at], cut.stop[at] + 1))
            place = assemble(problem, donors).world_positions()[frame, base.skeleton.index(hand)]
            graft = mg.graft(library, constraints=[mg.Reach(hand, tuple(place), frame)])
            met += not graft.violations
        print(f"{Path(path).name}: reached {met} of {count} places")


def wanted(library, kind, count=20):
    """Demands that the graft without them does not meet, and one of twenty by chance does.

    A place where it has the hips or the left hand; a wall in the way of the hips; a pole in
    the way of the body.
    """
    rng = np.random.default_rng(0)
    loose = replace(library, config=replace(library.config, choice="random"))
    plain, *others = (
        mg.Poses.from_motion(graft.motion)
        for graft in (mg.graft(library), *mg.graft_many(loose, count=20))
    )
    names, level = plain.skeleton.names, np.arange(3) != library.up
    hips = names[library.root]
    hand = next(name for name in HANDS if name in names)
    start, found = plain.joint_positions(hips)[0] * level, []
    for _ in range(400):
        frame, one = int(rng.integers(len(plain))), others[rng.integers(len(others))]
        spot = plain.joint_positions(hips)[frame] * level
        if len(found) == count or (spot == start).all():
            continue
        if kind == "Reach":
            joint = (hips, hand)[len(found) % 2]
            demand = mg.Reach(joint, tuple(one.joint_positions(joint)[frame]), frame)
        elif kind == "KeepOut":
            demand = mg.KeepOut(hips, mg.HalfSpace(tuple(spot), tuple(start - spot)))
        else:
            top = np.where(level, spot, 2 * plain.height)
            demand = mg.Avoid(mg.Capsule(tuple(spot), tuple(top), 0.05 * plain.height))
        if demand.errors(plain)[0].max() > 1 and demand.errors(one)[0].max() <= 1:
            found.append(demand)
    return found


def lead(paths, count=20):
    """Count the demands that are met where legs and root come from donors."""
    print()
    for path in paths:
        library = upper_body_library(opened(path))
        for kind in ("Reach", "KeepOut", "Avoid"):
            times, met, demands = [0.0], 0, wanted(library, kind, count)
            for demand in demands:
                begin = time.perf_counter()
                met += not mg.graft(library, constraints=[demand]).violations
                times.append(time.perf_counter() - begin)
            print(
                f"{Path(path).name}, {len(library.segments)} segments: {kind} met {met} of "
                f"{len(demands)}; {statistics.median(times[1:] or times):.1f} s, "
                f"at most {max(times):.1f} s"
            )


def report_tiny():
    speeds(repeats=1, n_segments=300, n_positions=30)
    stream(n_dances=1, strides=1)
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{seed}.bvh" for seed in (1, 2)]
        for seed, path in enumerate(paths):
            mg.write_bvh(tiny_motion(seed), path)
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
