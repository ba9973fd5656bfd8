"""Compare the methods of segmentation, on the dancer and on recordings.

The tables, one for each part:

- ``planted``: the agreement of each method with known frames: changes of the style and foot
  events of the dancer, and the joints of motions put together from pieces of recordings;
- ``offsets``: how late "contacts" finds the foot events of the dancer;
- ``agreement``: the agreement of each method with each other one on the recordings;
- ``segments``: for each source, the number and length of the segments, the share with a donor, the
  share that donor sequences exchange, and the seam angle;
- ``grafts``: for each source, the detectability at seams, and the compatibility.

Agreement is F1: cuts of both sides are paired one to one if they are at most 0.1 s apart. In
parentheses is what the same cuts reach on average after a circular shift in time by random
durations. All motions are resampled to 30 frames per second.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import lab.segmentations
import mograft as mg
from lab.common import tiny_motion
from lab.donors.compatibility import compatibility
from lab.donors.methods import Analogy
from lab.experiments.sources import MIN_FRAMES, RATE, SOURCES, find_files
from lab.experiments.tables import Table
from lab.segmentations import METHODS as OTHERS
from lab.segmentations import method as function_of
from mograft.dancer import dance
from mograft.evaluation import RandomLength
from mograft.evaluation.detectability import MIN_WINDOWS, block_folds, detect
from mograft.evaluation.windows import GraftWindows
from mograft.solve.plan import GraftPlan

NAME = "segmentations"
CODE = tuple(sorted(Path(lab.segmentations.__file__).parent.glob("*.py")))
METHODS = {"energy": "energy", **{name: function_of(name) for name in OTHERS}}
CHOSEN = ("salsa A", "perfume", "basketball", "actions and styles", "everyday")
TOLERANCE = 0.1  # seconds
N_SHIFTS = 10
MAX_FRAMES = 3600  # of a source: two minutes
MIN_BASE_SECONDS = 60.0  # of the clips that are bases
N_GRAFTS = 2  # of each base
MAX_WINDOWS = 400
N_SPLITS = 1  # of the folds of compatibility
PIECE_SECONDS = (3.0, 6.0)


@dataclass(frozen=True)
class Inputs:
    """Dances of the dancer, and the clips of each source; a few seconds if `is_quick`."""

    dances: tuple
    sources: dict
    is_quick: bool


def find_inputs(data, unpacked):
    """Return the files of the sources."""
    return [path for name in CHOSEN for path in find_files(SOURCES[name], data, unpacked)]


def read_inputs(data, unpacked, *, is_quick):
    """Return the `Inputs`."""
    if is_quick:
        return Inputs(
            (dance(strides=1)[:300],), {"tiny": [tiny_motion(), tiny_motion(2)]}, is_quick=True
        )
    sources = {name: read_source(find_files(SOURCES[name], data, unpacked)) for name in CHOSEN}
    dances = tuple(dance(seed=seed, strides=4) for seed in range(3))
    return Inputs(dances, {name: own for name, own in sources.items() if own}, is_quick=False)


def read_source(files):
    """The clips of a source at 30 frames per second, evenly spaced, up to a number of frames."""
    motions, hierarchy, n_frames = [], None, 0
    for path in sorted(files, key=lambda path: hash_of(path.name)):
        motion = mg.read_bvh(path)
        if any(fault.kind == "first_frame" for fault in mg.find_faults(motion)):
            motion = motion[1:]
        motion = motion.resample(RATE)[: MAX_FRAMES - n_frames]
        hierarchy = hierarchy or motion.skeleton.names
        if motion.n_frames >= MIN_FRAMES and motion.skeleton.names == hierarchy:
            motions.append(motion)
            n_frames += motion.n_frames
        if n_frames > MAX_FRAMES - MIN_FRAMES:
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


def planted(inputs):
    """Return how well the cuts of each method agree with known frames."""
    rng = np.random.default_rng(0)
    titles = ["styles", "foot events", *inputs.sources]
    rows = {method: [Agreement() for _ in titles] for method in METHODS}
    joined = {
        name: [put_together(mg.Library.build(motions), 12, rng) for _ in range(3)]
        for name, motions in inputs.sources.items()
    }
    for made in inputs.dances:
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
    return Table(
        ("method", *titles), [(method, *map(str, cells)) for method, cells in rows.items()]
    )


def offsets(inputs):
    """Return how late "contacts" finds the touchdowns and lift-offs of the dancer."""
    rows = []
    for events, change in (("touchdown", 1), ("liftoff", -1)):
        found = np.concatenate([_gaps(made, events, change) for made in inputs.dances])
        rows.append((events, f"{np.median(found):+.2f}"))
    return Table(("contacts", "median delay, s"), rows)


def _gaps(made, events, change):
    """Return the seconds from each event of the dancer to the nearest cut."""
    truth = np.flatnonzero((np.diff(made.stance.astype(int), axis=0) == change).any(axis=1)) + 1
    found = mg.segment(made.motion, method=function_of("contacts", events=events)).start[1:]
    gaps = found[:, None] - truth
    return gaps[np.abs(gaps).argmin(axis=0), np.arange(len(truth))] / made.motion.rate


def agreement(inputs):
    """Return how well the cuts of the methods agree with each other."""
    rng = np.random.default_rng(1)
    motions = [motion for own in inputs.sources.values() for motion in own]
    cuts = {method: [inner_cuts(motion, method) for motion in motions] for method in METHODS}
    rows = []
    for row, method in enumerate(METHODS):
        cells = []
        for other in list(METHODS)[row + 1 :]:
            found = Agreement()
            for motion, first, second in zip(motions, cuts[method], cuts[other], strict=True):
                found.add(first, second, motion, rng)
            cells.append(str(found))
        rows.append((method, *[""] * (row + 1), *cells))
    return Table(("method", *METHODS), rows)


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


def segments(inputs):
    """Return the number and length of segments, and their donors."""
    head = ("source", "method", "per minute", "median length, s", "10 % to 90 %")
    head += ("with a donor, %", "exchanged, %", "seam")
    rows = []
    for name, motions in inputs.sources.items():
        minutes = sum(motion.duration for motion in motions) / 60
        for method, function in METHODS.items():
            library = mg.Library.build(motions, config=mg.Config(segmentation=function))
            seconds = library.segments.lengths / library.rate
            low, high = np.percentile(seconds, (10, 90))
            share, angle = choose_donors(library, N_GRAFTS)
            cells = (
                f"{len(seconds) / minutes:.0f}",
                f"{np.median(seconds):.2f}",
                f"{low:.2f} to {high:.2f} s",
                f"{100 * donor_share(library):.0f}",
                f"{100 * share:.0f}",
                "none" if np.isnan(angle) else f"{angle:.1f}°",
            )
            rows.append((name, method, *cells))
    return Table(head, rows)


def grafts(inputs):
    """Return the detectability at seams and the compatibility of grafts."""
    head = ("source", "method", "seams, gross", "seams, fine", "κ", "accepted, points above random")
    methods = {"energy": "energy"} if inputs.is_quick else METHODS
    rows = []
    for name, motions in inputs.sources.items():
        for method, function in methods.items():
            library = mg.Library.build(motions, config=mg.Config(segmentation=function))
            made = [
                graft
                for base in choose_bases(library)
                for graft in mg.graft_many(library, base, N_GRAFTS)
            ]
            areas = ["too few" if np.isnan(own) else f"{own:.2f}" for own in detect_seams(made)]
            rows.append((name, method, *areas, *compatibility_of(library, N_SPLITS)))
    return Table(head, rows)


PARTS = {own.__name__: own for own in (planted, offsets, agreement, segments, grafts)}
