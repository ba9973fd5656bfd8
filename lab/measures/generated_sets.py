"""All measures of the motions that one generator made for the clips of a library."""

import itertools
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from lab.measures import two_sets
from lab.measures.contacts import toe_skate
from lab.measures.distributions import N_NEIGHBOURS, balls, frechet_distance
from lab.measures.nearest_patches import nearest_patches
from lab.measures.nearest_windows import (
    COVERAGE_FRAMES,
    LOCAL_FRAMES,
    MAX_COVERED_DISTANCE,
    nearest_windows,
)
from lab.measures.tracks import COMPARED_RATE, pose_track
from mograft import Segments
from mograft.analysis.embedding import embed, features, mean_rotations, normalise
from mograft.body.anatomy import feature_joints
from mograft.body.mass import mass_model
from mograft.evaluation import estimate
from mograft.evaluation.body_tracks import FrameBlocks

WINDOW_FRAMES, WINDOW_STEP = 15, 5  # of the embedded windows
PIECE_FRAMES = 100  # at 10 frames per second: of the motions that the global measure compares
MAX_COPIED_DISTANCE = 0.01  # local distance of a window that is a copy
MIN_PATCH_FRAMES = 10  # at 10 frames per second: shortest patch of the global measure
N_SPLITS = 4  # random divisions of the captured windows, for the null comparison
Z = 1.959964  # of a 95 % interval
_NO_INTERVAL = "bootstrap of 0 blocks"
NO_DETECTION = dict.fromkeys(
    ("gross", "fine"), estimate.Estimate.without_value(0, "windows", _NO_INTERVAL)
)


@dataclass(frozen=True, eq=False)
class Piece:
    """Poses at 10 frames per second, and the block that each frame is for."""

    track: np.ndarray  # (n_frames, 6 * n_joints)
    block: np.ndarray  # (n_frames,)

    @property
    def joint_scale(self):
        """Divisor that turns a distance of poses into the root mean square over joints."""
        return np.sqrt(self.track.shape[1] / 6)

    def parts(self):
        """Return pieces of at least ten seconds; a shorter piece is one."""
        n = max(len(self.track) // PIECE_FRAMES, 1)
        edges = np.arange(n + 1) * len(self.track) // n
        return [Piece(self.track[a:b], self.block[a:b]) for a, b in itertools.pairwise(edges)]

    def split_blocks(self):
        """Return one piece for each block."""
        edges = np.flatnonzero(np.diff(self.block)) + 1
        tracks, blocks = np.split(self.track, edges), np.split(self.block, edges)
        return [Piece(*own) for own in zip(tracks, blocks, strict=True)]


@dataclass(frozen=True, eq=False)
class Reference:
    """The captured motions that generated ones are compared with.

    The blocks of about five seconds are divided at random into halves. Set measures compare the
    first half of the captured windows with the generated windows in the blocks of the second half,
    so that the second half of the captured windows is a comparison of the same size.
    """

    library: object
    seed: int = 0

    @cached_property
    def clips(self):
        return list(self.library.clips)

    @cached_property
    def blocks(self):
        """The blocks of the frames of each clip."""
        found = FrameBlocks.of(self.library)
        return np.split(found.block, found.offsets[1:])

    @cached_property
    def n_blocks(self):
        return int(self.blocks[-1][-1]) + 1

    @cached_property
    def is_second(self):
        """Whether each block is in the second half."""
        order = np.random.default_rng(self.seed).permutation(self.n_blocks)
        return order < self.n_blocks // 2

    @cached_property
    def pieces(self):
        """The clips at 10 frames per second."""
        stride = max(round(self.library.rate / COMPARED_RATE), 1)
        return [
            Piece(pose_track(clip, self.library.root), block[::stride])
            for clip, block in zip(self.clips, self.blocks, strict=True)
        ]

    def halves(self):
        """Return the pieces of the first and of the second half of the blocks."""
        parts = [part for piece in self.pieces for part in piece.split_blocks()]
        halves = [], []
        for part in parts:
            halves[int(self.is_second[part.block[0]])].append(part)
        return halves

    @cached_property
    def embedding(self):
        samples = self._samples(self.clips)
        joints = feature_joints(self.library.skeleton, np.arange(self.library.skeleton.n_joints))
        means = mean_rotations(samples.chunks())
        config, root = self.library.config, self.library.root
        return embed(samples, joints, means, config, root=root, group="whole body")

    def _samples(self, motions):
        starts = [np.arange(0, motion.n_frames - WINDOW_FRAMES, WINDOW_STEP) for motion in motions]
        cut = Segments(
            np.concatenate(starts),
            np.concatenate(starts) + WINDOW_FRAMES,
            np.repeat(np.arange(len(motions)), list(map(len, starts))),
        )
        heights = [mass_model(motion.skeleton).height for motion in motions]
        return normalise(
            motions,
            cut,
            self.library.config,
            root=self.library.root,
            up=self.library.up,
            heights=heights,
        )

    def embed(self, motions):
        """Return the embedded windows of motions and their blocks; motions as long as the clips."""
        own = self.embedding
        matrix = features(self._samples(motions), own.joints, own.reference, has_root=own.has_root)
        blocks = [
            block[np.arange(0, motion.n_frames - WINDOW_FRAMES, WINDOW_STEP)]
            for motion, block in zip(motions, self.blocks, strict=True)
        ]
        return own.project(matrix), np.concatenate(blocks)

    @cached_property
    def embedded(self):
        return self.embed(self.clips)

    @cached_property
    def windows(self):
        return two_sets.read_windows(self.clips, self.blocks)


def measure(reference, runs):
    """Return all measures of generated motions as `Estimate`, by name.

    `runs` is a sequence of runs; a run has one motion for every clip, of its length.
    """
    pieces = [
        [
            Piece(pose_track(motion, reference.library.root), own.block)
            for motion, own in zip(run, reference.pieces, strict=True)
        ]
        for run in runs
    ]
    windows = [two_sets.read_windows(run, reference.blocks) for run in runs]
    generated = two_sets.assign_blocks(two_sets.WindowSet.concatenate(windows), reference.windows)
    return {
        "coverage": coverage(reference.pieces, pieces),
        **local_measures(pieces, reference.pieces),
        "global": global_distance(pieces, reference.pieces),
        "inter": distance_between(pieces),
        **embedding_measures(reference, runs),
        **detection([(reference.windows, generated)], reference.n_blocks),
        "skate": skate(reference, runs),
    }


def measure_captured(reference):
    """Return the same measures of captured motion.

    The second half of the blocks is compared with the first, and two random halves of the windows
    with each other.
    """
    first, second = reference.halves()
    splits = [two_sets.split_at_random(reference.windows, seed) for seed in range(N_SPLITS)]
    return {
        "coverage": coverage(first, [second]),
        **local_measures([second], first),
        "global": global_distance([second], first),
        "inter": estimate.Estimate.without_value(0, "pieces", _NO_INTERVAL),
        **embedding_measures(reference, [reference.clips]),
        **detection(splits, reference.n_blocks),
        "skate": skate(reference, [reference.clips]),
    }


def coverage(captured, runs):
    """Return the share of the captured one-second windows that a run covers (GANimator)."""
    is_covered, blocks = [], []
    for run in runs:
        nearest = nearest_windows(_tracks(captured), _tracks(run), COVERAGE_FRAMES)
        for own, piece in zip(nearest, captured, strict=True):
            is_covered += (own < MAX_COVERED_DISTANCE).tolist()
            blocks += piece.block[: len(own)].tolist()
    return estimate.block_mean(is_covered, blocks, "windows")


def local_measures(runs, captured):
    """Return the mean distance of half-second windows from the nearest captured one.

    `copied` is the share of the windows whose distance is at most 0.01.
    """
    values, blocks = [], []
    for run in runs:
        nearest = nearest_windows(_tracks(run), _tracks(captured), LOCAL_FRAMES)
        for own, piece in zip(nearest, run, strict=True):
            values.append(own / piece.joint_scale)
            blocks.append(piece.block[: len(own)])
    values, blocks = np.concatenate(values), np.concatenate(blocks)
    return {
        "local": estimate.block_mean(values, blocks, "windows"),
        "copied": estimate.block_mean(values <= MAX_COPIED_DISTANCE, blocks, "windows"),
    }


def global_distance(runs, captured):
    """Return the mean distance from the nearest sequence of captured pieces of 1 s or more."""
    examples = _tracks(captured)
    values, blocks = [], []
    for run in runs:
        for piece in run:
            for part in piece.parts():
                distance = nearest_patches(part.track, examples, MIN_PATCH_FRAMES)
                values.append(distance / part.joint_scale)
                blocks.append(int(part.block[0]))
    return estimate.block_mean(values, blocks, "pieces")


def distance_between(runs):
    """Return the mean global distance of the motions of one run from those of the next."""
    values, blocks = [], []
    for run, other in zip(runs, [*runs[1:], runs[0]], strict=True):
        for piece, own in zip(run, other, strict=True):
            for part in piece.parts() if len(runs) > 1 else ():
                distance = nearest_patches(part.track, [own.track], MIN_PATCH_FRAMES)
                values.append(distance / part.joint_scale)
                blocks.append(int(part.block[0]))
    return estimate.block_mean(values, blocks, "pieces")


def embedding_measures(reference, runs):
    """Return density, coverage and Fréchet distance of the windows in the second half of blocks.

    Each run is compared with the captured windows in the first half; the values are means over
    runs.
    """
    points, blocks = reference.embedded
    is_real = ~reference.is_second[blocks]
    real, real_blocks = points[is_real], blocks[is_real]
    inside, covered, covered_blocks, inside_blocks, fakes = [], [], [], [], []
    for run in runs:
        fake, own = reference.embed(run)
        kept = reference.is_second[own]
        fake, own = fake[kept], own[kept]
        if len(real) <= N_NEIGHBOURS or len(fake) <= N_NEIGHBOURS:
            continue
        is_inside = balls(real, fake)
        inside += (is_inside.sum(axis=0) / N_NEIGHBOURS).tolist()
        inside_blocks += own.tolist()
        covered += is_inside.any(axis=1).tolist()
        covered_blocks += real_blocks.tolist()
        fakes.append((fake, own))
    return {
        "density": estimate.block_mean(inside, inside_blocks, "windows"),
        "embedding coverage": estimate.block_mean(covered, covered_blocks, "windows"),
        "frechet": _frechet(real, fakes),
    }


def _frechet(real, fakes):
    """Return the mean Fréchet distance, with a jackknife interval: resampling is biased for it."""
    if not fakes:
        return estimate.Estimate.without_value(0, "windows", _NO_INTERVAL)
    present = np.unique(np.concatenate([own for _, own in fakes]))

    def distance(left_out):
        return np.mean(
            [frechet_distance(real, fake, None, (own != left_out) + 0.0) for fake, own in fakes]
        )

    value, error = float(distance(-1)), float("nan")
    if len(present) >= estimate.MIN_BLOCKS:
        without = np.array([distance(block) for block in present])
        error = float(np.sqrt(len(present) - 1) * without.std())
    return estimate.Estimate(
        value=value,
        low=value - Z * error,
        high=value + Z * error,
        n=sum(len(fake) for fake, _ in fakes),
        unit="windows",
        interval_method=f"jackknife of {len(present)} blocks",
    )


def detection(pairs, n_blocks):
    """Return the AUC of the classifiers that tell generated windows from captured ones.

    `pairs` has one or more pairs of captured and generated windows; the AUC is their mean.
    """
    found = [two_sets.compare_sets(*pair, seed) for seed, pair in enumerate(pairs)]
    found = [own for own in found if own is not None]
    if not found:
        return NO_DETECTION
    present = np.unique(np.concatenate([own.unit for own in found]))

    def auc(multiplicities, which):
        weights = np.zeros((len(multiplicities), n_blocks))
        weights[:, present] = multiplicities
        return np.mean([own.auc(which, weights) for own in found], axis=0)

    return {
        name: estimate.bootstrap_estimate(
            float(auc(np.ones((1, len(present))), which)[0]),
            partial(auc, which=which),
            len(present),
            n=max(int(own.is_new.sum()) for own in found),
            unit="windows",
            seed=0,
        )
        for which, name in enumerate(("gross", "fine"))
    }


def skate(reference, runs):
    """Return the share of the toe contacts that skate."""
    is_skating, blocks = [], []
    for run in runs:
        for motion, block in zip(run, reference.blocks, strict=True):
            n_contacts, n_skating = toe_skate(motion)
            is_skating += np.repeat(1.0, n_skating.sum()).tolist()
            blocks += np.repeat(block, n_skating).tolist()
            is_skating += np.repeat(0.0, (n_contacts - n_skating).sum()).tolist()
            blocks += np.repeat(block, n_contacts - n_skating).tolist()
    return estimate.block_mean(is_skating, blocks, "contacts")


def _tracks(pieces):
    return [piece.track for piece in pieces]
