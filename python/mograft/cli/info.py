"""``mograft info``: joints, rate, length, groups and faults of files."""

import argparse
import os
from typing import Any

from mograft.body.faults import HARMLESS_FAULTS, find_faults
from mograft.body.groups import JointGroups
from mograft.cli.files import expand_folders
from mograft.cli.output import print_result
from mograft.io.bvh.reader import BvhSummary, read_bvh, scan_bvh
from mograft.motion.motion import Motion

MAX_BYTES_IN_MEMORY = 1 << 28
"""Larger files are scanned without a check for faults."""


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    documents = []
    for name in expand_folders(options.files):
        document = _read(name, all_faults=options.verbose or options.json)
        documents.append(document)
        if not options.json:
            print(_describe(document))
    print_result(options, "info", {"files": documents}, [])
    return 0


def _read(name: str, *, all_faults: bool) -> dict[str, Any]:
    """Return the contents of a file; without `all_faults`, harmless faults are omitted."""
    faults: list[str] | None = None
    summary: BvhSummary | Motion
    if os.path.getsize(name) > MAX_BYTES_IN_MEMORY:
        summary = scan_bvh(name)
    else:
        summary = motion = read_bvh(name)
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


def _describe(document: dict[str, Any]) -> str:
    lines = [
        f"{document['file']}",
        f"  {document['joints']} joints, {document['channels']} channels (DoF)",
        f"  {document['frames']} frames at {document['rate']:.6g} fps, {document['seconds']:.2f} s",
    ]
    groups = document["groups"]
    lines += [f"  {group}: {' '.join(names)}" for group, names in groups.items()]
    if not groups:
        lines.append("  no joint groups recognized: pass your own as a TOML file with --groups")
    lines += [f"  repaired: {repair}" for repair in document["repairs"]]
    faults = document["faults"]
    if faults is None:
        faults = ["faults were not checked as the file is large: see mograft check"]
    lines += [f"  warning: {fault}" for fault in faults]
    return "\n".join(lines)
