"""Random walks on the transition graph: by duration, by number of frames, to beats (paper, 4.4)."""

from math import ceil, floor

import numpy as np
import numpy.typing as npt

from mograft._util.arrays import FloatArray, IntArray, as_floats
from mograft._util.validate import as_integer
from mograft.library.library import Library
from mograft.scenario.scenario import RepeatedRuns, Scenario
from mograft.scenario.transition_graph import Transitions, transitions

_MIN_RETURN = 3  # other segments between two visits to a segment, if there is a choice
_MAX_COMPARED_VISITS = 100  # of each segment, for repeated runs; determines the time of a step
_MAX_TABLE = 1 << 29  # probabilities, one per frame and segment: 2 GB, twice
MAX_DURATION_SECONDS = 86_400.0
"""Greatest duration of a walk: 24 hours."""
_MAX_BEAT_STRETCH = 0.15  # share of its length by which a segment may be stretched to meet a beat

Weights = npt.NDArray[np.float32]


def walk(
    library: Library,
    duration: float,
    seed: int = 0,
    *,
    graph: Transitions | None = None,
    repeat_penalty: float = 5.0,
) -> IntArray:
    """Draw a random sequence of base segments of a minimum duration.

    Parameters
    ----------
    library : Library
        The library of the segments.
    duration : float
        Minimum total duration in seconds, at most 86,400 (24 hours). It is exceeded by less than
        one segment.
    seed : int
        Random seed.
    graph : Transitions, optional
        The transition graph of the library, to save its computation. Default: `transitions`.
    repeat_penalty : float
        Penalty of repeated runs of segments, at least 0: a transition that makes a repeated run t
        seconds long is exp(repeat_penalty * t) times less likely.

    Returns
    -------
    ndarray of int
        Segments of the library, for `graft`.

    Raises
    ------
    ValueError
        If the duration is not above 0 or is above 24 hours, if the seed is not an integer of at
        least 0, if `repeat_penalty` is negative, or if the library has no transition graph; see
        `transitions`.

    Notes
    -----
    A transition of cost c is drawn with probability proportional to
    exp(-c / 5° - uses - repeat_penalty * run). `uses` is the number of earlier visits to its
    target; without this term, a walk would remain in segments in which the actor stands still.
    `run` is the duration in seconds of the longest repeated run of segments that the transition
    leads to, up to the next segment with several transitions. Between two visits to a segment there
    are at least three other segments, unless there is no other transition.

    Runs are compared with the latest 100 visits to each segment, so that the computing time is
    proportional to the duration.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> chosen = walk(library, 10.0, seed=3)
    >>> bool(library.segments.lengths[chosen].sum() >= 300)
    True
    """
    check_duration(duration)
    path = _WalkPath(library, seed, graph, repeat_penalty)
    frames = path.visit(int(path.rng.integers(len(path.lengths))))
    while frames < duration * library.rate:
        frames += path.advance(*path.edges())
    return path.segments


def check_duration(duration: float) -> None:
    """Raise ValueError unless a duration is above 0 and at most `MAX_DURATION_SECONDS`."""
    is_number = not isinstance(duration, bool)
    if not is_number or not 0.0 < as_floats("duration", duration, ()) <= MAX_DURATION_SECONDS:
        raise ValueError(
            f"`duration` must be above 0 and at most {MAX_DURATION_SECONDS:g} s, got {duration!r}"
        )


def fill(
    library: Library,
    frames: int,
    seed: int = 0,
    *,
    graph: Transitions | None = None,
    repeat_penalty: float = 5.0,
) -> IntArray:
    """Draw a random sequence of base segments with an exact number of frames.

    Parameters
    ----------
    library : Library
        The library of the segments.
    frames : int
        Number of frames of the motion, at the library's rate.
    seed : int
        Random seed.
    graph : Transitions, optional
        The transition graph of the library, to save its computation. Default: `transitions`.
    repeat_penalty : float
        Penalty of repeated runs of segments, as in `walk`.

    Returns
    -------
    ndarray of int
        Segments of the library, for `graft`. None is stretched.

    Raises
    ------
    ValueError
        If no segment sequence has `frames` frames; the message gives the nearest possible number.
        If `frames` is not an integer of at least 2 or is too large, if the seed is not an integer
        of at least 0, or if the library has no transition graph; see `transitions`.

    Notes
    -----
    Segments are drawn as in `walk`, on the condition that a segment ends with the last frame. The
    probability of this is computed backwards for every segment and number of remaining frames.
    Each transition is then weighted by the probability at its target.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> int(library.segments.lengths[fill(library, 301)].sum())
    300
    """
    total = as_integer("frames", frames, 2) - 1
    path = _WalkPath(library, seed, graph, repeat_penalty)
    _check_table_size(total, path.graph)
    ends = _end_probabilities(path, total)
    if not ends[total].any():
        possible = np.flatnonzero(ends.any(axis=1))
        nearest = int(possible[np.abs(possible - total).argmin()]) + 1
        raise ValueError(
            f"no segment sequence has {frames} frames; the nearest number is {nearest}"
        )
    left = total - path.start(ends[total])
    while left > 0:
        targets, probabilities = path.edges()
        left -= path.advance(targets, probabilities * ends[left, targets])
    return path.segments


def _end_probabilities(path: "_WalkPath", total: int) -> Weights:
    """Return the probabilities that a segment ends with the last frame of a walk.

    Entry (i, j) is for a walk of i more frame intervals that continues with the segment of node j.
    The rows after row `total` are 0 if a walk can have `total` intervals; otherwise they show which
    greater numbers are possible.
    """
    lengths = path.lengths
    n_rows = total + int(lengths.max()) + 1
    ends = np.zeros((n_rows, len(lengths)), np.float32)
    after = np.zeros_like(ends)
    after[0] = 1.0
    for left in range(1, n_rows):
        fits = lengths <= left
        ends[left, fits] = after[left - lengths[fits], fits]
        after[left] = path.expect(ends[left])
        if left == total and ends[left].any():
            break
    return ends


def to_beats(
    library: Library,
    beats: npt.ArrayLike,
    seed: int = 0,
    *,
    graph: Transitions | None = None,
    repeat_penalty: float = 5.0,
) -> Scenario:
    """Draw a random sequence of base segments in which the body comes to rest on every beat.

    Parameters
    ----------
    library : Library
        The library of the segments.
    beats : array_like, shape (n_beats,)
        Times of the beats in seconds, ascending. The motion starts with the first beat and ends
        with the last. ``np.arange(0.0, 60.0, 0.5)`` is a minute at 120 beats per minute.
    seed : int
        Random seed.
    graph : Transitions, optional
        The transition graph of the library, to save its computation. Default: `transitions`.
    repeat_penalty : float
        Penalty of repeated runs of segments, as in `walk`.

    Returns
    -------
    Scenario
        Segments with lengths. All segments between two beats are stretched by the same factor: by
        at most 15 %, apart from rounding to frames.

    Raises
    ------
    ValueError
        If no segment sequence can be stretched to the beats; the message gives the time of the
        beat from which there is none. If there are fewer than two beats, they do not ascend, are
        less than a frame apart or span more than 24 hours, if the seed or the penalty is negative,
        or if the library has no transition graph.

    Notes
    -----
    At each beat, a segment ends at a minimum of kinetic energy, because dancers come to rest on
    beats (Kim, Park and Shin, Rhythmic-motion synthesis based on motion-beat analysis, SIGGRAPH
    2003). Segments are drawn as in `fill`, on the condition that this holds for all beats.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> to_beats(library, np.arange(0.0, 8.0, 0.6)).lengths.sum()
    np.int64(234)
    """
    times = as_floats("beats", beats, ("n_beats",))
    if len(times) < 2:
        raise ValueError(f"`beats` must contain at least two times in seconds, got {len(times)}")
    if (steps := np.diff(times)).min() <= 0:
        first = int(np.argmax(steps <= 0))
        raise ValueError(f"`beats` must ascend, got {times[first + 1]:g} after {times[first]:g}")
    if not times[-1] - times[0] <= MAX_DURATION_SECONDS:
        span = f"{times[0]:g} to {times[-1]:g}"
        raise ValueError(f"`beats` must span at most {MAX_DURATION_SECONDS:g} s, got {span}")
    path = _WalkPath(library, seed, graph, repeat_penalty)
    _check_table_size(round(float(times[-1] - times[0]) * library.rate), path.graph)
    spans = np.diff(np.round((times - times[0]) * library.rate).astype(np.int64))
    if not spans.all():
        first = int(np.argmin(spans))
        near = f"{times[first]:g} and {times[first + 1]:g}"
        raise ValueError(f"`beats` must be at least a frame apart, got {near}")
    meets, continues = _plan_beats(path, spans, times)
    length = path.start(meets[0])
    new_lengths: list[int] = []
    for beat, span in enumerate(spans.tolist()):
        shortest, _ = _stretchable_lengths(span)
        captured = [length]
        while True:
            done = sum(captured)
            targets, probabilities = path.edges()
            ending = probabilities * meets[beat + 1, targets]
            continuing = probabilities * continues[beat][done, targets]
            ending *= path.graph.is_at_rest[path.nodes[-1]] and done >= shortest
            if path.rng.random() * (ending.sum() + continuing.sum()) < ending.sum():
                break
            captured.append(path.advance(targets, continuing))
        bounds = np.round(np.cumsum([0, *captured]) * (span / done)).astype(np.int64)
        new_lengths += np.diff(bounds).tolist()
        if beat < len(spans) - 1:
            length = path.advance(targets, ending)
    return Scenario(path.segments, np.array(new_lengths))


def _plan_beats(
    path: "_WalkPath", spans: IntArray, times: FloatArray
) -> tuple[Weights, list[Weights]]:
    """Return the probabilities that a walk meets all later beats, computed from the last beat back.

    The first result, shape (n_beats, n_segments), has the probability if the segment starts at the
    beat; each row is scaled to a maximum of 1. The second has an array for every beat but the last,
    shape (n_frames, n_segments): the probability if the segment starts that many frames after the
    beat.
    """
    lengths = path.lengths
    meets = np.ones((len(spans) + 1, len(lengths)), np.float32)
    continues: list[Weights] = []
    for beat in range(len(spans) - 1, -1, -1):
        shortest, longest = _stretchable_lengths(int(spans[beat]))
        at_rest = np.where(path.graph.is_at_rest, path.expect(meets[beat + 1]), 0.0)
        at_rest = at_rest.astype(np.float32)
        starting = np.zeros((longest + 1, len(lengths)), np.float32)
        after = np.zeros_like(starting)
        for done in range(longest - 1, -1, -1):
            stop = done + lengths
            fits = stop <= longest
            starting[done, fits] = after[stop[fits], fits]
            ends = (stop >= shortest) & fits
            starting[done, ends] += at_rest[ends]
            after[done] = path.expect(starting[done])
        if not starting[0].any():
            raise ValueError(
                f"no segment sequence comes to rest on all beats from that at {times[beat]:.4g} s "
                f"if stretched by at most {_MAX_BEAT_STRETCH:.0%}: change the tempo or add clips"
            )
        # Only ratios matter: the probability of many beats would underflow.
        meets[beat] = starting[0] / starting[0].max()
        continues.append(starting)
    continues.reverse()
    return meets, continues


class _WalkPath:
    """A random walk on a transition graph, to which one node at a time is appended."""

    def __init__(
        self, library: Library, seed: int, graph: Transitions | None, repeat_penalty: float
    ) -> None:
        self.rng = np.random.default_rng(as_integer("seed", seed))
        penalty = float(as_floats("repeat_penalty", repeat_penalty, ()))
        if penalty < 0:
            raise ValueError(f"`repeat_penalty` must not be negative, got {repeat_penalty}")
        self.graph = transitions(library) if graph is None else graph
        self.lengths = library.segments.lengths[self.graph.segments]
        self.nodes: list[int] = []
        self._frame_penalty = penalty / library.rate
        self._probabilities = self.graph.probabilities()
        self._uses = np.zeros(len(self.lengths), np.int64)
        self._runs = RepeatedRuns(_MAX_COMPARED_VISITS)
        self._only_next = np.where(
            np.diff(self.graph.first_edge) == 1, self.graph.targets[self.graph.first_edge[:-1]], -1
        )
        self._run_lengths = _lengths_to_choice(self._only_next, self.lengths)

    @property
    def segments(self) -> IntArray:
        """The segments of the walk."""
        return self.graph.segments[self.nodes]

    def expect(self, values: Weights) -> FloatArray:
        """Return, for each node, the expected value of `values` at the next node of a walk.

        `values` has one value for each node.
        """
        products = self._probabilities * values[self.graph.targets]
        return np.add.reduceat(products, self.graph.first_edge[:-1])

    def edges(self) -> tuple[IntArray, FloatArray]:
        """Return the target and the probability of each edge from the last node of the walk."""
        edges = self.graph.edges_from(self.nodes[-1])
        return self.graph.targets[edges], self._probabilities[edges]

    def visit(self, node: int) -> int:
        """Append a node to the walk; return the length of its segment in frames."""
        length = int(self.lengths[node])
        self.nodes.append(node)
        self._uses[node] += 1
        self._runs.append(node, length)
        return length

    def start(self, weights: Weights) -> int:
        """Draw the first node by `weights` and append it; return the length of its segment."""
        return self.visit(int(self.rng.choice(len(weights), p=_normalize(weights))))

    def advance(self, targets: IntArray, weights: FloatArray) -> int:
        """Draw the next node from `targets` and append it; return the length of its segment.

        One of the latest three nodes is drawn only if all other targets have weight 0.
        """
        is_possible = weights > 0
        is_new = is_possible & ~np.isin(targets, self.nodes[-_MIN_RETURN:])
        rows = np.flatnonzero(is_new if is_new.any() else is_possible)
        if len(rows) == 1:
            return self.visit(int(targets[rows[0]]))
        targets = targets[rows]
        penalties = self._uses[targets] + self._frame_penalty * self._repeated_lengths(targets)
        shares = _normalize(weights[rows] * np.exp(penalties.min() - penalties))
        return self.visit(int(self.rng.choice(targets, p=shares)))

    def _repeated_lengths(self, targets: IntArray) -> FloatArray:
        """Return, for each target, the length in frames of the repeated run that it leads to."""
        before, lengths = self._runs.lengths_before(), []
        for target in targets.tolist():
            node = target
            while not self._uses[node] and self._only_next[node] >= 0:
                node = int(self._only_next[node])
            is_repeated = self._uses[node] > 0
            lengths.append(before.get(target, 0) + is_repeated * self._run_lengths[node])
        return np.array(lengths, np.float64)


def _lengths_to_choice(only_next: IntArray, lengths: IntArray) -> IntArray:
    """Return the total length of the segments from each node to the next node with a choice.

    Both nodes are included. A node has a choice if it has several transitions. `only_next` is then
    -1, otherwise it is the target of the only transition.
    """
    has_choice = only_next < 0
    node = np.where(has_choice, np.arange(len(lengths)), only_next)
    following = np.where(has_choice, 0, lengths[node])
    for _ in range(len(lengths).bit_length()):
        following = following + following[node]
        node = node[node]
    return lengths + following


def _check_table_size(n_intervals: int, graph: Transitions) -> None:
    """Raise ValueError if the probabilities by frame and segment would not fit in memory."""
    n = len(graph.segments)
    limit = _MAX_TABLE // n
    if n_intervals > limit:
        raise ValueError(
            f"a walk on {n} segments must have at most {limit + 1} frames, got "
            f"{n_intervals + 1}: use fewer frames or fewer clips"
        )


def _normalize(weights: npt.NDArray[np.floating]) -> FloatArray:
    exact = weights.astype(np.float64)
    return exact / exact.sum()


def _stretchable_lengths(span: int) -> tuple[int, int]:
    """Return the least and greatest total length that can be stretched to `span` frames."""
    return ceil(span / (1.0 + _MAX_BEAT_STRETCH)), floor(span / (1.0 - _MAX_BEAT_STRETCH))
