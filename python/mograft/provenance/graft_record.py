"""`GraftRecord`: provenance as read from a JSON document; the library and files that it names."""

import glob
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Self

from mograft._util.documents import optional, parse_document
from mograft.body.groups import JointGroups
from mograft.config import Config
from mograft.errors import DAMAGE, LibraryError, ProvenanceError, join_names
from mograft.io.bvh.writer import check_digits
from mograft.io.formats import join_address, open_clips, read_clip, recognize_format, split_address
from mograft.library import discover, origin
from mograft.library.clip_table import skeleton_from_json
from mograft.library.ingest_run import IngestOptions
from mograft.library.library import Library
from mograft.motion.motion import Motion
from mograft.provenance.document import SCHEMA
from mograft.search.constraints import Span


@dataclass(frozen=True)
class DonorRecord:
    """The donor of one base segment for one group."""

    group: str
    frames: Span  # of the base segment in the base
    clip: str
    clip_frames: Span
    is_own: bool  # whether the donor is the base segment itself
    cost: float
    alternatives: int  # number of other candidates

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> Self:
        """Read an item of ``substitutions``, or of ``replaced`` in ``edits``."""
        group, clip = str(record["group"]), str(record["clip"])
        frames, clip_frames = as_frames(record["frames"]), as_frames(record["clip_frames"])
        cost, alternatives = float(record.get("cost", 0.0)), int(record.get("alternatives", 0))
        return cls(group, frames, clip, clip_frames, not record["exchanged"], cost, alternatives)


@dataclass(frozen=True, kw_only=True)
class GraftRecord:
    """The provenance of a graft. Made by `read_record`."""

    label: str  # the file, for messages
    folder: Path  # to which paths are relative
    file: Path | None  # the file of the graft, if it holds the provenance
    document: Mapping[str, Any]
    name: str
    base: str
    config: Config
    groups: JointGroups
    library: origin.LibraryOrigin
    clips: tuple[origin.ClipRecord, ...]
    sources: tuple[str, ...]  # files and folders, as typed on the command line
    digits: int | None  # decimals of computed angles in its .bvh file; None: as in the base's
    donors: tuple[DonorRecord, ...]
    edits: tuple[tuple[DonorRecord, ...], ...]  # the donors that each edit replaced

    @property
    def has_own_config(self) -> bool:
        """Whether `config` is that of the document."""
        return Config.from_dict(self.document["config"]) == self.config

    def error(self, message: str) -> ProvenanceError:
        """Return an error that names the document."""
        return ProvenanceError(f"{self.label}: {message}")


def read_record(source: str | PathLike[str] | Mapping[str, Any]) -> GraftRecord:
    """Read the provenance of a graft from a file, or from a document as `Graft.as_dict` returns it.

    Of a file of several grafts, ``path#NAME`` names one. Raise ProvenanceError if it is not the
    provenance of a graft or is damaged, and OSError if the file cannot be read.
    """
    if isinstance(source, Mapping):
        return _parse(source, "document", Path())
    path, name = split_address(fspath(source))
    file = Path(path)
    form = recognize_format(file)
    if form is None or form.name not in ("glTF", "NPZ"):
        is_motion = file.suffix.lower() != ".json" and discover.has_provenance(file)
        return _read_beside(file.with_suffix(".json") if is_motion else file)[0]
    grafts = open_clips(path).grafts
    if name not in grafts and (name is not None or len(grafts) != 1):
        if grafts:
            known, given = next(iter(grafts)), name or "no name"
            raise ProvenanceError(f"{path}: expected a graft, as in {path}#{known}, got {given}")
        raise ProvenanceError(
            f"{path}: expected a graft with its provenance, as mograft graft writes it; no motion "
            "in this file has one: to make new motions of them, give the file without --from"
        )
    return _held_record(file, name or next(iter(grafts)))


def read_clip_record(path: Path, clip: str | None) -> GraftRecord | None:
    """Read the provenance of the clip of a motion file; None if the clip is not a graft.

    `clip` is None for the only clip. If the provenance belongs to another motion, warn and return
    None. Raises as `read_record`.
    """
    address = join_address(str(path), clip)
    if discover.holds_graft(address):
        return _held_record(path, clip or open_clips(str(path)).names[0])
    if not discover.has_provenance(path):
        return None
    record, is_other = _read_beside(path.with_suffix(".json"))
    return None if is_other else record


def _read_beside(file: Path) -> tuple[GraftRecord, bool]:
    """Read the provenance in a JSON file, and whether it belongs to another motion."""
    document = _load(file.read_bytes(), str(file))
    is_other = isinstance(document, Mapping) and discover.warn_of_other_motion(document, file)
    return _parse(document, str(file), file.parent), is_other


def _held_record(path: Path, name: str) -> GraftRecord:
    """Read the provenance that a file holds of the graft with this name."""
    label = f"{path}#{name}"
    return _parse(_load(open_clips(str(path)).grafts[name], label), label, path.parent, path)


def _load(text: str | bytes, label: str) -> Any:  # noqa: ANN401 - of JSON
    try:
        return parse_document(text)
    except ValueError as error:
        raise ProvenanceError(
            f"{label}: expected the JSON file that is written beside a new motion: {error}"
        ) from None


def _parse(
    document: Any,  # noqa: ANN401 - of JSON
    label: str,
    folder: Path,
    file: Path | None = None,
) -> GraftRecord:
    schema = document.get("schema") if isinstance(document, Mapping) else None
    if schema != SCHEMA:
        raise ProvenanceError(
            f"{label}: not the provenance of a graft: `schema` must be {SCHEMA}, got {schema!r}"
        )
    try:
        record = GraftRecord(
            label=label,
            folder=folder,
            file=file,
            document=document,
            name=str(document["name"]),
            base=str(document["base"]),
            config=Config.from_dict(document["config"]),
            groups=JointGroups.from_toml(str(document["groups_toml"]) + "\n"),
            library=_read_library(document["library"], folder),
            clips=tuple(map(origin.ClipRecord.from_json, document["clips"])),
            sources=tuple(map(str, document["request"]["sources"])),
            digits=optional(check_digits, document.get("digits")),
            donors=tuple(map(DonorRecord.from_json, document["substitutions"])),
            edits=tuple(
                tuple(map(DonorRecord.from_json, edit["replaced"])) for edit in document["edits"]
            ),
        )
        if not record.donors:
            raise ValueError("`substitutions` is empty")
    except DAMAGE as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise ProvenanceError(f"{label}: damaged: {reason}") from error
    return record


def _read_library(record: Mapping[str, Any], folder: Path) -> origin.LibraryOrigin:
    path = optional(str, record["folder"])
    return origin.LibraryOrigin(
        folder=None if path is None else folder / path,
        sha256=str(record["sha256"]),
        n_clips=int(record["clips"]),
        is_mirrored=bool(record["is_mirrored"]),
        rate=float(record["rate"]),
        root=int(record["root"]),
        up=int(record["up"]),
        match=record["match"],
        hierarchy=optional(skeleton_from_json, record["hierarchy"]),
        rest=optional(skeleton_from_json, record["rest"]),
    )


def as_frames(value: Sequence[Any]) -> Span:
    """Return the first and last frame of a document as integers."""
    first, last = value
    return int(first), int(last)


@dataclass(frozen=True, eq=False)
class RecordedLibrary:
    """The library of a graft, with its base."""

    library: Library
    base: int | None  # index of the base; None if it is composed of segments
    clips: Mapping[str, int]  # index of each clip that may provide donors, by name

    def find_segment(self, record: GraftRecord, name: str, frames: Span) -> int:
        """Return the index of a segment of a clip; raise ProvenanceError if there is none."""
        if name not in self.clips:
            raise record.error(f"the library has no clip {name!r}")
        own = self.library.segments.of_clip(self.clips[name])
        cut = self.library.segments[own]
        found = own[(cut.start == frames[0]) & (cut.stop == frames[1])]
        if not len(found):
            raise record.error(f"{name} has no segment {frames[0]}-{frames[1]}")
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
        return _with_base(record, _prepare_library(record, library, "`library`"), sources)
    problem, folder = "", record.library.folder
    if folder is not None:
        try:
            library = _prepare_library(record, Library.open(folder), str(folder))
            return _with_base(record, library, sources)
        except OSError as error:
            problem = f"{folder}: {error.strerror}; "
        except (LibraryError, ProvenanceError) as error:
            problem = str(error).removeprefix(f"{record.label}: ") + "; "
    try:
        return _partial_library(record, sources)
    except ProvenanceError as error:
        reason = str(error).removeprefix(f"{record.label}: ")
        raise record.error(problem + reason) from error


def find_whole_library(record: GraftRecord, sources: Sequence[str]) -> Library:
    """Return the library of a graft with all its clips: the stored one, or one built from files.

    The files are `sources` or, by default, those of the recorded command line. Raise
    ProvenanceError if a file is missing or the library is another one, and LibraryError or OSError
    if the stored library cannot be opened.
    """
    recorded = record.library
    if recorded.folder is not None and not sources:
        return _prepare_library(record, Library.open(recorded.folder), str(recorded.folder))
    names = [_present_source(record, own) for own in sources or record.sources]
    if not names:
        raise record.error("the graft was made without files: give its library, or all clips of it")
    options: IngestOptions = {
        "match": recorded.match,
        "hierarchy": recorded.hierarchy,
        "skeleton": recorded.rest,
    }
    strict = not any(Path(name).is_dir() for name in names)
    library = Library.build(names, record.groups, record.config, strict=strict, **options)
    if origin.hash_library(library) != recorded.sha256 and not strict:
        # The graft may have been made with --include-grafts.
        options["include_grafts"] = True
        library = Library.build(names, record.groups, record.config, strict=strict, **options)
    return _prepare_library(record, library, f"the library of {join_names(names)}")


def _present_source(record: GraftRecord, source: str) -> str:
    """Return the address at which a file or folder of the recorded command line is now."""
    path, pattern = split_address(source)
    name = Path(path).name
    clip = next((own for own in record.clips if own.file and Path(own.file).name == name), None)
    if Path(path).exists() or glob.has_magic(path):
        return source
    # The command was typed in another folder: a clip of the graft lies in the folder, or is it.
    parts = tuple(own for own in Path(os.path.normpath(path)).parts if own != os.pardir)
    for file in (own.file for own in record.clips if own.file and parts):
        place = Path(os.path.abspath(record.folder / file))
        for own in (place, *place.parents):
            if own.parts[-len(parts) :] == parts and own.exists():
                return join_address(str(own), pattern)
    if clip is None:
        raise record.error(f"{source} is missing: give the library, or all of its files")
    return join_address(_find_file(record, clip, ()), pattern)


def _with_base(record: GraftRecord, library: Library, sources: Sequence[str]) -> RecordedLibrary:
    """Return `library`, which has all its clips, and the base if it is not one of them."""
    n_clips = origin.n_library_clips(library)
    clips = {info.name: index for index, info in enumerate(library.entries[:n_clips])}
    outside = [clip for clip in record.clips if clip.is_base and not clip.is_in_library]
    if record.document["scenario"] is not None:
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


def _prepare_library(record: GraftRecord, library: Library, label: str) -> Library:
    """Return `library` with the mirror images and the configuration of a graft.

    Raise ProvenanceError if `library` has another SHA-256 than the library of the graft.
    """
    expected = record.library
    found = origin.hash_library(library)
    if found != expected.sha256:
        raise record.error(
            f"{label} is another library: SHA-256 {found}, expected {expected.sha256}"
        )
    if expected.is_mirrored and not origin.is_mirrored(library):
        library = library.with_mirror_images()
    return library if library.config == record.config else library.relabelled(record.config)


def find_clip(record: GraftRecord, clip: origin.ClipRecord, sources: Iterable[str]) -> str:
    """Return the address of a clip, after comparing the SHA-256 of its file; see `_find_file`."""
    return join_address(_find_file(record, clip, sources), clip.clip)


def read_motion(
    values: Mapping[str, Any], record: GraftRecord, sources: Iterable[str] = ()
) -> Motion:
    """Read the motion of a `Character`, an obstacle that a constraint of a graft names."""
    clip = origin.ClipRecord.from_json(values)
    return replace(read_clip(find_clip(record, clip, sources)), name=clip.name)


def _find_file(record: GraftRecord, clip: origin.ClipRecord, sources: Iterable[str]) -> str:
    """Return the path of the file of a clip, after comparing its SHA-256.

    Raise ProvenanceError if there is no such file, or if it has changed.
    """
    if clip.file is None:
        raise record.error(f"clip {clip.name} is not from a file; give the library that holds it")
    changed = ""
    for path in _possible_paths(record, clip.file, sources):
        if not path.is_file():
            continue
        found = discover.SourceFile.from_path(str(path), clip.clip).sha256
        if found == clip.sha256:
            return str(path)
        changed = changed or f"{path} has changed: SHA-256 {found}, expected {clip.sha256}"
    raise record.error(changed or f"{record.folder / clip.file} is missing: give its new path")


def _possible_paths(record: GraftRecord, file: str, sources: Iterable[str]) -> Iterable[Path]:
    yield record.folder / file
    if record.file is not None:  # a copy of the file, which has its clips
        yield record.file
    name = Path(file).name
    for address in [*sources, *record.sources]:
        source, _ = split_address(address)
        if Path(source).is_dir():
            yield from (path for path in discover.scan_folder(source) if path.name == name)
        elif Path(source).name == name:
            yield Path(source)


def _partial_library(record: GraftRecord, sources: Sequence[str]) -> RecordedLibrary:
    """Return a library of only the clips of a graft, read from their files."""
    addresses = [find_clip(record, clip, sources) for clip in record.clips]
    library = origin.build_partial_library(
        Library, record.clips, addresses, record.groups, record.config, record.library
    )
    bases = [index for index, clip in enumerate(record.clips) if clip.is_base]
    base = bases[0] if bases and record.document["scenario"] is None else None
    members = {clip.name: i for i, clip in enumerate(record.clips) if clip.is_in_library}
    return RecordedLibrary(library, base, members)
