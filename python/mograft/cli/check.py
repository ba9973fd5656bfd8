"""``mograft check``: whether files are BVH, and what looks wrong in their motion."""

import argparse
from typing import Any

from mograft.cli._common import expanded, print_json, say


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    check = commands.add_parser("check", help="whether files are BVH, and what looks wrong in them")
    check.add_argument("files", nargs="+", metavar="FILE")
    check.add_argument("--strict", action="store_true", help="refuse what is usually tolerated")
    check.add_argument("--json", action="store_true", help="as one JSON document")
    check.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command: every file is looked at; 3 if one of them is no BVH motion."""
    documents = []
    for name in expanded(options.files):
        document = _judged(name, strict=options.strict)
        documents.append(document)
        if options.json:
            continue
        if document["error"] is not None:
            say(f"error: {document['error']}")
            continue
        found = [f"tolerated: {repair}" for repair in document["repairs"]]
        found += [f"{fault['kind']}: {_where(fault)}" for fault in document["faults"]]
        print("\n  ".join([f"{name}: {'' if found else 'good'}".rstrip(), *found]))
    if options.json:
        print_json({"schema": "mograft.check/1", "files": documents})
    return 3 if any(document["error"] for document in documents) else 0


def _judged(name: str, *, strict: bool) -> dict[str, Any]:
    from mograft.body.faults import find_faults
    from mograft.errors import BvhError
    from mograft.io.bvh import read_bvh

    try:
        motion = read_bvh(name, strict=strict)
    except BvhError as error:
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


def _where(fault: dict[str, Any]) -> str:
    first, last = fault["frames"]
    frames = f"frame {first}" if first == last else f"frames {first} to {last}"
    joint = "" if fault["joint"] is None else f", {fault['joint']}"
    return f"{frames}{joint}: {fault['message']}"
