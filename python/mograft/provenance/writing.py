"""`write`: a motion or graft as a file, in the format that the file name tells."""

from collections.abc import Callable
from os import PathLike, fspath
from pathlib import Path

from mograft.errors import suggest_name
from mograft.io.bvh.writer import write_bvh
from mograft.io.csv import write_csv
from mograft.io.glb import write_glb
from mograft.io.npz import write_npz
from mograft.io.usd import write_usd
from mograft.motion.motion import Motion
from mograft.provenance.graft_animations import find_base_file
from mograft.provenance.graft_files import write_graft
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
        raise ValueError(
            f"`path` must end with {', '.join(WRITERS)}, got {target.name}"
            f"{suggest_name(ending, WRITERS)}"
        )
    has_provenance = isinstance(item, Graft) and _has_provenance(item, ending)
    files = [target, target.with_suffix(".json")] if has_provenance else [target]
    for file in files:
        if file.exists() and not force:
            raise FileExistsError(f"{file} exists: use another name, or force=True to replace it")
    if isinstance(item, Graft) and has_provenance:
        write_graft(item, target)
    else:
        WRITERS[ending](item.motion if isinstance(item, Graft) else item, target)


def _has_provenance(graft: Graft, ending: str) -> bool:
    """Return whether `write_graft` can write the graft into a file with this ending."""
    formats = {".glb": "glTF", ".npz": "AMASS"}
    return ending == ".bvh" or (
        ending in formats and find_base_file(graft, formats[ending]) is not None
    )
