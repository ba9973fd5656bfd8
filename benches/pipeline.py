"""Time the whole way from file to written graft against the plain NumPy and SciPy version.

Run as ``python benches/pipeline.py FILE.bvh``; without a file the built-in dancer is used.
Both versions do the same steps on the same segments and draw the same donors; what they
write is compared. Prints machine, build profile, medians, the ratio and peak memory.
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
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from mograft import _core
from mograft.body.anatomy import feature_joints
from mograft.body.mass import mass_model, moments_of_inertia, up_axis
from mograft.library.ingest import DISQUALIFYING_FAULTS
from tests.oracles import analysis as analysis_oracle
from tests.oracles import blend as blend_oracle
from tests.oracles import bvh as bvh_oracle
from tests.oracles import rotations as rotations_oracle
from tests.oracles import search as search_oracle

CONFIG = mg.Config(choice="random", seam="paper")
"""The paper's own choice and seams: the plain version has no others."""

ONCE = "--once"


def fast(source, target, seed=0):
    """Graft as a user does."""
    library = mg.Library.build(source, config=CONFIG)
    mg.write_bvh(mg.graft(library, seed=seed).motion, target)


def slow(source, target, seed=0):
    """Graft with the plain version; joint groups, body model and faults are the package's."""
    motion = mg.read_bvh(source)
    groups = mg.JointGroups.preset("lower_upper", motion.skeleton).resolve(motion.skeleton)
    moments = moments_of_inertia(mass_model(motion.skeleton), motion.skeleton, CONFIG.inertia)
    height, up = mass_model(motion.skeleton).height, up_axis(motion)

    _, parents, offsets, channels, frame_time, values = bvh_oracle.read_bvh(source)
    quats, places = bvh_oracle.to_transforms(channels, offsets, values)
    energy = analysis_oracle.kinetic_energy(parents, quats, moments, frame_time)
    bounds = analysis_oracle.segment_bounds(energy, 1 / frame_time, CONFIG)
    labels = {}
    for name, joints in groups.items():
        counted = feature_joints(motion.skeleton, joints)
        root = 0 if 0 in joints else None
        matrix = analysis_oracle.features(
            quats, places[:, 0], bounds, counted, root, up, height, frame_time, CONFIG
        )
        points = analysis_oracle.embed(matrix, 3 * CONFIG.samples * len(counted), CONFIG)
        labels[name] = analysis_oracle.cluster(
            points, analysis_oracle.max_cluster_diameter(points, CONFIG)
        )
    is_donor = np.ones(len(bounds) - 1, bool)
    for fault in mg.find_faults(motion):
        if fault.kind in DISQUALIFYING_FAULTS:
            first, last = fault.frames
            is_donor[(bounds[:-1] <= last) & (bounds[1:] >= first)] = False
    found = search_oracle.candidates(
        labels["lower"], np.diff(bounds), 1 / frame_time, CONFIG, is_donor
    )
    upper = groups["upper"]
    counted = feature_joints(motion.skeleton, upper)
    rng = np.random.default_rng(seed)
    chosen = search_oracle.random_sequence(quats[:, counted], bounds, found, CONFIG, rng)
    grafted = blend_oracle.transplant(quats[:, upper], bounds, chosen, 1 / frame_time, CONFIG)
    new = values.copy()
    column = 0
    for joint, own in enumerate(channels):
        turns = [i for i, name in enumerate(own) if name.endswith("rotation")]
        if joint in upper:
            order = "".join(own[i][0] for i in turns)
            turned = grafted[:, list(upper).index(joint)]
            at = [column + i for i in turns]
            new[:, at] = rotations_oracle.to_euler_degrees(turned, order, values[0, at])
        column += len(own)
    header = Path(source).read_text().partition("Frame Time")[0]
    bvh_oracle.write_bvh(target, f"{header}Frame Time: {frame_time!r}\n", new)


def medians(way, source, target, repeats):
    times = []
    for _ in range(repeats):
        start, cpu = time.perf_counter(), time.process_time()
        way(source, target)
        times.append((time.perf_counter() - start, time.process_time() - cpu))
    return [statistics.median(own) for own in zip(*times, strict=True)]


def in_a_process_of_its_own(source):
    """Seconds and peak memory of a new interpreter that grafts one file and ends."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, __file__, ONCE, str(source), str(Path(folder) / "new.bvh")]
        start = time.perf_counter()
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        return time.perf_counter() - start, int(done.stdout) / 1024


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", nargs="?")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    if _core.BUILD_PROFILE != "release":
        sys.exit("this is a debug build: pip install . or maturin develop --release")
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        source, target = options.file, Path(folder) / "new.bvh"
        if source is None:
            from mograft.dancer import dance

            source = Path(folder) / "dance.bvh"
            mg.write_bvh(dance().motion, source)
        print(
            f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}, ",
            end="",
        )
        print(f"NumPy {np.__version__}, {_core.BUILD_PROFILE} build, {Path(source).name}")
        ours = medians(fast, source, target, options.repeats)
        new = mg.read_bvh(target)
        theirs = medians(slow, source, target, max(options.repeats // 2, 1))
        old = mg.read_bvh(target)
        apart = mg.rotations.angle(new.rotations, old.rotations).max()
        whole = [in_a_process_of_its_own(source) for _ in range(options.repeats)]
        seconds = statistics.median(own for own, _ in whole)
        memory = max(peak for _, peak in whole)
        print("medians of file to file                  wall        CPU")
        for name, own in (("mograft", ours), ("plain NumPy and SciPy", theirs)):
            print(f"{name:<36} {own[0] * 1e3:8.0f} ms {own[1] * 1e3:8.0f} ms")
        print(f"{'ratio':<36} {theirs[0] / ours[0]:8.1f}    {theirs[1] / ours[1]:8.1f}")
        print(f"greatest angle between the two       {apart:8.1e} rad")
        print(f"mograft in a new process             {seconds * 1e3:8.0f} ms, peak {memory:.0f} MB")


if __name__ == "__main__":
    if sys.argv[1:2] == [ONCE]:
        warnings.simplefilter("ignore")
        fast(sys.argv[2], sys.argv[3])
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    else:
        main()
