"""The files of grafts: the motions, and beside them their provenance."""

import warnings
from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from mograft._core import VERSION  # noqa: TID251 - the crates hold the version
from mograft._util.atomic import write_bytes, write_json
from mograft._util.validate import check_type
from mograft.errors import join_names
from mograft.io.bvh.decimals import check_digits
from mograft.io.bvh.writer import write_bvh
from mograft.io.smpl.writer import write_amass
from mograft.provenance.document import SEVERAL_SCHEMA, graft_record
from mograft.provenance.graft_animations import add_graft_animations, find_base_file
from mograft.synthesis.graft_result import Graft

Sections = Mapping[str, Any]

MOTION_SUFFIXES = (".bvh", ".glb", ".npz")
"""Endings of the names of files that hold the motions of grafts."""


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
    Graft(dance_graft0: 151 of 197 parts exchanged)
    """
    target = Path(fspath(path))
    digits = None if digits is None else check_digits(digits)
    grafts = [graft] if isinstance(graft, Graft) else list(graft)
    for own in grafts:
        check_type("graft", own, Graft)
    suffix = target.suffix.lower()
    if suffix not in MOTION_SUFFIXES:
        raise ValueError(f"`path` must end with {', '.join(MOTION_SUFFIXES)}, got {target.name}")
    is_glb = suffix == ".glb"
    if len(grafts) != 1 and not (is_glb and grafts):
        raise ValueError(
            f"`graft` must be one graft, for a .glb file one or more, got {len(grafts)}"
        )
    if sections is None or isinstance(sections, Mapping):
        sections = [sections or {}] * len(grafts)
    documents = [
        {"mograft": VERSION, **graft_record(own, target.parent), "digits": digits, **extra}
        for own, extra in zip(grafts, sections, strict=True)
    ]
    data, source = b"", None
    if suffix == ".npz":
        source = _amass_source(grafts[0], target)
    if is_glb:
        names, data = add_graft_animations(grafts, target)
        documents = [{**own, "animation": name} for own, name in zip(documents, names, strict=True)]
    several = {"schema": SEVERAL_SCHEMA, "mograft": VERSION, "grafts": documents}
    document = documents[0] if len(documents) == 1 else several
    # The provenance comes first: an interruption then leaves no motion without it.
    write_json(target.with_suffix(".json"), document)
    if is_glb:
        write_bytes(target, data)
    elif source is not None:
        omitted = write_amass(grafts[0].motion, target, like=source)
        if omitted:
            warnings.warn(
                f"{target} lacks {join_names(omitted)}, which have one row per frame of {source}",
                stacklevel=2,
            )
    else:
        write_bvh(grafts[0].motion, target, digits=digits)


def _amass_source(graft: Graft, target: Path) -> str:
    """Return the AMASS file of the base of a graft; raise ValueError if there is none."""
    file = find_base_file(graft, "AMASS")
    if file is None:
        raise ValueError(
            f"{target.name} must be a .bvh file: {graft.base.name}, the base of "
            f"{graft.motion.name}, is not from an AMASS file; to write a new .npz file, "
            "use mograft export"
        )
    return file.path
