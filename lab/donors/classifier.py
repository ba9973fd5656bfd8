"""The support vector machine that classifies pairs of parts, and its cross-validation."""

from dataclasses import dataclass

import numpy as np
from sklearn.decomposition import PCA
from sklearn.model_selection import GridSearchCV, PredefinedSplit
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

N_INNER_FOLDS = 3  # folds of the cross-validation that selects the parameters
PARAMETER_GRID = {"C": (1.0, 10.0), "gamma": (0.003, 0.01, 0.03)}
"""Parameters of the support vector machine that the cross-validation compares."""
_FALLBACK_PARAMETERS = {"C": 1.0, "gamma": 0.03}
_N_COMPONENTS = 20


@dataclass(frozen=True, eq=False)
class PairFeatures:
    """Principal components of the base part and the grafted part of every segment.

    Each array has shape (n_segments, n_components); a part is the motion of one joint group.
    """

    base: np.ndarray
    grafted: np.ndarray

    @classmethod
    def reduce(cls, base, grafted, train):
        """Return the principal components of the features of both parts.

        `base` and `grafted` have shape (n_segments, n_features). The components are fitted to the
        segments `train` and computed for all segments.
        """
        return cls(_reduce(base, train), _reduce(grafted, train))

    def join(self, pairs):
        """Return the features of pairs (base segment, donor), shape (n_pairs, 2 * n_components).

        They are the components of the base part of the base segment, then those of the grafted part
        of the donor. `pairs` has shape (n_pairs, 2).
        """
        return np.concatenate([self.base[pairs[:, 0]], self.grafted[pairs[:, 1]]], axis=1)


def _reduce(features, train):
    n_components = min(_N_COMPONENTS, features.shape[1], len(train) - 1)
    pipeline = make_pipeline(StandardScaler(), PCA(n_components, svd_solver="full"))
    return pipeline.fit(features[train]).transform(features)


def build_classifier(parameters):
    """Return a scikit-learn pipeline of a scaler and an untrained support vector machine.

    `parameters` are arguments of ``sklearn.svm.SVC``, such as C and gamma.
    """
    svm = SVC(kernel="rbf", class_weight="balanced", **parameters)
    scaler = StandardScaler()
    return make_pipeline(scaler, svm)


def select_parameters(features, labels, folds):
    """Select the parameters of `PARAMETER_GRID` with the best cross-validated ROC AUC.

    Labels are 0 or 1. Folds with a single class are used only for training. With fewer than two
    folds that have both classes, the result is C = 1 and gamma = 0.03.
    """
    testable = [fold for fold in np.unique(folds) if len(np.unique(labels[folds == fold])) > 1]
    if len(testable) < 2:
        return dict(_FALLBACK_PARAMETERS)
    search = GridSearchCV(
        build_classifier({}),
        {f"svc__{name}": values for name, values in PARAMETER_GRID.items()},
        scoring="roc_auc",
        # A fold of -1 is never tested on.
        cv=PredefinedSplit(np.where(np.isin(folds, testable), folds, -1)),
        refit=False,
    ).fit(features, labels)
    return {name: float(search.best_params_[f"svc__{name}"]) for name in PARAMETER_GRID}
