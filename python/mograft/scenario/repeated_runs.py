"""Repetition in a scenario: runs of segments that occur twice."""

from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass

from mograft._util.arrays import IntArray, as_indices
from mograft.library.library import Library
from mograft.scenario.scenario import Scenario


@dataclass(frozen=True)
class Repetition:
    """How much of a scenario is repeated; see `repetition`.

    Attributes
    ----------
    longest_repeat : float
        Duration in seconds of the longest run of segments that occurs twice without overlap; 0 if
        all segments are different.
    distinct_share : float
        Number of different segments, divided by the number of all segments.
    """

    longest_repeat: float
    distinct_share: float


def repetition(library: Library, scenario: Sequence[int] | IntArray | Scenario) -> Repetition:
    """Measure how much of a scenario is repeated.

    Parameters
    ----------
    library : Library
        The library of the segments.
    scenario : sequence of int or Scenario
        Segments of the library, in order.

    Returns
    -------
    Repetition
        The longest repeat in seconds, at captured speed, and the fraction of different segments.

    Raises
    ------
    ValueError
        If the scenario has no segment, or one that is not in the library.

    Examples
    --------
    >>> from mograft.dancer import dance
    >>> library = Library.build(dance(strides=1).motion)
    >>> repetition(library, [0, 1, 5, 0, 1])
    Repetition(longest_repeat=0.5, distinct_share=0.6)
    """
    if not isinstance(scenario, Scenario):
        scenario = Scenario(as_indices("scenario", scenario, ("n",)))
    segments = scenario.segments.tolist()
    n = len(library.segments)
    for segment in segments:
        if not 0 <= segment < n:
            raise ValueError(f"`scenario` must contain only segments 0 to {n - 1}, got {segment}")
    lengths = library.segments.lengths[segments].tolist()
    runs = RepeatedRuns()
    longest = max(runs.append(*item) for item in zip(segments, lengths, strict=True))
    return Repetition(float(longest / library.rate), len(set(segments)) / len(segments))


class RepeatedRuns:
    """The runs of items at the end of a growing sequence that also occur earlier in it.

    The two occurrences do not overlap. Only the latest `max_visits` occurrences of an item are
    compared, which bounds the time per item. By default all are compared.
    """

    def __init__(self, max_visits: int | None = None) -> None:
        self._items: list[int] = []
        self._ends: list[int] = []
        self._positions: dict[int, deque[int]] = defaultdict(lambda: deque(maxlen=max_visits))
        self._runs: dict[int, int] = {}  # length of the repeated run that ends at each position

    def append(self, item: int, length: int) -> int:
        """Append an item; return the length of the longest repeated run that ends with it."""
        end = length + (self._ends[-1] if self._ends else 0)
        positions = self._positions[item]
        self._runs = {
            position: min(length + self._runs.get(position - 1, 0), end - self._ends[position])
            for position in positions
        }
        positions.append(len(self._items))
        self._items.append(item)
        self._ends.append(end)
        return max(self._runs.values(), default=0)

    def lengths_before(self) -> dict[int, int]:
        """Return the items that would extend a repeated run, with the length of the longest one."""
        lengths: dict[int, int] = {}
        for position, length in self._runs.items():
            item = self._items[position + 1]
            lengths[item] = max(length, lengths.get(item, 0))
        return lengths
