"""Measure where the package has its own code, or a rule, instead of the plain library call.

Run with a release build: ``python benches/replacements.py FOLDER``, where every subfolder of FOLDER
holds BVH recordings. Prints the effect of the number of BLAS threads on principal components, the
time to read and print numbers, the time to open array files, and the differences from
`scipy.stats.bootstrap` and `scipy.spatial.ConvexHull`. ``--part`` selects one of these. Times are
processor times.
"""

import argparse
import pickle
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from unittest import mock

import numpy as np
from scipy import spatial, stats

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches import _common
from mograft import _core
from mograft._util.linalg import GRID
from mograft.analysis.segmentation import kinetic_energy
from mograft.body import support_polygon
from mograft.evaluation import estimate
from mograft.library.files.array_files import map_array

# Prints the correlation matrices of all recordings as pickles: the matrix, its loadings before
# rounding, and the rounded eigenvalues and loadings.
COLLECT = """
import pickle, sys, warnings
from pathlib import Path
import numpy as np
import threadpoolctl
import mograft as mg
from mograft.analysis import principal_components

threadpoolctl.threadpool_limits(int(sys.argv[2]), "blas")
warnings.simplefilter("ignore")
eigenvectors = principal_components.eigenvectors
found = []

def record(matrix, n_vectors):
    rounded = eigenvectors(matrix, n_vectors)
    found.append((matrix, np.linalg.eigh(matrix)[1][:, ::-1][:, :n_vectors], *rounded))
    return rounded

principal_components.eigenvectors = record
for folder in sorted(path for path in Path(sys.argv[1]).iterdir() if path.is_dir()):
    hierarchies = {}
    for path in sorted(folder.glob("*.bvh")):
        clip = mg.read_bvh(path)
        if clip.n_frames > 1:
            key = clip.skeleton.names, tuple(clip.skeleton.parents)
            hierarchies.setdefault(key, []).append(clip)
    for clips in hierarchies.values():
        for config in (mg.Config(), mg.Config.paper()):
            for preset in ("lower_upper", "lower_torso_arms"):
                try:
                    mg.Library.build(clips, groups=preset, config=config).with_mirror_images()
                except ValueError:  # no legs, or not symmetric
                    pass
sys.stdout.buffer.write(pickle.dumps(found))
"""


def measure_threads(folder, thread_counts=(1, 2, 3)):
    """Compare correlation matrices and loadings between numbers of BLAS threads."""
    found = []
    for n_threads in map(str, thread_counts):
        command = [sys.executable, "-c", COLLECT, str(folder), n_threads]
        done = subprocess.run(command, stdout=subprocess.PIPE, check=True)
        found.append(pickle.loads(done.stdout))
    columns = [_thread_differences(found[0], other) for other in found[1:]]
    print(f"\n| {len(found[0])} correlation matrices | 1 against 2 threads | 1 against 3 threads |")
    print("|---|--:|--:|")
    for name in columns[0]:
        print(f"| {name} | {columns[0][name]} | {columns[1][name]} |")


def _thread_differences(first_run, second_run):
    """Return the differences between two runs of `COLLECT`, by their names."""
    n_matrices = n_signs = n_rounded = 0
    loading_gap = matrix_gap = n_expected = 0.0
    for one, two in zip(first_run, second_run, strict=True):
        n_matrices += bool((one[0] != two[0]).any())
        matrix_gap = max(matrix_gap, float(np.abs(one[0] - two[0]).max()))
        n_rounded += any((a != b).any() for a, b in zip(one[2:], two[2:], strict=True))
        kept = one[2][: one[1].shape[1]] > 1e-6 * one[2][0]
        first, second = (_positive_largest(loadings[:, kept]) for loadings in (one[1], two[1]))
        # The sign of the second loadings is that of the first if their product is positive.
        agree = np.where(np.einsum("ij,ij->j", first, second) < 0, -1.0, 1.0)
        n_signs += bool((agree < 0).any())
        gaps = np.abs(first - agree * second)
        loading_gap = max(loading_gap, float(gaps.max(initial=0.0)))
        n_expected += float(gaps.sum()) / GRID
    return {
        "matrices with other bits": n_matrices,
        "largest difference of an entry": f"{matrix_gap:.1e}",
        "largest difference of a loading, components kept": f"{loading_gap:.1e}",
        "expected number of loadings that round differently": f"{n_expected:.1e}",
        "matrices with another sign if it is chosen before rounding": n_signs,
        "matrices whose eigenvalues or loadings differ after rounding": n_rounded,
    }


def _positive_largest(loadings):
    """Return columns with the sign that makes the entry of largest absolute value positive."""
    largest = np.take_along_axis(loadings, np.abs(loadings).argmax(axis=0)[None], axis=0)
    return loadings * np.sign(largest)


def _seconds(task, n_runs):
    """Return the median processor seconds of a task, which other processes hardly change."""
    runs = []
    for _ in range(n_runs):
        start = time.process_time()
        task()
        runs.append(time.process_time() - start)
    return statistics.median(runs)


def measure_numbers(n_numbers):
    """Time the parser and the printer of numbers against `float` and `repr` of Python."""
    print("\n| ns per number | parse | `float` | print | `repr` |\n|---|--:|--:|--:|--:|")
    angles = np.random.default_rng(0).uniform(-180.0, 180.0, n_numbers)
    for name, values in (
        ("4 decimals", angles.round(4)),
        ("6 decimals", angles.round(6)),
        ("17 digits", angles),
    ):
        rows = values.reshape(-1, 64)
        text = _core.format_rows(rows)
        words, numbers, out = text.split(), values.tolist(), np.empty(n_numbers)
        tasks = (
            lambda text=text, out=out: _core.scan_numbers(text, 0, out, last=True),
            lambda words=words: [float(word) for word in words],
            lambda rows=rows: _core.format_rows(rows),
            lambda numbers=numbers: [repr(number) for number in numbers],
        )
        times = (f"{_seconds(task, 15) / n_numbers * 1e9:.1f}" for task in tasks)
        print(f"| {name} | {' | '.join(times)} |")


def measure_headers(motion):
    """Time opening the array files of a library with three groups against `open_memmap`."""
    with tempfile.TemporaryDirectory() as folder:
        mg.Library.build(motion, groups="lower_torso_arms").save(Path(folder) / "library")
        files = list(Path(folder).rglob("*.npy"))
        own = _seconds(lambda: [map_array(path) for path in files], 15)
        numpy = _seconds(lambda: [np.lib.format.open_memmap(path, mode="r") for path in files], 15)
    print(f"\n{len(files)} array files: {own * 1e3:.2f} ms, `open_memmap` {numpy * 1e3:.2f} ms")


def measure_bootstrap(motion):
    """Compare the interval of `block_mean` with that of `scipy.stats.bootstrap`."""
    cut, energy = mg.segment(motion), kinetic_energy(motion)
    values = [energy[a : b + 1].mean() for a, b in zip(cut.start, cut.stop, strict=True)]
    blocks = estimate.segment_blocks(cut)
    own = estimate.block_mean(values, blocks, "J")
    sums, counts = np.bincount(blocks, values), np.bincount(blocks).astype(float)
    low, high = _scipy_interval(sums, counts)
    shift = max(abs(low - own.low), abs(high - own.high)) / (own.high - own.low)
    print(f"\n`scipy.stats.bootstrap` moves interval ends by {shift:.1%} of the width")
    # Some resamples draw no block with values.
    weights = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    own = estimate.block_bootstrap(lambda drawn: (drawn @ (2 * weights)) / (drawn @ weights), 8)
    low, high = _scipy_interval(2 * weights, weights)
    print(f"resamples without a value: {own[0]:g} to {own[1]:g}, SciPy {low:g} to {high:g}")


def _scipy_interval(sums, counts):
    """Return the 95 % percentile interval of the ratio of two sums over blocks, by SciPy."""

    def ratio(sums, counts, axis):
        return sums.sum(axis=axis) / counts.sum(axis=axis)

    return stats.bootstrap(
        (sums, counts), ratio, paired=True, method="percentile", random_state=0
    ).confidence_interval


def measure_hulls(motion):
    """Compare the hulls of the soles in all frames with `scipy.spatial.ConvexHull`."""
    clouds, hull = [], support_polygon.convex_hull

    def record(points):
        clouds.append(points)
        return hull(points)

    with mock.patch.object(support_polygon, "convex_hull", record):
        support_polygon.support_polygons(motion)

    def find_scipy_hulls():
        for points in clouds:
            if len(points):
                spatial.ConvexHull(points)

    own = _seconds(lambda: [hull(points) for points in clouds], 5)
    scipy = _seconds(find_scipy_hulls, 5)
    times = f"{own * 1e3:.0f} ms, `ConvexHull` {scipy * 1e3:.0f} ms"
    print(f"\nhulls of the soles in {len(clouds)} frames: {times}")
    line = np.arange(6.0).reshape(3, 2)
    for name, points in {"no": line[:0], "single": line[:1], "collinear": line}.items():
        try:
            spatial.ConvexHull(points)
        except (ValueError, spatial.QhullError):
            print(f"`ConvexHull` refuses {name} points; own code returns {len(hull(points))}")


PARTS = ("threads", "numbers", "headers", "bootstrap", "hulls")


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--part", choices=PARTS)
    _common.run(parser, report, argv, is_timing=True)


def report(options):
    motion = _common.tiny_motion() if options.tiny else _common.dance(seed=0, strides=2).motion
    parts = [options.part] if options.part else PARTS
    if "threads" in parts:
        with tempfile.TemporaryDirectory() as folder:
            if options.tiny:
                (Path(folder) / "dance").mkdir()
                mg.write_bvh(motion, Path(folder) / "dance" / "a.bvh")
            elif options.folder is None:
                sys.exit("FOLDER is missing: a folder with folders of BVH recordings")
            if options.tiny:
                # More threads than cores take minutes.
                measure_threads(folder, thread_counts=(1, 1, 1))
            else:
                measure_threads(options.folder)
    if "numbers" in parts:
        measure_numbers(1 << 8 if options.tiny else 1 << 20)
    if "headers" in parts:
        measure_headers(motion)
    if "bootstrap" in parts:
        measure_bootstrap(motion)
    if "hulls" in parts:
        measure_hulls(motion)


if __name__ == "__main__":
    main()
