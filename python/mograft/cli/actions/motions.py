"""``mograft info``, ``check`` and ``groups``: contents, faults and joint groups of motion files."""

from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

from mograft._util.atomic import write_text
from mograft._util.automatic_groups import automatic_number, is_automatic
from mograft.body.faults import HARMLESS_FAULTS, find_faults
from mograft.body.groups import JointGroups
from mograft.cli.configuration import selected_skeleton
from mograft.cli.files import check_suffix, check_writable, expand_folders
from mograft.cli.output import print_error, print_result
from mograft.cli.syntax.commands import CheckOptions, GroupsOptions, InfoOptions
from mograft.errors import FormatError
from mograft.io.addresses import join_address, open_clips, read_clip, split_address
from mograft.io.bvh.reader import read_bvh
from mograft.io.formats import find_format
from mograft.library.group_choice import discover_groups
from mograft.library.spec import describe_match
from mograft.motion.skeleton import Skeleton


def run_info(options: InfoOptions) -> int:
    """Describe every file; return exit code 3 if one of them is invalid, else 0."""
    documents: list[dict[str, Any]] = []
    rest, hierarchy = selected_skeleton(options.skeleton), None
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
    clips = open_clips(path, skeleton=rest)
    motion = clips[0 if clip is None else clip]
    skeleton = motion.skeleton
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
        "frames": motion.n_frames,
        "frame_time": motion.frame_time,
        "rate": motion.rate,
        "seconds": motion.duration,
        "groups": groups,
        "notes": list(clips.notes),
        "repairs": list(motion.repairs),
        "faults": [
            fault.message
            for fault in find_faults(motion)
            if all_faults or fault.kind not in HARMLESS_FAULTS
        ],
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
    lines += [f"  warning: {fault}" for fault in document["faults"]]
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


def run_check(options: CheckOptions) -> int:
    """Check every file; return exit code 3 if one of them is not valid, else 0."""
    documents, skeleton = [], selected_skeleton(options.skeleton)
    for name in expand_folders(options.files):
        document = _check_file(name, skeleton, strict=options.strict)
        documents.append(document)
        if options.json:
            continue
        if document["error"] is not None:
            print_error(document["error"])
            continue
        lines = [f"tolerated: {repair}" for repair in document["repairs"]]
        lines += [
            f"{fault['kind']}: {_describe_fault(fault)}"
            for fault in document["faults"]
            if options.verbose or fault["kind"] not in HARMLESS_FAULTS
        ]
        print("\n  ".join([f"{name}: {'' if lines else 'good'}".rstrip(), *lines]))
    print_result(options, "check", {"files": documents}, [])
    return 3 if any(document["error"] for document in documents) else 0


def _check_file(name: str, skeleton: Skeleton | None, *, strict: bool) -> dict[str, Any]:
    try:
        is_bvh = find_format(Path(split_address(name)[0])).name == "BVH"
        motion = read_bvh(name, strict=strict) if is_bvh else read_clip(name, skeleton=skeleton)
    except FormatError as error:
        return {"file": name, "error": str(error), "repairs": [], "faults": []}
    names = motion.skeleton.names
    faults = [
        {
            "kind": fault.kind,
            "frames": list(fault.frames),
            "joint": None if fault.joint is None else names[fault.joint],
            "message": fault.message,
        }
        for fault in find_faults(motion)
    ]
    return {"file": name, "error": None, "repairs": list(motion.repairs), "faults": faults}


def _describe_fault(fault: dict[str, Any]) -> str:
    first, last = fault["frames"]
    frames = f"frame {first}" if first == last else f"frames {first} to {last}"
    joint = "" if fault["joint"] is None else f", {fault['joint']}"
    return f"{frames}{joint}: {fault['message']}"


def run_groups(options: GroupsOptions) -> int:
    """Print or write the joint groups of a file."""
    target = options.output
    if target is not None:
        check_suffix(target, ".toml")
    files = expand_folders(options.files)
    rest = selected_skeleton(options.skeleton)
    skeleton = read_clip(files[0], skeleton=rest).skeleton
    if is_automatic(options.preset):
        number = automatic_number(options.preset)
        groups = discover_groups(files, number, skeleton=rest).groups
    else:
        groups = JointGroups.preset(options.preset, skeleton)
    if target is not None:
        check_writable([target], force=options.force)
        target.parent.mkdir(parents=True, exist_ok=True)
        write_text(target, groups.to_toml())
    members = groups.resolve(skeleton).items()
    document = {
        "file": None if target is None else str(target),
        "base": groups.base,
        "groups": {name: [skeleton.names[j] for j in joints] for name, joints in members},
    }
    print_result(options, "groups", document, [target or groups.to_toml().removesuffix("\n")])
    return 0
