"""The support vector machine that classifies pairs of parts, and its cross-validation."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from mograft._util.arrays import FloatArray, IntArray
from mograft.evaluation._extra import import_extra

N_INNER_FOLDS = 3  # folds of the cross-validation that selects the parameters
PARAMETER_GRID: Mapping[str, tuple[float, ...]] = {
    "C": (1.0, 10.0),
    "gamma": (0.003, 0.01, 0.03),
}
"""Parameters of the support vector machine that the cross-validation compares."""
_FALLBACK_PARAMETERS = {"C": 1.0, "gamma": 0.03}
_N_COMPONENTS = 20


@dataclass(frozen=True, eq=False)
class PairFeatures:
    """Principal components of the base part and the grafted part of every segment.

    Each array has shape (n_segments, n_components); a part is the motion of one joint group.
    """

    base: FloatArray
    grafted: FloatArray

    @classmethod
    def reduce(cls, base: FloatArray, grafted: FloatArray, train: IntArray) -> Self:
        """Return the principal components of the features of both parts.

        `base` and `grafted` have shape (n_segments, n_features). The components are fitted to the
        segments `train` and computed for all segments.
        """
        return cls(_reduce(base, train), _reduce(grafted, train))

    def join(self, pairs: IntArray) -> FloatArray:
        """Return the features of pairs (base segment, donor), shape (n_pairs, 2 * n_components).

        They are the components of the base part of the base segment, then those of the grafted part
        of the donor. `pairs` has shape (n_pairs, 2).
        """
        return np.concatenate([self.base[pairs[:, 0]], self.grafted[pairs[:, 1]]], axis=1)


def _reduce(features: FloatArray, train: IntArray) -> FloatArray:
    n_components = min(_N_COMPONENTS, features.shape[1], len(train) - 1)
    pipeline = import_extra("sklearn.pipeline").make_pipeline(
        import_extra("sklearn.preprocessing").StandardScaler(),
        import_extra("sklearn.decomposition").PCA(n_components, svd_solver="full"),
    )
    components: FloatArray = pipeline.fit(features[train]).transform(features)
    return components


def assign_folds(groups: IntArray, n_folds: int, seed: int | tuple[int, ...]) -> IntArray:
    """Assign groups of segments at random to folds of similar size; return each segment's fold.

    `groups` has the group of each segment; all segments of a group are in one fold. The number of
    folds is `n_folds`, or the number of groups if that is smaller.
    """
    sizes = np.bincount(groups)
    shuffled = np.random.default_rng(seed).permutation(len(sizes))
    descending = shuffled[np.argsort(-sizes[shuffled], kind="stable")]
    load = np.zeros(min(n_folds, int((sizes > 0).sum())))
    folds = np.zeros(len(sizes), np.int64)
    for group in descending.tolist():
        folds[group] = int(load.argmin())
        load[folds[group]] += sizes[group]
    return folds[groups]


def build_classifier(parameters: Mapping[str, float]) -> Any:  # noqa: ANN401 - scikit-learn's
    """Return a scikit-learn pipeline of a scaler and an untrained support vector machine.

    `parameters` are arguments of ``sklearn.svm.SVC``, such as C and gamma.
    """
    svm = import_extra("sklearn.svm").SVC(kernel="rbf", class_weight="balanced", **parameters)
    scaler = import_extra("sklearn.preprocessing").StandardScaler()
    return import_extra("sklearn.pipeline").make_pipeline(scaler, svm)


def select_parameters(features: FloatArray, labels: IntArray, folds: IntArray) -> dict[str, float]:
    """Select the parameters of `PARAMETER_GRID` with the best cross-validated ROC AUC.

    Labels are 0 or 1. Folds with a single class are used only for training. With fewer than two
    folds that have both classes, the result is C = 1 and gamma = 0.03.
    """
    testable = [fold for fold in np.unique(folds) if len(np.unique(labels[folds == fold])) > 1]
    if len(testable) < 2:
        return dict(_FALLBACK_PARAMETERS)
    selection = import_extra("sklearn.model_selection")
    search = selection.GridSearchCV(
        build_classifier({}),
        {f"svc__{name}": values for name, values in PARAMETER_GRID.items()},
        scoring="roc_auc",
        # A fold of -1 is never tested on.
        cv=selection.PredefinedSplit(np.where(np.isin(folds, testable), folds, -1)),
        refit=False,
    ).fit(features, labels)
    return {name: float(search.best_params_[f"svc__{name}"]) for name in PARAMETER_GRID}
