"""``mograft info``: joints, rate, length, groups and faults of files."""

import argparse
import os
from typing import TYPE_CHECKING, Any

from mograft.cli._common import expanded, print_json

if TYPE_CHECKING:
    from mograft.io.bvh import BvhSummary
    from mograft.motion.motion import Motion

_LARGE = 1 << 28
"""Files of more bytes are not held in memory to be described."""


def add(commands: Any) -> None:  # noqa: ANN401 - argparse keeps the type to itself
    """Add the command to the parser."""
    info = commands.add_parser("info", help="joints, rate, length, groups and faults of files")
    info.add_argument("files", nargs="+", metavar="FILE")
    info.add_argument("--json", action="store_true", help="as one JSON document")
    info.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    documents = []
    for name in expanded(options.files):
        document = _describe(name)
        documents.append(document)
        if not options.json:
            print(_description(document))
    if options.json:
        print_json({"schema": "mograft.info/1", "files": documents})
    return 0


def _describe(name: str) -> dict[str, Any]:
    from mograft.body.faults import find_faults
    from mograft.body.groups import JointGroups
    from mograft.io.bvh import read_bvh, scan_bvh

    faults: list[str] | None = None
    summary: BvhSummary | Motion
    if os.path.getsize(name) > _LARGE:
        summary = scan_bvh(name)
    else:
        summary = motion = read_bvh(name)
        faults = [fault.message for fault in find_faults(motion)]
    skeleton = summary.skeleton
    try:
        members = JointGroups.preset("lower_torso_arms", skeleton).resolve(skeleton)
        groups = {g: [skeleton.names[j] for j in own] for g, own in members.items()}
    except ValueError:
        groups = {}
    return {
        "file": name,
        "joints": skeleton.n_joints,
        "channels": skeleton.n_channels,
        "frames": summary.n_frames,
        "frame_time": summary.frame_time,
        "rate": summary.rate,
        "seconds": summary.duration,
        "groups": groups,
        "repairs": list(summary.repairs),
        "faults": faults,
    }


def _description(document: dict[str, Any]) -> str:
    lines = [
        f"{document['file']}",
        f"  {document['joints']} joints, {document['channels']} channels (DoF)",
        f"  {document['frames']} frames at {document['rate']:.6g} fps, {document['seconds']:.2f} s",
    ]
    groups = document["groups"]
    lines += [f"  {group}: {' '.join(names)}" for group, names in groups.items()]
    if not groups:
        lines.append("  no groups recognised: see mograft groups and --groups FILE")
    lines += [f"  repaired: {repair}" for repair in document["repairs"]]
    faults = document["faults"]
    if faults is None:
        faults = ["a large file, read through but not looked at for faults: see mograft check"]
    lines += [f"  warning: {fault}" for fault in faults]
    return "\n".join(lines)
