"""Grafts as additional training clips of a classifier that learns from few clips."""

import math
import warnings
from functools import lru_cache

import numpy as np

import mograft as mg
from benches.baselines import augmentation, body_mixing
from benches.baselines.augmentation import SCHEMES, LabelledClips
from benches.evidence.section import Section, Table, format_estimate, verdict
from benches.measures import clip_features

NAME = "learning"
SOURCES = ("actions and styles",)
HELPERS = (augmentation, body_mixing, clip_features)
LEFT_OUT = (
    "Locomotion and gestures are of the same data set. The experiment was not computed for the "
    "others, most of which have no labels."
)
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


def render(results):
    """The section."""
    found = {
        _TASKS.get(task, task): shares for task, shares in next(iter(results.values())).items()
    }
    return Section(
        anchor=NAME,
        title="Do grafts help to learn from few clips?",
        question="A small classifier learns from few labelled clips. Is it better on unseen clips "
        "if copies of the training clips are added, and are grafts better copies than simpler "
        "ones?",
        data="Bandai-Namco set 2, every third clip. Labels are in the file names. The files do "
        "not name performers, but the hips have three rest positions, and the data set has three "
        "performers; every style has one rest position. A rest position is therefore presumably a "
        "performer. "
        "Actions (10) are therefore learned from "
        "two rest positions and tested on the third, in turn; all styles of the test are unseen. "
        f"Each share of the training clips has at least {MIN_TRAIN} clips, so that 5 % of the "
        "styles "
        "is more than 5 %. Styles cannot be tested on another rest position: three styles of one "
        "rest position are "
        "learned from some actions and tested on others "
        f"({', '.join(TEST_ACTIONS)}).",
        measure="Balanced accuracy, mean over random draws of the training clips, and the "
        "difference from `repeated`, paired by draw, with Student's interval; n is the number of "
        f"draws ({N_SEEDS}). Every scheme adds two copies of every clip. Mirror and noise: the "
        "mirror image, with left and right exchanged in the label, and noise of 2 degrees. CutMix: "
        "upper bodies of random clips. Grafts: default configuration. Donors are training clips "
        "only; `same label` takes them from clips of the same label. Features: quantiles of "
        "positions and speeds over time. The settings of the classifiers were not tuned.",
        null="`repeated` adds the clips themselves: the same number of clips, and no new motion. "
        "`none` "
        "adds nothing. `repeated` itself can harm or help, so that the readings have both. "
        "Chance is 0.10 for actions and 0.33 for styles.",
        tables=(
            _reading_table(found),
            _accuracy_table(found),
            _difference_table(found),
            _pair_table(found),
        ),
        conclusions=_conclusions(found),
        limits=(
            "That other models, features or tasks gain as much or as little.",
            "That mirror images help as much elsewhere: the actions on which styles are tested "
            "include mirror images of trained ones.",
            "That the result holds for further performers: the intervals cover the choice of the "
            "training clips, and there are three rest positions.",
            "That a scheme is equal to another where the comparison is undecided: there are "
            f"{N_SEEDS} draws.",
        ),
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
    return Table(head, tuple(rows), "Balanced accuracy.")


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
    return Table(head, tuple(rows), f"Balanced accuracy less that of `{REFERENCE}`.")


def _pair_table(found):
    pairs = [own for own in _READINGS if own[1] != REFERENCE]
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
    return Table(head, tuple(rows), f"Other differences of balanced accuracy, n = {N_SEEDS}.")


_READINGS = (
    (REFERENCE, "none"),
    ("mirror and noise", "none"),
    ("CutMix", "none"),
    ("grafts", "none"),
    ("grafts, same label", "none"),
    ("mirror and noise", REFERENCE),
    ("CutMix", REFERENCE),
    ("CutMix, same label", REFERENCE),
    ("grafts", REFERENCE),
    ("grafts, same label", REFERENCE),
    ("grafts, same label", "CutMix, same label"),
    ("grafts, same label", "mirror and noise"),
)


def _count(found, task, first, second):
    """Return in how many comparisons of a task a scheme is better or worse than another."""
    verdicts = [
        verdict(differences(scores, first, second))
        for own, *_, scores in _cells(found)
        if own == task
    ]
    counts = ((verdicts.count(own), word) for own, word in _WORDS.items())
    return ", ".join(f"{n} {word}" for n, word in counts if n)


_WORDS = {"above": "better", "below": "worse", "undecided": "undecided"}


def _reading_table(found):
    rows = [
        (first, second, *(_count(found, task, first, second) for task in found))
        for first, second in _READINGS
    ]
    return Table(
        ("added clips", "compared with", *found),
        tuple(rows),
        "In how many comparisons (shares and classifiers) the interval of the difference lies "
        "above or below 0.",
    )


def _conclusions(found):
    lines = []
    for task in found:
        cells = [
            f"against {title}: {_count(found, task, first, second)}"
            for title, first, second in (
                ("no added clips (`none`)", "grafts, same label", "none"),
                ("copies without new motion (`repeated`)", "grafts, same label", REFERENCE),
                ("mirror and noise", "grafts, same label", "mirror and noise"),
            )
        ]
        lines += [
            f"Task {task}, grafts of the same label {'; '.join(cells)}.",
            f"Task {task}, grafts of all labels against `none`: "
            f"{_count(found, task, 'grafts', 'none')}; `{REFERENCE}` against `none`: "
            f"{_count(found, task, REFERENCE, 'none')}. Where `{REFERENCE}` is worse than `none`, "
            f"a gain over `{REFERENCE}` is in part its harm.",
        ]
    return tuple(lines)
