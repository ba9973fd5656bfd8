"""The formats that mograft reads, and addresses: ``path``, or ``path#clip`` for a single clip."""

import os
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Protocol

import numpy as np

from mograft.errors import FormatError, join_names
from mograft.io.clips import Clips
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

_HEAD_BYTES = 64
"""Bytes at the start of a file by which its format is recognized."""


class Opener(Protocol):
    """A function that opens a file of one format.

    The clips are sampled at `rate` frames per second, by default at the rate of the file.
    `skeleton` is used by formats that store no rest pose; the others ignore it. Raises
    `FormatError` if the file is invalid, OSError if it cannot be read.
    """

    def __call__(self, path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:
        """Return the clips of the file `path`."""


@dataclass(frozen=True)
class Format:
    """A format that mograft reads."""

    name: str  # in messages and in libraries
    suffixes: tuple[str, ...]  # in lower case, with the dot
    opener: str  # "module:function" of an `Opener`, imported when the first file is opened
    matches: Callable[[Path, bytes], bool]  # whether a file with these first bytes has the format
    requires: str | None = None  # the module without which no file can be opened

    def open(self, path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:
        """Open a file; see `Opener`."""
        module, _, function = self.opener.partition(":")
        opener: Opener = getattr(import_module(f"mograft.{module}"), function)
        return opener(path, rate=rate, skeleton=skeleton)


def npz_arrays(path: Path) -> frozenset[str]:
    """Return the names of the arrays of an NPZ file; empty if the file is not a ZIP archive."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
        return frozenset()
    return frozenset(name.removesuffix(".npy") for name in names if name.endswith(".npy"))


_BVH = Format("BVH", (".bvh",), "io.bvh.reader:open_bvh", lambda _, head: b"HIERARCHY" in head)


def _begins(*starts: bytes, suffix: str | None = None) -> Callable[[Path, bytes], bool]:
    """Return the condition that a file begins with one of `starts`, or has a suffix."""
    return lambda path, head: head.startswith(starts) or path.suffix.lower() == suffix


def _is_table(path: Path, head: bytes) -> bool:
    """Return whether a CSV file has many columns that are not those of `write_csv`."""
    is_wide = head.partition(b"\n")[0].count(b",") > 1
    return path.suffix.lower() == ".csv" and is_wide and not head.startswith(b"frame,time,")


def _holds(condition: Callable[[frozenset[str]], bool]) -> Callable[[Path, bytes], bool]:
    """Return the condition that a file is NPZ, and the names of its arrays meet a condition."""
    return lambda path, _: condition(npz_arrays(path))


def _is_amass(names: frozenset[str]) -> bool:
    """Return whether an NPZ file with these arrays is an AMASS motion."""
    return "trans" in names and ("poses" in names or {"root_orient", "pose_body"} <= names)


_TRACKER = frozenset(("joint_pos", "body_pos_w", "body_quat_w"))
_KIMODO_ARRAYS = frozenset(("posed_joints", "global_rot_mats"))
_NPZ_ARRAYS = frozenset(("format", "rotations", "parents"))
_FBX_STARTS = (b"Kaydara FBX Binary", b"; FBX ")
_USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
_IS_USD = _begins(b"#usda", b"PXR-USDC", suffix=".usdz")
_IS_GLTF = _begins(b"glTF", suffix=".gltf")

FORMATS = (
    _BVH,
    Format("glTF", (".glb", ".gltf"), "io.gltf.document:open_gltf", _IS_GLTF),
    Format("FBX", (".fbx",), "io.fbx:open_fbx", _begins(*_FBX_STARTS), "mograft_fbx"),
    Format("AMASS", (".npz",), "io.smpl.amass:open_amass", _holds(_is_amass)),
    Format("Kimodo", (".npz",), "io.kimodo:open_kimodo", _holds(_KIMODO_ARRAYS.issubset)),
    Format("robot NPZ", (".npz",), "io.robots.trackers:open_tracker", _holds(_TRACKER.issubset)),
    Format("NPZ", (".npz",), "io.npz:open_npz", _holds(_NPZ_ARRAYS.issubset)),
    Format("robot CSV", (".csv",), "io.robots.tables:open_table", _is_table),
    Format("USD", _USD_SUFFIXES, "io.usd_reader:open_usd", _IS_USD, "pxr"),
)
"""All formats, in order of precedence: if the content of a file matches several, the first is
used. Of files in a folder with the same stem, those of the first format are used."""

SUFFIXES = tuple(dict.fromkeys(suffix for form in FORMATS for suffix in form.suffixes))
"""The suffixes of files with motions, which mograft looks for in folders."""


def find_format(path: Path) -> Format:
    """Return the format of a file.

    It is the result of `recognize_format`. If this is None, it is the last of the formats with the
    suffix of the file, whose reader then raises an error that states the first invalid content.
    Raises `FormatError` if no format has the suffix, and OSError if the file cannot be read.
    """
    found = recognize_format(path)
    if found is not None:
        return found
    by_suffix = [form for form in FORMATS if path.suffix.lower() in form.suffixes]
    if not by_suffix:
        raise FormatError(f"expected a motion file ({', '.join(SUFFIXES)}), got another kind", path)
    return by_suffix[-1]


def recognize_format(path: Path) -> Format | None:
    """Return the format that matches the content of a file, or None if there is none.

    If several match, formats with the suffix of the file take precedence. A pipe or a device counts
    as BVH. Raises OSError if the file cannot be read.
    """
    if not path.is_file():  # a pipe, whose first bytes can be read only once
        return _BVH
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    by_suffix = [form for form in FORMATS if path.suffix.lower() in form.suffixes]
    for form in (*by_suffix, *FORMATS):
        if form.matches(path, head):
            return form
    return None


def read(
    path: str | os.PathLike[str], *, rate: float | None = None, skeleton: Skeleton | None = None
) -> Clips:
    """Open a file of any format that mograft reads, and return its clips.

    Parameters
    ----------
    path : str or path
        The file, or ``path#clip`` for some of its clips. Suffix and content determine the format.
    rate : float, optional
        Frames per second at which the motions are sampled. Default: the rate of the file.
    skeleton : Skeleton, optional
        The rest pose, for formats that store none. Other formats ignore it.

    Returns
    -------
    Clips
        The motions of the file by index or name. A motion is read when it is accessed.

    Raises
    ------
    FormatError
        If the file is invalid; the message names the file and the place in it.
    ValueError
        If `rate` is not above 0.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from mograft.dancer import dance
    >>> from mograft.io.npz import write_npz
    >>> target = Path(tempfile.mkdtemp()) / "dance.npz"
    >>> write_npz(dance(strides=1).motion[:61], target)
    >>> read(target, rate=10)[0]
    Motion(dance: 18 joints, 21 frames, 10 fps, 2.00 s)
    """
    if rate is not None and not 0 < rate < float("inf"):
        raise ValueError(f"`rate` must be above 0 frames per second, got {rate}")
    name, pattern = split_address(os.fspath(path))
    file = Path(name)
    if not file.exists():
        raise FileNotFoundError(2, "No such file or directory", name)
    # Numbers that overflow in a damaged file are refused when they become a motion.
    with np.errstate(all="ignore"):
        clips = find_format(file).open(file, rate=rate, skeleton=skeleton)
    return clips if pattern is None else clips.select(pattern)


def join_address(path: str, clip: str | None) -> str:
    """Return the address of a clip of a file; if `clip` is None, the address is the path."""
    return path if clip is None else f"{path}#{clip}"


def split_address(address: str) -> tuple[str, str | None]:
    """Split an address into its path and the name of the clip, None if it has no name.

    A path may contain ``#``, too. Each ``#``, and the end of the address, may therefore end the
    path. Of these, the last one is chosen whose path exists. If no path exists, the address is
    split at its last ``#``.

    >>> split_address("Knight.glb#Walking_A")
    ('Knight.glb', 'Walking_A')
    >>> split_address("walk.bvh")
    ('walk.bvh', None)
    """
    if "#" not in address or os.path.lexists(address):
        return address, None
    path, end = address, len(address)
    while (end := address.rfind("#", 0, end)) > 0:
        if os.path.isfile(address[:end]):
            path = address[:end]
            break
    else:
        path = address.rpartition("#")[0]
    return path, address[len(path) + 1 :]


def absolute_address(address: str) -> str:
    """Return an address with an absolute path."""
    path, clip = split_address(address)
    return join_address(os.path.abspath(path), clip)


def read_clip(address: str | os.PathLike[str], *, skeleton: Skeleton | None = None) -> Motion:
    """Read the motion at an address.

    `skeleton` is as for `read`. Raises `FormatError` unless the address stands for
    exactly one clip, and the errors of `read`.
    """
    path, pattern = split_address(os.fspath(address))
    clips = open_clips(path, skeleton=skeleton)
    found = [*range(len(clips))] if pattern is None else clips.find(pattern)
    if not found:
        raise FormatError("expected at least one motion, got none", path)
    if pattern is None:
        found = [index for index in found if clips.clip(index) is None] or found
    if len(found) == 1:
        return clips[found[0]]
    names = [clips.names[index] for index in found]
    expected = f"the name of one clip, as in {clips.address(found[0])}"
    raise FormatError(f"expected {expected}, got {len(names)} clips: {join_names(names)}", path)


def find_addresses(address: str, *, skeleton: Skeleton | None = None) -> list[str]:
    """Return the addresses of all clips that an address stands for, in the order of the file.

    A path stands for all clips of the file, ``path#pattern`` for those that `Clips.find` returns.
    Clips of one frame are poses: they are left out if `Clips.count_frames` finds them, and another
    of the clips has more frames. Raises `FormatError` if there is no clip, ValueError if no
    name matches, and the errors of `read`.
    """
    path, pattern = split_address(address)
    clips = open_clips(path, skeleton=skeleton)
    found = range(len(clips)) if pattern is None else clips.find(pattern)
    if not found:
        raise FormatError("expected at least one motion, got none", path)
    if len(found) > 1 and clips.count_frames is not None:
        found = [index for index in found if clips.count_frames(index) > 1] or found
    return [clips.address(index) for index in found]


def open_clips(path: str, *, skeleton: Skeleton | None = None) -> Clips:
    """Return the clips of a file as `read` does, at the rate of the file.

    The result of the last call is kept, and returned again unless the file has changed: a file is
    not parsed again for each of its clips.
    """
    if not os.path.isfile(path):
        return read(path, skeleton=skeleton)
    status = os.stat(path)
    state = status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns
    return _read_once(path, skeleton, *state)


@lru_cache(maxsize=1)
def _read_once(path: str, skeleton: Skeleton | None, *_state: int) -> Clips:
    return read(path, skeleton=skeleton)
