"""Compare the methods of segmentation.

``python -m lab segmentations DATA [--only PART]`` prints five tables:

- ``speed``: how many times faster than real time each method cuts the dancer (57 channels, 30
  frames per second), and the processor time for a minute of a CMU recording at 120 frames per
  second; best of five runs on one core;
- ``planted``: the agreement of each method with known frames: changes of the style and foot
  events of the dancer, and the joints of motions put together from pieces of recordings; and how
  late "contacts" finds the foot events;
- ``agreement``: the agreement of each method with each other one on the recordings;
- ``segments``: for each source, the number and length of the segments, the share with a donor, the
  share that donor sequences exchange, and the seam angle;
- ``grafts``: for each source, the detectability at seams, and the compatibility.

DATA holds the recordings of the experiments (`lab/experiments/sources.py`). Agreement is F1:
cuts of both sides are paired one to one if they are at most 0.1 s apart. In parentheses is what
the same cuts reach on average after a circular shift in time by random durations. All motions are
resampled to 30 frames per second. Needs scikit-learn.
"""

import argparse
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

import mograft as mg
from lab.common import run, tiny_motion
from lab.donors.compatibility import compatibility
from lab.donors.donor_methods import RandomLength
from lab.donors.methods import Analogy
from lab.experiments.sources import MIN_FRAMES, RATE, SOURCES, find_files
from lab.segmentations import METHODS as OTHERS
from lab.segmentations import method as function_of
from mograft.dancer import dance
from mograft.evaluation.detectability import MIN_WINDOWS, block_folds, detect
from mograft.evaluation.windows import GraftWindows
from mograft.solve.plan import GraftPlan

METHODS = {"energy": "energy", **{name: function_of(name) for name in OTHERS}}
CHOSEN = ("salsa A", "perfume", "basketball", "actions and styles", "everyday")
CMU = "dance_cmu60_salsa/60_0*.bvh"
PARTS = ("speed", "planted", "agreement", "segments", "grafts")
TOLERANCE = 0.1  # seconds
N_SHIFTS = 10
MAX_FRAMES = 3600  # of a source: two minutes
MIN_BASE_SECONDS = 60.0  # of the clips that are bases
MAX_WINDOWS = 400
N_SPLITS = 1  # of the folds of compatibility
PIECE_SECONDS = (3.0, 6.0)


def read_source(name, data, unpacked, max_frames):
    """The clips of a source at 30 frames per second, evenly spaced, up to a number of frames."""
    motions, hierarchy, n_frames = [], None, 0
    files = find_files(SOURCES[name], data, unpacked)
    for path in sorted(files, key=lambda path: hash_of(path.name)):
        motion = mg.read_bvh(path)
        if any(fault.kind == "first_frame" for fault in mg.find_faults(motion)):
            motion = motion[1:]
        motion = motion.resample(RATE)[: max_frames - n_frames]
        hierarchy = hierarchy or motion.skeleton.names
        if motion.n_frames >= MIN_FRAMES and motion.skeleton.names == hierarchy:
            motions.append(motion)
            n_frames += motion.n_frames
        if n_frames > max_frames - MIN_FRAMES:
            break
    return motions


def hash_of(name):
    """A number that orders names without regard to what they mean, the same in every run."""
    return np.random.default_rng(list(name.encode())).random()


def inner_cuts(motion, method):
    """The cuts of a motion, without its ends."""
    return mg.segment(motion, method=METHODS[method]).start[1:]


def count_pairs(found, truth, tolerance):
    """How many cuts of both sides can be paired, each once, at most `tolerance` frames apart."""
    n_pairs, i, j = 0, 0, 0
    while i < len(found) and j < len(truth):
        gap = found[i] - truth[j]
        n_pairs += abs(gap) <= tolerance
        i, j = i + (gap <= tolerance), j + (gap >= -tolerance)
    return n_pairs


class Agreement:
    """Counts of paired cuts, of several motions, and of the same cuts shifted in time."""

    def __init__(self):
        self.pairs, self.shifted, self.n_found, self.n_truth = 0, 0.0, 0, 0

    def add(self, found, truth, motion, rng):
        tolerance = TOLERANCE * motion.rate
        self.pairs += count_pairs(found, truth, tolerance)
        for shift in rng.integers(motion.n_frames, size=N_SHIFTS):
            moved = np.sort((found + shift) % motion.n_frames)
            self.shifted += count_pairs(moved, truth, tolerance) / N_SHIFTS
        self.n_found += len(found)
        self.n_truth += len(truth)

    def f1(self, pairs):
        total = self.n_found + self.n_truth
        return 2 * pairs / total if total else np.nan

    @property
    def recall(self):
        return self.pairs / self.n_truth if self.n_truth else np.nan

    @property
    def precision(self):
        return self.pairs / self.n_found if self.n_found else np.nan

    def __str__(self):
        return f"{self.f1(self.pairs):.2f} ({self.f1(self.shifted):.2f})"


def put_together(library, n_pieces, rng):
    """A motion of pieces from random clips of a library, and the frames between the pieces."""
    chosen, lengths = [], []
    segments, last = library.segments, -1
    while len(lengths) < n_pieces:
        first = int(rng.integers(len(segments)))
        seconds = rng.uniform(*PIECE_SECONDS)
        clip = segments.clip[first]
        piece = np.arange(first, len(segments))
        piece = piece[(segments.clip[piece] == clip) & (library.is_donor[piece])]
        piece = piece[(segments.stop[piece] - segments.start[first]) <= seconds * library.rate]
        is_long = len(piece) and segments.lengths[piece].sum() >= 0.5 * seconds * library.rate
        if not is_long or (clip == last and len(library.entries) > 1):
            continue
        chosen.append(piece)
        lengths.append(int(segments.lengths[piece].sum()))
        last = clip
    motion = mg.graft(library, scenario=np.concatenate(chosen)).base
    return motion, np.cumsum(lengths)[:-1]


def time_of(function):
    """The processor time of a call, in seconds: the best of five."""
    times = []
    for _ in range(5):
        start = time.process_time()
        function()
        times.append(time.process_time() - start)
    return min(times)


def print_speed(dancer, minute):
    print("| method | dancer, times real time | a minute at 120 fps |")
    print("|---|---|---|")
    for method in METHODS:
        # Copies, because results of forward kinematics are kept with a motion.
        speed = dancer.duration / time_of(lambda m=method: mg.segment(dancer[:], method=METHODS[m]))
        seconds = time_of(lambda m=method: mg.segment(minute[:], method=METHODS[m]))
        print(f"| `{method}` | {speed:.0f} | {seconds:.3f} s |", flush=True)


def print_planted(dances, sources):
    rng = np.random.default_rng(0)
    titles = ["styles", "foot events", *sources]
    rows = {method: [Agreement() for _ in titles] for method in METHODS}
    joined = {
        name: [put_together(mg.Library.build(motions), 12, rng) for _ in range(3)]
        for name, motions in sources.items()
    }
    for made in dances:
        is_change = (made.legs[1:] != made.legs[:-1]) | (made.arms[1:] != made.arms[:-1])
        styles = np.flatnonzero(is_change) + 1
        events = np.flatnonzero((np.diff(made.stance, axis=0) != 0).any(axis=1)) + 1
        for method, cells in rows.items():
            found = inner_cuts(made.motion, method)
            cells[0].add(found, styles, made.motion, rng)
            cells[1].add(found, events, made.motion, rng)
    for column, motions in enumerate(joined.values(), start=2):
        for motion, truth in motions:
            for method, cells in rows.items():
                cells[column].add(inner_cuts(motion, method), truth, motion, rng)
    print("| method |" + "".join(f" {title} |" for title in titles))
    print("|---|" + "---|" * len(titles))
    for method, cells in rows.items():
        print(f"| `{method}` |" + "".join(f" {cell} |" for cell in cells), flush=True)


def print_event_offsets(dances):
    """Print how late `contacts` finds the touchdowns and lift-offs of the dancer."""
    for events, change in (("touchdown", 1), ("liftoff", -1)):
        offsets = []
        for made in dances:
            planted = (
                np.flatnonzero((np.diff(made.stance.astype(int), axis=0) == change).any(1)) + 1
            )
            found = mg.segment(made.motion, method=function_of("contacts", events=events)).start[1:]
            gaps = found[:, None] - planted
            nearest = np.abs(gaps).argmin(axis=0)
            offsets += (gaps[nearest, np.arange(len(planted))] / made.motion.rate).tolist()
        print(f"`contacts`, {events}: {np.median(offsets):+.2f} s after the dancer's (median)")


def print_agreement(sources):
    rng = np.random.default_rng(1)
    cuts = {
        method: [
            (inner_cuts(motion, method), motion)
            for motions in sources.values()
            for motion in motions
        ]
        for method in METHODS
    }
    print("| method |" + "".join(f" `{method}` |" for method in METHODS))
    print("|---|" + "---|" * len(METHODS))
    for row, method in enumerate(METHODS):
        cells = []
        for column, other in enumerate(METHODS):
            agreement = Agreement()
            for (found, motion), (truth, _) in zip(cuts[method], cuts[other], strict=True):
                agreement.add(found, truth, motion, rng)
            cells.append(f" {agreement} |" if column > row else " |")
        print(f"| `{method}` |" + "".join(cells), flush=True)


def donor_share(library):
    """The share of segments with a donor other than themselves."""
    group = next(own for own in library.groups.names if own != library.groups.base)
    segments = np.flatnonzero(library.is_donor)
    lists = library.pool(group).candidate_lists(segments, library.config)
    return np.mean([bool(set(own) - {k}) for k, own in zip(segments, lists, strict=True)])


def choose_bases(library):
    """The names of the longest clips, together of at least a minute."""
    names, seconds = [], 0.0
    for entry in sorted(library.entries, key=lambda own: -own.n_frames):
        if seconds < MIN_BASE_SECONDS:
            names.append(entry.name)
            seconds += entry.n_frames / library.rate
    return names


def detect_seams(grafts):
    """The areas under the curve of both classifiers at seams; NaN if there are few windows."""
    windows = GraftWindows.of(grafts, "seams", MAX_WINDOWS, np.random.default_rng(0))
    if len(windows) < MIN_WINDOWS:
        return np.nan, np.nan
    found = detect([windows.pairs()], [block_folds(windows.frames, (0, 0))], 0)
    return found.gross.value, found.fine.value


def compatibility_of(library, splits):
    """How compatible the donors of the cluster are: κ, and accepted parts more than random ones."""
    methods = [RandomLength(), Analogy()]
    try:
        found = compatibility(library, methods=methods, splits=splits)
    except mg.InsufficientDataError:
        return ["not defined", ""]
    kappa = next(own.kappa for own in found.scores if own.method == "analogy")
    more = found.difference("analogy", "random, length limit").accepted
    share, low, high = (100 * value for value in (more.value, more.low, more.high))
    interval = f" ({low:.1f} to {high:.1f})" if np.isfinite(low) else ", no interval"
    return [f"{kappa.value:.2f}", f"{share:.1f}{interval}"]


def choose_donors(library, count):
    """The share of exchanged segments, and the mean seam angle in degrees, of donor sequences."""
    is_new, gaps = [], []
    for name in choose_bases(library):
        plan = GraftPlan.build(library, name, None, ())
        for donors in plan.choose_donors(count, 0):
            for group, sequence in donors.items():
                is_new.append(sequence != plan.problem.scenario)
                gaps.append(plan.pools[group].seam_angles_along(sequence))
    gaps = np.concatenate(gaps)
    gaps = gaps[gaps > 1e-9]
    return np.concatenate(is_new).mean(), np.degrees(gaps.mean()) if len(gaps) else np.nan


def print_segments(sources, count):
    titles = ("per minute", "median length", "10 % to 90 %", "with a donor", "exchanged", "seam")
    print("| source | method |" + "".join(f" {title} |" for title in titles))
    print("|---|---|" + "---|" * len(titles))
    for name, motions in sources.items():
        for method in METHODS:
            library = mg.Library.build(motions, config=mg.Config(segmentation=METHODS[method]))
            seconds = library.segments.lengths / library.rate
            low, high = np.percentile(seconds, (10, 90))
            minutes = sum(motion.duration for motion in motions) / 60
            share, angle = choose_donors(library, count)
            cells = (
                f"{len(seconds) / minutes:.0f}",
                f"{np.median(seconds):.2f} s",
                f"{low:.2f} to {high:.2f} s",
                f"{100 * donor_share(library):.0f} %",
                f"{100 * share:.0f} %",
                "none" if np.isnan(angle) else f"{angle:.1f}°",
            )
            print(f"| {name} | `{method}` | {' | '.join(cells)} |", flush=True)


def print_grafts(sources, count, methods, splits):
    titles = ("seams, gross", "seams, fine", "κ", "accepted, points above random")
    print("| source | method |" + "".join(f" {title} |" for title in titles))
    print("|---|---|" + "---|" * len(titles))
    for name, motions in sources.items():
        for method in methods:
            library = mg.Library.build(motions, config=mg.Config(segmentation=METHODS[method]))
            grafts = [
                graft
                for base in choose_bases(library)
                for graft in mg.graft_many(library, base, count)
            ]
            gross, fine = detect_seams(grafts)
            areas = ["too few" if np.isnan(own) else f"{own:.2f}" for own in (gross, fine)]
            cells = [*areas, *compatibility_of(library, splits)]
            print(f"| {name} | `{method}` | {' | '.join(cells)} |", flush=True)


def read_minute(data):
    """A minute of CMU recordings of one dancer at 120 frames per second."""
    motions = [mg.read_bvh(path)[1:] for path in sorted(data.glob(CMU))]
    rotations = np.concatenate([motion.rotations for motion in motions])[:7200]
    positions = np.concatenate([motion.positions for motion in motions])[:7200]
    return mg.Motion(motions[0].skeleton, 1 / 120, rotations, positions, name="CMU 60")


def report(options):
    """Print the tables."""
    is_tiny = options.tiny
    dances = [dance(seed=seed, strides=1 if is_tiny else 4) for seed in range(1 if is_tiny else 3)]
    with tempfile.TemporaryDirectory() as unpacked:
        if is_tiny:
            dances = [dances[0][:300]]
            minute, sources = dances[0].motion, {"tiny": [tiny_motion(), tiny_motion(2)]}
        else:
            data = Path(options.data)
            minute = read_minute(data)
            sources = {
                name: read_source(name, data, Path(unpacked), options.frames)
                for name in options.source or CHOSEN
            }
    warnings.simplefilter("ignore")
    if options.only in (None, "speed"):
        print_speed(dances[0].motion, minute)
    if options.only in (None, "planted"):
        print_planted(dances, sources)
        print_event_offsets(dances)
    if options.only in (None, "agreement"):
        print_agreement(sources)
    if options.only in (None, "segments"):
        print_segments(sources, options.count)
    if options.only in (None, "grafts"):
        methods, splits = (["energy"], 1) if is_tiny else (METHODS, N_SPLITS)
        print_grafts(sources, options.count, methods, splits)


def main(argv=None):
    """Run the bench."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", nargs="?", help="folder of the recordings of the experiments")
    parser.add_argument("--only", choices=PARTS)
    parser.add_argument("--source", action="append", choices=list(SOURCES), help="default: five")
    parser.add_argument("--frames", type=int, default=MAX_FRAMES, help="frames of a source")
    parser.add_argument("--count", type=int, default=2, help="grafts per clip")
    return run(parser, report, argv)
