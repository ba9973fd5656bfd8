"""Measure data sets: augment, find and curate, and curation against other choices of clips.

Run with a release build: ``python benches/datasets.py FOLDER``, where FOLDER holds BVH files of one
skeleton. It prints

- ``augment``: seconds, processor seconds and peak memory of `mograft augment` of 1,000 windows;
- ``windows``: windows of 64 frames a second that a training loop reads from a data set; that it
  computes on access, without overlap in order, and from each frame on in random order over blocks
  of bases; and that a random exchange of joints between clips makes, which checks nothing;
- ``split``: what the choice of a part costs without and with the comparison of motions;
- ``find`` and ``curate``: their times, of `find` also in a new process;
- ``recall``: how often the first hit of a clip, and some of the first ten, have its label, the
  second word of names such as ``dataset-1_punch_normal_001``; and for clips drawn at random;
- ``coverage``: distances of the segments of held-out clips from the segments of chosen ones, for
  `curate`, random clips, k-means and farthest points at equal numbers of frames; and the greatest
  distance of a segment that could have been chosen.

Peak memory is the greatest resident set of one process, with the mapped files; own memory has no
mapped files, after 30 bases.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches._common import run, tiny_motion
from mograft import datasets
from mograft.datasets.splits import select_part

FIND = """
import sys, time
start = time.perf_counter()
import mograft as mg
from mograft import datasets
library = mg.Library.open(sys.argv[1])
datasets.find(library, sys.argv[2], frames=(0, int(sys.argv[3])))
print(time.perf_counter() - start)
"""

OWN_MEMORY = """
import re, sys
import mograft as mg
from mograft import datasets
windows = datasets.augment(mg.Library.open(sys.argv[1]))
for job in range(30):
    windows.run_job(job)
text = open("/proc/self/status").read() if sys.platform == "linux" else "RssAnon: 0"
print(int(re.search(r"RssAnon:\\s+(\\d+)", text)[1]) // 1024)
"""


def cpu_seconds():
    found = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(own.ru_utime + own.ru_stime for own in found)


def timed(function):
    """Return the result of a function, the seconds and the processor seconds that it took."""
    start, cpu = time.perf_counter(), cpu_seconds()
    result = function()
    return result, time.perf_counter() - start, cpu_seconds() - cpu


def measure_augment(folder, target, count, jobs):
    words = ["-m", "mograft", "augment", folder, "-o", target, "-n", count, "-j", jobs, "--json"]
    done, seconds, cpu = timed(
        lambda: subprocess.run(
            [sys.executable, *map(str, words)], check=True, capture_output=True, text=True
        )
    )
    report = json.loads(done.stdout)["report"]
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    script = [sys.executable, "-c", OWN_MEMORY, str(folder)]
    own = subprocess.run(script, check=True, capture_output=True, text=True).stdout.strip()
    print(
        f"augment: {report['windows']} windows of 4 s in {seconds:.1f} s, {cpu:.1f} s of processor "
        f"time with {jobs} processes, peak {peak:.0f} MB, own {own} MB; "
        f"{report['new_frames']:.0%} new frames, {report['bases']} bases, "
        f"{report['segments_used']} segments used"
    )


def cut_mix(library, rng):
    """A window of 64 frames whose upper body is from a window of another clip."""
    joints = library.joints(library.groups.names[-1])
    clips = []
    while len(clips) < 2:
        clip = library.clips[int(rng.integers(len(library.clips)))]
        if clip.n_frames >= 64:
            start = int(rng.integers(clip.n_frames - 63))
            clips.append(clip.rotations[start : start + 64])
    mixed = clips[0].astype(np.float32)
    mixed[:, joints] = clips[1][:, joints]
    return mixed


def measure_windows(library, target, n):
    windows = datasets.augment(library, seconds=64 / library.rate)
    datasets.write(windows, target, n)
    found, rng = datasets.read_set(target), np.random.default_rng(0)
    order = rng.integers(len(found), size=20 * n)
    _, _, cpu = timed(lambda: [found[index] for index in order])
    mixed = n
    _, _, mixing = timed(lambda: [cut_mix(library, rng) for _ in range(mixed)])
    n = min(n, len(windows))
    _, _, grafting = timed(lambda: [windows[index] for index in range(n)])
    every = datasets.augment(library, seconds=64 / library.rate, stride=1 / library.rate)
    last = int(np.searchsorted(np.cumsum([len(own) for own in windows.starts]), n)) + 1
    shuffled = rng.permutation(sum(len(own) for own in every.starts[:last]))
    _, _, overlapping = timed(lambda: [every[index] for index in shuffled])
    print(
        f"windows of 64 frames a second of processor time: {len(order) / cpu:.0f} from a data set, "
        f"{n / grafting:.0f} grafted on access, in order; {len(shuffled) / overlapping:.0f} of "
        f"{len(shuffled)} that begin at each frame, in random order; {mixed / mixing:.0f} by "
        "random exchange"
    )


def measure_split(library):
    table = dict.fromkeys(library.names[::2], "train") | dict.fromkeys(library.names[1::2], "test")
    _, _, without = timed(lambda: datasets.augment(library, seconds=1.0))
    part, _, with_check = timed(lambda: select_part(library, table, "train", 0))
    plain = replace(part, clips=np.ones(len(library.entries), bool))
    jobs = []
    for own in (part, plain):
        windows = replace(datasets.augment(library, seconds=1.0), part=own)
        jobs.append(timed(lambda windows=windows: [windows.run_job(job) for job in range(20)])[2])
    print(
        f"split: {without:.2f} s of processor time for augment without one, {with_check:.1f} s for "
        f"the comparison of {len(library.entries)} clips; grafts with half of the donors take "
        f"{jobs[0] / jobs[1]:.2f} times as long as with all"
    )


def measure_find(library, folder, n):
    long = [
        name for name, own in zip(library.names, library.entries, strict=True) if own.n_frames > 70
    ]
    new = [
        float(
            subprocess.run(
                [sys.executable, "-c", FIND, str(folder), long[0], "60"],
                check=True,
                capture_output=True,
                text=True,
            ).stdout
        )
        for _ in range(3)
    ]
    seconds, clips = [], library.segments.clip
    for name in long[:: max(len(long) // n, 1)]:
        _, _, cpu = timed(lambda name=name: datasets.find(library, name, frames=(0, 60)))
        seconds.append(cpu)
    print(
        f"find in {len(clips)} segments: {1000 * np.median(seconds[1:]):.0f} ms of processor time, "
        f"in a new process {np.median(new):.2f} s with imports"
    )


def interval(values, rng, scale=100.0):
    """The mean of values with the 95 % interval of a bootstrap, as text in percent."""
    values = scale * np.asarray(values, float)
    draws = rng.choice(values, (1000, len(values))).mean(axis=1)
    low, high = np.percentile(draws, [2.5, 97.5])
    return f"{values.mean():.1f} ({low:.1f} to {high:.1f})"


def measure_recall(library, n):
    """Search whole clips; the span is the middle of the query, two seconds at most."""
    rng = np.random.default_rng(0)
    labels = [[*name.split("_"), "", ""][1] for name in library.names]
    clips = rng.permutation([k for k, own in enumerate(library.entries) if own.n_frames > 60])[:n]
    rows = {"find": [], "random": []}
    for clip in clips.tolist():
        n_frames, reach = library.entries[clip].n_frames, round(library.rate)
        span = max(n_frames // 2 - reach, 0), min(n_frames // 2 + reach, n_frames - 1)
        hits = datasets.find(library, library.names[clip], frames=span, top=10)
        found = [library.names.index(own.clip) for own in hits if own.clip != library.names[clip]]
        drawn = rng.choice(np.delete(np.arange(len(labels)), clip), 10).tolist()
        for name, others in (("find", found), ("random", drawn)):
            rows[name].append([labels[other] == labels[clip] for other in others] or [False])
    print(f"\n| {len(clips)} clips | first hit has the label, % | one of ten has it, % |")
    print("|---|--:|--:|")
    for name, found in rows.items():
        first, some = [own[0] for own in found], [any(own) for own in found]
        print(f"| {name} | {interval(first, rng)} | {interval(some, rng)} |")


def nearest(points, kept):
    """The distance of each point from the nearest kept one."""
    found = np.empty(len(points))
    squares = (kept**2).sum(axis=1)
    for start in range(0, len(points), 512):
        own = points[start : start + 512]
        gaps = squares - 2.0 * own @ kept.T + (own**2).sum(axis=1)[:, None]
        found[start : start + 512] = np.sqrt(np.maximum(gaps.min(axis=1), 0.0))
    return found


def k_means(means, k, rng):
    """The items nearest to the centres of k-means."""
    centres = means[rng.choice(len(means), k, replace=False)]
    for _ in range(20):
        labels = ((means[:, None] - centres[None]) ** 2).sum(axis=2).argmin(axis=1)
        for label in np.unique(labels):
            centres[label] = means[labels == label].mean(axis=0)
    return np.unique(((means[:, None] - centres[None]) ** 2).sum(axis=2).argmin(axis=0))


def farthest_points(means, k):
    """Items chosen one by one, each the farthest from those before."""
    chosen = [int(((means - means.mean(axis=0)) ** 2).sum(axis=1).argmin())]
    gaps = np.full(len(means), np.inf)
    while len(chosen) < k:
        gaps = np.minimum(gaps, ((means - means[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(gaps.argmax()))
    return np.array(chosen)


def measure_coverage(library, shares):
    """Choose among the even clips, and cover the odd ones."""
    found, _, cpu = timed(lambda: datasets.curate(library))
    print(f"curate: {cpu:.1f} s of processor time; {found}")
    clips, frames = library.segments.clip, np.array([own.n_frames for own in library.entries])
    half = replace(library, is_donor=library.is_donor & (clips % 2 == 0))
    points = np.concatenate(
        [library.embedding[g].points / library.sigma[g] for g in library.groups.names], axis=1
    )
    even = np.arange(0, len(frames), 2)
    means = np.stack([points[clips == clip].mean(axis=0) for clip in even])
    held_out = np.flatnonzero(clips % 2 == 1)
    budget_of = frames[even].sum()
    print("\n| choice | frames | clips | held-out within 1 | mean distance | 99 % | greatest |")
    print("|---|--:|--:|--:|--:|--:|--:|")
    mine = np.flatnonzero(clips % 2 == 0)
    for share in shares:
        rng = np.random.default_rng(0)
        kept = datasets.curate(half, keep=share / 2).kept
        first = np.flatnonzero(np.isin(library.names, kept))
        budget = frames[first].sum()

        def up_to_budget(order, budget=budget):
            order = np.asarray(order)
            return order[np.cumsum(frames[order]) <= budget]

        k = len(first)
        rows = {
            "curate": [first],
            "random": [up_to_budget(rng.permutation(even)) for _ in range(10)],
            "k-means": [
                up_to_budget(rng.permutation(even[k_means(means, k, rng)])) for _ in range(3)
            ],
            "farthest points": [up_to_budget(even[farthest_points(means, min(4 * k, len(even)))])],
        }
        for name, choices in rows.items():
            gaps = np.stack(
                [nearest(points[held_out], points[np.isin(clips, own)]) for own in choices]
            )
            by_clip = [
                gaps[:, clips[held_out] == clip].mean() for clip in np.unique(clips[held_out])
            ]
            draws = rng.choice(by_clip, (1000, len(by_clip))).mean(axis=1)
            low, high = np.percentile(draws, [2.5, 97.5])
            used = np.mean([frames[own].sum() for own in choices]) / budget_of
            n_clips = np.mean([len(own) for own in choices])
            worst = [nearest(points[mine], points[np.isin(clips, own)]).max() for own in choices]
            print(
                f"| {name} | {used:.1%} | {n_clips:.0f} | {(gaps <= 1).mean():.1%} | "
                f"{np.mean(by_clip):.3f} ({low:.3f} to {high:.3f}) | "
                f"{np.percentile(gaps, 99):.2f} | {np.mean(worst):.2f} |"
            )


def report(options):
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        sources = options.folder
        if options.tiny:
            sources = place / "clips"
            sources.mkdir()
            for seed in range(4):
                mg.write_bvh(tiny_motion(seed), sources / f"{seed}.bvh")
        library = mg.Library.index(sources, place / "library")
        measure_augment(place / "library", place / "set", 3 if options.tiny else 1000, options.jobs)
        measure_windows(library, place / "windows", 3 if options.tiny else 300)
        measure_split(library)
        measure_find(library, place / "library", 2 if options.tiny else 20)
        measure_recall(library, 2 if options.tiny else 300)
        measure_coverage(library, (0.9,) if options.tiny else (0.02, 0.1))


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("-j", "--jobs", type=int, default=2)
    return run(parser, report, argv, is_timing=True)


if __name__ == "__main__":
    main()
