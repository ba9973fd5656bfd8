"""The inputs of a project: what was found in them, and the library of their clips."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mograft.body.faults import find_faults
from mograft.config import Config
from mograft.errors import DAMAGE, MograftError
from mograft.io.formats import split_address
from mograft.library.derive import BUILD_STAGES
from mograft.library.discover import SourceFile, find_clips
from mograft.library.files.storage import is_library
from mograft.library.files.stored_clips import StoredClips
from mograft.library.ingest_run import MISMATCH_REMEDY
from mograft.library.library import Library
from mograft.library.origin import hash_library
from mograft.studio.notes import captured_warnings
from mograft.studio.project import Project, ProjectInput

Progress = Callable[[str, int, int], None]
_MAX_REASON = 300  # characters
_MAX_FAULTS = 50  # of a clip
_MAX_BYTES_OF_CLIPS = 256_000_000
"""Clips of a stored library that stay in memory, because every edit reads many of them."""


@dataclass(frozen=True, eq=False)
class Opened:
    """What was found in the inputs of a project."""

    key: tuple[Any, ...] = ()  # the result of `library_key`
    library: Library | None = None
    status: str = "none"  # none, building, ready or failed
    done: int = 0
    total: int = 0
    message: str = ""
    sources: tuple[dict[str, Any], ...] = ()
    clips: tuple[dict[str, Any], ...] = ()
    hashes: dict[str, str | None] = field(default_factory=dict)  # SHA-256 by input


def library_key(project: Project) -> tuple[Any, ...]:
    """Return what determines the library of a project."""
    options = tuple(_build_options(project).items())
    return (tuple(own.path for own in project.inputs), project.groups, options)


def _build_options(project: Project) -> dict[str, Any]:
    """Return the fields of the configuration on which the library of a project depends."""
    config = project.full_config
    return {name: getattr(config, name) for name in Config.fields_of(*BUILD_STAGES)}


def build(project: Project, progress: Progress) -> Opened:
    """Read the inputs of a project, and build the library of their clips.

    An input that cannot be read is left out, with the message of the reader.
    """
    opened = Opened(library_key(project))
    if not project.inputs:
        return opened
    broken: dict[str, str] = {}
    with captured_warnings() as caught:
        paths = [own.path for own in project.inputs if _can_open(own.path, broken)]
        try:
            library = _read(project, paths, progress)
        except (MograftError, OSError, *DAMAGE) as error:
            lost = tuple(_source(own, [], broken, {}) for own in project.inputs)
            message = str(error) if paths else "no motion could be read"
            return replace(opened, status="failed", message=message, sources=lost)
    files = [own.source_file for own in library.entries if own.source_file is not None]
    hashes: dict[str, str | None] = {}
    sources = list[dict[str, Any]]()
    for own in project.inputs:
        if is_library(own.path):
            names, hashes[own.path] = list(library.names), hash_library(library)
        else:
            inside = [file for file in files if _is_inside(file.path, own.path)]
            names, hashes[own.path] = [file.address for file in inside], _hash(inside)
        sources.append(_source(own, names, broken, library.refused, hashes[own.path]))
    return replace(
        opened,
        library=library,
        status="ready",
        message="\n".join(caught),
        sources=tuple(sources),
        clips=tuple(
            {"name": own.name, "frames": own.n_frames, "rate": round(library.rate, 6), "faults": []}
            for own in library.entries
        ),
        hashes=hashes,
    )


def _hash(files: Sequence[SourceFile]) -> str | None:
    """Return the SHA-256 of a file, or of the names and hashes of several; None for none."""
    texts = sorted({f"{own.sha256} {Path(own.path).name}" for own in files})
    if len(texts) == 1:
        return files[0].sha256
    return hashlib.sha256("\n".join(texts).encode()).hexdigest() if texts else None


def _can_open(path: str, broken: dict[str, str]) -> bool:
    try:
        if not is_library(path):
            find_clips([path])
    except (MograftError, OSError, *DAMAGE) as error:
        broken[path] = str(error)
    return path not in broken


def _read(project: Project, paths: Sequence[str], progress: Progress) -> Library:
    libraries = [own for own in paths if is_library(own)]
    if libraries and len(paths) > 1:
        raise ValueError(
            f"{libraries[0]} is a library: open it alone, or add files to it by mograft index --add"
        )
    if libraries:
        library = Library.open(libraries[0])
        if isinstance(library.clips, StoredClips):
            n_numbers = 7 * library.skeleton.n_joints + library.skeleton.n_channels
            size = 8 * n_numbers * max(own.n_frames for own in library.entries)
            clips = library.clips
            clips.cache.limit = max(clips.cache.limit, _MAX_BYTES_OF_CLIPS // size)
        return library
    config = Config(**_build_options(project))
    return Library.build(paths, project.joint_groups, config, strict=False, progress=progress)


def _is_inside(file: str, source: str) -> bool:
    path = Path(split_address(source)[0])
    return Path(file) == path or Path(file).is_relative_to(path)


def _source(
    given: ProjectInput,
    clips: Sequence[str],
    broken: dict[str, str],
    refused: Mapping[str, str],
    sha256: str | None = None,
) -> dict[str, Any]:
    """Return what the page shows of an input; `sha256` is that of its motions if it was read."""
    path = given.path
    reasons = [
        why for address, why in refused.items() if _is_inside(split_address(address)[0], path)
    ]
    reasons += [broken[path]] if path in broken else []
    is_other = bool(reasons) and all(own.endswith(MISMATCH_REMEDY) for own in reasons)
    status = "ok" if clips else "skipped" if is_other else "broken"
    more = f" (and {len(reasons) - 1} more)" if len(reasons) > 1 else ""
    message = f"{reasons[0][:_MAX_REASON]}{more}" if reasons else ""
    if given.sha256 is not None and sha256 not in (None, given.sha256):
        message = "; ".join(filter(None, [message, "has changed since the project was saved"]))
    name = path.removeprefix(f"{Path(split_address(path)[0]).parent}/")
    return {"path": path, "name": name, "clips": len(clips), "status": status, "message": message}


def with_faults(opened: Opened, *, should_stop: Callable[[], bool]) -> Opened:
    """Return the clips with their recording faults; of an opened library, nothing is changed."""
    clips = []
    for own, motion in zip(
        opened.clips, opened.library.clips if opened.library else (), strict=True
    ):
        if should_stop():
            return opened
        faults = [
            {"kind": each.kind, "first": each.frames[0], "last": each.frames[1]}
            | {"text": each.message}
            for each in find_faults(motion)[:_MAX_FAULTS]
        ]
        clips.append({**own, "faults": faults})
    return replace(opened, clips=tuple(clips))
