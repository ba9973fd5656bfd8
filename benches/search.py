"""Time the search against its plain version, and count what it gains over chance.

Run as ``python benches/search.py FILE.bvh...``; the speeds need no file. Prints machine, build
profile, medians, ratios, and for every file the mean seam gap of the cheapest row of donors
and of the paper's random choice (the mean of ten seeds).
"""

import argparse
import platform
import statistics
import sys
import time
import warnings
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from mograft import _core
from mograft.capsules import clearance
from mograft.search import Chain, viterbi
from mograft.substitution import Pool, Row
from tests import plain

CONFIG = mg.Config()


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
    ends = (quats[:-1], quats[1:], 30.0, speeds[:-1], speeds[1:], points, 5.0)
    return Pool(cut, labels, np.ones(n, bool), *ends)


def speeds(repeats):
    rng = np.random.default_rng(0)
    print(f"{'':58} {'mograft':>12} {'plain':>14} {'ratio':>8}")
    pools = [make_pool(10_000, rng) for _ in range(3)]
    scenario = np.arange(10_000)

    def listed():
        for pool in pools:
            lists = pool.candidate_lists(scenario, CONFIG)
            counts = [len(own) for own in lists]
            pool.costs(np.repeat(scenario, counts), np.concatenate(lists), CONFIG)

    def plainly():
        for pool in pools:
            plain.candidates(pool.labels, pool.segments.lengths, 30.0, CONFIG)

    line("candidates of 10,000 segments, 3 groups", median(listed, repeats), median(plainly, 1))

    alone = [rng.normal(size=30) for _ in range(900)]
    after = [rng.normal(size=(30, 30)) for _ in range(899)]
    chain = Chain(tuple(alone), tuple(after))
    ours = median(lambda: viterbi(chain), repeats)
    line("Viterbi, 900 positions of 30", ours, median(lambda: plain.cheapest(alone, after), 3))

    lists = pools[0].candidate_lists(scenario[:900], CONFIG)
    ours = median(lambda: Row.of(pools[0], scenario[:900], lists, CONFIG), repeats)

    def seams():
        for left, right in pairwise(lists[:100]):
            for a in left:
                for b in right:
                    plain.gap(pools[0].last[a], pools[0].first[b])

    line("seam costs of 900 positions (plain: times 9)", ours, 9 * median(seams, 1))

    ends, others = rng.normal(size=(240, 11, 2, 3)), rng.normal(size=(240, 11, 2, 3))
    radii = np.full(11, 0.05)
    ours = median(lambda: clearance(ends, radii, others, radii), 20 * repeats)
    theirs = median(lambda: plain.capsule_distances(ends, radii, others, radii), repeats)
    line("collision, 30 candidates x 8 frames x 11 x 11 capsules", ours, theirs)


def gains(paths):
    name = max(len(Path(path).name) for path in paths)
    print(f"\n{'mean seam gap':{name}} {'random':>9} {'viterbi':>9} {'less':>7}   exchanged")
    for path in paths:
        motion = mg.read_bvh(path)
        if motion.rate > 35:
            motion = motion.resample(30.0)
        library = mg.Library.build(motion)
        chance = replace(library, config=replace(CONFIG, choice="random"))

        def gap(grafts):
            seams = [np.degrees(s.gap) for graft in grafts for s in graft.seams]
            parts = [not s.is_own for graft in grafts for s in graft.substitutions]
            return (float(np.mean(seams)) if seams else 0.0), float(np.mean(parts))

        random, old = gap([mg.graft(chance, seed=seed) for seed in range(10)])
        best, new = gap([mg.graft(library)])
        less = 1 - best / random if random else 0.0
        print(
            f"{Path(path).name:{name}} {random:8.2f}° {best:8.2f}° {less:6.0%}   "
            f"{old:.0%} and {new:.0%} of {len(library.segments)} segments"
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="*")
    parser.add_argument("--repeats", type=int, default=7)
    options = parser.parse_args()
    if _core.BUILD_PROFILE != "release":
        sys.exit("this is a debug build: pip install . or maturin develop --release")
    warnings.simplefilter("ignore")
    print(f"{platform.machine()} {platform.processor()}, Python {platform.python_version()}, ")
    print(f"NumPy {np.__version__}, {_core.BUILD_PROFILE} build\n")
    speeds(options.repeats)
    if options.files:
        gains(options.files)


if __name__ == "__main__":
    main()
