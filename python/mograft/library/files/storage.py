"""Read libraries from disk: arrays, a database, and a manifest with their hashes.

docs/library.md lists the files. Files of a generation never change: a generation becomes the
library when the manifest that names it replaces the previous manifest. Readers need no lock;
writers hold an exclusive one (`mograft.library.files.generation`).
"""

import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft._util.documents import parse_document
from mograft.analysis.embedding import Embedding
from mograft.body.groups import JointGroups
from mograft.config import Config
from mograft.errors import LibraryError
from mograft.library.clip_table import ClipTable, read_clip_table, skeleton_from_json
from mograft.library.data import LibraryData
from mograft.library.files import array_files
from mograft.library.files.array_files import DATABASE, MANIFEST, damage
from mograft.library.files.stored_clips import JoinedSamples, StoredClips
from mograft.library.spec import LibrarySpec
from mograft.motion.segments import Segments

FORMAT, FORMAT_VERSION = "mograft.library", 1
LOCK = ".lock"

L = TypeVar("L", bound=LibraryData)

EMBEDDING_ARRAYS = ("points", "reference", "mean", "scale", "components", "variances")
"""Fields of `Embedding` that are stored as arrays of floats."""

_FILE = re.compile(rf"\d{{4,}}/(?:(?:\d+/)?[\w-]+\.npy|{re.escape(DATABASE)})")

_MAX_READ_ATTEMPTS = 8
"""How many times reading is attempted if other processes replace the generation meanwhile."""


@dataclass(frozen=True, eq=False)
class StoredLibrary:
    """The files of a stored library."""

    folder: Path
    manifest: dict[str, Any]
    table: ClipTable
    arrays: dict[str, npt.NDArray[Any]]  # by path in the generation, memory-mapped


def read(folder: Path) -> StoredLibrary:
    """Open the files of a library; they stay valid when another process writes a generation.

    Raise LibraryError if the folder is not a library, or the library is damaged or was written by
    another version. Raise FileNotFoundError if the folder does not exist.
    """
    for _ in range(_MAX_READ_ATTEMPTS):
        manifest = read_manifest(folder)
        try:
            with array_files.damage_raises_library_error(folder, MANIFEST):
                return _read_generation(folder, manifest)
        except FileNotFoundError as error:
            # Another process may have replaced the generation since the manifest was read.
            if read_manifest(folder) == manifest:
                raise damage(folder, f"{Path(error.filename).name} is missing") from error
    raise LibraryError(f"{folder} was rewritten {_MAX_READ_ATTEMPTS} times while it was read")


def is_library(path: str | Path) -> bool:
    """Return whether a path is the folder of a library."""
    return (Path(path) / MANIFEST).is_file()


def read_manifest(folder: Path) -> dict[str, Any]:
    """Return the manifest of a library after checking format, version, checksum and files."""
    if not folder.exists():
        raise FileNotFoundError(2, "no such library", str(folder))
    try:
        document = parse_document((folder / MANIFEST).read_text(encoding="utf-8"))
    except NotADirectoryError as error:
        if is_library(folder.parent):
            raise LibraryError(
                f"{folder} is a file of a library; did you mean {str(folder.parent)!r}?"
            ) from error
        raise LibraryError(
            f"{folder} is not a mograft library: it is a file; mograft info describes motion "
            f"files, mograft index {folder} -o {folder.with_suffix('.mograft')} makes a library"
        ) from error
    except FileNotFoundError as error:
        raise LibraryError(
            f"{folder} is not a mograft library: it has no {MANIFEST}; "
            f"mograft index {folder} -o {folder.with_suffix('.mograft')} makes one of motion files"
        ) from error
    except ValueError as error:
        raise damage(folder, f"{MANIFEST} is not valid JSON: {error}") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise LibraryError(f"{folder} is not a mograft library: its {MANIFEST} has another format")
    if document.get("version") != FORMAT_VERSION:
        raise LibraryError(
            f"{folder} has format version {document.get('version')}, written by mograft "
            f"{document.get('mograft')}; this is mograft {VERSION}, which reads version "
            f"{FORMAT_VERSION}: install the other version, or index the clips again"
        )
    with array_files.damage_raises_library_error(folder, MANIFEST):
        if document.get("checksum") != array_files.manifest_checksum(document):
            raise damage(folder, f"{MANIFEST} does not match its checksum")
        foreign = [name for name in document["files"] if not _FILE.fullmatch(name)]
        _ = [(own["bytes"], own["sha256"]) for own in document["files"].values()]
        if not isinstance(document["generation"], str):
            raise TypeError(f"`generation` must be a name, got {document['generation']!r}")
    if foreign:
        raise damage(folder, f"{MANIFEST} lists {foreign[0]!r}, which is no file of a generation")
    return document


def _read_generation(folder: Path, manifest: dict[str, Any]) -> StoredLibrary:
    arrays = {}
    prefix = manifest["generation"] + "/"
    for name, expected in manifest["files"].items():
        size = os.stat(f"{folder}{os.sep}{name}").st_size
        if size != expected["bytes"]:
            raise damage(folder, f"{name} has {size} bytes, expected {expected['bytes']}")
    for name in manifest["files"]:
        if name.endswith(".npy"):
            with array_files.damage_raises_library_error(folder, name):
                arrays[name.removeprefix(prefix).removesuffix(".npy")] = array_files.map_array(
                    folder / name
                )
    with array_files.damage_raises_library_error(folder, DATABASE):
        table = read_clip_table(folder / prefix / DATABASE)
        if len(table.entries) != manifest["clips"]:
            raise ValueError(f"expected {manifest['clips']} clips, got {len(table.entries)}")
    return StoredLibrary(folder, manifest, table, arrays)


def load_library(library_type: type[L], stored: StoredLibrary) -> L:
    """Return a stored library as a `library_type`, with memory-mapped arrays.

    Raise LibraryError if the files do not fit together.
    """
    with array_files.damage_raises_library_error(stored.folder, MANIFEST):
        manifest, arrays = stored.manifest, stored.arrays
        groups = JointGroups.from_toml(manifest["groups"] + "\n")  # text, never a path
        embedding: dict[str, Embedding | None] = {}
        labels, states = {}, {}
        for group, about in manifest["group"].items():
            prefix = about["folder"] + "/"
            own = {
                key.removeprefix(prefix): arrays[key] for key in arrays if key.startswith(prefix)
            }
            labels[group] = own.pop("labels")
            embedding[group] = None
            if about["compared"]:
                embedding[group] = Embedding(
                    joints=np.array(own.pop("joints")),
                    has_root=about["has_root"],
                    **{name: own.pop(name) for name in EMBEDDING_ARRAYS},
                )
            states[group] = own
        if (missing := set(groups.names) - labels.keys()) or isinstance(manifest["rate"], bool):
            raise ValueError(f"no data of the groups {missing}" if missing else "no rate")
        frames = [arrays[f"frames-{shard}"] for shard in manifest["shards"]]
        spec = LibrarySpec(
            skeleton=skeleton_from_json(manifest["skeleton"]),
            rate=float(manifest["rate"]),
            root=range(len(manifest["skeleton"]["names"]))[manifest["root"]],
            up=range(3)[manifest["up"]],
            match=manifest["match"],
            rest=None if manifest["rest"] is None else skeleton_from_json(manifest["rest"]),
        )
        config = Config.from_dict(manifest["config"])
        library = library_type(
            clips=StoredClips(stored.table, frames, spec, stored.folder),
            entries=stored.table.entries,
            segments=_read_segments(arrays, stored.table),
            is_donor=arrays["donors"],
            groups=groups,
            config=config,
            spec=spec,
            embedding=embedding,
            labels=labels,
            sigma={group: float(about["sigma"]) for group, about in manifest["group"].items()},
            boundary_states=states,
            samples=_join_samples(stored, config.samples, spec.skeleton.n_joints),
            refused=stored.table.refused,
            folder=stored.folder,
        )
        folder = Path(os.path.abspath(stored.folder))
        return library.set_recipe(_reopen, library_type, folder, manifest["checksum"])


def _read_segments(arrays: dict[str, npt.NDArray[Any]], table: ClipTable) -> Segments:
    """Return the segments; raise ValueError if one is not within its clip."""
    segments = Segments(arrays["starts"], arrays["stops"], arrays["clips"])
    n_frames = np.array([entry.n_frames for entry in table.entries])
    if (segments.start < 0).any() or (segments.stop >= n_frames[segments.clip]).any():
        raise ValueError("segments end outside of their clips")
    return segments


def _join_samples(stored: StoredLibrary, n_samples: int, n_joints: int) -> JoinedSamples:
    """Return the samples of all segments; raise ValueError if they are not within their files."""
    files = tuple(stored.arrays[f"samples-{shard}"] for shard in stored.manifest["shards"])
    counts = np.bincount(stored.arrays["clips"], minlength=len(stored.table.locations))
    firsts = [(location.shard, location.first_row) for location in stored.table.locations]
    ranges = np.column_stack([firsts, counts])
    ends = np.array([len(rows) for rows in files])[ranges[:, 0]]
    is_inside = (ranges >= 0).all() and (ranges[:, 1] <= ends - ranges[:, 2]).all()
    width = n_samples * (4 * n_joints + 3) + 1
    if not is_inside or any(rows.shape[1:] != (width,) for rows in files):
        raise ValueError("samples end outside of their files")
    return JoinedSamples(files, ranges, n_samples, n_joints)


def _reopen(library_type: type[L], folder: Path, checksum: str) -> L:
    """Open the library of a pickle; raise LibraryError if the library in the folder has changed."""
    stored = read(folder)
    if stored.manifest["checksum"] != checksum:
        raise LibraryError(
            f"{folder} has changed since the library was pickled; open and pickle it again"
        )
    return load_library(library_type, stored)


def verify(folder: Path) -> list[str]:
    """Compare the size and the SHA-256 of every file of a library with the manifest.

    Return a message for each missing or different file. Raise LibraryError if the manifest cannot
    be read.
    """
    files, problems = read_manifest(folder)["files"], []
    hashes = array_files.hash_files(folder, [name for name in files if (folder / name).is_file()])
    for name, expected in files.items():
        found = hashes.get(name)
        if found is None:
            problems.append(f"{name} is missing")
        elif (size := found["bytes"]) != expected["bytes"]:
            problems.append(f"{name} has {size} bytes, expected {expected['bytes']}")
        elif found != expected:
            problems.append(f"{name} has changed: its SHA-256 differs from the manifest")
    return problems


def list_leftovers(folder: Path) -> list[str]:
    """Return the names of files and folders that an interrupted write left in a library's folder.

    The next write removes generations and drafts of manifests. Other files stay.
    """
    manifest = read_manifest(folder)
    known = {MANIFEST, LOCK, manifest["generation"]}
    return sorted(path.name for path in folder.iterdir() if path.name not in known)
