"""The library and the files that the provenance of a graft names."""

import glob
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mograft.errors import LibraryError, ProvenanceError, join_names
from mograft.io.addresses import join_address, read_clip, split_address
from mograft.library.discover import SourceFile, scan_folder
from mograft.library.ingest_run import IngestOptions
from mograft.library.library import Library
from mograft.library.origin import (
    PartialClip,
    build_partial_library,
    hash_library,
    is_mirrored,
    n_library_clips,
)
from mograft.provenance.graft_record import ClipRecord, GraftRecord, SegmentRecord


@dataclass(frozen=True, eq=False)
class RecordedLibrary:
    """The library of a graft, with its base."""

    library: Library
    base: int | None  # index of the base; None if it is composed of segments
    clips: Mapping[str, int]  # index of each clip that may provide donors, by name

    def find_segment(self, record: GraftRecord, segment: SegmentRecord) -> int:
        """Return the index of a segment; raise ProvenanceError if there is none."""
        clip = self.clips.get(segment.clip)
        if clip is None:
            raise record.error(f"the library has no clip {segment.clip!r}")
        segments = self.library.segments
        indices = segments.of_clip(clip)
        ends = np.stack([segments.start[indices], segments.stop[indices]], axis=1)
        found = indices[(ends == segment.frames).all(axis=1)]
        if not len(found):
            first, last = segment.frames
            raise record.error(f"{segment.clip} has no segment {first}-{last}")
        return int(found[0])


def find_library(
    record: GraftRecord, library: Library | None, sources: Sequence[str]
) -> RecordedLibrary:
    """Return the library of a graft: `library`, or the stored library that the provenance names.

    If there is no stored library, or if it has changed, return a library of only the clips of the
    graft. Their files are searched for beside the document, and then in `sources`, which are files
    and folders. Raise ProvenanceError if a file, too, is missing or has changed.
    """
    if library is not None:
        return _with_base(record, prepare_library(record, library, "`library`"), sources)
    problem = ""
    if record.library.folder is not None:
        folder = record.library.folder
        try:
            library = prepare_library(record, Library.open(folder), str(folder))
            return _with_base(record, library, sources)
        except OSError as error:
            problem = f"{folder}: {error.strerror}; "
        except (LibraryError, ProvenanceError) as error:
            problem = str(error).removeprefix(f"{record.label}: ") + "; "
    try:
        addresses = [find_clip(record, clip, sources) for clip in record.clips]
    except ProvenanceError as error:
        reason = str(error).removeprefix(f"{record.label}: ")
        raise record.error(problem + reason) from error
    return _partial_library(record, addresses)


def find_whole_library(record: GraftRecord, sources: Sequence[str]) -> Library:
    """Return the library of a graft with all its clips: the stored one, or one built from files.

    The files are `sources` or, by default, those of the recorded command line. Raise
    ProvenanceError if a file is missing or the library is another one, and LibraryError or OSError
    if the stored library cannot be opened.
    """
    origin = record.library
    if origin.folder is not None and not sources:
        return prepare_library(record, Library.open(origin.folder), str(origin.folder))
    names = [_present_source(record, own) for own in sources or record.sources]
    if not names:
        raise record.error("the graft was made in Python: give the library, or all of its files")
    options: IngestOptions = {
        "match": origin.match,
        "hierarchy": origin.hierarchy,
        "skeleton": origin.rest,
    }
    library = Library.build(names, record.groups, record.config, **options)
    if hash_library(library) != origin.sha256 and any(Path(name).is_dir() for name in names):
        # The graft may have been made with --include-grafts.
        options["include_grafts"] = True
        library = Library.build(names, record.groups, record.config, **options)
    return prepare_library(record, library, f"the library of {join_names(names)}")


def _present_source(record: GraftRecord, source: str) -> str:
    """Return the address at which a file or folder of the recorded command line is now."""
    path, pattern = split_address(source)
    name = Path(path).name
    clip = next((own for own in record.clips if own.file and Path(own.file).name == name), None)
    if Path(path).exists() or glob.has_magic(path):
        return source
    if clip is None:
        raise record.error(f"{source} is missing: give the library, or all of its files")
    return join_address(find_file(record, clip, ()), pattern)


def _with_base(record: GraftRecord, library: Library, sources: Sequence[str]) -> RecordedLibrary:
    """Return `library`, which has all its clips, and the base if it is not one of them."""
    n_clips = n_library_clips(library)
    clips = {info.name: index for index, info in enumerate(library.entries[:n_clips])}
    outside = [clip for clip in record.clips if clip.is_base and not clip.is_in_library]
    if record.scenario is not None:
        base = None
    elif outside:
        base = n_clips
        if n_clips == len(library.entries):
            address = find_clip(record, outside[0], sources)
            motion = read_clip(address, skeleton=record.library.rest)
            library = library.with_clip(replace(motion, name=outside[0].name))
    elif record.base in clips:
        base = clips[record.base]
    else:
        raise record.error(f"the library has no clip {record.base!r}, the base of the graft")
    return RecordedLibrary(library, base, clips)


def prepare_library(record: GraftRecord, library: Library, label: str) -> Library:
    """Return `library` with the mirror images and the configuration of a graft.

    Raise ProvenanceError if `library` has another SHA-256 than the library of the graft.
    """
    expected = record.library
    found = hash_library(library)
    if found != expected.sha256:
        raise record.error(
            f"{label} is another library: its SHA-256 is {found}, expected {expected.sha256}"
        )
    if expected.is_mirrored and not is_mirrored(library):
        library = library.with_mirror_images()
    return library if library.config == record.config else library.relabelled(record.config)


def find_clip(record: GraftRecord, clip: ClipRecord, sources: Iterable[str]) -> str:
    """Return the address of a clip, after comparing the SHA-256 of its file; see `find_file`."""
    return join_address(find_file(record, clip, sources), clip.clip)


def find_file(record: GraftRecord, clip: ClipRecord, sources: Iterable[str]) -> str:
    """Return the path of the file of a clip, after comparing its SHA-256.

    Raise ProvenanceError if there is no such file, or if it has changed.
    """
    if clip.file is None:
        raise record.error(
            f"clip {clip.name} was not read from a file; give the library that holds it"
        )
    changed = ""
    for path in _possible_paths(record, clip.file, sources):
        if not path.is_file():
            continue
        found = SourceFile.from_path(str(path)).sha256
        if found == clip.sha256:
            return str(path)
        changed = changed or f"{path} has changed: SHA-256 {found}, expected {clip.sha256}"
    raise record.error(changed or f"{record.folder / clip.file} is missing: give its new path")


def _possible_paths(record: GraftRecord, file: str, sources: Iterable[str]) -> Iterable[Path]:
    yield record.folder / file
    name = Path(file).name
    for address in [*sources, *record.sources]:
        source, _ = split_address(address)
        if Path(source).is_dir():
            yield from (path for path in scan_folder(source) if path.name == name)
        elif Path(source).name == name:
            yield Path(source)


def _partial_library(record: GraftRecord, addresses: Sequence[str]) -> RecordedLibrary:
    """Return a library of only the clips of a graft, read from `addresses`."""
    clips = [
        PartialClip(
            name=clip.name,
            address=address,
            rate_override=clip.true_rate,
            is_mirrored=clip.is_mirrored,
            is_in_library=clip.is_in_library,
            tags=() if clip.licence is None else (f"licence:{clip.licence}",),
        )
        for clip, address in zip(record.clips, addresses, strict=True)
    ]
    library = build_partial_library(Library, clips, record.groups, record.config, record.library)
    numbered = list(enumerate(record.clips))
    base = next((index for index, clip in numbered if clip.is_base), None)
    return RecordedLibrary(
        library,
        None if record.scenario is not None else base,
        {clip.name: index for index, clip in numbered if clip.is_in_library},
    )
