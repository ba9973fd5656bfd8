"""`GraftRecord`: the provenance of a graft as read from a JSON document."""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Self

from mograft.body.groups import JointGroups
from mograft.config import Config
from mograft.errors import DAMAGE, ProvenanceError, join_names
from mograft.io.bvh.writer import check_digits
from mograft.library.clip_table import skeleton_from_json
from mograft.library.origin import LibraryOrigin
from mograft.motion.skeleton import Skeleton
from mograft.provenance.document import SCHEMA, SEVERAL_SCHEMA
from mograft.search.constraints import Span


@dataclass(frozen=True, kw_only=True)
class ClipRecord:
    """A clip of which a graft is made."""

    name: str
    file: str | None  # relative to the folder of the document
    clip: str | None  # name in the file, if the file holds several clips
    sha256: str | None
    is_base: bool
    is_mirrored: bool
    is_in_library: bool
    true_rate: float | None
    licence: str | None

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> Self:
        """Read an item of ``clips``, or the file of the motion of a `Character`."""
        rate = record.get("true_rate")
        return cls(
            name=str(record["name"]),
            file=_optional_str(record["file"]),
            clip=_optional_str(record["clip"]),
            sha256=_optional_str(record["sha256"]),
            is_base="base" in record.get("roles", ()),
            is_mirrored=bool(record.get("is_mirrored")),
            is_in_library=bool(record.get("is_in_library")),
            true_rate=None if rate is None else float(rate),
            licence=_optional_str(record.get("licence")),
        )


@dataclass(frozen=True)
class SegmentRecord:
    """A segment by its clip and frames."""

    clip: str
    frames: Span

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> Self:
        """Read a JSON object with ``clip`` and ``clip_frames``."""
        return cls(str(record["clip"]), _span(record["clip_frames"]))


@dataclass(frozen=True)
class DonorRecord:
    """The donor of one base segment for one group."""

    group: str
    frames: Span  # of the base segment in the base
    donor: SegmentRecord
    is_own: bool  # whether the donor is the base segment itself
    cost: float
    alternatives: int  # number of other candidates

    @classmethod
    def from_json(cls, record: Mapping[str, Any]) -> Self:
        """Read an item of ``substitutions``, or of ``replaced`` in ``edits``."""
        return cls(
            str(record["group"]),
            _span(record["frames"]),
            SegmentRecord.from_json(record),
            not record["exchanged"],
            float(record.get("cost", 0.0)),
            int(record.get("alternatives", 0)),
        )


@dataclass(frozen=True, kw_only=True)
class GraftRecord:
    """The provenance of a graft. Made by `read_record`."""

    label: str  # the file, for messages
    folder: Path  # to which paths are relative
    document: Mapping[str, Any]
    name: str
    base: str
    seed: int
    index: int
    poses_sha256: str
    config: Config
    groups: JointGroups
    library: LibraryOrigin
    clips: tuple[ClipRecord, ...]
    sources: tuple[str, ...]  # files and folders, as typed on the command line
    donors: tuple[DonorRecord, ...]
    edits: tuple[tuple[DonorRecord, ...], ...]  # the donors that each edit replaced

    @property
    def digits(self) -> int | None:
        """Decimals of the computed angles of its .bvh file; None are those of the base's file."""
        digits = self.document.get("digits")
        try:
            return None if digits is None else check_digits(digits)
        except ValueError as error:
            raise self.error(f"damaged: {error}") from None

    @property
    def scenario(self) -> Mapping[str, Any] | None:
        """The segments that compose the base, as JSON; None if the base is a clip."""
        return self.document["scenario"]

    def error(self, message: str) -> ProvenanceError:
        """Return an error that names the document."""
        return ProvenanceError(f"{self.label}: {message}")


def read_record(source: str | PathLike[str] | Mapping[str, Any]) -> GraftRecord:
    """Read the provenance of a graft from a file, or from a document as `Graft.as_dict` returns it.

    Of a file with the provenance of several grafts, ``path#NAME`` names one. Raise ProvenanceError
    if it is not the provenance of a graft or is damaged, and OSError if the file cannot be read.
    """
    if isinstance(source, Mapping):
        return _parse(source, "document", Path())
    address, _, name = fspath(source).rpartition("#")
    if not address or os.path.exists(source):
        address, name = fspath(source), ""
    path = Path(address)
    grafts = _read_documents(path)
    names = [str(own.get("name")) for own in grafts]
    if name and names.count(name) == 1:
        return _parse(grafts[names.index(name)], address, path.parent)
    if name or len(grafts) > 1:
        raise ProvenanceError(
            f"{path}: expected the name of a graft, as in {path}#{names[0]}, one of "
            f"{join_names(names)}; got {name or 'none'}"
        )
    return _parse(grafts[0], address, path.parent)


def read_clip_record(path: Path, clip: str | None) -> GraftRecord | None:
    """Read the provenance beside a motion file; None if the clip of the file is not a graft.

    `clip` is None for the only clip. Raises as `read_record`.
    """
    source = path.with_suffix(".json")
    for document in _read_documents(source):
        if clip is None or document.get("animation", clip) == clip:
            return _parse(document, str(source), source.parent)
    return None


def _read_documents(path: Path) -> list[Mapping[str, Any]]:
    """Return the documents of all grafts in a file: at least one object."""
    try:
        document = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise ProvenanceError(f"{path}: not a JSON document: {error}") from None
    grafts = [document]
    if isinstance(document, Mapping) and document.get("schema") == SEVERAL_SCHEMA:
        grafts = document.get("grafts", [])
    if not isinstance(grafts, list) or not grafts:
        raise ProvenanceError(f"{path}: damaged: `grafts` must be a list of objects")
    return [own if isinstance(own, Mapping) else {} for own in grafts]


def _parse(document: Any, label: str, folder: Path) -> GraftRecord:  # noqa: ANN401 - of JSON
    schema = document.get("schema") if isinstance(document, Mapping) else None
    if schema != SCHEMA:
        raise ProvenanceError(
            f"{label}: not the provenance of a graft: `schema` must be {SCHEMA}, got {schema!r}"
        )
    try:
        return _record(document, label, folder)
    except DAMAGE as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise ProvenanceError(f"{label}: damaged: {reason}") from error


def _record(document: Mapping[str, Any], label: str, folder: Path) -> GraftRecord:
    donors = tuple(DonorRecord.from_json(own) for own in document["substitutions"])
    if not donors:
        raise ValueError("`substitutions` is empty")
    return GraftRecord(
        label=label,
        folder=folder,
        document=document,
        name=str(document["name"]),
        base=str(document["base"]),
        seed=int(document["seed"]),
        index=int(document["index"]),
        poses_sha256=str(document["poses_sha256"]),
        config=Config.from_dict(document["config"]),
        groups=JointGroups.from_toml(str(document["groups_toml"]) + "\n"),
        library=_read_library(document["library"], folder),
        clips=tuple(ClipRecord.from_json(own) for own in document["clips"]),
        sources=tuple(str(own) for own in document["request"]["sources"]),
        donors=donors,
        edits=tuple(
            tuple(DonorRecord.from_json(own) for own in edit["replaced"])
            for edit in document["edits"]
        ),
    )


def _read_library(record: Mapping[str, Any], folder: Path) -> LibraryOrigin:
    path = _optional_str(record["folder"])
    return LibraryOrigin(
        folder=None if path is None else folder / path,
        sha256=str(record["sha256"]),
        n_clips=int(record["clips"]),
        is_mirrored=bool(record["is_mirrored"]),
        rate=float(record["rate"]),
        root=int(record["root"]),
        up=int(record["up"]),
        match=record["match"],
        hierarchy=_optional_skeleton(record["hierarchy"]),
        rest=_optional_skeleton(record["rest"]),
    )


def _optional_skeleton(value: Any) -> Skeleton | None:  # noqa: ANN401 - of JSON
    return None if value is None else skeleton_from_json(value)


def _span(value: Sequence[Any]) -> Span:
    first, last = value
    return int(first), int(last)


def _optional_str(value: Any) -> str | None:  # noqa: ANN401 - of JSON
    return None if value is None else str(value)
