"""``mograft info``: joints, rate, length, groups and faults of motions, and the clips of files."""

import argparse
import os
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

from mograft.body.faults import HARMLESS_FAULTS, find_faults
from mograft.body.groups import JointGroups
from mograft.cli.configuration import selected_skeleton
from mograft.cli.files import expand_folders
from mograft.cli.output import print_error, print_result
from mograft.errors import FormatError
from mograft.io.addresses import join_address, open_clips, split_address
from mograft.io.bvh.reader import BvhSummary, scan_bvh
from mograft.library.spec import describe_match
from mograft.motion.motion import Motion
from mograft.motion.skeleton import Skeleton

MAX_BYTES_IN_MEMORY = 1 << 28
"""Larger BVH files are scanned without a check for faults."""


def run(options: argparse.Namespace) -> int:
    """Describe every file; return exit code 3 if one of them is invalid, else 0."""
    documents: list[dict[str, Any]] = []
    rest, hierarchy = selected_skeleton(options), None
    for path, members in groupby(_find_clips(options.files), key=lambda found: found[0]):
        names = [name for _, name in members]
        try:
            clips = _read_clips(path, names, rest, all_faults=options.verbose or options.json)
        except FormatError as error:
            documents.append({"file": path, "error": str(error)})
            print_error(str(error))
            continue
        if options.match == "anatomy":
            own = open_clips(path, skeleton=rest)[clips[0]["clip"] or 0].skeleton
            hierarchy = hierarchy or own
            for document in clips:
                document["match"] = describe_match(hierarchy, own, path)
        documents += clips
        if not options.json:
            print(_describe(clips[0]) if len(clips) == 1 else _describe_several(clips))
    print_result(options, "info", {"files": documents}, [])
    return 3 if any(document["error"] for document in documents) else 0


def _find_clips(names: Iterable[str]) -> Iterator[tuple[str, str | FormatError | None]]:
    """Yield the path and the clip name of each clip of the given files and folders.

    Clips of a single pose are included if their file is given by name; those in folders are left
    out as in `find_addresses`. The name is None if a file has only one clip, and the error if the
    clips of a file cannot be listed.
    """
    for name in names:
        try:
            yield from _find_in(name)
        except FormatError as error:
            yield split_address(name)[0], error


def _find_in(name: str) -> list[tuple[str, str | None]]:
    """Return the path and the clip name of each clip of a file or folder.

    The name is None if the file has only one clip.
    """
    if Path(name).is_dir():
        return list(map(split_address, expand_folders([name])))
    path, pattern = split_address(name)
    clips = open_clips(path)
    chosen = range(len(clips)) if pattern is None else clips.find(pattern)
    if not len(clips):
        raise ValueError(f"{path} holds no motion: {'; '.join(clips.notes)}")
    return [(path, clips.names[index] if len(clips) > 1 else None) for index in chosen]


def _read_clips(
    path: str,
    names: Iterable[str | FormatError | None],
    rest: Skeleton | None,
    *,
    all_faults: bool,
) -> list[dict[str, Any]]:
    """Return the contents of clips of one file; raise the error among `names`, if there is one."""
    documents = []
    for name in names:
        if isinstance(name, FormatError):
            raise name
        documents.append(_read(path, name, rest, all_faults=all_faults))
    return documents


def _read(
    path: str, clip: str | None, rest: Skeleton | None, *, all_faults: bool
) -> dict[str, Any]:
    """Return the contents of a clip; without `all_faults`, harmless faults are omitted."""
    faults: list[str] | None = None
    summary: BvhSummary | Motion
    clips = open_clips(path, skeleton=rest)
    if clips.format == "BVH" and os.path.getsize(path) > MAX_BYTES_IN_MEMORY:
        summary = scan_bvh(path)
    else:
        summary = motion = clips[0 if clip is None else clip]
        faults = [
            fault.message
            for fault in find_faults(motion)
            if all_faults or fault.kind not in HARMLESS_FAULTS
        ]
    skeleton = summary.skeleton
    try:
        members = JointGroups.preset("lower_torso_arms", skeleton).resolve(skeleton)
        groups = {g: [skeleton.names[j] for j in joints] for g, joints in members.items()}
    except ValueError:
        groups = {}
    return {
        "file": path,
        "error": None,
        "format": clips.format,
        "clip": clip,
        "joints": skeleton.n_joints,
        "channels": skeleton.n_channels,
        "frames": summary.n_frames,
        "frame_time": summary.frame_time,
        "rate": summary.rate,
        "seconds": summary.duration,
        "groups": groups,
        "notes": list(clips.notes),
        "repairs": list(summary.repairs),
        "faults": faults,
    }


def _describe(document: dict[str, Any]) -> str:
    lines = [
        join_address(document["file"], document["clip"]),
        f"  {document['joints']} joints, {document['channels']} channels (DoF)",
        f"  {_length(document)}",
        *_groups(document),
        *_notes(document),
    ]
    lines += [f"  repaired: {repair}" for repair in document["repairs"]]
    faults = document["faults"]
    if faults is None:
        faults = ["faults were not checked as the file is large: see mograft check"]
    lines += [f"  warning: {fault}" for fault in faults]
    return "\n".join(lines)


def _describe_several(documents: list[dict[str, Any]]) -> str:
    """Return the text for several clips of one file."""
    first = documents[0]
    lines = [
        f"{first['file']}",
        f"  {first['format']}, {len(documents)} clips, {first['joints']} joints",
        *_groups(first),
        *_notes(first),
    ]
    for document in documents:
        lines.append(f"  #{document['clip']}: {_length(document)}")
        lines += [f"    warning: {fault}" for fault in document["faults"]]
    return "\n".join(lines)


def _length(document: dict[str, Any]) -> str:
    if document["frames"] == 1:
        return "1 frame"
    return f"{document['frames']} frames at {document['rate']:.6g} fps, {document['seconds']:.2f} s"


def _groups(document: dict[str, Any]) -> list[str]:
    groups = document["groups"]
    if not groups:
        return ["  no joint groups recognized: pass your own as a TOML file with --groups"]
    return [f"  {group}: {' '.join(names)}" for group, names in groups.items()]


def _notes(document: dict[str, Any]) -> list[str]:
    lines = [f"  note: {note}" for note in document["notes"]]
    match = document.get("match")
    return lines if not match else [*lines, f"  joints matched by anatomy: {match}"]
