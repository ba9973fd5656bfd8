"""The files that ``mograft graft`` writes."""

import argparse
from collections.abc import Iterable
from pathlib import Path

from mograft._util.names import portable_stem
from mograft.cli.configuration import options_given
from mograft.cli.files import check_suffix
from mograft.io.addresses import split_address
from mograft.io.formats import SUFFIXES
from mograft.provenance.graft_files import MOTION_SUFFIXES

_INPUTS_OF_SUFFIX = {".glb": (".glb", ".gltf"), ".npz": (".npz",)}
"""Suffixes of files of which an output with a suffix may be a copy."""


def check_graft_suffix(options: argparse.Namespace) -> None:
    """End with a usage error unless ``-o`` of ``mograft graft`` is a folder or a motion file.

    A .glb file requires an input that may be a glTF file, an .npz file an input that may be an
    AMASS file. ``--digits`` is a usage error with both, because it applies to .bvh files only.
    """
    paths = [Path(split_address(name)[0]) for name in options.files]
    suffixes = [".bvh"]
    for suffix, inputs in _INPUTS_OF_SUFFIX.items():
        if getattr(options, "from") is not None or any(
            path.is_dir() or path.suffix.lower() in inputs for path in paths
        ):
            suffixes.append(suffix)
    check_suffix(options, *suffixes, is_folder=True)
    if options.output.suffix.lower() in _INPUTS_OF_SUFFIX and options_given(options, "digits"):
        options.usage_error(f"--digits requires .bvh; got {options.output.name}")


def graft_files(paths: Iterable[Path]) -> list[Path]:
    """Return the files that are written for grafts with the motions `paths`, each once.

    They are the motions and the .json files beside them.
    """
    files = [file for path in paths for file in (path, path.with_suffix(".json"))]
    return list(dict.fromkeys(files))


def output_paths(options: argparse.Namespace, first: str) -> tuple[list[Path], Path]:
    """Return the path of each motion and the path of the report page.

    All motions have the same path if ``-o`` is a file. `first` is as for `_base_stem`.
    """
    if options.output.suffix.lower() in MOTION_SUFFIXES:
        return [options.output] * options.count, options.output.with_suffix(".html")
    stem = _base_stem(options, first)
    paths = [options.output / f"{stem}_graft{i}.bvh" for i in range(options.count)]
    return paths, options.output / "index.html"


def _base_stem(options: argparse.Namespace, first: str) -> str:
    """Return the name of the base motion, with which the names of the new motions begin.

    `first` is the first file, or the name of the first clip of a library.
    """
    if options.scenario != "original":
        return "scenario"
    path, clip = split_address(options.base or first)
    if clip is not None:
        return portable_stem(clip)
    return portable_stem(
        Path(path).stem if Path(path).suffix.lower() in SUFFIXES else Path(path).name
    )
