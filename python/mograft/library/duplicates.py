"""Spans of a library that occur twice: the same movement in two places, as in a take and its piece.

One pass over the embedding of the base group finds pairs of near segments; of these, the pairs
whose parts are copies in every group are compared pose by pose.
"""

from dataclasses import dataclass

import numpy as np

from mograft._util.arrays import IntArray
from mograft.library.data import LibraryData
from mograft.search.neighbourhoods import NEIGHBOURHOODS

_RADIUS = 0.25
"""Greatest distance of copies in the embedding, in cluster diameter thresholds.

Two recordings of one movement at other rates differ by less, and the pose comparison decides.
"""

_SEGMENTS_PER_BATCH = 4096


@dataclass(frozen=True)
class DuplicateSpan:
    """A span of a clip that occurs again in another place.

    Attributes
    ----------
    clip, other : str
        Names of the two clips, which may be the same.
    frames, other_frames : tuple of int
        First and last frame of the span in each of them, at the rate of the library.
    """

    clip: str
    frames: tuple[int, int]
    other: str
    other_frames: tuple[int, int]

    def __str__(self) -> str:
        (start, stop), (first, last) = self.frames, self.other_frames
        return f"{self.clip} {start}-{stop} = {self.other} {first}-{last}"


def find_duplicates(library: LibraryData) -> list[DuplicateSpan]:
    """Return the spans of whole segments that occur twice in a library.

    A segment is the duplicate of another if every joint, but for the heading of the root, is
    within 0.5 degrees in all samples. Mirror images are duplicates only of other mirror images.
    Memory is linear in the number of segments.

    Parameters
    ----------
    library : Library
        The library.

    Returns
    -------
    list of DuplicateSpan
        The spans, by clip and first frame.

    Examples
    --------
    >>> from mograft import Library
    >>> from mograft.dancer import dance
    >>> take = dance(strides=1).motion
    >>> find_duplicates(Library.build([take, take]))[0].other
    'dance~2'
    """
    cut, names = library.segments, library.names
    first, second = find_copies(library)
    pairs = np.stack([first, second])[:, np.lexsort((first, second - first))]
    # Pairs of segments that follow each other in both clips form one span.
    follows = ((np.diff(pairs) == 1) & (np.diff(cut.clip[pairs]) == 0)).all(axis=0)
    starts = pairs[:, np.append(True, ~follows)[: len(first)]]
    ends = pairs[:, np.append(~follows, True)[: len(first)]]
    columns = np.concatenate([cut.clip[starts], cut.start[starts], cut.stop[ends]])
    rows = columns[:, np.lexsort(starts[::-1])].T.tolist()
    return [
        DuplicateSpan(names[clip], (start, stop), names[other], (other_start, other_stop))
        for clip, other, start, other_start, stop, other_stop in rows
    ]


def find_copies(library: LibraryData) -> tuple[IntArray, IntArray]:
    """Return the pairs of segments that are copies in every group, the first index smaller."""
    pools = [library.pool(group) for group in library.groups.names]
    points, radius = pools[0].points, _RADIUS * pools[0].sigma
    pairs = [np.zeros((2, 0), np.int64)]
    for start in range(0, len(library.segments), _SEGMENTS_PER_BATCH):
        own = np.arange(start, min(start + _SEGMENTS_PER_BATCH, len(library.segments)))
        near = NEIGHBOURHOODS["ball"].find_members(pools[0].labels, points, radius, own)
        first, second = np.repeat(own, [len(members) for members in near]), np.concatenate(near)
        first, second = first[first < second], second[first < second]
        for pool in pools:
            is_copy = pool.are_copies(first, second)
            first, second = first[is_copy], second[is_copy]
        pairs.append(np.stack([first, second]))
    found = np.concatenate(pairs, axis=1)
    return found[0], found[1]
