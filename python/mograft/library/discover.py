"""Find the clips of a library, and look up their tags and frame rates."""

import errno
import glob
import hashlib
import os
import stat
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.util import find_spec
from os import PathLike, fspath
from pathlib import Path
from typing import Any, NamedTuple

from mograft._util.documents import parse_document
from mograft.errors import MograftError, join_names
from mograft.io import formats
from mograft.io.gltf.container import read_container
from mograft.io.gltf.grafts import find_original
from mograft.motion.motion import Motion

ClipSource = Motion | str | PathLike[str]

_RANK_OF_SUFFIX = {
    suffix: rank for rank, form in [*enumerate(formats.FORMATS)][::-1] for suffix in form.suffixes
}
"""Index in `FORMATS` of the first format with each suffix."""


MOTION_HASH = "motion_sha256"
"""Key of the SHA-256 of the motion file in provenance."""


class SourceFile(NamedTuple):
    """The state of a file when a clip was read from it."""

    path: str
    size: int  # bytes
    mtime_ns: int  # time of the last modification
    sha256: str
    format: str  # name of the `Format`
    clip: str | None = None  # name of the clip in the file, if the file holds several

    @classmethod
    def from_path(cls, path: str, clip: str | None = None) -> "SourceFile":
        """Return the present state of a file; `clip` is the clip that is read from it.

        Raise OSError if it is not a regular file: reading a pipe or a device might never end.
        """
        status = os.stat(path)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "is not a regular file", path)
        state = (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)
        sha256, form = _hash_and_format(path, state)
        if form == "glTF" and holds_graft(formats.join_address(path, clip)):
            sha256 = hashlib.sha256(Path(path).read_bytes()).hexdigest()  # it may be replaced
        return cls(path, status.st_size, status.st_mtime_ns, sha256, form, clip)

    @property
    def address(self) -> str:
        """The address of the clip."""
        return formats.join_address(self.path, self.clip)


@lru_cache(maxsize=2)  # a file may hold many clips
def _hash_and_format(path: str, _state: tuple[int, ...]) -> tuple[str, str]:
    """Return the SHA-256 and the format of a file; of a glTF file, as it was without its grafts.

    `_state` is part of the key of the cache: a file that has changed is read again.
    """
    form = formats.find_format(Path(path)).name
    if form == "glTF":
        return find_original(read_container(Path(path))).sha256, form
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest(), form


@dataclass(frozen=True, eq=False)
class FoundClip:
    """A clip that a source stands for."""

    source: Motion | str  # the clip, or its address
    folders: tuple[str, ...] = ()  # the folders between the source and the file
    is_graft: bool = False  # whether it is a graft that the source does not name

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys by which `tags` and `frame_rates` can name the clip; see `ClipKeys`.

        A motion has one key: its name. The clip of a file has three: the name of the file without
        suffix, with suffix, and the path of the file relative to the source. If the file holds
        several clips, a clip has three more: its name ``Walk``, ``file.glb#Walk``, and the relative
        path followed by ``#Walk``.
        """
        if isinstance(self.source, Motion):
            return (self.source.name,)
        path, clip = formats.split_address(self.source)
        stem, name = Path(path).stem, Path(path).name
        relative = "/".join((*self.folders, name))
        keys = (stem, name, relative)
        return keys if clip is None else (clip, f"{name}#{clip}", f"{relative}#{clip}", *keys)


def find_clips(sources: ClipSource | Iterable[ClipSource]) -> list[FoundClip]:
    """Find the clips that motions, addresses, folders and globs stand for, in this order.

    A folder stands for the files that `scan_folder` returns, a glob for the regular files that it
    matches. Both are sorted by name. A file stands for all of its clips. Raise FileNotFoundError if
    a path, folder or glob provides no file, and ValueError if there is no source or an address
    matches no clip. Raise `FormatError` if the clips of a file that is not in a folder cannot be
    listed; BVH files, which have one clip, are not parsed.
    """
    several = [sources] if isinstance(sources, Motion | str | PathLike) else sources
    clips: list[FoundClip] = []
    for source in several:
        clips += [FoundClip(source)] if isinstance(source, Motion) else _find_files(fspath(source))
    if not clips:
        raise ValueError("`sources` must hold at least one clip, got none")
    return _exclude_copies(clips)


def _exclude_copies(clips: list[FoundClip]) -> list[FoundClip]:
    """Return the clips; those of a file with grafts count as grafts if its original is present."""
    paths = {id(own): formats.split_address(str(own.source))[0] for own in clips}
    holders = {paths[id(own)] for own in clips if own.is_graft and holds_graft(str(own.source))}
    if not holders:
        return clips
    seen: dict[str, str] = {}  # the first file with each SHA-256, files without grafts first
    for path in sorted(dict.fromkeys(paths.values()), key=lambda path: path in holders):
        if os.path.isfile(path):
            seen.setdefault(SourceFile.from_path(path).sha256, path)
    copies = holders - set(seen.values())
    return [replace(own, is_graft=True) if paths[id(own)] in copies else own for own in clips]


def scan_folder(folder: str, *, every: bool = False) -> list[Path]:
    """Return the motion files in a folder and its subfolders, sorted by path.

    Files are chosen by suffix. Files in the same folder with the same stem are taken for exports of
    one another: unless `every`, only those of the first format in `FORMATS` are returned. Hidden
    files and folders are left out, because other programs give hidden names to copies and to
    incomplete files. So is anything but regular files, because reading a pipe would block.
    """
    files: list[Path] = []
    for parent, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        ranks: dict[str, dict[int, list[Path]]] = {}
        for path in (Path(parent, name) for name in names if not name.startswith(".")):
            rank = _RANK_OF_SUFFIX.get(path.suffix.lower())
            if rank is not None and path.is_file():
                ranks.setdefault(path.stem, {}).setdefault(rank, []).append(path)
        for by_rank in ranks.values():
            for rank in by_rank if every else [min(by_rank)]:
                files += by_rank[rank]
    return sorted(files)


def _find_files(address: str) -> list[FoundClip]:
    if os.path.isdir(address):
        return _find_in_folder(address)
    path, clip = formats.split_address(address)
    is_glob = glob.has_magic(path)
    matches = sorted(filter(os.path.isfile, glob.glob(path, recursive=True))) if is_glob else []
    if not matches and not os.path.lexists(path):
        reason = f"no file matches {path}"
        raise FileNotFoundError(*([reason] if is_glob else [2, "No such file or directory", path]))
    found: list[FoundClip] = []
    for match in matches or [path]:
        try:
            found += _found(formats.join_address(match, clip))
        except ValueError:
            if clip is None or not matches:
                raise  # otherwise no clip of this file has the name
    if not found:
        raise ValueError(
            f"none of the {len(matches)} files that match {path} has a clip that matches {clip!r}"
        )
    return found


def _found(address: str) -> list[FoundClip]:
    """Return the clips of a file; those that the address names exactly do not count as grafts."""
    clips = formats.find_addresses(address)
    return [FoundClip(own, is_graft=own != address and holds_graft(own)) for own in clips]


def _find_in_folder(folder: str) -> list[FoundClip]:
    """Return the clips of the files in a folder.

    Files without a motion are left out, such as meshes and arrays of other programs. If a file
    cannot be opened, its path is returned as a clip: ingest then refuses it and states the reason.
    Warn about files whose format needs a package that is not installed.
    """
    found: list[FoundClip] = []
    missing: dict[str, list[str]] = {}
    for file in scan_folder(folder):
        is_bvh = file.suffix.lower() == ".bvh"
        form = (formats.find_format if is_bvh else formats.recognize_format)(file)
        if form is None:
            continue
        if form.requires is not None and find_spec(form.requires) is None:
            missing.setdefault(form.name, []).append(file.name)
            continue
        try:
            has_clip = len(formats.open_clips(str(file))) > 0
            addresses = formats.find_addresses(str(file)) if has_clip else []
            kinds = [holds_graft(own) for own in addresses]
        except (MograftError, OSError, ValueError):
            addresses, kinds = [str(file)], [False]
        folders, is_graft = file.relative_to(folder).parts[:-1], has_provenance(file)
        pairs = zip(addresses, kinds, strict=True)
        found += [FoundClip(own, folders, is_graft=is_graft or kind) for own, kind in pairs]
    for name, files in missing.items():
        remedy = f"pip install 'mograft[{name.lower()}]'"
        warnings.warn(f"left out {join_names(files)}: {name} needs {remedy}", stacklevel=5)
    if not found:
        raise FileNotFoundError(2, "no motion file in this folder", folder)
    return found


def holds_graft(address: str) -> bool:
    """Return whether the clip at an address has its provenance in its file."""
    path, clip = formats.split_address(address)
    clips = formats.open_clips(path)
    names = clips.names if clip is None else (clip,)
    return len(names) == 1 and names[0] in clips.grafts


def is_graft(address: str) -> bool:
    """Return whether the provenance of a clip is in its file or beside it."""
    return holds_graft(address) or has_provenance(Path(formats.split_address(address)[0]))


def has_provenance(path: Path) -> bool:
    """Return whether a JSON file that ``mograft graft`` wrote lies beside a motion file.

    Warn if it belongs to another motion.
    """
    provenance = path.with_suffix(".json")
    try:
        document = parse_document(provenance.read_bytes()) if provenance.is_file() else None
    except (OSError, ValueError):
        return False
    if not isinstance(document, dict) or not str(document.get("schema")).startswith(
        "mograft.graft/"
    ):
        return False
    warn_of_other_motion(document, provenance)
    return True


def warn_of_other_motion(document: Mapping[str, Any], path: Path) -> bool:
    """Warn, and return True, if the provenance in a file belongs to no motion file beside it.

    A kill between the replacements of the two files causes this, and so does a program that changes
    the motion.
    """
    motions = filter(Path.is_file, map(path.with_suffix, (".bvh", ".csv", ".glb", ".npz")))
    found = [SourceFile.from_path(str(own)).sha256 for own in motions]
    is_other = bool(found) and document.get(MOTION_HASH, found[0]) not in found
    if is_other:
        warnings.warn(f"{path} belongs to another motion than the file beside it", stacklevel=3)
    return is_other


def exclude_grafts(clips: Sequence[FoundClip]) -> list[FoundClip]:
    """Return the clips without the grafts that no source names; warn about such grafts.

    Donors from a graft could contain its seams. Raise FileNotFoundError if no clip remains.
    """
    kept = [clip for clip in clips if not clip.is_graft]
    n_grafts = len(clips) - len(kept)
    remedy = "--include-grafts (include_grafts=True) includes them"
    if clips and not kept:
        raise FileNotFoundError(f"all clips are grafts of mograft; {remedy}")
    if n_grafts:
        grafts = "1 graft" if n_grafts == 1 else f"{n_grafts} grafts"
        message = f"{grafts} of mograft excluded as donors; {remedy}"
        warnings.warn(message, stacklevel=3)
    return kept


def relative_path(path: str, folder: Path) -> Path:
    """Return a file's path relative to a folder; absolute if the two are on different drives."""
    try:
        return Path(os.path.relpath(path, folder))
    except ValueError:
        return Path(os.path.abspath(path))
