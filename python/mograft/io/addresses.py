"""Addresses of clips: ``path``, or ``path#clip`` for a clip of a file that holds several."""

import os
from functools import lru_cache

from mograft.errors import FormatError, join_names
from mograft.io.clips import Clips
from mograft.io.formats import read
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton


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


def read_clip(
    address: str | os.PathLike[str], *, rate: float | None = None, skeleton: Skeleton | None = None
) -> Motion:
    """Read the motion at an address.

    `rate` and `skeleton` are as for `read`. Raises `FormatError` unless the address stands for
    exactly one clip, and the errors of `read`.
    """
    path, pattern = split_address(os.fspath(address))
    clips = open_clips(path, rate=rate, skeleton=skeleton)
    found = range(len(clips)) if pattern is None else clips.find(pattern)
    if len(found) == 1:
        return clips[found[0]]
    names = clips.names if pattern is None else [clips.names[index] for index in found]
    if not names:
        raise FormatError("expected at least one motion, got none", path)
    expected = f"the name of one clip, as in {clips.address(found[0])}"
    raise FormatError(f"expected {expected}, got {len(names)} clips: {join_names(names)}", path)


def find_addresses(address: str, *, skeleton: Skeleton | None = None) -> list[str]:
    """Return the addresses of all clips that an address stands for, in the order of the file.

    A path stands for all clips of the file, ``path#pattern`` for those that `Clips.find` returns.
    Clips of one frame are poses: they are left out if the format states the lengths of clips, and
    another of the clips has more frames. Raises `FormatError` if there is no clip, ValueError if no
    name matches, and the errors of `read`.
    """
    path, pattern = split_address(address)
    clips = open_clips(path, skeleton=skeleton)
    found = range(len(clips)) if pattern is None else clips.find(pattern)
    if not found:
        raise FormatError("expected at least one motion, got none", path)
    lengths = clips.lengths
    if len(found) > 1 and lengths is not None:
        found = [index for index in found if lengths[index].n_frames > 1] or found
    return [clips.address(index) for index in found]


def open_clips(path: str, *, rate: float | None = None, skeleton: Skeleton | None = None) -> Clips:
    """Return the clips of a file as `read` does.

    The result of the last call is kept, and returned again unless the file has changed: a file is
    not parsed again for each of its clips.
    """
    if not os.path.isfile(path):
        return read(path, rate=rate, skeleton=skeleton)
    status = os.stat(path)
    state = (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)
    return _read_once(path, state, rate, skeleton)


@lru_cache(maxsize=1)
def _read_once(
    path: str,
    state: tuple[int, ...],  # noqa: ARG001 - part of the key
    rate: float | None,
    skeleton: Skeleton | None,
) -> Clips:
    return read(path, rate=rate, skeleton=skeleton)
