"""Time the pipeline from input file to grafted file against a NumPy and SciPy implementation.

Run as ``python benches/pipeline.py FILE.bvh``; without a file, the built-in dancer is used. Both
implementations use the same segments and the same donors. Prints the machine, the build profile,
median times and their ratio, the largest angle between the two results, and the peak memory. Then
it prints the frames per second that one core grafts if the library exists: the first graft on a
base, and each of twenty.
"""

import argparse
import os
import platform
import resource
import statistics
import subprocess
import sys
import tempfile
import time
import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches._common import run, tiny_motion
from mograft import _core
from mograft.body.anatomy import feature_joints
from mograft.body.mass import mass_model, moments_of_inertia, up_axis
from mograft.dancer import dance
from mograft.library.ingest import DISQUALIFYING_FAULTS
from mograft.search.copies import COPY_ANGLE
from tests.oracles import analysis as analysis_oracle
from tests.oracles import blend as blend_oracle
from tests.oracles import bvh as bvh_oracle
from tests.oracles import rotations as rotations_oracle
from tests.oracles import search as search_oracle

CONFIG = mg.Config(neighbourhood="cluster", choice="random", seam="paper", torso="pelvis")
"""The candidates, donor choice, seams and trunk of the paper, the only ones that the oracle has."""

CHILD = "--child"


def graft_with_mograft(source, target, seed=0):
    """Graft with the public functions."""
    library = mg.Library.build(source, config=CONFIG)
    mg.write_bvh(mg.graft(library, seed=seed).motion, target)


def graft_with_oracle(source, target, seed=0):
    """Graft with the oracle; joint groups, mass model and faults are those of the package."""
    motion = mg.read_bvh(source)
    groups = mg.JointGroups.preset("lower_upper", motion.skeleton).resolve(motion.skeleton)
    _, parents, offsets, channels, frame_time, values = bvh_oracle.read_bvh(source)
    quats, positions = bvh_oracle.to_transforms(channels, offsets, values)
    moments = moments_of_inertia(mass_model(motion.skeleton), motion.skeleton, CONFIG.inertia)
    energy = analysis_oracle.kinetic_energy(parents, quats, moments, frame_time)
    bounds = analysis_oracle.segment_bounds(energy, 1 / frame_time, CONFIG)
    labels = {
        name: cluster_with_oracle(motion, joints, quats, positions[:, 0], bounds, frame_time)
        for name, joints in groups.items()
    }
    upper = groups["upper"]
    counted = feature_joints(motion.skeleton, upper)
    found = search_oracle.candidates(
        labels["lower"], np.diff(bounds), 1 / frame_time, CONFIG, find_donors(motion, bounds)
    )
    found = without_copies(found, quats[:, counted], bounds)
    rng = np.random.default_rng(seed)
    chosen = search_oracle.random_sequence(quats[:, counted], bounds, found, CONFIG, rng)
    grafted = blend_oracle.transplant(quats[:, upper], bounds, chosen, 1 / frame_time, CONFIG)
    new_values = replace_rotations(values, channels, upper, grafted)
    header = Path(source).read_text().partition("Frame Time")[0]
    bvh_oracle.write_bvh(target, f"{header}Frame Time: {frame_time!r}\n", new_values)


def cluster_with_oracle(motion, joints, quats, root_positions, bounds, frame_time):
    """Return the cluster of every segment by the joints of one group."""
    counted = feature_joints(motion.skeleton, joints)
    root = 0 if 0 in joints else None
    height = mass_model(motion.skeleton).height
    matrix = analysis_oracle.features(
        quats, root_positions, bounds, counted, root, up_axis(motion), height, frame_time, CONFIG
    )
    points = analysis_oracle.embed(matrix, 3 * CONFIG.samples * len(counted), CONFIG)
    return analysis_oracle.cluster(points, analysis_oracle.max_cluster_diameter(points, CONFIG))


def find_donors(motion, bounds):
    """Return for every segment whether no fault of the recording excludes it as a donor."""
    is_donor = np.ones(len(bounds) - 1, bool)
    for fault in mg.find_faults(motion):
        if fault.kind in DISQUALIFYING_FAULTS:
            first, last = fault.frames
            is_donor[(bounds[:-1] <= last) & (bounds[1:] >= first)] = False
    return is_donor


def without_copies(candidates, quats, bounds):
    """Return the candidates without those that have the same poses as their base segment."""
    poses = [
        rotations_oracle.resample(quats[start : stop + 1], CONFIG.samples)
        for start, stop in pairwise(bounds)
    ]

    def differ(first, second):
        turns = rotations_oracle.multiply(rotations_oracle.inverse(first), second)
        return np.linalg.norm(rotations_oracle.log(turns), axis=-1).max() > COPY_ANGLE

    return [
        [donor for donor in own if donor == base or differ(poses[base], poses[donor])]
        for base, own in enumerate(candidates)
    ]


def replace_rotations(values, channels, joints, quats):
    """Return the channel values with other rotations of some joints."""
    new_values = values.copy()
    column = 0
    for joint, names in enumerate(channels):
        rotating = [i for i, name in enumerate(names) if name.endswith("rotation")]
        if joint in joints:
            order = "".join(names[i][0] for i in rotating)
            columns = [column + i for i in rotating]
            track = quats[:, list(joints).index(joint)]
            new_values[:, columns] = rotations_oracle.to_euler_degrees(
                track, order, values[0, columns]
            )
        column += len(names)
    return new_values


def median_times(graft, source, target, repeats):
    """Return the median wall and CPU seconds of a function that grafts."""
    times = []
    for _ in range(repeats):
        start, cpu = time.perf_counter(), time.process_time()
        graft(source, target)
        times.append((time.perf_counter() - start, time.process_time() - cpu))
    return [statistics.median(values) for values in zip(*times, strict=True)]


def measure_process(source):
    """Return seconds and peak MB of a new interpreter that grafts one file and ends."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, __file__, CHILD, str(source), str(Path(folder) / "new.bvh")]
        start = time.perf_counter()
        child = subprocess.run(command, check=True, capture_output=True, text=True)
        return time.perf_counter() - start, int(child.stdout) / 1024


def compare(source, target, repeats):
    """Time both implementations on a file and print the comparison."""
    print(f"{platform.machine()}, {os.cpu_count()} cores, ", end="")
    print(f"Python {platform.python_version()}, NumPy {np.__version__}, ", end="")
    print(f"{_core.BUILD_PROFILE} build, {Path(source).name}")
    times = median_times(graft_with_mograft, source, target, repeats)
    motion = mg.read_bvh(target)
    oracle_times = median_times(graft_with_oracle, source, target, max(repeats // 2, 1))
    angles = mg.rotations.angle(motion.rotations, mg.read_bvh(target).rotations)
    processes = [measure_process(source) for _ in range(repeats)]
    seconds = statistics.median(wall for wall, _ in processes)
    memory = max(peak for _, peak in processes)
    print("medians, file to file                    wall        CPU")
    for name, (wall, cpu) in (("mograft", times), ("NumPy and SciPy", oracle_times)):
        print(f"{name:<36} {wall * 1e3:8.0f} ms {cpu * 1e3:8.0f} ms")
    ratios = [slow / fast for slow, fast in zip(oracle_times, times, strict=True)]
    print(f"{'ratio':<36} {ratios[0]:8.1f}    {ratios[1]:8.1f}")
    print(f"largest angle between the results    {angles.max():8.1e} rad")
    if angles.max() > 1e-6:
        sys.exit("the implementations made different motions: their times cannot be compared")
    print(f"mograft in a new process             {seconds * 1e3:8.0f} ms, peak {memory:.0f} MB")


def time_grafts(source, repeats, count=20):
    """Print how many frames one core grafts per second, with the default settings.

    The clip is grafted at most at 30 fps, and at most its first 164 s.
    """
    motion = mg.read_bvh(source)
    motion = (motion.resample(30.0) if motion.rate > 35 else motion)[: 164 * 30]
    library = mg.Library.build(motion)
    one, many = [], []
    for seed in range(repeats):
        start = time.process_time()
        mg.graft(library, seed=seed)
        one.append(time.process_time() - start)
        start = time.process_time()
        for _ in mg.graft_many(library, count=count, seed=seed):
            pass
        many.append((time.process_time() - start) / count)
    print(f"grafts alone: {motion.n_frames} frames, {motion.n_joints} joints, ", end="")
    print(f"{len(library.segments)} segments")
    for name, times in ((f"graft, each of {repeats}", one), (f"graft_many, each of {count}", many)):
        seconds = statistics.median(times)
        rate = motion.n_frames / seconds
        print(f"{name:<36} {seconds * 1e3:8.1f} ms CPU {rate:12,.0f} frames/s")


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", nargs="?")
    parser.add_argument("--repeats", type=int, default=5)
    run(parser, report, argv, is_timing=True)


def report(options):
    with tempfile.TemporaryDirectory() as folder:
        source = options.file
        if options.tiny or source is None:
            source = Path(folder) / "dance.bvh"
            mg.write_bvh(tiny_motion() if options.tiny else dance().motion, source)
        compare(source, Path(folder) / "new.bvh", 1 if options.tiny else options.repeats)
        time_grafts(source, 1 if options.tiny else options.repeats)


if __name__ == "__main__":
    if sys.argv[1:2] == [CHILD]:
        warnings.simplefilter("ignore")
        graft_with_mograft(sys.argv[2], sys.argv[3])
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    else:
        main()
