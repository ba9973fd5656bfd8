"""Hashes by which results are compared to the bit."""

import dataclasses
import hashlib
from collections.abc import Mapping, Sequence, Set

import numpy as np

import mograft as mg


def fingerprint(value):
    """Return a hash of all numbers and texts in a result."""
    digest = hashlib.sha256()
    _update(digest, value)
    return digest.hexdigest()


def _update(digest, value):
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype}{value.shape}".encode() + value.tobytes())
    elif isinstance(value, mg.Graft):
        _update(digest, [value.motion, value.substitutions, value.seams, value.feet])
    elif isinstance(value, mg.Motion):
        _update(digest, [value.rotations, value.positions, value.channel_numbers(), value.name])
    elif dataclasses.is_dataclass(value):
        _update(digest, {own.name: getattr(value, own.name) for own in dataclasses.fields(value)})
    elif isinstance(value, Mapping):
        _update(digest, list(value.items()))
    elif isinstance(value, Set):
        _update(digest, sorted(value))
    elif isinstance(value, Sequence) and not isinstance(value, str | bytes):
        digest.update(f"{len(value)}[".encode())
        for item in value:
            _update(digest, item)
    else:
        digest.update(value if isinstance(value, bytes) else repr(value).encode())
