"""The files, libraries and clips that commands read, and the files that they may write."""

import glob
import os
import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path

from mograft import Library, Motion
from mograft._util.names import find_matches
from mograft.cli.syntax.arguments import UsageError
from mograft.cli.syntax.values import Range, resolve_frames
from mograft.errors import join_names, suggest_frames
from mograft.io.formats import split_address
from mograft.library.discover import FoundClip, exclude_grafts, find_clips, scan_folder
from mograft.library.files.storage import is_library

_MAX_SHOWN_CLIPS = 12
_EXPORTED = (".glb", ".usd", ".usda", ".usdc", ".mp4", ".gif", ".npz", ".csv")
_FILE_SUFFIXES = (
    *_EXPORTED,
    *(".bvh", ".json", ".html", ".htm", ".txt", ".png", ".svg", ".pdf", ".toml", ".parquet"),
    *(".gltf", ".fbx", ".usdz", ".mov", ".avi", ".c3d", ".amc", ".asf", ".zip"),
)
"""Suffixes of file formats. A new folder must not have a name that ends in one of them."""


def expand_folders(names: Iterable[str], *, include_grafts: bool = True) -> list[str]:
    """Return the addresses of all clips of the given files and folders.

    A folder stands for the motion files in it and in its subfolders, sorted by path. If
    `include_grafts` is false, grafts found in a folder are left out: the motions that
    ``mograft graft`` wrote.
    """
    clips: list[FoundClip] = []
    for name in names:
        if not (os.path.exists(split_address(name)[0]) or glob.has_magic(name)):
            clips.append(FoundClip(name))  # reading it raises the error, after other checks
            continue
        refuse_library(name)
        clips += find_clips(name)
    kept = clips if include_grafts else exclude_grafts(clips)
    return [str(clip.source) for clip in kept]


def refuse_library(name: str) -> None:
    """Raise ValueError if a file of a command is a library."""
    if is_library(name):
        raise ValueError(f"{name} {describe_folder(name)}")


def describe_folder(name: str) -> str:
    """Return what a folder is that was given instead of a motion file, and what to give."""
    if is_library(name):
        return f"is a library; expected motion files, as mograft lib info {name} --clips lists them"
    found = scan_folder(name)
    return f"is a folder; expected one file, such as {found[0]}" if found else "has no motion file"


def shell_names(names: Sequence[str]) -> str:
    """Return the first names as words of a shell."""
    return join_names([shlex.quote(name) for name in names], 4)


def has_folder(files: Iterable[str]) -> bool:
    """Return whether folders are among files; their clips may be left out."""
    return any(map(os.path.isdir, files))


def library_folder(files: Sequence[str], clips: Sequence[str] = ()) -> Path | None:
    """Return the library folder among the files of a command, or None if there is none.

    Raise a UsageError if there is a library and any other file, or if there is none, but `clips`
    select some of its clips.
    """
    if not any(is_library(name) for name in files):
        if clips:
            raise UsageError("--clip requires a library; of files, give FILE or FILE#CLIP")
        return None
    if len(files) > 1:
        raise UsageError(
            "expected one library or motion files, got both or several libraries; mograft graft "
            "LIB --base FILE grafts a file, mograft index FILE --add -o LIB adds it to a library"
        )
    return Path(files[0])


def select_clips(library: Library, patterns: Sequence[str]) -> list[int]:
    """Return the indices of the clips whose names match one of `patterns`.

    Without patterns, all clips match. Raise ValueError if a pattern matches no clip, or if more
    clips match than can be shown at once.
    """
    names = library.names
    selected = find_matches("clip", patterns, names) if patterns else list(range(len(names)))
    if len(selected) > _MAX_SHOWN_CLIPS:
        raise ValueError(
            f"at most {_MAX_SHOWN_CLIPS} clips can be shown at once, got {len(selected)}; use "
            f"--clip to select from {join_names([names[index] for index in selected])}"
        )
    return selected


def frame_range(motion: Motion, given: Range | None) -> tuple[int, int]:
    """Return the first and last frame of ``--frames`` in a motion; all frames if `given` is None.

    Raise ValueError if the motion ends earlier, or if the range has a single frame.
    """
    if given is None:
        return 0, motion.n_frames - 1
    first, last = resolve_frames(given, motion.rate)
    if last >= motion.n_frames or first == last:
        raise ValueError(
            f"--frames must be two or more frames within 0-{motion.n_frames - 1}, the frames of "
            f"{motion.name} ({motion.duration:.6g} s), "
            f"{suggest_frames((first, last), motion.n_frames - 1, 1)}"
        )
    return first, last


def check_suffix(target: Path, *suffixes: str, is_folder: bool = False) -> None:
    """Raise a UsageError if the suffix of ``-o``, the path `target`, is not one of `suffixes`.

    If `is_folder` is true, ``-o`` may also be a folder: one that exists, or a new one whose name
    does not have the suffix of a known file format.
    """
    suffix = target.suffix.lower()
    if suffix in suffixes or (is_folder and (suffix not in _FILE_SUFFIXES or target.is_dir())):
        return
    file = f"a file that ends in {', '.join(suffixes)}"
    expected = " or ".join(["a folder"] * is_folder + [file] * bool(suffixes))
    hint = "" if suffix not in _EXPORTED else f"; mograft export writes {suffix} from a .bvh file"
    if suffix in (".png", ".svg", ".pdf"):
        hint = f"; mograft plot strip draws {suffix}"
    elif suffix == ".fbx":
        hint = "; mograft reads .fbx, but does not write it: write .glb"
    elif suffix in (".csv", ".json", ".txt") and ".html" in suffixes:
        hint = "; --json prints the results as data"
    raise UsageError(f"-o must be {expected}, got {target.name}{hint}")


def check_writable(paths: Sequence[Path], *, force: bool, inputs: Iterable[str] = ()) -> None:
    """Raise an OSError if one of the files `paths` must not or cannot be written.

    A file must not be written if it exists and `force` is false, or if it is one of `inputs`, which
    are files or addresses of clips. A file cannot be written if a folder in its path is a file.
    """
    for path in paths:
        nearest = next((above for above in path.parents if above.exists()), path)
        if not nearest.is_dir():
            raise NotADirectoryError(f"{nearest} is a file; expected a folder")
    existing = [path for path in paths if path.exists()]
    if existing and not force:
        n = len(existing) - 1
        verb = f"and {n} other file{'s' * (n > 1)} exist" if n else "exists"
        raise FileExistsError(f"{existing[0]} {verb}; use --force to overwrite")
    sources = [Path(split_address(name)[0]) for name in inputs]
    for path in existing:
        if any(source.exists() and path.samefile(source) for source in sources):
            raise FileExistsError(f"{path} is an input; choose another output")
