"""The clips of a source that are bases of grafts, and the number of grafts of each."""

import math

MIN_BASE_FRAMES = 60
MAX_BASES = 8
MAX_FRAMES = 4000  # of all bases
N_GRAFTS = 3
MIN_GRAFTS = 12  # of all bases: an interval needs ten


def choose_bases(library, *, is_quick):
    """Return the names of evenly spaced clips, and the number of grafts of each."""
    entries = [own for own in library.entries if own.n_frames >= MIN_BASE_FRAMES]
    n = min(len(entries), 1 if is_quick else MAX_BASES)
    names, n_frames = [], 0
    for index in range(n):
        own = entries[index * len(entries) // n]
        if not names or n_frames + own.n_frames <= MAX_FRAMES:
            names.append(own.name)
            n_frames += own.n_frames
    return names, 1 if is_quick else max(N_GRAFTS, math.ceil(MIN_GRAFTS / max(len(names), 1)))
