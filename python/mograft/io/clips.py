"""`Clips`: the motions of one file, each of which is read when it is accessed."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import overload

import numpy as np

from mograft._util.names import find_matches
from mograft._util.validate import is_integer
from mograft.errors import FormatError, join_names, suggest_name
from mograft.motion.motion import Motion, replace_unchecked


@dataclass(frozen=True, eq=False)
class Clips(Sequence[Motion]):
    """The motions of a file: a sequence whose items are read when they are accessed.

    Parameters
    ----------
    path : Path
        The file.
    names : tuple of str
        One name per clip; all different.
    load : callable
        Function from the index of a clip to its motion. Not part of the public interface.
    format : str
        Name of the format, such as ``"glTF"``.
    notes : tuple of str
        Content of the file that is not part of the motions, such as nodes that are not joints.
    count_frames : callable or None
        Function from the index of a clip to its number of frames, which does not read the motion;
        None if there is none. Not part of the public interface.
    grafts : mapping of str to str
        The provenance of the clips that `mograft.write_graft` wrote, by name: the text of a JSON
        document.
    is_part : bool
        Whether these are some clips of a file with others.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from mograft.dancer import dance
    >>> from mograft.io.bvh.writer import write_bvh
    >>> from mograft.io.formats import read
    >>> target = Path(tempfile.mkdtemp()) / "dance.bvh"
    >>> write_bvh(dance(strides=1).motion[:90], target)
    >>> clips = read(target)
    >>> clips
    Clips(dance.bvh: BVH, 1 clip)
    >>> clips["dance"]
    Motion(dance: 18 joints, 90 frames, 30 fps, 2.97 s)
    """

    path: Path
    names: tuple[str, ...]
    load: Callable[[int], Motion] = field(repr=False)
    format: str
    notes: tuple[str, ...] = ()
    count_frames: Callable[[int], int] | None = field(default=None, repr=False)
    grafts: Mapping[str, str] = field(default_factory=dict, repr=False)
    is_part: bool = field(default=False, repr=False)

    def __repr__(self) -> str:
        return f"Clips({self.path.name}: {self.format}, {self._count()})"

    def _count(self) -> str:
        return "1 clip" if len(self) == 1 else f"{len(self)} clips"

    def __len__(self) -> int:
        return len(self.names)

    @overload
    def __getitem__(self, index: int | str) -> Motion: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Motion, ...]: ...
    def __getitem__(self, index: int | str | slice) -> Motion | tuple[Motion, ...]:
        """Read and return a clip, given its index or name, or the clips of a slice.

        Raises ValueError if no clip has the name, IndexError if none has the index, and the errors
        of the reader.
        """
        if isinstance(index, slice):
            return tuple(self._load(i) for i in range(len(self))[index])
        if isinstance(index, str):
            if index not in self.names:
                raise self._unknown(index)
            return self._load(self.names.index(index))
        if not is_integer(index):
            kind = type(index).__name__
            raise TypeError(f"the index of a clip must be an integer, name or slice, got {kind}")
        if not -len(self) <= index < len(self):
            raise IndexError(f"{self.path} has {self._count()}, got the index {index}")
        return self._load(range(len(self))[index])

    def _load(self, index: int) -> Motion:
        """Read a clip; set `path` and `clip` of the motion to the parts of its address."""
        with np.errstate(all="ignore"):
            motion = self.load(index)
        clip = self.clip(index)
        if (motion.path, motion.clip) == (self.path, clip):
            return motion
        return replace_unchecked(motion, path=self.path, clip=clip)

    def _unknown(self, name: str) -> ValueError:
        hint = suggest_name(name, self.names) or f"; its clips are {join_names(self.names)}"
        return ValueError(f"{self.path} has no clip named {name!r}{hint}")

    def find(self, pattern: str) -> list[int]:
        """Return the indices of the clips whose names match a pattern; see `find_matches`."""
        try:
            return find_matches("pattern", pattern, self.names)
        except ValueError:
            raise self._unknown(pattern) from None

    def select(self, pattern: str) -> "Clips":
        """Return the clips that `find` finds."""
        found = self.find(pattern)
        names = tuple(self.names[index] for index in found)
        load, count = self.load, self.count_frames
        return replace(
            self,
            names=names,
            load=lambda i: load(found[i]),
            count_frames=None if count is None else lambda i: count(found[i]),
            is_part=True,
        )

    def clip(self, index: int) -> str | None:
        """Return the name in the address of a clip, None if the address is the path.

        The path is the address of the only clip, or of the only one that is not a graft.
        """
        name = self.names[index]
        captured = [own for own in self.names if own not in self.grafts]
        is_only = [name] in (captured, list(self.names)) and not self.is_part
        return None if is_only else name

    def address(self, index: int) -> str:
        """Return the address of a clip: the path, followed by ``#`` and the result of `clip`."""
        clip = self.clip(index)
        return str(self.path) if clip is None else f"{self.path}#{clip}"


def single_clip(
    path: Path, form: str, load: Callable[[], Motion], rate: float | None, notes: Sequence[str] = ()
) -> Clips:
    """Return the clips of a file with one motion, which has the name of the file.

    `load` reads the motion; unless `rate` is None, it is resampled.
    """

    def read(_: int) -> Motion:
        with errors_of_file(path):
            motion = replace_unchecked(load(), name=path.stem)
        return motion if rate is None else motion.resample(rate)

    return Clips(path, (path.stem,), read, form, tuple(notes))


@contextmanager
def errors_of_file(path: str | Path, place: str | None = None) -> Iterator[None]:
    """Convert ValueError and TypeError to `FormatError`, which names the file and the place."""
    try:
        yield
    except FormatError:
        raise
    except (TypeError, ValueError) as error:
        raise FormatError(str(error), path, place) from error
