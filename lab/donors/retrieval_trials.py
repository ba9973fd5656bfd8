"""Held-out base parts, the donors that rules select for them, and the errors of these donors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from lab.donors import held_out
from lab.donors.methods import contact_patterns
from lab.donors.part_features import N_INSTANTS, part_features
from mograft import InsufficientDataError
from mograft.body.anatomy import feature_joints
from mograft.body.contacts import find_legs
from mograft.evaluation.detectability import assign_folds
from mograft.search.costs import length_fits

RULES = ("random", "contact pattern", "linear regression", "nearest neighbours", "ball", "analogy")
BEST = "best possible"
BALL_RADIUS = 0.65  # cluster diameter thresholds; balls then have as many members as clusters
_N_FOLDS = 5
_RIDGE = 1.0  # penalty of the linear regression, for standardised features
_INSTANT_STEP = 2  # every second of ten instants is compared
_CHUNK = 64  # rows of the matrix of part distances that are computed at once


@dataclass(frozen=True, eq=False)
class PartErrors:
    """Distances between the grafted parts of all pairs of segments, (n_segments, n_segments)."""

    angle: np.ndarray  # mean joint angle in radians
    distance: np.ndarray  # mean distance of bone ends in skeleton heights
    mean_angle: np.ndarray  # mean over the other segments without recording faults, (n_segments,)
    mean_distance: np.ndarray

    @classmethod
    def of(cls, library, group):
        """Compute the distances of the parts of one group at five instants of each segment."""
        n = len(library.segments)
        joints = feature_joints(library.skeleton, library.joints(group))
        sampled = library.samples.select(np.arange(n)).rotations
        quats = np.asarray(sampled[:, ::_INSTANT_STEP, joints], np.float32)
        features = part_features(library, group)
        positions = features[:, : features.shape[1] // 2].reshape(n, N_INSTANTS, -1, 3)
        ends = positions[:, ::_INSTANT_STEP].astype(np.float32)
        angle = _pairwise_means(quats.reshape(n, -1, 4), _rotation_angles)
        distance = _pairwise_means(ends.reshape(n, -1, 3), _point_distances)
        means = []
        for errors in (angle, distance):
            sums = errors[library.is_donor].sum(axis=0, dtype=np.float64)
            means.append(sums.astype(np.float64) / max(int(library.is_donor.sum()) - 1, 1))
        return cls(angle, distance, means[0], means[1])


def _pairwise_means(rows, compare):
    """Return the mean of `compare` over the axis 1 of `rows`, for all pairs of rows, (n, n)."""
    columns = np.ascontiguousarray(rows.transpose(1, 2, 0))
    means = np.empty((len(rows), len(rows)), np.float32)
    for start in range(0, len(rows), _CHUNK):
        chunk = np.ascontiguousarray(rows[start : start + _CHUNK].transpose(1, 0, 2))
        means[start : start + _CHUNK] = compare(chunk, columns).mean(axis=0)
    return means


def _rotation_angles(chunk, columns):
    return 2.0 * np.arccos(np.minimum(np.abs(chunk @ columns), 1.0))


def _point_distances(chunk, columns):
    squares = (chunk**2).sum(axis=2)[:, :, None] + (columns**2).sum(axis=1)[:, None, :]
    return np.sqrt(np.maximum(squares - 2.0 * (chunk @ columns), 0.0))


@dataclass(frozen=True, eq=False)
class Regression:
    """A linear regression from the base part to the grafted part, for the queries of one fold."""

    predictors: np.ndarray  # of all segments, (n_segments, n_predictors); the first column is 1
    parts: np.ndarray  # embedded grafted parts of all segments, (n_segments, n_components)
    fitted: np.ndarray  # segments of the other folds, on which the regression is fitted

    def fit(self, shuffled):
        """Return the coefficients of a ridge regression, (n_predictors, n_components).

        `shuffled` has, for each segment, the segment whose part it gets.
        """
        x, y = self.predictors[self.fitted], self.parts[shuffled[self.fitted]]
        penalty = _RIDGE * np.eye(x.shape[1])
        penalty[0, 0] = 0.0
        coefficients = np.linalg.solve(x.T @ x + penalty, x.T @ y)
        return np.asarray(coefficients, np.float64)


@dataclass(frozen=True, eq=False)
class Query:
    """A held-out segment, its allowed donors, and the orders in which rules prefer them."""

    segment: int
    allowed: np.ndarray  # allowed donors
    n_donors: int  # number of donors of "analogy"
    orders: Mapping[str, np.ndarray]  # by rule, one number for each allowed donor; low is first
    is_in_ball: np.ndarray  # for each allowed donor
    regression: Regression


def make_queries(library, group, groups, seed):
    """Return the held-out segments of all folds that have an allowed donor."""
    folds = assign_folds(groups, _N_FOLDS, seed)
    contacts = None
    if find_legs(library.skeleton):
        contacts = contact_patterns(library).reshape(len(library.segments), -1)
    queries = []
    for fold in range(int(folds.max()) + 1):
        known = held_out.fit_on(library, (folds != fold) & library.is_donor)
        held = np.flatnonzero((folds == fold) & library.is_donor)
        queries += _queries_of_fold(known, group, held, contacts)
    return queries


def _queries_of_fold(library, group, held, contacts):
    base = library.groups.base
    embedding, parts = library.embedding[base], library.embedding[group]
    if embedding is None or parts is None:
        raise InsufficientDataError("retrieval needs segments that move differently in each group")
    donors = np.flatnonzero(library.is_donor)
    points, lengths, labels = embedding.points, library.segments.lengths, library.labels[base]
    predictors = np.insert(points / points[donors].std(axis=0), 0, 1.0, axis=1)
    regression = Regression(predictors, parts.points, donors)
    queries = []
    for segment in held.tolist():
        fits = length_fits(lengths[[segment]], lengths[donors], library.rate, library.config)
        allowed = donors[fits]
        if not len(allowed):
            continue
        distances = np.linalg.norm(points[allowed] - points[segment], axis=1)
        is_similar = labels[allowed] == labels[segment]
        orders = {"random": np.zeros(len(allowed))}
        if contacts is not None:
            differences = (contacts[allowed] != contacts[segment]).sum(axis=1)
            orders["contact pattern"] = differences.astype(np.float64)
        orders |= {"nearest neighbours": distances, "analogy": np.where(is_similar, 0.0, 1.0)}
        is_in_ball = distances <= BALL_RADIUS * library.sigma[base]
        n_donors = int(is_similar.sum())
        queries.append(Query(segment, allowed, n_donors, orders, is_in_ball, regression))
    return queries


def first_weights(order, n):
    """Return the weights that average over the `n` elements with the lowest values of `order`.

    The weight of an element is the probability that it is among these `n`, divided by `n`: elements
    that are tied at the last place are drawn at random. The weights sum to 1, or to 0 if `n` is 0.

    >>> first_weights(np.array([0.0, 1.0, 1.0]), 2)
    array([0.5 , 0.25, 0.25])
    """
    if n == 0:
        return np.zeros(len(order))
    last = np.partition(order, n - 1)[n - 1]
    is_before, is_tied = order < last, order == last
    return (is_before + is_tied * (n - is_before.sum()) / is_tied.sum()) / n


def middle_ranks(order):
    """Return the rank of each element of `order`, from 0 to 1; equal elements have the same rank.

    >>> middle_ranks(np.array([3.0, 1.0, 1.0, 5.0]))
    array([0.625, 0.25 , 0.25 , 0.875])
    """
    ascending = np.sort(order)
    below, not_above = (np.searchsorted(ascending, order, side) for side in ("left", "right"))
    return (below + not_above) / (2 * len(order))


@dataclass(frozen=True, eq=False)
class Trials:
    """All pairs of a held-out segment and an allowed donor, with the choice of each rule.

    The arrays without another shape have one element for each pair, in the order of the queries.
    """

    queries: Sequence[Query]
    segment: np.ndarray  # held-out segment of each query
    starts: np.ndarray  # first pair of each query
    query: np.ndarray  # position of the query
    donor: np.ndarray
    weights: Mapping[str, np.ndarray]  # by rule; those of a query sum to 1
    ranks: Mapping[str, np.ndarray]  # by rule, the rank in its order

    @classmethod
    def of(cls, queries):
        """Compute the weights and ranks of the rules that do not depend on the grafted parts."""
        counts = np.array([len(query.allowed) for query in queries])
        weights = {}
        ranks = {}
        for rule in queries[0].orders:
            weights[rule] = np.concatenate(
                [first_weights(query.orders[rule], query.n_donors) for query in queries]
            )
            ranks[rule] = np.concatenate([middle_ranks(query.orders[rule]) for query in queries])
        outside = [np.where(query.is_in_ball, 0.0, 1.0) for query in queries]
        weights["ball"] = np.concatenate(
            [first_weights(order, int((order == 0.0).sum())) for order in outside]
        )
        ranks["ball"] = np.concatenate([middle_ranks(order) for order in outside])
        return cls(
            queries=queries,
            segment=np.array([query.segment for query in queries]),
            starts=np.cumsum(counts) - counts,
            query=np.repeat(np.arange(len(queries)), counts),
            donor=np.concatenate([query.allowed for query in queries]),
            weights=weights,
            ranks=ranks,
        )

    def n_donors(self, rule):
        """Return the number of donors that a rule selects for each query."""
        if rule == "ball":
            return np.array([float(query.is_in_ball.sum()) for query in self.queries])
        return np.array([float(query.n_donors) for query in self.queries])

    def measure(self, errors, shuffled, *, has_best=False):
        """Return both errors, both gains and the rank, (n_queries, 5), of each rule.

        `shuffled` has, for each segment, the segment whose part it gets: itself, or for a null a
        random one. `has_best` adds the rule `BEST`. Rows are NaN if the rule has no donor.
        """
        rows, columns = shuffled[self.segment[self.query]], shuffled[self.donor]
        angle, distance = errors.angle[rows, columns], errors.distance[rows, columns]
        weights, ranks = dict(self.weights), dict(self.ranks)
        orders = {"linear regression": self._regression_orders(shuffled)}
        if has_best:
            orders[BEST] = np.split(distance.astype(np.float64), self.starts[1:])
        for rule, several in orders.items():
            weights[rule] = np.concatenate(
                [
                    first_weights(order, query.n_donors)
                    for order, query in zip(several, self.queries, strict=True)
                ]
            )
            ranks[rule] = np.concatenate([middle_ranks(order) for order in several])
        gains = (errors.mean_angle[columns] - angle, errors.mean_distance[columns] - distance)
        is_nearest = distance == np.minimum.reduceat(distance, self.starts)[self.query]
        found = {}
        for rule in (*RULES, BEST):
            if rule not in weights:
                continue
            values = [self._sum(weights[rule] * own) for own in (angle, distance, *gains)]
            rank = self._sum(is_nearest * ranks[rule]) / self._sum(is_nearest)
            table = np.stack([*values, rank], axis=1)
            table[self._sum(weights[rule]) == 0] = np.nan
            found[rule] = table
        return found

    def _sum(self, values):
        """Return the sum of one value for each pair over the pairs of each query."""
        sums = np.bincount(self.query, values, minlength=len(self.queries))
        return sums.astype(np.float64)

    def _regression_orders(self, shuffled):
        """Return, for each query, the distances of the donors' parts from the predicted part."""
        coefficients = {}
        orders = []
        for query in self.queries:
            regression = query.regression
            if id(regression) not in coefficients:
                coefficients[id(regression)] = regression.fit(shuffled)
            predicted = regression.predictors[query.segment] @ coefficients[id(regression)]
            parts = regression.parts[shuffled[query.allowed]]
            orders.append(np.linalg.norm(parts - predicted, axis=1))
        return orders
