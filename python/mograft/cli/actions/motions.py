"""``mograft info``, ``check`` and ``groups``: contents, faults and joint groups of motion files."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import mograft as mg
from mograft._util.arrays import IntArray
from mograft._util.atomic import write_text
from mograft._util.names import automatic_number, is_automatic
from mograft._util.runs import find_runs
from mograft.body.anatomy import anatomy
from mograft.body.contacts import Ground, sliding_feet
from mograft.body.faults import HARMLESS_FAULTS
from mograft.body.loops import is_loop
from mograft.body.size import describe_sizes
from mograft.cli.configuration import selected_skeleton
from mograft.cli.files import check_suffix, check_writable, expand_folders
from mograft.cli.output import print_error, print_result
from mograft.cli.syntax.commands import CheckOptions, GroupsOptions, InfoOptions
from mograft.evaluation.robot_checks import describe_checks, robot_checks
from mograft.io.formats import find_format, join_address, open_clips, read_clip, split_address
from mograft.library.discover import scan_folder
from mograft.library.spec import describe_match
from mograft.search.constraints import find_violations


def run_info(options: InfoOptions) -> int:
    """Describe every file; return exit code 3 if one of them is invalid, else 0."""
    documents: list[dict[str, Any]] = []
    skeletons: dict[str, mg.Skeleton] = {}
    rest, hierarchy = selected_skeleton(options), None
    for address in _find_files(options.files):
        path, pattern = split_address(address)
        try:
            clips = open_clips(path, skeleton=rest)
            if not len(clips):
                raise mg.FormatError(f"holds no motion: {'; '.join(clips.notes)}", path)
            chosen = range(len(clips)) if pattern is None else clips.find(pattern)
            found = [_contents(clips, index, options) for index in chosen]
            skeletons[path] = clips[chosen[0]].skeleton
        except mg.FormatError as error:
            documents.append({"file": path, "error": str(error)})
            print_error(str(error))
            continue
        if options.match == "anatomy":
            hierarchy = hierarchy or skeletons[path]
            match = describe_match(hierarchy, skeletons[path], path)
            found = [{**document, "match": match} for document in found]
        documents += found
        if not options.json:
            print("\n".join(_describe(found)))
    sizes = describe_sizes(skeletons)
    print_result(options, "info/1", {"files": documents, "sizes": sizes}, sizes)
    return 3 if any(document["error"] for document in documents) else 0


def _find_files(names: Iterable[str]) -> list[str]:
    """Return the addresses of the files that are given, or that are in the given folders."""
    found: list[str] = []
    for name in names:
        paths = [str(path) for path in scan_folder(name, every=True)] if Path(name).is_dir() else []
        found += paths or [name]
    return found


def _find_clips(names: Iterable[str]) -> list[str]:
    """Return the addresses of the clips in the files, and the files that have none."""
    found: list[str] = []
    for file in _find_files(names):
        try:
            found += expand_folders([file])
        except mg.FormatError:
            found.append(file)  # reading it raises the error again
    return found


def _contents(clips: mg.Clips, index: int, options: InfoOptions) -> dict[str, Any]:
    """Return the contents of a clip; harmless faults only with ``--verbose`` or ``--json``."""
    motion = clips[index]
    skeleton = motion.skeleton
    members: Mapping[str, IntArray] = {}
    for preset in ("lower_upper", "lower_torso_arms"):  # the default of graft, or finer groups
        with suppress(ValueError):
            members = mg.JointGroups.preset(preset, skeleton).resolve(skeleton)
    source = {"file": str(clips.path), "error": None, "format": clips.format}
    source["clip"] = clips.names[index] if len(clips) > 1 else None
    size = {"joints": skeleton.n_joints, "channels": skeleton.n_channels, "frames": motion.n_frames}
    time = {"frame_time": motion.frame_time, "rate": motion.rate, "seconds": motion.duration}
    time["loop"] = is_loop(motion)
    size["person"] = "arms" in members and not anatomy(skeleton).joints("tail")
    groups = {g: [skeleton.names[j] for j in joints] for g, joints in members.items()}
    is_complete = options.verbose or options.json
    shown = [f for f in mg.find_faults(motion) if is_complete or f.kind not in HARMLESS_FAULTS]
    notes = {"notes": list(clips.notes), "repairs": list(motion.repairs)}
    notes["faults"] = [fault.message for fault in shown]
    if skeleton.hinges is not None:
        notes["notes"] += [f"robot: {describe_checks(robot_checks(motion))}"]
    return {**source, **size, **time, "groups": groups, **notes}


def _describe(clips: Sequence[dict[str, Any]]) -> list[str]:
    """Return the lines that describe clips of one file."""
    first = clips[0]
    lines = [f"  {group}: {' '.join(names)}" for group, names in first["groups"].items()]
    if not lines:
        lines = ["  no joint groups recognized: use --groups auto, or a TOML file of your own"]
    elif not first["person"]:
        lines.append("  not recognized as a person: no arms, or a tail")
    lines += [f"  note: {note}" for note in first["notes"]]
    if first.get("match"):
        lines.append(f"  joints matched by anatomy: {first['match']}")
    if len(clips) == 1:
        size = f"  {first['joints']} joints, {first['channels']} channels (DoF)"
        lines = [join_address(first["file"], first["clip"]), size, f"  {_length(first)}", *lines]
        lines += [f"  repaired: {repair}" for repair in first["repairs"]]
        return [*lines, *(f"  warning: {fault}" for fault in first["faults"])]
    size = f"  {first['format']}, {len(clips)} clips, {first['joints']} joints"
    lines = [first["file"], size, *lines]
    for document in clips:
        lines.append(f"  #{document['clip']}: {_length(document)}")
        lines += [f"    warning: {fault}" for fault in document["faults"]]
    return lines


def _length(document: dict[str, Any]) -> str:
    if document["frames"] == 1:
        return "1 frame"
    loop = ", a loop" if document["loop"] else ""
    seconds = f"{document['seconds']:.2f} s"
    return f"{document['frames']} frames at {document['rate']:.6g} fps, {seconds}{loop}"


def run_check(options: CheckOptions) -> int:
    """Check every file; return exit code 3 if one of them is not valid, else 0."""
    documents, rest = [], selected_skeleton(options)
    skeletons: dict[str, mg.Skeleton] = {}
    n_good = n_invalid = 0
    for name in _find_clips(options.files):
        document = _check_file(name, rest, skeletons, options)
        documents.append(document)
        if options.json:
            continue
        if document["error"] is not None:
            print_error(document["error"])
            n_invalid += 1
            continue
        lines = [f"tolerated: {repair}" for repair in document["repairs"]]
        lines += [
            f"{fault['kind']}: {_describe_fault(fault)}"
            for fault in document["faults"]
            if options.verbose or fault["kind"] not in HARMLESS_FAULTS
        ]
        lines += document.get("contacts", [])
        n_good += all(fault["kind"] in HARMLESS_FAULTS for fault in document["faults"])
        print("\n  ".join([f"{name}: {'' if lines else 'good'}".rstrip(), *lines]))
        if document["robot"]:
            print(f"  robot: {describe_checks(document['robot'])}")
    if (n := len(documents)) > 1 and not options.json:
        n_faulty = n - n_good - n_invalid
        print(
            f"{n} clips: {n_good} usable, {n_faulty} usable except for the listed frames, "
            f"{n_invalid} invalid"
        )
    sizes = describe_sizes(skeletons)
    print_result(options, "check/1", {"files": documents, "sizes": sizes}, sizes)
    return 3 if any(document["error"] for document in documents) else 0


def _check_file(
    name: str, rest: mg.Skeleton | None, skeletons: dict[str, mg.Skeleton], options: CheckOptions
) -> dict[str, Any]:
    """Return the faults of a file, and add its skeleton to `skeletons`."""
    try:
        is_bvh = find_format(Path(split_address(name)[0])).name == "BVH"
        motion = (
            mg.read_bvh(name, strict=options.strict) if is_bvh else read_clip(name, skeleton=rest)
        )
    except mg.FormatError as error:
        return {"file": name, "error": str(error), "repairs": [], "faults": [], "robot": {}}
    skeletons[name] = motion.skeleton
    names = motion.skeleton.names
    faults = []
    for fault in mg.find_faults(motion):
        joint = None if fault.joint is None else names[fault.joint]
        place = {"frames": list(fault.frames), "joint": joint}
        faults.append({"kind": fault.kind, **place, "message": fault.message})
    robot = robot_checks(motion) if motion.skeleton.hinges is not None else {}
    found = {"repairs": list(motion.repairs), "faults": faults, "robot": robot}
    if options.contacts:
        found["contacts"] = _describe_contacts(motion)
    return {"file": name, "error": None, **found}


def _describe_contacts(motion: mg.Motion) -> list[str]:
    """Return how much the feet slide, and the frames in which hands are in the body."""
    sliding = sliding_feet(motion, Ground.of(motion))
    runs = find_runs(sliding.sum(axis=1) > 0).tolist()
    first, last = max(runs, key=lambda run: run[1] - run[0], default=(0, 0))
    longest = f", longest in frames {first} to {last}" if runs else ""
    lines = [f"feet slide in {mg.foot_skate(motion):.1%} of the steps{longest}"]
    for own in find_violations([mg.constraints.AvoidSelf()], mg.Poses.from_motion(motion)):
        depth = f"{own.error * mg.constraints.AvoidSelf.tolerance:.3f} heights at frame {own.worst}"
        frames = "{} to {}".format(*own.frames)
        lines.append(f"{own.joint} is in the body in frames {frames}, {depth}")
    return lines if lines[1:] else [*lines, "no hand or forearm is in the body"]


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
    rest = selected_skeleton(options)
    skeleton = read_clip(files[0], skeleton=rest).skeleton
    if is_automatic(options.preset):
        number = automatic_number(options.preset)
        groups = mg.discover_groups(files, number, skeleton=rest).groups
    else:
        groups = mg.JointGroups.preset(options.preset, skeleton)
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
    print_result(options, "groups/1", document, [target or groups.to_toml().removesuffix("\n")])
    return 0
