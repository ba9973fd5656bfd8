"""Copies of labelled clips for training: mirrored, noisy, mixed at random, or grafted."""

import warnings
from dataclasses import dataclass

import numpy as np

import mograft as mg
from lab.baselines import body_mixing

N_COPIES = 2
NOISE_DEGREES = 2.0


@dataclass(frozen=True, eq=False)
class LabelledClips:
    """Clips and their labels."""

    clips: tuple
    labels: np.ndarray  # of text

    def __len__(self):
        return len(self.clips)

    def choose(self, rows):
        return LabelledClips(tuple(self.clips[row] for row in rows), self.labels[rows])

    def join(self, other):
        labels = np.concatenate([self.labels, other.labels])
        return LabelledClips((*self.clips, *other.clips), labels)


def swap_sides(label):
    """Return the label of a mirrored clip: left becomes right, and right becomes left."""
    other = {"left": "right", "right": "left"}
    return "-".join(other.get(word, word) for word in label.split("-"))


def no_copies(train, rng):  # noqa: ARG001
    """Add nothing."""
    return LabelledClips((), train.labels[:0])


def repeat(train, rng):  # noqa: ARG001
    """Add the clips themselves: the comparison of equal size."""
    return LabelledClips(train.clips * N_COPIES, np.tile(train.labels, N_COPIES))


def mirror_and_noise(train, rng):
    """Add the mirror image of every clip, and the clip with noise of two degrees."""
    mirrored = tuple(mg.mirror(clip) for clip in train.clips)
    noisy = tuple(body_mixing.add_noise(clip, NOISE_DEGREES, rng) for clip in train.clips)
    swapped = np.array([swap_sides(label) for label in train.labels])
    return LabelledClips((*mirrored, *noisy), np.concatenate([swapped, train.labels]))


def mix_any(train, rng):
    """Add copies with upper bodies of random clips (MotionCutMix)."""
    return _mix(train, rng, is_same_label=False)


def mix_same_label(train, rng):
    """Add copies with upper bodies of random clips of the same label."""
    return _mix(train, rng, is_same_label=True)


def _mix(train, rng, *, is_same_label):
    joints = _upper_joints(train)
    made = []
    for _ in range(N_COPIES):
        for clip, label in zip(train.clips, train.labels, strict=True):
            rows = np.flatnonzero(train.labels == label) if is_same_label else range(len(train))
            donors = [train.clips[row] for row in rows]
            made.append(body_mixing.cut_mix(clip, donors, joints, rng))
    return LabelledClips(tuple(made), np.tile(train.labels, N_COPIES))


def _upper_joints(train):
    skeleton = train.clips[0].skeleton
    names = mg.JointGroups.preset("lower_upper", skeleton).groups["upper"]
    return np.array([skeleton.index(name) for name in names])


def graft_any(train, rng):
    """Add grafts whose donors are all training clips."""
    return _graft(train, rng, [np.arange(len(train))])


def graft_same_label(train, rng):
    """Add grafts whose donors are the training clips of the same label."""
    return _graft(
        train, rng, [np.flatnonzero(train.labels == one) for one in np.unique(train.labels)]
    )


def _graft(train, rng, parts):
    """Return grafts of every clip within each part; clips without other donors are repeated."""
    made, labels = [], []
    seed = int(rng.integers(1 << 30))
    for rows in parts:
        own = train.choose(rows)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            library = mg.Library.build(list(own.clips))
            for entry, label in zip(library.entries, own.labels, strict=True):
                grafts = [
                    graft.motion
                    for graft in mg.graft_many(library, entry.name, N_COPIES, seed=seed)
                ]
                made += [grafts[copy % len(grafts)] for copy in range(N_COPIES)]
                labels += [label] * N_COPIES
    return LabelledClips(tuple(made), np.array(labels))


SCHEMES = {
    "none": no_copies,
    "repeated": repeat,
    "mirror and noise": mirror_and_noise,
    "CutMix": mix_any,
    "CutMix, same label": mix_same_label,
    "grafts": graft_any,
    "grafts, same label": graft_same_label,
}
