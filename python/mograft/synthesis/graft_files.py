"""The files of a graft: the motion, and beside it its provenance."""

import json
from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft._util.atomic import write_text
from mograft.io.bvh.decimals import check_digits
from mograft.io.bvh.writer import write_bvh
from mograft.synthesis.graft_result import Graft

GRAFT_ENDINGS = (".bvh", ".json")
"""Endings of the files of a graft: the motion and its provenance."""


def write_graft(
    graft: Graft,
    path: str | PathLike[str],
    sections: Mapping[str, Any] | None = None,
    *,
    digits: int | None = None,
) -> None:
    """Write the motion of a graft, and a file with the provenance from which `replay` remakes it.

    Parameters
    ----------
    graft : Graft
        The graft.
    path : path
        The BVH file. The provenance has the same name with the ending ``.json``. Existing files are
        overwritten.
    sections : mapping of str to JSON values, optional
        Further keys of the provenance, such as measures of the motion.
    digits : int, optional
        Decimals of computed angles; see `write_bvh`. The provenance contains it.

    Raises
    ------
    ValueError
        If `digits` is not an integer from 1 to 12.
    OSError
        If a file cannot be written.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> import mograft as mg
    >>> from mograft.dancer import dance
    >>> library = mg.Library.build(dance(strides=1).motion)
    >>> with TemporaryDirectory() as folder:
    ...     mg.write_graft(mg.graft(library, seed=7), f"{folder}/new.bvh")
    ...     mg.replay(f"{folder}/new.json", library)
    Graft(dance_graft0: 151 of 197 parts exchanged)
    """
    target = Path(fspath(path))
    digits = None if digits is None else check_digits(digits)
    document = {"mograft": VERSION, **graft.as_dict(target.parent), "digits": digits}
    document |= sections or {}
    # The provenance comes first: an interruption then leaves no motion without it.
    write_text(target.with_suffix(".json"), json.dumps(document, indent=1) + "\n")
    write_bvh(graft.motion, target, digits=digits)
