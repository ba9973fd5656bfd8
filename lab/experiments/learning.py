"""Do grafts help to learn from few clips? Classifiers with added copies of clips.

Bandai-Namco set 2, every third clip; labels are in the file names. Actions (10) are learned from
two rest positions of the hips, presumably performers, and tested on the third, in turn. Styles of
one rest position are learned from some actions and tested on others. Balanced accuracy, mean over
ten random draws of the training clips, and differences paired by draw, with Student's interval.
Every scheme adds two copies of every clip: `repeated` the clips themselves, `mirror and noise` the
mirror image and noise of 2 degrees, `CutMix` upper bodies of random clips, `grafts` the default
configuration; `same label` takes donors from clips of the same label. The settings of the
classifiers were not tuned. Chance is 0.10 for actions and 0.33 for styles.
"""

import math
import warnings
from functools import lru_cache

import numpy as np

import mograft as mg
from lab.baselines.augmentation import SCHEMES, LabelledClips
from lab.experiments.tables import Table, format_estimate
from lab.measures import clip_features

NAME = "learning"
SOURCES = ("actions and styles",)
SHARES = (0.05, 0.1, 0.25)
N_SEEDS = 10
REFERENCE = "repeated"
CLASSIFIERS = ("logistic regression", "random forest")
STYLES = ("active", "elderly", "exhausted")
"""The styles of the rest position that has the most."""
TEST_ACTIONS = ("raise-up-right-hand", "wave-right-hand", "walk-turn-right", "run")
MIN_TRAIN = 20


def read_labels(motion):
    """Return action and style of a clip of Bandai-Namco set 2, which its name states."""
    _, action, style, _ = motion.name.split("_")
    return action, style


def performers(motions):
    """Return a number for each clip: clips with the same rest position of the hips have the same.

    The data set has three performers, and exactly three rest positions.
    """
    rest = np.array([motion.skeleton.offsets[1] for motion in motions])
    return np.unique(rest.round(2), axis=0, return_inverse=True)[1].reshape(-1)


def split_actions(labelled, groups, seed):
    """Return the pool of training clips and the test clips: those of one performer."""
    held_out = np.unique(groups)[seed % len(np.unique(groups))]
    return labelled.choose(np.flatnonzero(groups != held_out)), labelled.choose(
        np.flatnonzero(groups == held_out)
    )


def split_styles(clips, actions, styles):
    """Return training pool and test clips of one performer: clips of different actions."""
    is_used, is_test = np.isin(styles, STYLES), np.isin(actions, TEST_ACTIONS)
    labelled = LabelledClips(clips, styles)
    train, test = np.flatnonzero(is_used & ~is_test), np.flatnonzero(is_used & is_test)
    return labelled.choose(train), labelled.choose(test)


def measure(recordings, *, is_quick):
    """Return the balanced accuracy by task, share, classifier, scheme and seed."""
    if is_quick:
        raise mg.InsufficientDataError("a quick run has too few clips to learn from")
    clips = tuple(recordings.motions)
    actions, styles = (np.array(own) for own in zip(*map(read_labels, clips), strict=True))
    labelled, groups = LabelledClips(clips, actions), performers(clips)
    tasks = {
        "action, other performer": lambda seed: split_actions(labelled, groups, seed),
        "style, other actions": lambda seed: split_styles(clips, actions, styles),  # noqa: ARG005
    }
    return {
        task: {f"{share:g}": run_share(split, share, N_SEEDS) for share in SHARES}
        for task, split in tasks.items()
    }


def run_share(split, share, n_seeds, schemes=None):
    """Return training clips, test clips and accuracies for random shares of the training pool.

    `split` maps a seed to training pool and test clips.
    """
    scores, sizes = {}, []
    for seed in range(n_seeds):
        pool, test = split(seed)
        rng = np.random.default_rng(seed)
        n = max(round(share * len(pool)), MIN_TRAIN)
        train = pool.choose(np.sort(rng.permutation(len(pool))[:n]))
        sizes.append((len(train), len(test)))
        seen, unseen = (
            np.array([_captured_features(clip) for clip in own.clips]) for own in (train, test)
        )
        for name, scheme in (schemes or SCHEMES).items():
            added = scheme(train, np.random.default_rng((seed, 1)))
            new = [clip_features.clip_features(clip) for clip in added.clips]
            rows = np.concatenate([seen, new]) if new else seen
            labels = np.concatenate([train.labels, added.labels])
            for classifier in CLASSIFIERS:
                score = accuracy(classifier, (rows, labels), (unseen, test.labels), seed)
                scores.setdefault(classifier, {}).setdefault(name, []).append(score)
    train_size, test_size = np.median(sizes, axis=0).tolist()
    return {"train": train_size, "test": test_size, "scores": scores}


@lru_cache(maxsize=2000)
def _captured_features(clip):
    """Return the features of a clip, which many draws use."""
    return clip_features.clip_features(clip)


def accuracy(classifier, train, test, seed):
    """Return the balanced accuracy on the test clips, whose labels were all trained on."""
    from sklearn.ensemble import RandomForestClassifier
    from sklearn.linear_model import LogisticRegression
    from sklearn.metrics import balanced_accuracy_score
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    if classifier == CLASSIFIERS[0]:
        model = make_pipeline(StandardScaler(), LogisticRegression(C=0.1, max_iter=300))
    else:
        model = RandomForestClassifier(60, random_state=seed)
    rows, labels = test
    is_known = np.isin(labels, train[1])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        predicted = model.fit(*train).predict(rows[is_known])
    return float(balanced_accuracy_score(labels[is_known], predicted))


def mean_estimate(values):
    """Return the mean over seeds as an estimate, with Student's interval."""
    from scipy.stats import t

    values = np.asarray(values, float)
    n = len(values)
    half = t.ppf(0.975, n - 1) * values.std(ddof=1) / math.sqrt(n) if n > 1 else math.nan
    mean = float(values.mean())
    interval = [mean - half, mean + half] if n > 1 else None
    return {"value": mean, "interval": interval, "n": n, "of": "seeds", "method": "Student"}


def differences(scores, scheme, reference=REFERENCE):
    """Return the mean difference of a scheme from a reference, paired by seed."""
    return mean_estimate(np.subtract(scores[scheme], scores[reference]))


def tables(results):
    """Balanced accuracies, and differences between schemes."""
    found = {
        _TASKS.get(task, task): shares for task, shares in next(iter(results.values())).items()
    }
    return {
        "accuracy": _accuracy_table(found),
        "differences": _difference_table(found),
        "pairs": _pair_table(found),
    }


_PAIRS = (
    (REFERENCE, "none"),
    ("mirror and noise", "none"),
    ("CutMix", "none"),
    ("grafts", "none"),
    ("grafts, same label", "none"),
    ("grafts, same label", "CutMix, same label"),
    ("grafts, same label", "mirror and noise"),
)

_TASKS = {"action, other performer": "action, other rest position"}
"""Titles of the page for stored tasks: that a rest position is a performer is an inference."""


def _cells(found):
    for task, shares in found.items():
        for share, own in shares.items():
            for classifier, scores in own["scores"].items():
                yield task, float(share), own, classifier, scores


def _accuracy_table(found):
    rows = [
        (
            task,
            f"{100 * share:.0f} % ({own['train']:.0f})",
            f"{own['test']:.0f}",
            classifier,
            *(format_estimate(mean_estimate(scores[name]), 3) for name in scores),
        )
        for task, share, own, classifier, scores in _cells(found)
    ]
    head = ("task", "share (training clips)", "test clips", "classifier", *SCHEMES)
    return Table(head, rows)


def _difference_table(found):
    names = [name for name in SCHEMES if name != REFERENCE]
    rows = [
        (
            task,
            f"{100 * share:.0f} %",
            classifier,
            *(format_estimate(differences(scores, name), 4) for name in names),
        )
        for task, share, _, classifier, scores in _cells(found)
    ]
    head = ("task", "share", "classifier", *names)
    return Table(head, rows)


def _pair_table(found):
    pairs = _PAIRS
    rows = [
        (
            task,
            f"{100 * share:.0f} %",
            classifier,
            *(format_estimate(differences(scores, *pair), 4, has_n=False) for pair in pairs),
        )
        for task, share, _, classifier, scores in _cells(found)
    ]
    head = ("task", "share", "classifier", *(f"{a} less {b}" for a, b in pairs))
    return Table(head, rows)
