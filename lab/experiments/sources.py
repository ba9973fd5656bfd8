"""The recordings of the experiments, and what they were used for before.

On development sources constants were chosen. On test sources none was, but decisions were checked
on them. No one had looked at results on untouched sources before the plan in ``lab/plan.md``.
"""

import fnmatch
import tarfile
import warnings
from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property

import mograft as mg

RATE = 30.0  # segments of the paper have 7.3 frames on average, as those at this rate do
MIN_FRAMES = 30  # shorter clips have too few segments
QUICK_FRAMES = 1200
ARCHIVE = "bandai_all.tar.xz"


@dataclass(frozen=True)
class Source:
    """A set of recordings of one skeleton.

    `pattern` is a glob below the data folder or, if `is_archived`, one or more patterns of file
    names in the archive of the Bandai-Namco data sets, separated by spaces.
    """

    name: str
    pattern: str
    description: str
    use: str  # "development", "test" or "untouched"
    is_archived: bool = False
    max_clips: int = 10_000  # evenly spaced in the order of names
    without: str = ""  # a pattern of names of files that are left out
    others: tuple = ()  # names of sources whose files are left out


_DEVELOPMENT = (
    Source(
        "salsa A",
        "paper_shape_57dof/paper_shape_A.bvh",
        "CMU subject 60, four takes in one file, as many frames as the first dance of the paper",
        use="development",
    ),
    Source(
        "salsa B",
        "paper_shape_57dof/paper_shape_B.bvh",
        "the same dancer, three takes",
        use="development",
    ),
    Source(
        "perfume",
        "dance_perfume_test/*.bvh",
        "three dancers, one take each (Perfume Global Site Project)",
        use="development",
    ),
    Source(
        "indian",
        "dance_cmu94_indian_30fps/*.bvh",
        "CMU subject 94, Indian dance, four takes",
        use="development",
    ),
    Source(
        "basketball",
        "database_vsports_basket/*.bvh",
        "basketball practice (SNU VSports), 9 of 28 takes",
        use="development",
        max_clips=9,
    ),
)
_TEST = (
    Source(
        "locomotion",
        "dataset-2_walk_* dataset-2_run_* dataset-2_walk-turn-*",
        "Bandai-Namco set 2: walks, runs and turns in seven styles",
        use="test",
        is_archived=True,
        max_clips=120,
    ),
    Source(
        "gestures",
        "dataset-2_raise-up-* dataset-2_wave-*",
        "Bandai-Namco set 2: raised and waving hands in seven styles",
        use="test",
        is_archived=True,
        max_clips=120,
    ),
    Source(
        "actions and styles",
        "dataset-2_*",
        "Bandai-Namco set 2: ten actions in seven styles, every third clip",
        use="test",
        is_archived=True,
        max_clips=968,
    ),
    Source(
        "everyday",
        "dataset-1_*",
        "Bandai-Namco set 1: everyday actions in all styles but the normal one",
        use="test",
        is_archived=True,
        max_clips=120,
        without="dataset-1_*_normal_*",
    ),
    Source(
        "slow walks",
        "skel_snu_wd2/w*.bvh",
        "walks of one person (SNU, DataDrivenBipedController)",
        use="test",
    ),
    Source(
        "video dance",
        "skel_animated_drawings/jesse_dance.bvh",
        "a dance estimated from video (Rokoko)",
        use="test",
    ),
    Source(
        "acting",
        "skel_animated_drawings/[!j]*.bvh",
        "short actions of one person (FAIR, AnimatedDrawings)",
        use="test",
    ),
    Source(
        "stage",
        "skel_optitrack_arena_57dof/*.bvh",
        "one take of one person, 57 DoF (OptiTrack Arena)",
        use="test",
    ),
    Source("boxing", "skel_cmu_motionbuilder/*.bvh", "CMU subject 13, one take", use="test"),
    Source(
        "estimated", "skel_video2bvh/*.bvh", "a dance estimated from video (video2bvh)", use="test"
    ),
)
_UNTOUCHED = (
    Source(
        "other clips",
        "dataset-2_*",
        "Bandai-Namco set 2: clips of no other source, of the same people",
        use="untouched",
        is_archived=True,
        max_clips=120,
        others=("locomotion", "gestures", "actions and styles"),
    ),
    Source(
        "pair dance",
        "dance_carousel_pair/*.bvh",
        "two dancers who dance together, and a warm-up (Carousel Dancing)",
        use="untouched",
    ),
    Source(
        "game clips",
        "glb/kaykit_Med_*.glb",
        "animations of a game's character, made by hand (KayKit)",
        use="untouched",
    ),
)
SOURCES = {source.name: source for source in _DEVELOPMENT + _TEST + _UNTOUCHED}
DEVELOPMENT, TEST, UNTOUCHED = (
    tuple(own.name for own in several) for several in (_DEVELOPMENT, _TEST, _UNTOUCHED)
)
SEVERAL = (
    *("salsa A", "perfume", "indian", "locomotion", "gestures", "everyday", "slow walks"),
    *UNTOUCHED,
)
"""The sources of experiments that take long."""


@dataclass(frozen=True, eq=False)
class Recordings:
    """The clips of a source at 30 frames per second."""

    name: str
    motions: tuple

    @cached_property
    def library(self):
        """The library with the default configuration and two groups."""
        return self.build()

    def build(self, config=None, groups="lower_upper"):
        """A library of the clips."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return mg.Library.build(list(self.motions), groups, config)


def find_files(source, data, unpacked):
    """Return the files of a source; unpack the archive into the folder `unpacked` if needed."""
    if not source.is_archived:
        files = sorted(data.glob(source.pattern))
    else:
        if not (data / ARCHIVE).exists():
            return []
        if not (unpacked / "bn").exists():
            with tarfile.open(data / ARCHIVE) as archive:
                archive.extractall(unpacked / "draft", filter="data")
            (unpacked / "draft" / "bn").rename(unpacked / "bn")
        patterns = source.pattern.split()
        files = [
            path
            for path in sorted((unpacked / "bn").glob("*.bvh"))
            if any(fnmatch.fnmatch(path.name, pattern) for pattern in patterns)
        ]
    if source.without:
        files = [own for own in files if not own.match(source.without)]
    used = {own for name in source.others for own in find_files(SOURCES[name], data, unpacked)}
    files = [own for own in files if own not in used]
    n = min(source.max_clips, len(files))
    return [files[index * len(files) // n] for index in range(n)]


def read_recordings(name, files, *, is_quick=False):
    """Read files; return the largest set with one hierarchy, without a leading rest pose.

    If `is_quick`, only the first clips are read, `QUICK_FRAMES` frames in all.
    """
    sets = defaultdict(list)
    n_frames = 0
    for motion in (clip for path in files for clip in mg.read(path)):
        if any(fault.kind == "first_frame" for fault in mg.find_faults(motion)):
            motion = motion[1:]
        motion = motion.resample(RATE)
        if is_quick:
            motion = motion[: max(QUICK_FRAMES - n_frames, 0)]
        if motion.n_frames >= MIN_FRAMES:
            sets[motion.skeleton.names, tuple(motion.skeleton.parents)].append(motion)
            n_frames += motion.n_frames
        if is_quick and n_frames > QUICK_FRAMES - MIN_FRAMES:
            break
    largest = max(sets.values(), key=lambda motions: sum(own.n_frames for own in motions))
    return Recordings(name, tuple(largest))
