"""Damaged files for the readers, and the laws that hold for them: one module per format.

A module has `mutate(seed)`, the damaged file; `check(seed, folder)`, which reads it and returns the
number of motions that were read; and `SEEDS` that failed in earlier versions, which the tests run.
"""

import resource
import time
from contextlib import contextmanager

import numpy as np

import mograft as mg

MAX_KIBIBYTES = 1 << 20


class LimitError(AssertionError):
    """A reader took too long, or too much memory."""


def outcome(function, *arguments):
    """Return the result of a function, or the `FormatError` that it raises."""
    try:
        return function(*arguments)
    except mg.FormatError as error:
        return error


@contextmanager
def limits(seconds):
    """Fail if a block takes more processor time, or raises the memory used over 1 GiB."""
    start, before = time.process_time(), _peak_kibibytes()
    yield
    used, peak = time.process_time() - start, _peak_kibibytes()
    if used >= seconds or (peak > before and peak >= MAX_KIBIBYTES):
        raise LimitError(f"{used:.1f} s, {peak} KiB of memory")


def _peak_kibibytes():
    """Return the most memory that this process has used; other tests of its worker count too."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def read_motions(path):
    """Read up to 20 clips of a file; return the finite motions, and the errors of the others."""
    clips = outcome(mg.read, path)
    if isinstance(clips, mg.FormatError):
        found = [clips]
    else:
        found = [outcome(clips.__getitem__, index) for index in range(min(len(clips), 20))]
    for index, own in enumerate(found):
        if isinstance(own, mg.FormatError):
            assert str(own).startswith(f"{path}: "), own
        else:
            assert np.isfinite(own.world_positions()).all()
            assert np.isfinite(own.frame_time)
            assert clips.count_frames is None or own.n_frames == clips.count_frames(index)
    errors = [own for own in found if isinstance(own, mg.FormatError)]
    return [own for own in found if not isinstance(own, mg.FormatError)], errors
