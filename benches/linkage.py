"""Time complete linkage against SciPy and fastcluster, and on inputs too large for them.

Every figure is the median of runs in a separate process, which also reports the memory that the
call used in addition to its input. Ratios are of consecutive runs. Usage:

    python benches/linkage.py [PART ...] [--kinds KIND ...] [--json FILE]

peers   SciPy and fastcluster, up to 30,000 points, for which they need 7 GB
large   50,000 to 500,000 points, the tree and the cut at the standard deviation; growth
real    the segments of a real motion database, the tree and its cuts at both sigmas
hard    adverse point sets of 100,000 points
huge    1 to 5 million points: the tree, and the cut at the standard deviation
axes    tables like gene expression with 34 to 300 axes, with SciPy and fastcluster
scaling serial share, 16 simulated threads and counted comparisons, by an example of the crate
ties    points with many equal distances or many axes, with SciPy and fastcluster
chain   the nearest-neighbour chain over all n(n-1)/2 distances, on adverse point sets
stop    time from Ctrl-C at random moments to the end of the call
counts  instructions, by Valgrind: independent of the load of the machine

Without PART all parts run, which takes an hour, mostly for the peers and for millions of points.
Figures are appended to FILE; benches/linkage_figure.py draws them.
"""

import argparse
import json
import os
import platform
import re
import resource
import shutil
import signal
import statistics
import subprocess
import sys
import threading
import time
from importlib import metadata
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benches import _common
from mograft import _core, clustering

REAL = Path(__file__).parents[2] / "shared" / "data" / "embedding_bandai_60k.npy"
CHILD = "--child"
SIGMAS = {"literal": 3.525, "rms": 13.590}


def make(kind, n, n_axes=10):
    """Return points of a kind; deterministic."""
    rng = np.random.default_rng(n)
    decay = np.sqrt(1.0 / np.arange(1, n_axes + 1))
    if kind == "white":  # whitened scores of a principal component analysis
        return rng.standard_normal((n, n_axes))
    if kind == "mixture":  # 20 groups; 70 % of the variance is between them
        fixed = np.random.default_rng(12345)
        centres = fixed.standard_normal((20, n_axes)) * np.sqrt(0.7) * decay
        chosen = rng.choice(20, n, p=fixed.dirichlet(np.ones(20)))
        return centres[chosen] + rng.standard_normal((n, n_axes)) * np.sqrt(0.3) * decay
    if kind == "walk":  # phrases of motion: noisy points on closed curves of unequal frequency
        fixed = np.random.default_rng(99)
        centres = fixed.standard_normal((200, n_axes)) * decay
        waves = fixed.standard_normal((2, 200, 3, n_axes)) * 0.5 * decay
        weight = fixed.pareto(1.2, 200) + 0.05
        chosen = rng.choice(200, n, p=weight / weight.sum())
        angle = rng.random(n) * 2 * np.pi
        points = centres[chosen] + 0.05 * rng.standard_normal((n, n_axes)) * decay
        for h in range(3):
            points += np.cos((h + 1) * angle)[:, None] * waves[0, chosen, h] / (h + 1)
            points += np.sin((h + 1) * angle)[:, None] * waves[1, chosen, h] / (h + 1)
        return points
    if kind == "clump":  # half of the points within 1e-9 of each other
        points = rng.standard_normal((n, n_axes))
        points[: n // 2] *= 1e-9
        return points
    if kind == "scale-free":  # radii distributed uniformly on a logarithmic scale
        return rng.standard_normal((n, n_axes)) * 10.0 ** (-8 * rng.random((n, 1)))
    if kind == "lattice":  # many tied distances
        return rng.integers(0, 8, (n, n_axes)).astype(float)
    if kind == "tails":
        return rng.standard_cauchy((n, n_axes))
    if kind == "300 axes":  # distances differ little in every direction
        return rng.standard_normal((n, 300))
    if kind == "binary":  # some distances occur in 5 % of all pairs
        return rng.integers(0, 2, (n, 64)).astype(float)
    if kind.startswith("genes"):  # logarithms of counts of 40 kinds of cells
        n_genes = int(kind.split()[1])
        fixed = np.random.default_rng(7)
        rates = fixed.gamma(0.5, 4.0, (40, n_genes))
        cells = rng.choice(40, n, p=fixed.dirichlet(np.ones(40)))
        depth = rng.lognormal(0.0, 0.3, (n, 1))
        return np.log1p(rng.poisson(rates[cells] * depth) + rng.gamma(1.0, 0.1, (n, n_genes)))
    if kind == "unit":  # all distances are equal
        return np.eye(n)
    if kind == "one-hot":  # 40 categories of 5 values
        values = rng.integers(0, 5, (n, 40, 1))
        return (values == np.arange(5)).reshape(n, 200).astype(float)
    if kind == "prints":  # binary fingerprints, of which 5 % of the bits are set
        return (rng.random((n, 1024)) < 0.05).astype(float)
    if kind == "coins":  # binary numbers with 2,000 axes
        return rng.integers(0, 2, (n, 2000)).astype(float)
    if kind == "grid":  # whole numbers from 0 to 3
        return rng.integers(0, 4, (n, 50)).astype(float)
    if kind == "real":
        return np.load(REAL).astype(np.float64)
    raise ValueError(f"unknown kind of points: {kind!r}")


def run_scipy(points):
    from scipy.cluster import hierarchy

    return hierarchy.linkage(points, "complete")


def run_fastcluster(points):
    import fastcluster

    return fastcluster.linkage(points, "complete")


def run_chain(points):
    """Run the nearest-neighbour chain on one thread, distances included."""
    from scipy.spatial.distance import pdist

    return clustering.linkage_condensed(pdist(points), n_threads=1, memory_limit=0)


def measure(who, kind, n, runs, diameter=None):
    """Return the seconds of runs in this process, and the memory that they used."""
    points = make(kind, n)[:n]
    if who == "stop":
        return interrupt_delays(points, runs)
    if diameter == "rms":
        diameter = clustering.threshold(points)
    call = {
        "mograft": lambda: clustering.linkage(points),
        "cut": lambda: clustering.cut(points, diameter),
        "one thread": lambda: clustering.linkage(points, n_threads=1, memory_limit=0),
        "chain": lambda: run_chain(points),
        "SciPy": lambda: run_scipy(points),
        "fastcluster": lambda: run_fastcluster(points),
    }[who]
    if who in ("SciPy", "fastcluster", "chain"):
        call_once = {"SciPy": run_scipy, "fastcluster": run_fastcluster, "chain": run_chain}[who]
        call_once(points[:10])  # exclude the import from the measurement
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    walls, cpus = [], []
    for _ in range(runs):
        wall, cpu = time.perf_counter(), time.process_time()
        call()
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    added = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return {"wall": walls, "cpu": cpus, "MB": added / 1024}


def interrupt_delays(points, runs):
    """Return the seconds from interrupts at random moments to the end of the call."""
    # A shell starts background processes with SIGINT ignored, and children inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    begin = time.perf_counter()
    clustering.linkage(points)
    duration = time.perf_counter() - begin
    walls, cpus = [], []
    for moment in np.random.default_rng(0).uniform(0, 0.95 * duration, runs):
        sent = []

        def interrupt(sent=sent):
            sent.append((time.perf_counter(), time.process_time()))
            os.kill(os.getpid(), signal.SIGINT)

        timer = threading.Timer(moment, interrupt)
        has_ended = False
        try:
            timer.start()  # on a busy machine, the interrupt may arrive before the call
            clustering.linkage(points)
            has_ended = True
            timer.cancel()
            timer.join()  # a late interrupt arrives here, not in the next run
        except KeyboardInterrupt:
            if not has_ended:
                walls.append(time.perf_counter() - sent[0][0])
                cpus.append(time.process_time() - sent[0][1])
    return {"wall": walls or [np.nan], "cpu": cpus or [np.nan], "MB": 0}


def child(who, kind, n, runs=3, diameter=None):
    """Measure in a separate process."""
    task = json.dumps([who, kind, n, runs, diameter])
    command = [sys.executable, __file__, CHILD, task]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    return summary(who, kind, n, json.loads(run.stdout))


def tiny_child(who, kind, n, runs=3, diameter=None):  # noqa: ARG001 - as `child`
    """Measure a few points in this process; interrupts are measured in a new one."""
    if who == "stop":
        return child(who, kind, 10_000, runs=1)
    return summary(who, kind, n, measure(who, kind, 40, 1, diameter))


def summary(who, kind, n, measured):
    wall, cpu = statistics.median(measured["wall"]), statistics.median(measured["cpu"])
    largest = {f"largest {time}": max(measured[time]) for time in ("wall", "cpu")}
    row = {"who": who, "kind": kind, "n": n, "wall": wall, "cpu": cpu, "MB": measured["MB"]}
    return row | largest


def show(row, note=""):
    label = f"{row['who']:>12} {row['kind']:>10} {row['n']:>8,}"
    print(f"{label} {row['wall']:9.3f} s {row['cpu']:9.3f} s CPU {row['MB']:8.0f} MB  {note}")
    sys.stdout.flush()


def installed_peers():
    """Return the names of the packages to compare with that are installed."""
    names = {distribution.name.lower() for distribution in metadata.distributions()}
    return [who for who in ("SciPy", "fastcluster") if who.lower() in names]


def peers(kinds, child):
    rows = []
    for kind in (kind for kind in kinds if kind != "walk"):
        for n in (1_000, 2_000, 5_000, 10_000, 20_000, 30_000):
            ours = child("mograft", kind, n, runs=7)
            show(ours)
            rows.append(ours)
            for who in installed_peers():
                row = child(who, kind, n, runs=3 if n <= 10_000 else 1)
                show(row, f"{row['wall'] / ours['wall']:.1f} times mograft")
                rows.append(row)
    return rows


def large(kinds, child):
    rows = []
    for kind in kinds:
        for who in ("mograft", "cut"):
            line = []
            for n in LARGE:
                line.append(child(who, kind, n, 3 if n < 500_000 else 1, "rms"))
                show(line[-1])
            exponent, exponent_cpu = (
                np.log(line[-1][time] / line[0][time]) / np.log(LARGE[-1] / LARGE[0])
                for time in ("wall", "cpu")
            )
            print(f"{'':>12} exponent of n {exponent:.2f}, of CPU time {exponent_cpu:.2f}")
            rows += line
    return rows


LARGE = (50_000, 100_000, 200_000, 500_000)


def real(_, child):
    if not REAL.exists():
        print(f"real: skipped, there is no {REAL.name}")
        return []
    n = len(np.load(REAL, mmap_mode="r"))
    rows = [child("mograft", "real", n)]
    rows += [child("cut", "real", n, diameter=sigma) for sigma in SIGMAS.values()]
    for row, note in zip(rows, ("tree", *SIGMAS), strict=True):
        show(row, note)
    return rows


def hard(_, child):
    rows = [
        child("mograft", kind, 100_000, runs=1)
        for kind in ("lattice", "tails", "clump", "scale-free")
    ]
    for row in rows:
        show(row)
    return rows


def huge(_, child):
    rows = []
    for who, kind, n in HUGE:
        rows.append(child(who, kind, n, 1, "rms" if who == "cut" else None))
        show(rows[-1])
    return rows


HUGE = (
    ("mograft", "mixture", 1_000_000),
    ("mograft", "walk", 1_000_000),
    ("cut", "mixture", 2_000_000),
    ("cut", "walk", 2_000_000),
    ("cut", "mixture", 5_000_000),
    ("cut", "walk", 5_000_000),
)


def scaling(_, child):
    del child  # the example measures processor time
    command = "cargo run -q --release -p mograft-linkage --features profile --example scaling --"
    cases = (("mixture", 1_000_000), ("white", 10_000), ("white", 100_000), ("white", 300_000))
    for kind, n in cases:
        print(f"{kind}, {n:,} points")
        sys.stdout.flush()
        subprocess.run([*command.split(), str(n), kind], check=True)
    return []


def axes(_, child):
    return beside_peers(AXES, child)


AXES = (("genes 34", 10_000), ("genes 100", 10_000), ("genes 300", 10_000), ("genes 34", 182_440))


def ties(_, child):
    return beside_peers(TIES, child)


def beside_peers(cases, child):
    rows = []
    for kind, n in cases:
        ours = child("mograft", kind, n, runs=1)
        show(ours)
        rows.append(ours)
        for who in installed_peers() if n <= MAX_PEER_POINTS else ():
            row = child(who, kind, n, runs=1)
            ratios = [row[time] / ours[time] for time in ("wall", "cpu")]
            show(row, "{:.1f} times mograft, {:.1f} times in CPU time".format(*ratios))
            rows.append(row)
    return rows


# Above this the peers need more than 7 GB.
MAX_PEER_POINTS = 30_000

TIES = (
    ("unit", 1_500),
    ("unit", 3_000),
    ("one-hot", 5_000),
    ("prints", 3_000),
    ("coins", 3_000),
    ("grid", 5_000),
    ("binary", 10_000),
    ("300 axes", 5_000),
)


def chain(_, child):
    rows = []
    for kind in ("300 axes", "binary", "lattice", "tails", "clump", "scale-free"):
        pair = [child(who, kind, 10_000, runs=1) for who in ("one thread", "chain")]
        show(pair[0])
        show(pair[1], f"{pair[1]['wall'] / pair[0]['wall']:.2f} times")
        rows += pair
    return rows


def stop(_, child):
    cases = (("mixture", 1_000_000), ("white", 500_000), ("binary", 100_000), ("coins", 20_000))
    rows = [child("stop", kind, n, runs=20) for kind, n in cases]
    for row in rows:
        wall, cpu = (f"{row[f'largest {time}']:.3f} s" for time in ("wall", "cpu"))
        show(row, f"from the signal to the exception, median; largest {wall}, {cpu} CPU")
    return rows


def instructions(kind, n):
    """Count the instructions of a process that computes the tree of n points on one thread."""
    task = json.dumps(["one thread", kind, n, 1, None])
    valgrind = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
    command = [*valgrind, sys.executable, __file__, CHILD, task]
    environment = {**os.environ, "PYTHONHASHSEED": "0", "OPENBLAS_NUM_THREADS": "1"}
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return int(re.search(r"Collected : (\d+)", run.stderr)[1])


def counts(*_):
    if not shutil.which("valgrind"):
        print("counts: skipped, there is no valgrind")
        return []
    for kind in ("white", "mixture", "scale-free"):
        n = 10_000
        count = instructions(kind, n) - instructions(kind, 2)
        print(f"{'instructions':>12} {kind:>10} {n:>8,} {count / 1e6:9.1f} million")
    return []


def machine():
    model = "unknown processor"
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        lines = cpuinfo.read_text().splitlines()
        model = next((line.split(":")[1].strip() for line in lines if "model name" in line), model)
    versions = []
    for name in ("mograft", "numpy", "scipy", "fastcluster"):
        try:
            versions.append(f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            versions.append(f"no {name}")
    load = os.getloadavg()[0]
    return (
        f"{model}, {os.cpu_count()} processors, load {load:.1f}; {platform.system()}, "
        f"Python {platform.python_version()}, {', '.join(versions)}; {_core.BUILD_PROFILE} build"
    )


PARTS = {
    part.__name__: part
    for part in (peers, large, huge, real, hard, ties, axes, scaling, chain, stop, counts)
}
KINDS = ("white", "mixture", "walk")


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "parts", nargs="*", choices=[*PARTS, []], help="parts to run (default: all)"
    )
    parser.add_argument(
        "--kinds",
        nargs="+",
        choices=KINDS,
        default=KINDS,
        help="kinds of points for peers and large (default: all)",
    )
    parser.add_argument("--json", type=Path, help="file to which the figures are appended")
    _common.run(parser, report, argv, is_timing=True)


def report(options):
    print(machine())
    # Valgrind takes half a minute to import NumPy, and cargo compiles the example.
    names = [name for name in PARTS if not options.tiny or name not in ("counts", "scaling")]
    for name in options.parts or names:
        print(f"-- {name}")
        rows = PARTS[name](options.kinds, tiny_child if options.tiny else child)
        if options.json:
            known = json.loads(options.json.read_text())["rows"] if options.json.exists() else []
            figures = {"machine": machine(), "rows": known + rows}
            options.json.write_text(json.dumps(figures, indent=1))
    print(f"load at the end {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    if sys.argv[1:2] == [CHILD]:
        print(json.dumps(measure(*json.loads(sys.argv[2]))))
    else:
        main()
