"""Do grafts help to learn edits from few clips? "The arms of this style on these legs".

After the protocol of MotionCutMix (Jiang et al., CVPR 2025) at a small scale: an editor learns from
pairs that exchange made, and is tested on captured motion. Bandai-Namco set 2, every third clip;
clips of three styles and some actions are learned, clips of other actions tested. The editor is a
ridge regression, frame by frame, from the rotations of the legs in five frames over two thirds of a
second, the speed of the root, and mean and deviation of the upper body's rotations in a reference,
another clip of the style, to the upper body's rotations. Its strength is chosen by
cross-validation in training. The error is the mean joint angle to the captured upper body, in
degrees: mean over ten random draws of the training clips, and differences paired by draw, with
Student's interval. Schemes add copies as in `learning`; donors have the label of the clip.
"""

import numpy as np

import mograft as mg
from lab.baselines.augmentation import SCHEMES
from lab.experiments.learning import differences, mean_estimate, read_labels, split_styles
from lab.experiments.tables import Table, format_estimate
from mograft import rotations

NAME = "editing"
SOURCES = ("actions and styles",)
TRAIN_CLIPS = (20, 40)
N_SEEDS = 10
CHOSEN = ("none", "repeated", "mirror and noise", "CutMix, same label", "grafts, same label")
MEAN_POSE = "mean pose of the style"
OFFSETS = (-10, -5, 0, 5, 10)  # frames at 30 frames per second
N_COMPONENTS = 12
STRENGTHS = tuple(10.0**power for power in range(7))
N_FOLDS = 4
STEP = 3  # frames between the frames that are learned


def measure(recordings, *, is_quick):
    """Return the errors by number of training clips, scheme and seed."""
    if is_quick:
        raise mg.InsufficientDataError("a quick run has too few clips to learn from")
    clips = tuple(recordings.motions)
    actions, styles = (np.array(own) for own in zip(*map(read_labels, clips), strict=True))
    pool, test = split_styles(clips, actions, styles)
    schemes = {name: SCHEMES[name] for name in CHOSEN}
    return {str(n): run_draws(pool, test, n, N_SEEDS, schemes) for n in TRAIN_CLIPS}


def run_draws(pool, test, n_train, n_seeds, schemes):
    """Return numbers of clips, and the errors by scheme, for random draws of training clips."""
    errors = {}
    for seed in range(n_seeds):
        rng = np.random.default_rng(seed)
        train = pool.choose(np.sort(rng.permutation(len(pool))[:n_train]))
        known = test.choose(np.flatnonzero(np.isin(test.labels, train.labels)))
        for name, scheme in schemes.items():
            joined = train.join(scheme(train, np.random.default_rng((seed, 1))))
            editor = Editor(train, joined, seed)
            errors.setdefault(name, []).append(editor.error(known))
            if name == "none":
                errors.setdefault(MEAN_POSE, []).append(editor.error(known, is_mean=True))
    return {"train": n_train, "test": len(test), "scores": errors}


class Editor:
    """Predicts upper bodies from legs and a reference; learned from labelled clips.

    References are clips of `train`, which are captured; `joined` also has copies.
    """

    def __init__(self, train, joined, seed):
        from sklearn.decomposition import PCA
        from sklearn.linear_model import Ridge
        from sklearn.model_selection import GridSearchCV, GroupKFold
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler

        self.train, self.rng = train, np.random.default_rng((seed, 2))
        groups = mg.JointGroups.preset("lower_upper", train.clips[0].skeleton).groups
        index = train.clips[0].skeleton.index
        self.legs, self.arms = ([index(own) for own in groups[name]] for name in ("lower", "upper"))
        every = np.concatenate([clip.rotations for clip in train.clips])
        # The mean is the greatest eigenvector (Markley et al., J. Guidance 30(4), 2007).
        self.means = np.linalg.eigh(np.einsum("njk,njl->jkl", every, every))[1][..., -1]
        described = np.array([self._describe(clip) for clip in train.clips])
        self.styles = PCA(min(N_COMPONENTS, len(described) - 1)).fit(described)
        self.references = self.styles.transform(described)
        pairs = [
            tuple(values[::STEP] for values in self._pair(clip, label))
            for clip, label in zip(joined.clips, joined.labels, strict=True)
        ]
        rows, targets = (np.concatenate(own) for own in zip(*pairs, strict=True))
        # Copies of a clip are in the same fold: they come in the order of the clips.
        clip = np.repeat(np.arange(len(pairs)) % len(train), [len(own) for own, _ in pairs])
        search = GridSearchCV(
            make_pipeline(StandardScaler(), Ridge()),
            {"ridge__alpha": STRENGTHS},
            scoring="neg_mean_squared_error",
            cv=GroupKFold(N_FOLDS),
        )
        self.model = search.fit(rows, targets, groups=clip)

    def _turns(self, clip, joints):
        """Return the rotation vectors of joints relative to the mean pose, (n_frames, 3 n)."""
        relative = rotations.multiply(
            rotations.inverse(self.means[joints]), clip.rotations[:, joints]
        )
        return rotations.log(relative).reshape(clip.n_frames, -1)

    def _describe(self, clip):
        turns = self._turns(clip, self.arms)
        return np.concatenate([turns.mean(axis=0), turns.std(axis=0)])

    def _pair(self, clip, label):
        """Return the inputs of each frame, with a random reference, and the upper body."""
        legs = self._turns(clip, self.legs)
        near = np.clip(np.arange(len(legs))[:, None] + OFFSETS, 0, len(legs) - 1)
        root = clip.positions[:, 0]
        speed = np.linalg.norm(np.gradient(root, axis=0), axis=1, keepdims=True)
        own = np.flatnonzero(self.train.labels == label)
        reference = self.references[self.rng.choice(own)]
        columns = [legs[near].reshape(len(legs), -1), speed, np.tile(reference, (len(legs), 1))]
        return np.concatenate(columns, axis=1), self._turns(clip, self.arms)

    def error(self, test, *, is_mean=False):
        """Return the mean joint angle to captured upper bodies, in degrees.

        With `is_mean`, it is that of the mean pose of the style in the training clips.
        """
        errors = []
        for clip, label in zip(test.clips, test.labels, strict=True):
            rows, captured = self._pair(clip, label)
            if is_mean:
                own = self.train.choose(np.flatnonzero(self.train.labels == label))
                poses = np.concatenate([self._turns(each, self.arms) for each in own.clips])
                found = np.broadcast_to(poses.mean(axis=0), captured.shape)
            else:
                found = self.model.predict(rows)
            first, second = (
                rotations.exp(values.reshape(len(values), -1, 3)) for values in (found, captured)
            )
            errors.append(np.degrees(rotations.angle(first, second).mean()))
        return float(np.mean(errors))


def tables(results):
    """Errors, and their differences from those without copies; less is better."""
    found = next(iter(results.values()))
    names = [name for name in (MEAN_POSE, *CHOSEN) if name in next(iter(found.values()))["scores"]]
    errors = [
        (n, str(own["test"]), *(format_estimate(mean_estimate(own["scores"][m]), 2) for m in names))
        for n, own in found.items()
    ]
    others = [name for name in names if name != "none"]
    less = [
        (n, *(format_estimate(differences(own["scores"], m, "none"), 2) for m in others))
        for n, own in found.items()
    ]
    head = (f"{name}, degrees" for name in names)
    return {
        "errors": Table(("training clips", "test clips", *head), errors),
        "differences": Table(("training clips", *(f"{own} less none" for own in others)), less),
    }
