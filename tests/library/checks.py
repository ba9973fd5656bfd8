"""Helpers of the tests of libraries in folders."""

import shutil

from mograft.dancer import dance

DANCE = dance(seed=5, strides=1).motion
CLIP_NAMES = ["c", "d", "jump/a", "walk/a", "walk/b"]


def assert_same_libraries(a, b):
    """Assert that two libraries have the same numbers, bit for bit."""
    assert [entry.name for entry in a.entries] == [entry.name for entry in b.entries]
    assert (a.rate, a.root, a.up, a.sigma, a.config) == (b.rate, b.root, b.up, b.sigma, b.config)
    pairs = [(a.is_donor, b.is_donor)]
    pairs += [(getattr(a.segments, n), getattr(b.segments, n)) for n in ("start", "stop", "clip")]
    for group in a.labels:
        pairs.append((a.labels[group], b.labels[group]))
        pairs += [
            (states, b.boundary_states[group][key])
            for key, states in a.boundary_states[group].items()
        ]
        one, other = a.embedding[group], b.embedding[group]
        assert (one is None) == (other is None)
        if one is not None and other is not None:
            names = ("points", "joints", "reference", "mean", "scale", "components", "variances")
            pairs += [(getattr(one, name), getattr(other, name)) for name in names]
    chunks = zip(a.samples.chunks(), b.samples.chunks(), strict=True)
    pairs += [(one.rows, other.rows) for one, other in chunks]
    for ours, theirs in zip(a.clips, b.clips, strict=True):
        assert ours.frame_time == theirs.frame_time
        pairs += [(ours.rotations, theirs.rotations), (ours.positions, theirs.positions)]
        assert (ours.channel_values is None) == (theirs.channel_values is None)
    for one, other in pairs:
        assert one.dtype == other.dtype
        assert one.shape == other.shape
        assert one.tobytes() == other.tobytes()


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
