"""The table of all segments: clusters, contacts, phases and copies, with ids that stay."""

import hashlib

import numpy as np

from mograft._util.arrays import BoolArray, FloatArray, IntArray
from mograft.body.contacts import detect_contacts, find_legs
from mograft.library.data import Columns, LibraryData, library_tables
from mograft.library.discover import relative_path
from mograft.library.duplicates import find_copies

_MAX_STEP_SECONDS = 1.5
"""Greatest time between the contacts of two feet that belong to one stride."""

_FACTOR = np.uint64(0x9E37_79B9_7F4A_7C15)  # odd: frames of a clip have different multiples


def segment_table(library: LibraryData) -> Columns:
    """Return the table of all segments; `Library.table` describes it."""
    table = library_tables(library)["segments"]
    cut = library.segments
    with np.errstate(over="ignore"):
        ids = _clip_ids(library)[cut.clip] + cut.start.astype(np.uint64) * _FACTOR
    legs = find_legs(library.skeleton)
    contacts, phase = np.zeros((len(cut), len(legs))), np.full(len(cut), np.nan)
    for clip, motion in enumerate(library.clips) if legs else ():
        own = cut.of_clip(clip)
        stands = np.asarray(detect_contacts(motion).any(axis=2))
        sums = np.concatenate([np.zeros((1, len(legs))), np.cumsum(stands, axis=0)])
        last = cut.stop[own] + 1
        contacts[own] = (sums[last] - sums[cut.start[own]]) / (last - cut.start[own])[:, None]
        phase[own] = stride_phases(stands, library.rate)[cut.start[own]]
    twin, (first, second) = np.zeros(len(cut), np.uint64), find_copies(library)
    pairs = np.concatenate([np.stack([first, second]), np.stack([second, first])], axis=1)
    pairs = pairs[:, np.lexsort(pairs)]
    segments, rows = np.unique(pairs[0], return_index=True)
    twin[segments] = ids[pairs[1][rows]]
    names = [library.skeleton.names[leg.ankle] for leg in legs]
    columns = {f"contact_{name}": contacts[:, k] for k, name in enumerate(names)}
    return Columns(id=ids, **table, **columns, phase=phase, twin=twin)


def stride_phases(stands: BoolArray, rate: float) -> FloatArray:
    """Return the phase of each frame: 0 when the first leg begins a contact, 0.5 the second.

    It grows linearly between. It is NaN before the first contact and after the last one, between
    two contacts of the same leg, and between contacts more than 1.5 s apart. `stands`, shape
    (n_frames, n_legs), states which legs are in contact; only two legs have phases.
    """
    phases = np.full(len(stands), np.nan)
    if stands.shape[1] != 2:
        return phases
    frames, legs = np.nonzero(stands[1:] & ~stands[:-1])
    for low, high, leg, other in zip(frames, frames[1:], legs, legs[1:], strict=False):
        if leg != other and 0 < high - low <= _MAX_STEP_SECONDS * rate:
            steps = np.arange(high - low) / (high - low)
            phases[low + 1 : high + 1] = (leg + steps) / 2.0
    return phases


def _clip_ids(library: LibraryData) -> IntArray:
    """Return a number for each clip, which depends only on the path of its file, or its name."""
    seen: dict[str, int] = {}
    found = []
    for entry in library.entries:
        key, file = entry.name, entry.source_file
        if file is not None:
            path = file.path if library.folder is None else relative_path(file.path, library.folder)
            key = f"{path}#{file.clip or ''}"
        seen[key] = seen.get(key, 0) + 1  # a mirrored clip has the file of the original
        text = f"{key}\0{seen[key]}".encode("utf-8", "surrogatepass")
        found.append(int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), "big"))
    return np.array(found, np.uint64)
