"""Open the library of a folder."""

import os
from pathlib import Path
from typing import TypeVar

import numpy as np

from mograft.analysis.embedding import Embedding
from mograft.body.groups import JointGroups
from mograft.config import Config
from mograft.errors import LibraryError
from mograft.library.clip_table import skeleton_from_json
from mograft.library.data import LibraryData
from mograft.library.files import storage
from mograft.library.files.integrity import MANIFEST, damage_raises_library_error
from mograft.library.files.storage import StoredLibrary
from mograft.library.files.stored_clips import StoredClips
from mograft.library.spec import LibrarySpec
from mograft.motion.segments import Segments

L = TypeVar("L", bound=LibraryData)

EMBEDDING_ARRAYS = ("points", "reference", "mean", "scale", "components", "variances")
"""Fields of `Embedding` that are stored as arrays of floats."""


def load_library(library_type: type[L], stored: StoredLibrary) -> L:
    """Return a stored library as a `library_type`, with memory-mapped arrays.

    Raise LibraryError if the files do not fit together.
    """
    with damage_raises_library_error(stored.folder, MANIFEST):
        return _load_library(library_type, stored)


def _load_library(library_type: type[L], stored: StoredLibrary) -> L:
    """Return a stored library as a `library_type`."""
    manifest, arrays = stored.manifest, stored.arrays
    groups = JointGroups.from_toml(manifest["groups"])
    embedding: dict[str, Embedding | None] = {}
    labels, states = {}, {}
    for group, about in manifest["group"].items():
        prefix = about["folder"] + "/"
        own = {key.removeprefix(prefix): arrays[key] for key in arrays if key.startswith(prefix)}
        labels[group] = own.pop("labels")
        embedding[group] = None
        if about["compared"]:
            embedding[group] = Embedding(
                joints=np.array(own.pop("joints")),
                has_root=about["has_root"],
                **{name: own.pop(name) for name in EMBEDDING_ARRAYS},
            )
        states[group] = own
    frames = [arrays[f"frames-{shard}"] for shard in manifest["shards"]]
    spec = LibrarySpec(
        skeleton=skeleton_from_json(manifest["skeleton"]),
        rate=manifest["rate"],
        root=manifest["root"],
        up=manifest["up"],
        match=manifest["match"],
        rest=None if manifest["rest"] is None else skeleton_from_json(manifest["rest"]),
    )
    library = library_type(
        clips=StoredClips(stored.table, frames, spec, stored.folder),
        entries=stored.table.entries,
        segments=Segments(arrays["starts"], arrays["stops"], arrays["clips"]),
        is_donor=arrays["donors"],
        groups=groups,
        config=Config.from_dict(manifest["config"]),
        spec=spec,
        embedding=embedding,
        labels=labels,
        sigma={group: about["sigma"] for group, about in manifest["group"].items()},
        boundary_states=states,
        samples=stored.samples,
        refused=stored.table.refused,
        folder=stored.folder,
    )
    folder = Path(os.path.abspath(stored.folder))
    return library.set_recipe(_reopen, library_type, folder, manifest["checksum"])


def _reopen(library_type: type[L], folder: Path, checksum: str) -> L:
    """Open the library of a pickle; raise LibraryError if the library in the folder has changed."""
    stored = storage.read(folder)
    if stored.manifest["checksum"] != checksum:
        raise LibraryError(
            f"{folder} has changed since the library was pickled; open and pickle it again"
        )
    return load_library(library_type, stored)
