"""Helpers of the tests of libraries in folders."""

import shutil

from mograft.dancer import dance
from tests.fingerprint import fingerprint

DANCE = dance(seed=5, strides=1).motion
CLIP_NAMES = ["c", "d", "jump/a", "walk/a", "walk/b"]
PACK_NAMES = ("walk", "jump", "walk.b#2", "turn/../left")
"""Names of clips in a file that are hard to tell from paths."""


def assert_same_libraries(a, b):
    """Assert that two libraries have the same numbers, bit for bit."""
    for name in ("names", "rate", "root", "up", "sigma", "config"):
        assert getattr(a, name) == getattr(b, name), name
    for name in ("segments", "is_donor", "labels", "embedding"):
        assert fingerprint(getattr(a, name)) == fingerprint(getattr(b, name)), name
    for group, states in a.boundary_states.items():
        found = sorted(b.boundary_states[group].items())
        assert fingerprint(sorted(states.items())) == fingerprint(found), group
    samples = ([chunk.rows for chunk in own.samples.chunks()] for own in (a, b))
    assert len(set(map(fingerprint, samples))) == 1
    for ours, theirs in zip(a.clips, b.clips, strict=True):
        assert (ours.channel_values is None) == (theirs.channel_values is None)
        one, other = ((own.rate, own.rotations, own.positions) for own in (ours, theirs))
        assert fingerprint(one) == fingerprint(other)


def copy_clips(clip_folder, folder, names):
    """Copy clips to a folder and keep their modification times."""
    for name in names:
        target = folder / f"{name}.bvh"
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(clip_folder / f"{name}.bvh", target)
    return folder


def list_files(library):
    """Return the files of a library that are not empty."""
    return sorted(path for path in library.rglob("*") if path.is_file() and path.stat().st_size)
