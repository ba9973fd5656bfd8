"""Write motions and grafts to files, and beside grafts their provenance."""

from collections.abc import Callable, Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft._util.atomic import atomic_path, write_json
from mograft._util.signals import delay_signals
from mograft._util.validate import check_type
from mograft.errors import suggest_name
from mograft.io.bvh.writer import check_digits, write_bvh
from mograft.io.csv import write_csv
from mograft.io.glb import write_glb
from mograft.io.gltf.document import GltfFile, read_gltf_file
from mograft.io.gltf.writer import Addition, append_animations, has_duration
from mograft.io.npz import write_npz
from mograft.io.smpl.amass import write_amass
from mograft.io.usd import write_usd
from mograft.library.discover import MOTION_HASH, SourceFile
from mograft.library.origin import find_clip_origin
from mograft.motion.motion import Motion
from mograft.provenance.document import SEVERAL_SCHEMA, graft_record
from mograft.synthesis.graft_result import Graft

WRITERS: dict[str, Callable[[Motion, Path], object]] = {
    ".bvh": write_bvh,
    ".csv": write_csv,
    ".glb": write_glb,
    ".npz": write_npz,
    ".usd": write_usd,
    ".usda": write_usd,
    ".usdc": write_usd,
}
"""The writer of each ending of a file name."""

Sections = Mapping[str, Any]

_COPIED_FORMATS = {".glb": "glTF", ".npz": "AMASS"}
"""By ending, the format of the file of a base of which the file of a graft is a copy."""

MOTION_SUFFIXES = (".bvh", *_COPIED_FORMATS)
"""Endings of the names of files that hold the motions of grafts."""


def write(item: Motion | Graft, path: str | PathLike[str], *, force: bool = False) -> None:
    """Write a motion or graft in the format that the ending of the file name tells.

    Parameters
    ----------
    item : Motion or Graft
        The motion, or a graft. Beside the ``.bvh`` file of a graft, and beside its ``.glb`` or
        ``.npz`` file if the base came from such a file, stands its provenance, `NAME.json`; see
        `write_graft`.
    path : path
        The file: ``.bvh``, ``.glb``, ``.npz``, ``.csv``, ``.usd``, ``.usda`` or ``.usdc``.
    force : bool
        Whether to replace existing files.

    Raises
    ------
    FileExistsError
        If the file, or the provenance beside it, exists and `force` is false.
    TypeError
        If `item` is neither a `Motion` nor a `Graft`.
    ValueError
        If the ending is another; further errors as of the writer in `mograft.formats`.
    OSError
        If the file cannot be written.

    See Also
    --------
    mograft.formats : The writers with their options, such as the unit of length.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import mograft as mg
    >>> from mograft.dancer import dance
    >>> motion = dance(strides=1).motion
    >>> with TemporaryDirectory() as folder:
    ...     mg.write(motion, f"{folder}/dance.bvh")
    ...     mg.read(f"{folder}/dance.bvh")[0].n_frames == motion.n_frames
    True
    """
    target = Path(fspath(path))
    ending = target.suffix.lower()
    if not isinstance(item, Motion | Graft):
        raise TypeError(f"`item` must be a Motion or a Graft, got {type(item).__name__}")
    if ending not in WRITERS:
        hint = suggest_name(ending, WRITERS)
        raise ValueError(f"`path` must end with {', '.join(WRITERS)}, got {target.name}{hint}")
    form = _COPIED_FORMATS.get(ending)
    has_provenance = isinstance(item, Graft) and (
        ending == ".bvh" or _base_file(item, form) is not None
    )
    for file in [target, target.with_suffix(".json")] if has_provenance else [target]:
        if file.exists() and not force:
            raise FileExistsError(f"{file} exists: use another name, or force=True to replace it")
    if isinstance(item, Graft) and has_provenance:
        write_graft(item, target)
    else:
        WRITERS[ending](item.motion if isinstance(item, Graft) else item, target)


def write_graft(
    graft: Graft | Sequence[Graft],
    path: str | PathLike[str],
    sections: Sections | Sequence[Sections] | None = None,
    *,
    digits: int | None = None,
) -> None:
    """Write the motion of a graft, and a file with the provenance from which `replay` remakes it.

    A ``.glb`` file is a copy of the glTF file of the base to which the motion is added; see
    `write_glb_animations`. An ``.npz`` file is a copy of the AMASS file of the base with
    this motion in place of the base's; see `write_amass`.

    Parameters
    ----------
    graft : Graft or sequence of Graft
        The graft; for a ``.glb`` file also several grafts with bases from one file.
    path : path
        The ``.bvh``, ``.glb`` or ``.npz`` file. The provenance has the same name with the ending
        ``.json``. Existing files are overwritten.
    sections : mapping of str to JSON values, or a sequence of them, optional
        Further keys of the provenance of each graft, such as measures of the motion.
    digits : int, optional
        Decimals of computed angles in a ``.bvh`` file; see `write_bvh`. The provenance contains it.

    Raises
    ------
    ValueError
        If `path` has another ending; if `digits` is not an integer from 1 to 12; if there is no
        graft, or several and `path` is not a ``.glb`` file; or if `path` is a ``.glb`` or ``.npz``
        file, and the bases are not from one glTF or AMASS file.
    OSError
        If a file cannot be written, or the glTF file cannot be read.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import mograft as mg
    >>> from mograft.dancer import dance
    >>> library = mg.Library.build(dance(strides=1).motion)
    >>> with TemporaryDirectory() as folder:
    ...     mg.write_graft(mg.graft(library, seed=7), f"{folder}/new.bvh")
    ...     mg.replay(f"{folder}/new.json", library)
    Graft(dance_graft0: 195 of 197 parts exchanged)
    """
    target = Path(fspath(path))
    digits = None if digits is None else check_digits(digits)
    grafts = [graft] if isinstance(graft, Graft) else list(graft)
    for own in grafts:
        check_type("graft", own, Graft)
    suffix = target.suffix.lower()
    if suffix not in MOTION_SUFFIXES:
        raise ValueError(f"`path` must end with {', '.join(MOTION_SUFFIXES)}, got {target.name}")
    is_glb, n = suffix == ".glb", len(grafts)
    if n != 1 and not (is_glb and grafts):
        raise ValueError(f"`graft` must be one graft, for a .glb file one or more, got {n}")
    if sections is None or isinstance(sections, Mapping):
        sections = [sections or {}] * len(grafts)
    documents = [
        {"mograft": VERSION, **graft_record(own, target.parent), "digits": digits, **extra}
        for own, extra in zip(grafts, sections, strict=True)
    ]
    files = [] if suffix == ".bvh" else [_copied_file(own, target) for own in grafts]
    if is_glb:
        names, data = _add_animations(grafts, files, target)
        documents = [{**own, "animation": name} for own, name in zip(documents, names, strict=True)]
    # The provenance comes first: an interruption then leaves no motion without it.
    with delay_signals(), atomic_path(target) as draft:
        if is_glb:
            draft.write_bytes(data)
        elif files:
            write_amass(grafts[0].motion, draft, like=files[0])
        else:
            write_bvh(grafts[0].motion, draft, digits=digits)
        known = {MOTION_HASH: SourceFile.from_path(str(draft)).sha256}
        documents = [{**own, **known} for own in documents]
        several = {"schema": SEVERAL_SCHEMA, "mograft": VERSION, **known, "grafts": documents}
        write_json(target.with_suffix(".json"), documents[0] if len(documents) == 1 else several)


def _copied_file(graft: Graft, target: Path) -> str:
    """Return the file of the base that `target` copies; raise ValueError if there is none."""
    ending = target.suffix.lower()
    form = _COPIED_FORMATS[ending]
    file = _base_file(graft, form)
    if file is None:
        raise ValueError(
            f"{target.name} must be a .bvh file: the base {graft.base.name} is not from {form}; to "
            f"write a new {ending} file, use mograft export"
        )
    return file.path


def _add_animations(
    grafts: Sequence[Graft], files: Sequence[str], path: Path
) -> tuple[tuple[str, ...], bytes]:
    """Return the names of the animations of grafts, and the copy of a file that has them.

    `files` are the glTF files of the bases; `path` is the one to write. Joints that a graft does
    not change keep the tracks of its base, if the base is a clip of the file. Raises ValueError if
    the bases are not from one file.
    """
    paths = list(dict.fromkeys(files))
    if len(paths) > 1:
        found = ", ".join(paths)
        raise ValueError(f"all bases must be from one glTF file for {path.name}, got {found}")
    source = read_gltf_file(Path(paths[0]))
    return append_animations(source, [_addition(source, graft) for graft in grafts])


def _base_file(graft: Graft, form: str | None) -> SourceFile | None:
    """Return the first file of a format from which a base was read; None without one."""
    origins = (find_clip_origin(graft.library, clip) for clip in _base_clips(graft))
    files = (origin.source_file for origin in origins)
    return next((file for file in files if file is not None and file.format == form), None)


def _base_clips(graft: Graft) -> list[int]:
    """Return the clips of the base segments in the order of the motion, each once."""
    clips = graft.library.segments.clip[[own.segment for own in graft.substitutions]]
    return list(dict.fromkeys(clips.tolist()))


def _addition(file: GltfFile, graft: Graft) -> Addition:
    """Return the motion of a graft, with its base if this is the motion of a clip of the file."""
    origin = find_clip_origin(graft.library, _base_clips(graft)[0])
    source = origin.source_file
    if graft.scenario or origin.is_mirrored or source is None:
        return Addition(graft.motion)
    clip = 0 if source.clip is None else file.clip_names.index(source.clip)
    # A base whose frame rate was corrected has another duration than the clip.
    if not has_duration(file, clip, graft.base):
        return Addition(graft.motion)
    return Addition(graft.motion, graft.base, clip)
