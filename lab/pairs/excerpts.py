"""What is compared: excerpts of grafts beside other motions with the same base."""

import warnings
from dataclasses import dataclass, replace

import numpy as np

import mograft as mg
from lab.baselines.body_mixing import add_noise
from lab.baselines.catalogue import GENERATORS, Studio
from mograft.viewing.geometry import DrawnSkeleton

SECONDS, N_PAIRS = 4.0, 60  # N_PAIRS of an arm
MIN_EXCHANGED = 0.5
"""Share of the frames of an excerpt whose parts the graft exchanges, at least."""
CHECK_DEGREES = 8.0
"""Noise on every joint of the worse motion of an attention check."""

CAPTURED, TARGET, CHECK = "captured", "graft", "check"
ARMS = (CAPTURED, "random, same segments", "GenMM, upper body")
CHOICES = (CAPTURED, *(own.name for own in GENERATORS if own.name != TARGET))
"""What grafts are compared with: by default, and all that they can be."""


@dataclass(frozen=True, eq=False)
class Excerpt:
    """The same frames of a captured clip, of its graft, and of the motions of each arm."""

    source: str
    clip: str
    start: int
    motions: dict  # by `TARGET`, the arms, and `CHECK` for some


def find_excerpts(recordings, count, seed=0, *, seconds=SECONDS, arms=ARMS, n_checks=4):
    """Return `count` excerpts, evenly from all recordings; the first `n_checks` have a `CHECK`.

    Raises `InsufficientDataError` if the grafts exchange enough in fewer excerpts.
    """
    rng = np.random.default_rng(seed)
    studios = [Studio(own.library, own, seed) for own in recordings]
    places = [_places(studio, seconds, rng) for studio in studios]
    total = sum(map(len, places))
    if total < count:
        raise mg.InsufficientDataError(
            f"{count} excerpts of {seconds:g} s with {MIN_EXCHANGED:.0%} exchanged frames are "
            f"needed, the recordings have {total}"
        )
    chosen = []
    while len(chosen) < count:
        chosen += [(k, own.pop()) for k, own in enumerate(places) if own][: count - len(chosen)]
    made = {}
    found = []
    for index, (k, (clip, start)) in enumerate(chosen):
        studio = studios[k]
        for name in (TARGET, *arms):
            if (k, clip, name) not in made:
                made[k, clip, name] = _make(studio, name, clip)
        frames = slice(start, start + round(seconds * studio.library.rate))
        motions = {name: made[k, clip, name][frames] for name in (TARGET, *arms)}
        captured = studio.library.clips[clip][frames]
        if index < n_checks:
            motions[CHECK] = add_noise(captured, CHECK_DEGREES, rng)
            motions[CAPTURED] = captured
        name = studio.library.entries[clip].name
        found.append(Excerpt(recordings[k].name, name, start, _normalised(motions, captured)))
    return found


def _places(studio, seconds, rng):
    """Return clip and first frame of the excerpts in which the graft exchanges enough, shuffled."""
    found = []
    library, length = studio.library, round(seconds * studio.library.rate)
    for clip, entry in enumerate(library.entries):
        if entry.n_frames <= length:
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            graft = mg.graft_many(library, entry.name, 1, seed=studio.seed)[0]
        is_exchanged = np.zeros(graft.motion.n_frames)
        for own in graft.substitutions:
            is_exchanged[own.start : own.stop] = not own.is_own
        starts = range(0, graft.motion.n_frames - length + 1, length)
        found += [(clip, a) for a in starts if is_exchanged[a : a + length].mean() >= MIN_EXCHANGED]
    return [found[index] for index in rng.permutation(len(found))]


def _make(studio, name, clip):
    if name == CAPTURED:
        return studio.library.clips[clip]
    generator = next(own for own in GENERATORS if own.name == name)
    return studio.make(generator, clip, 1)[0][0]


def _normalised(motions, captured):
    """Return motions in body heights, with the floor of the captured one at 0."""
    drawn = DrawnSkeleton.of(captured)
    skeleton = captured.skeleton.with_offsets(captured.skeleton.offsets / drawn.height)
    sites = (replace(own, offset=own.offset / drawn.height) for own in skeleton.end_sites)
    skeleton = replace(skeleton, end_sites=tuple(sites))
    found = {}
    for name, motion in motions.items():
        positions = motion.positions.copy()
        positions[:, 0] -= drawn.floor * drawn.to_y_up[1]
        found[name] = replace(
            motion,
            skeleton=skeleton,
            positions=positions / drawn.height,
            channel_values=None,
            name="",
            path=None,
        )
    return found
