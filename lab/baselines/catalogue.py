"""The generators that are compared: each makes several motions for every clip of a library."""

import time
import warnings
from dataclasses import dataclass
from functools import cached_property

import numpy as np

import mograft as mg
from lab.baselines import body_mixing, genmm, motion_matching
from lab.baselines.motion_arrays import MotionArrays
from mograft.evaluation import RandomLength, draw_donors, grafts_by
from mograft.scenario import transitions, walk
from mograft.synthesis.graft_building import build_graft

NOISE_DEGREES = 2.0
OWN_FRAMES = 30  # motion around the replaced frames that methods without a novelty term may not use


@dataclass(frozen=True)
class Generator:
    """A generator: the name of its method in `Studio`, and a description."""

    name: str
    method: str
    description: str


GENERATORS = (
    Generator("graft", "graft", "default configuration"),
    Generator("graft, paper()", "graft_paper", "`Config.paper()`"),
    Generator("random donors", "random_donors", "random segments of similar length"),
    Generator("random, same segments", "same_segments", "as above, where the graft exchanges"),
    Generator("CutMix", "cut_mix", "random pieces of up to 3 s (MotionCutMix, 2025)"),
    Generator("motion matching", "matching", "frames with the most similar legs"),
    Generator("GenMM, upper body", "genmm_upper", "patches, legs given (Li et al. 2023)"),
    Generator("noise", "noise", "2 degrees on every joint and frame (pybvh-ml)"),
    Generator("GenMM", "genmm_body", "patches of the whole body (Li et al. 2023)"),
    Generator("motion graph", "walks", "`scenario.walk` without exchange"),
    Generator("motion graph, graft", "grafted_walks", "`scenario.walk`, upper bodies grafted"),
)


@dataclass(frozen=True, eq=False)
class Studio:
    """A library and what generators derive from it."""

    library: mg.Library
    recordings: object
    seed: int = 0

    @cached_property
    def paper_library(self):
        return self.recordings.build(mg.Config.paper())

    @cached_property
    def arrays(self):
        return MotionArrays.of(self.library)

    @cached_property
    def examples(self):
        return [self.arrays.encode(clip) for clip in self.library.clips]

    @cached_property
    def database(self):
        return motion_matching.MatchingDatabase.of(self.library.clips)

    @cached_property
    def graph(self):
        return transitions(self.library)

    @property
    def joints(self):
        """The joints that are exchanged."""
        return self.library.joints("upper")

    def make(self, generator, clip, n_runs):
        """Return `n_runs` motions of the length of a clip, and the seconds that they took."""
        start = time.process_time()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            motions = getattr(self, generator.method)(clip, n_runs)
        n_frames = self.library.clips[clip].n_frames
        motions = [motions[run % len(motions)][:n_frames] for run in range(n_runs)]
        return motions, time.process_time() - start

    def _rng(self, clip, run):
        return np.random.default_rng((self.seed, clip, run))

    def name(self, clip):
        """Return the name of a clip."""
        return self.library.entries[clip].name

    def graft(self, clip, n_runs):
        found = mg.graft_many(self.library, self.name(clip), n_runs, seed=self.seed)
        return [graft.motion for graft in found]

    def graft_paper(self, clip, n_runs):
        found = mg.graft_many(self.paper_library, self.name(clip), n_runs, seed=self.seed)
        return [graft.motion for graft in found]

    def random_donors(self, clip, n_runs):
        name, method = self.name(clip), RandomLength(has_seam_limit=False)
        found = grafts_by(method, self.library, name, n_runs, seed=self.seed)
        return [graft.motion for graft in found]

    def same_segments(self, clip, n_runs):
        """Return grafts with random donors for exactly the segments that `graft` exchanges."""
        name, method = self.name(clip), RandomLength(has_seam_limit=False)
        plan, drawn = draw_donors(method, self.library, name, n_runs, seed=self.seed)
        grafts = mg.graft_many(self.library, name, n_runs, seed=self.seed)
        return [
            build_graft(plan, keep_own(graft.substitutions, drawn[run]), self.seed, run).motion
            for run, graft in enumerate(grafts)
        ]

    def cut_mix(self, clip, n_runs):
        clips = self.library.clips
        return [
            body_mixing.cut_mix(clips[clip], clips, self.joints, self._rng(clip, run))
            for run in range(n_runs)
        ]

    def matching(self, clip, n_runs):
        base, database = self.library.clips[clip], self.database
        return [
            motion_matching.match(
                base, clip, self.joints, database, self._rng(clip, run), radius=OWN_FRAMES
            )
            for run in range(n_runs)
        ]

    def noise(self, clip, n_runs):
        base = self.library.clips[clip]
        return [
            body_mixing.add_noise(base, NOISE_DEGREES, self._rng(clip, run))
            for run in range(n_runs)
        ]

    def genmm_body(self, clip, n_runs):
        return [self._synthesize(clip, run, None) for run in range(n_runs)]

    def genmm_upper(self, clip, n_runs):
        given = self.examples[clip]
        columns = np.arange(given.shape[1])
        columns = np.setdiff1d(columns, self.arrays.joint_columns(self.joints))
        kept = genmm.Kept(columns, given[:, columns], clip, OWN_FRAMES)
        return [self._synthesize(clip, run, kept) for run in range(n_runs)]

    def _synthesize(self, clip, run, kept):
        length = len(self.examples[clip])
        features = genmm.synthesize(self.examples, length, self._rng(clip, run), kept=kept)
        return self.arrays.decode(features, name=self.name(clip))

    def _walk(self, clip, run):
        base = self.library.clips[clip]
        duration = (base.n_frames + 1) / base.rate
        return walk(self.library, duration, self.seed + 1000 * clip + run, graph=self.graph)

    def walks(self, clip, n_runs):
        return [
            mg.graft(self.library, scenario=self._walk(clip, run)).base for run in range(n_runs)
        ]

    def grafted_walks(self, clip, n_runs):
        return [
            mg.graft(self.library, scenario=self._walk(clip, run), seed=self.seed + run).motion
            for run in range(n_runs)
        ]


def keep_own(substitutions, drawn):
    """Return the donor sequences `drawn`, but base segments where `substitutions` keep them."""
    donors = {group: own.copy() for group, own in drawn.items()}
    position = dict.fromkeys(donors, 0)
    for own in substitutions:
        if own.is_own:
            donors[own.group][position[own.group]] = own.segment
        position[own.group] += 1
    return donors
