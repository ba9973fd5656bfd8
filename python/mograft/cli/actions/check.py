"""``mograft check``: the syntax of motion files, and the faults of their recordings."""

import argparse
from pathlib import Path
from typing import Any

from mograft.body.faults import HARMLESS_FAULTS, find_faults
from mograft.cli.configuration import selected_skeleton
from mograft.cli.files import expand_folders
from mograft.cli.output import print_error, print_result
from mograft.errors import FormatError
from mograft.io.addresses import read_clip, split_address
from mograft.io.bvh.reader import read_bvh
from mograft.io.formats import find_format
from mograft.motion.skeleton import Skeleton


def run(options: argparse.Namespace) -> int:
    """Check every file; return exit code 3 if one of them is not valid, else 0."""
    documents, skeleton = [], selected_skeleton(options)
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
            f"{fault['kind']}: {_describe(fault)}"
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


def _describe(fault: dict[str, Any]) -> str:
    first, last = fault["frames"]
    frames = f"frame {first}" if first == last else f"frames {first} to {last}"
    joint = "" if fault["joint"] is None else f", {fault['joint']}"
    return f"{frames}{joint}: {fault['message']}"
