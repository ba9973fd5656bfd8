"""The formats that mograft reads, and the functions that read motions of any of them."""

import os
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Protocol

from mograft.errors import FormatError, join_names
from mograft.io.clips import Clips
from mograft.io.kimodo.joints import is_kimodo
from mograft.io.smpl.joints import is_amass
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

_HEAD_BYTES = 64
"""Bytes at the start of a file by which its format is recognized."""

_CACHED_FILES = 2
"""Files that `read_clip` keeps open, so that a file is not parsed again for each of its clips."""


class Opener(Protocol):
    """A function that opens a file of one format.

    Without `rate`, the clips have the rate of the file. `skeleton` is used by formats that store no
    rest pose; the others ignore it. Raises `FormatError` if the file is invalid, OSError if it
    cannot be read.
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

    def open(self, path: Path, *, rate: float | None, skeleton: Skeleton | None) -> Clips:
        """Open a file; see `Opener`."""
        module, _, function = self.opener.partition(":")
        opener: Opener = getattr(import_module(f"mograft.{module}"), function)
        return opener(path, rate=rate, skeleton=skeleton)


def npz_arrays(path: Path) -> frozenset[str]:
    """Return the names of the arrays of an NPZ file; none if the file is not a ZIP archive."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
        return frozenset()
    return frozenset(name.removesuffix(".npy") for name in names if name.endswith(".npy"))


_BVH = Format("BVH", (".bvh",), "io.bvh.reader:open_bvh", lambda _, head: b"HIERARCHY" in head)
_AMASS = Format(
    "AMASS", (".npz",), "io.smpl.reader:open_amass", lambda path, _: is_amass(npz_arrays(path))
)
_KIMODO = Format(
    "Kimodo", (".npz",), "io.kimodo.reader:open_kimodo", lambda path, _: is_kimodo(npz_arrays(path))
)
# Its reader names what is wrong with other NPZ files.
_NPZ = Format("NPZ", (".npz",), "io.npz:open_npz", lambda path, _: bool(npz_arrays(path)))

_GLTF = Format(
    "glTF",
    (".glb", ".gltf"),
    "io.gltf.reader:open_gltf",
    lambda path, head: head.startswith(b"glTF") or path.suffix.lower() == ".gltf",
)
_FBX = Format(
    "FBX",
    (".fbx",),
    "io.fbx:open_fbx",
    lambda _, head: head.startswith((b"Kaydara FBX Binary", b"; FBX ")),
)

_USD = Format(
    "USD",
    (".usd", ".usda", ".usdc", ".usdz"),
    "io.usd_reader:open_usd",
    lambda path, head: head.startswith((b"#usda", b"PXR-USDC")) or path.suffix.lower() == ".usdz",
)

FORMATS: tuple[Format, ...] = (_BVH, _FBX, _GLTF, _AMASS, _KIMODO, _NPZ, _USD)
"""All formats. If the content of a file matches several, the first is used."""

SUFFIXES = tuple(dict.fromkeys(suffix for form in FORMATS for suffix in form.suffixes))
"""The suffixes of files with motions, which mograft looks for in folders."""


def find_format(path: Path) -> Format:
    """Return the format of a file.

    Formats with the suffix of the file come first; among these, and then among all formats, the
    content decides. A file that no format matches has the only format of its suffix; without such a
    format, it is BVH, whose reader then names what is wrong. Raises OSError if the file cannot be
    read, and `FormatError` if several formats have the suffix and none matches.
    """
    if not path.is_file():  # a pipe, whose first bytes can be read only once
        return _BVH
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    by_suffix = [form for form in FORMATS if path.suffix.lower() in form.suffixes]
    for form in (*by_suffix, *FORMATS):
        if form.matches(path, head):
            return form
    if len(by_suffix) > 1:
        names = " or ".join(form.name for form in by_suffix)
        raise FormatError(f"expected {names}, got other content", path)
    return by_suffix[0] if by_suffix else _BVH


def read(
    path: str | os.PathLike[str], *, rate: float | None = None, skeleton: Skeleton | None = None
) -> Clips:
    """Open a file of any format that mograft reads, and return its clips.

    Parameters
    ----------
    path : str or path
        The file. Suffix and content determine the format.
    rate : float, optional
        Frames per second of the motions. Default: those of the file.
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
    >>> from mograft.dancer import dance
    >>> from mograft.io.npz import write_npz
    >>> target = Path(tempfile.mkdtemp()) / "dance.npz"
    >>> write_npz(dance(strides=1).motion[:61], target)
    >>> read(target, rate=10)[0]
    Motion(dance: 18 joints, 21 frames, 10 fps, 2.00 s)
    """
    if rate is not None and not 0 < rate < float("inf"):
        raise ValueError(f"`rate` must be above 0 frames per second, got {rate}")
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(2, "No such file or directory", str(path))
    return find_format(path).open(path, rate=rate, skeleton=skeleton)


def split_address(address: str) -> tuple[str, str | None]:
    """Split the address of a clip into its path and the name of the clip, None without a name.

    The path is the longest start of the address, up to the end or a ``#``, that exists. If none
    exists, the address is split at its last ``#``.

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


def read_clip(
    address: str | os.PathLike[str], *, rate: float | None = None, skeleton: Skeleton | None = None
) -> Motion:
    """Read the motion at an address: a path, or ``path#clip`` for a clip of a file with several.

    `rate` and `skeleton` are as for `read`. Raises ValueError if the file has several clips and the
    address names none of them, and the errors of `read`.
    """
    path, name = split_address(os.fspath(address))
    clips = open_clips(path, rate=rate, skeleton=skeleton)
    if name is not None:
        return clips[name]
    if len(clips) != 1:
        raise ValueError(
            f"{path} has {len(clips)} clips; name one of them, as in {clips.address(0)}: "
            f"{join_names(clips.names)}"
        )
    return clips[0]


def find_addresses(address: str) -> list[str]:
    """Return the addresses of all clips that an address stands for, in the order of the file.

    A path stands for all clips of the file, ``path#pattern`` for those whose names match a glob.
    Raises ValueError if no name matches, and the errors of `read`.
    """
    path, pattern = split_address(address)
    clips = open_clips(path)
    names = clips.names
    chosen = [
        index
        for index, name in enumerate(names)
        if pattern is None or name == pattern or fnmatchcase(name, pattern)
    ]
    if not chosen and pattern is not None:
        clips[pattern]  # raises an error that lists the names
    return [clips.address(index) for index in chosen]


def open_clips(path: str, *, rate: float | None = None, skeleton: Skeleton | None = None) -> Clips:
    """Return the clips of a file as `read` does; the last files are kept open."""
    if not os.path.isfile(path):
        return read(path, rate=rate, skeleton=skeleton)
    status = os.stat(path)
    state = (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)
    return _open_cached(path, state, rate, skeleton)


@lru_cache(maxsize=_CACHED_FILES)
def _open_cached(
    path: str, _state: tuple[int, ...], rate: float | None, skeleton: Skeleton | None
) -> Clips:
    """Open a file; `_state` differs if the file has changed."""
    return read(path, rate=rate, skeleton=skeleton)
