"""Damaged files for the readers, and the laws that hold for them: one module per format.

A module has `mutate(seed)`, the damaged file; `check(seed, folder)`, which reads it and returns the
number of motions that were read. A test of the format checks the first seeds.
"""

import random
import resource
import time
from contextlib import contextmanager

import numpy as np

import mograft as mg

MAX_KIBIBYTES = 1 << 20

NUMBERS = [
    bytes(8), b"\xff" * 8, b"\xff\xff\xff\x7f" + bytes(4), b"\xff" * 7 + b"\x7f", b"\1" + bytes(7),
    b"\0\0\0\0\0\0\xf0\x7f", b"\0\0\0\0\0\0\xf8\x7f", b"\xff" * 6 + b"\xef\x7f", b"\0\0\0\x80" * 2
]  # fmt: skip
"""Extreme integers and floats, little-endian."""


class LimitError(AssertionError):
    """A reader took too long, or too much memory."""


def outcome(function, *arguments):
    """Return the result of a function, or the `FormatError` that it raises."""
    try:
        return function(*arguments)
    except mg.FormatError as error:
        return error


def change_bytes(data, rng, words):
    """Return bytes with a random change: a part or a word is removed, replaced, added or copied."""
    start, other = rng.randint(0, len(data)), rng.randint(0, len(data))
    size = rng.choice([1, 1, 4, 8, 40, 400])
    word = rng.choice([rng.choice(words), rng.randbytes(rng.choice([1, 4]))])
    found = rng.choice([b"", word, word, data[other : other + size]])
    removed = rng.choice([0, size, len(found), len(found)])
    return data[:start] + found + (data[start + removed :] if rng.random() < 0.95 else b"")


def change_words(data, rng, words):
    """Return text with a random change: another word or number, or lines that replace others."""
    separator = rng.choice([b" ", b" ", b",", b"\n"])
    parts = data.split(separator)
    one, other = rng.randrange(len(parts)), rng.randrange(len(parts))
    if separator == b"\n":
        parts[one : one + rng.randint(0, 3)] = parts[other : other + rng.randint(0, 30)]
    else:
        parts[one] = rng.choice(words)
    return separator.join(parts)


def damage(seed, files, words):
    """Return the name and the content of one of the files, with one to five random changes."""
    rng = random.Random(seed)
    name, data = rng.choice(list(files.items()))
    for _ in range(rng.choice([1, 1, 2, 5])):
        data = rng.choice([change_bytes, change_words])(data, rng, words)
    return name, data


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
