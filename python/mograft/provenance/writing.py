"""Write motions and grafts to files, and beside grafts their provenance."""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft._util.atomic import atomic_path, write_bytes, write_text
from mograft._util.signals import delay_signals
from mograft._util.validate import check_type
from mograft.errors import suggest_name
from mograft.io.bvh.writer import check_digits, write_bvh
from mograft.io.character import open_character
from mograft.io.csv import write_csv
from mograft.io.formats import open_clips
from mograft.io.glb import Json, bone_figure, write_glb
from mograft.io.gltf.document import GltfFile, read_gltf_file
from mograft.io.gltf.grafts import find_original, provenance, with_provenance
from mograft.io.gltf.writer import Addition, append_animations, fit_motion, has_duration
from mograft.io.npz import write_npz
from mograft.io.robots.tables import write_table
from mograft.io.smpl.amass import write_amass
from mograft.io.usd import write_usd
from mograft.library.discover import MOTION_HASH, SourceFile
from mograft.library.origin import find_clip_origin
from mograft.motion.motion import Motion
from mograft.provenance.document import graft_record, move_record
from mograft.synthesis.graft_result import Graft


def _write_csv(motion: Motion, path: Path) -> None:
    """Write joint angles of a robot, else world positions of the joints."""
    (write_csv if motion.skeleton.hinges is None else write_table)(motion, path)


WRITERS: dict[str, Callable[[Motion, Path], object]] = {
    ".bvh": write_bvh,
    ".csv": _write_csv,
    ".glb": write_glb,
    ".npz": write_npz,
    ".usd": write_usd,
    ".usda": write_usd,
    ".usdc": write_usd,
}
"""The writer of each ending of a file name."""

MOTION_SUFFIXES = (".bvh", ".csv", ".glb", ".npz")
"""Endings of the names of files that hold the motions of grafts; ``.csv`` is for robots."""


def write(item: Motion | Graft, path: str | PathLike[str], *, force: bool = False) -> None:
    """Write a motion or graft in the format that the ending of the file name tells.

    Parameters
    ----------
    item : Motion or Graft
        The motion, or a graft, whose provenance is also written; see `write_graft`.
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
    motion = item.motion if isinstance(item, Graft) else item
    is_world = ending == ".csv" and motion.skeleton.hinges is None
    holds_graft = isinstance(item, Graft) and ending in MOTION_SUFFIXES and not is_world
    for file in files_of_graft(target) if holds_graft else [target]:
        if file.exists() and not force:
            raise FileExistsError(f"{file} exists: use another name, or force=True to replace it")
    if isinstance(item, Graft) and holds_graft:
        write_graft(item, target)
    else:
        WRITERS[ending](motion, target)


def files_of_graft(path: Path) -> list[Path]:
    """Return the files that `write_graft` writes: a ``.glb`` file holds the provenance."""
    is_beside = path.suffix.lower() in (".bvh", ".csv", ".npz")
    return [path, path.with_suffix(".json")] if is_beside else [path]


def write_graft(
    graft: Graft | Sequence[Graft],
    path: str | PathLike[str],
    sections: Sequence[Mapping[str, Any]] = (),
    *,
    digits: int | None = None,
    update: bool = False,
    force: bool = False,
    character: str | PathLike[str] | None = None,
) -> tuple[str, ...]:
    """Write the motions of grafts, and the provenance from which `replay` remakes them.

    A ``.glb`` file is a copy of the glTF or FBX file of the bases, to which the motions are added
    as animations; see `write_glb_animations`. Without such a file, it shows bones. The provenance
    is in ``extras`` of the animations. An ``.npz`` file has the arrays of `write_npz`, which
    include the provenance. For one graft with a base from AMASS, it is a copy of the file of the
    base with this motion in place of the base's; see `write_amass`.

    Parameters
    ----------
    graft : Graft or sequence of Graft
        The graft; for a ``.glb`` or ``.npz`` file also several grafts.
    path : path
        The ``.bvh``, ``.glb`` or ``.npz`` file; for a robot also a ``.csv`` file of joint angles in
        the layout of the base. Existing files are overwritten. The provenance of a ``.bvh`` file, a
        ``.csv`` file and of a copy of an AMASS file has the same name with the ending ``.json``.
    sections : sequence of mapping of str to JSON values, optional
        Further keys of the provenance of each graft, such as measures of the motion.
    digits : int, optional
        Decimals of computed angles in a ``.bvh`` file; see `write_bvh`. The provenance contains it.
    update : bool
        Whether to add the animations to an existing ``.glb`` file. An animation takes the place of
        a graft with its name, and all other content of the file stays as it is.
    force : bool
        With `update`, whether to replace also an animation that is not a graft.
    character : path, optional
        The glTF file of which a new ``.glb`` file is a copy. Default: that of the bases.

    Returns
    -------
    tuple of str
        The names that the motions have in the file.

    Raises
    ------
    ValueError
        If `path` has another ending; if `digits` is not an integer from 1 to 12; if there is no
        graft, or several for a ``.bvh`` file; or if the bases are from several glTF or FBX files.
    FileExistsError
        If an animation with the name of a graft is not a graft, and `force` is false.
    SkeletonMismatchError
        If the motion has other joints or another rest pose than the file of `update` or
        `character`.
    OSError
        If a file cannot be read or written.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import mograft as mg
    >>> from mograft.dancer import dance
    >>> library = mg.Library.build(dance(strides=1).motion)
    >>> with TemporaryDirectory() as folder:
    ...     _ = mg.write_graft(mg.graft(library, seed=7), f"{folder}/new.bvh")
    ...     mg.replay(f"{folder}/new.json", library)
    Graft(dance_graft0: 196 of 197 parts exchanged)
    """
    grafts = [graft] if isinstance(graft, Graft) else list(graft)
    for own in grafts:
        check_type("graft", own, Graft)
    digits = None if digits is None else check_digits(digits)
    target = Path(fspath(path))
    suffix = target.suffix.lower()
    if suffix not in MOTION_SUFFIXES:
        raise ValueError(f"`path` must end with {', '.join(MOTION_SUFFIXES)}, got {target.name}")
    n = len(grafts)
    if suffix == ".csv" and any(own.motion.skeleton.hinges is None for own in grafts):
        raise ValueError(f"`path` may end with .csv only for a robot, got {target.name}")
    if n != 1 and (suffix in (".bvh", ".csv") or not grafts):
        raise ValueError(f"`graft` must be one graft, for .glb and .npz one or more, got {n}")
    if update and suffix != ".glb":
        raise ValueError(f"`path` must be a .glb file with `update`, got {target.name}")
    documents = [
        {"mograft": VERSION, **graft_record(own, target.parent), "digits": digits, **extra}
        for own, extra in zip(grafts, sections or [{}] * n, strict=True)
    ]
    texts = [json.dumps(own) for own in documents]
    if suffix == ".glb":
        given = target if update else None if character is None else Path(fspath(character))
        file = _find_character(grafts, target) if given is None else read_gltf_file(given)
        if update and not force:
            _refuse_captured(file, grafts)
        file = _move_provenance(file, target.parent)
        pairs = zip(grafts, texts, strict=True)
        additions = [_addition(file, *pair, is_copy=given is None) for pair in pairs]
        names, data = append_animations(file, additions, is_update=update)
        write_bytes(target, data)
        return names
    like = _base_file(grafts[0], "AMASS") if suffix == ".npz" and n == 1 else None
    if suffix == ".npz" and like is None:
        write_npz([own.motion for own in grafts], target, provenance=texts)
        return tuple(own.motion.name for own in grafts)
    # The provenance comes first: an interruption then leaves no motion without it.
    with delay_signals(), atomic_path(target) as draft:
        if like is not None:
            write_amass(grafts[0].motion, draft, like=like.path)
        elif suffix == ".csv":
            write_table(grafts[0].motion, draft)
        else:
            write_bvh(grafts[0].motion, draft, digits=digits)
        known = {MOTION_HASH: SourceFile.from_path(str(draft)).sha256}
        text = json.dumps({**documents[0], **known}, indent=1)
        write_text(target.with_suffix(".json"), f"{text}\n")
    return (grafts[0].motion.name,)


def _find_character(grafts: Sequence[Graft], target: Path) -> GltfFile:
    """Return the file to which animations are added: that of the bases, or their bones.

    `target` is the file to write. Raises ValueError if the bases are from several files.
    """
    files = [_base_file(own, "glTF", "FBX") for own in grafts]
    paths = list(dict.fromkeys(own.path for own in files if own is not None))
    if len(paths) > 1:
        found = ", ".join(paths)
        raise ValueError(f"all bases must be from one glTF file for {target.name}, got {found}")
    if files[0] is not None and files[0].format == "glTF":
        return read_gltf_file(Path(paths[0]))
    figure = open_character(Path(paths[0])) if paths else None
    return figure or read_gltf_file(target, bone_figure(grafts[0].base))


def _refuse_captured(file: GltfFile, grafts: Sequence[Graft]) -> None:
    """Raise FileExistsError if an animation with the name of a graft is not a graft."""
    animations = file.container.items("animations")
    captured = [own.get("name") for own in animations if provenance(own) is None]
    for graft in grafts:
        if graft.motion.name in captured:
            raise FileExistsError(
                f"{file.container.path} has an animation {graft.motion.name} that mograft did not "
                "write; choose another name (--as), or replace it with --force (force=True)"
            )


def _addition(file: GltfFile, graft: Graft, text: str, *, is_copy: bool) -> Addition:
    """Return the motion of a graft, with its base if this is the motion of a clip of the file."""
    origin = find_clip_origin(graft.library, _base_clips(graft)[0])
    source, base, clip = origin.source_file, graft.base, None
    is_own = source is not None and find_original(file.container).sha256 == source.sha256
    is_same = is_own or (is_copy and source is not None and source.format == "FBX")
    if source is not None and is_same and not (graft.scenario or origin.is_mirrored):
        clip = _find_clip(file, source.clip)
    motion = graft.motion if is_own else fit_motion(file, graft.motion)
    # A base whose frame rate was corrected has another duration than the clip.
    if clip is None or not has_duration(file, clip, base):
        return Addition(motion, provenance=text)
    return Addition(motion, base if is_own else fit_motion(file, base), clip, text)


def _find_clip(file: GltfFile, name: str | None) -> int:
    """Return the index of a clip of a file; without a name, that of the only captured one."""
    items = [file.container.items("animations")[index] for index in file.animations]
    return file.clip_names.index(name) if name else [*map(provenance, items)].index(None)


def write_character(
    character: GltfFile, motions: Sequence[Motion], path: Path, *, keeps_animations: bool
) -> None:
    """Write a character with motions as animations, and with its own if `keeps_animations`.

    A motion of the file of the character keeps its tracks. Raises SkeletonMismatchError if a motion
    has other joints or another rest pose than the character, and OSError if the file cannot be
    written.
    """
    file = _move_provenance(character, path.parent)
    additions = []
    for motion in motions:
        fitted, name = fit_motion(file, motion), motion.clip or motion.name
        is_own = motion.path == file.container.path and name in file.clip_names
        clip = file.clip_names.index(name) if is_own else None
        text = _find_provenance(motion, path.parent)
        is_kept = clip is not None and has_duration(file, clip, motion)
        base, clip = (fitted, clip) if is_kept else (None, None)
        additions.append(Addition(fitted, base, clip, text))
    kept: list[Json] | None = None if keeps_animations else []
    write_bytes(path, append_animations(file, additions, kept=kept)[1])


def _find_provenance(motion: Motion, folder: Path) -> str | None:
    """Return the provenance that the file of a motion has, with paths relative to a folder."""
    clips = None if motion.path is None else open_clips(str(motion.path))
    name = motion.clip or (clips.names[0] if clips else "")
    text = None if clips is None else clips.grafts.get(name)
    return None if clips is None or text is None else _move(text, clips.path.parent, folder)


def _move(text: str, old: Path, new: Path) -> str:
    """Return provenance with paths relative to another folder; damaged one unchanged."""
    with suppress(ValueError, RecursionError):
        return json.dumps(move_record(json.loads(text), old, new))
    return text


def _move_provenance(file: GltfFile, folder: Path) -> GltfFile:
    """Return a file in which the provenance of grafts has paths relative to another folder."""
    old = file.container.path.parent
    if old.resolve() == folder.resolve():
        return file

    animations = [
        with_provenance(own, _move(text, old, folder)) if (text := provenance(own)) else own
        for own in file.container.items("animations")
    ]
    document = {**file.container.document, "animations": animations}
    return replace(file, container=replace(file.container, document=document))


def _base_file(graft: Graft, *formats: str) -> SourceFile | None:
    """Return the first file of some formats from which a base was read; None without one."""
    origins = (find_clip_origin(graft.library, clip) for clip in _base_clips(graft))
    files = (origin.source_file for origin in origins)
    return next((file for file in files if file is not None and file.format in formats), None)


def _base_clips(graft: Graft) -> list[int]:
    """Return the clips of the base segments in the order of the motion, each once."""
    clips = graft.library.segments.clip[[own.segment for own in graft.substitutions]]
    return list(dict.fromkeys(clips.tolist()))
