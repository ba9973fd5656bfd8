"""Compare discovered joint groups with those of the presets.

``python benches/groups.py [FOLDER]`` reads the recordings in FOLDER (default: ``../shared/data``
beside the checkout) and prints

- ``table``: for each hierarchy, the groups that `discover_groups` finds at the number of the preset
  ``lower_torso_arms``, or at four groups for an animal, and the joints in other groups than there;
- ``quality``: measures of grafts with the discovered groups and with those of each preset.

``--only NAME`` prints one of these. Quality needs scikit-learn.
"""

import argparse
import sys
from collections import defaultdict
from itertools import permutations
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mograft as mg
from benches._common import run, tiny_motion
from mograft.body.anatomy import anatomy, feature_joints
from mograft.library.discover import scan_folder

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
PRESET = "lower_torso_arms"
N_ANIMAL_GROUPS = 4
PARTS = ("table", "quality")


def read_sources(folder):
    """The motions of each subfolder and hierarchy, by name; files that cannot be read are left out.

    Motions of one frame have no segments.
    """
    sources = defaultdict(list)
    for file in scan_folder(str(folder)):
        try:
            motions = [motion for motion in mg.read(file) if motion.n_frames > 1]
        except (mg.MograftError, ValueError, OSError):
            continue
        for motion in motions:
            key = file.parent.name, motion.skeleton.names, tuple(motion.skeleton.parents)
            sources[key].append(motion)
    return {
        f"{folder} {Path(motions[0].path or motions[0].name).stem}": motions
        for (folder, *_), motions in sources.items()
    }


def differing_joints(skeleton, found, expected):
    """The compared joints whose group differs, under the best assignment of group names."""
    joints = feature_joints(skeleton, np.arange(skeleton.n_joints)).tolist()
    group_of = [
        {joint: name for name, members in groups.items() for joint in members.tolist()}
        for groups in (found, expected)
    ]
    differing = []
    for names in permutations(found, len(expected)):
        translation = dict(zip(expected, names, strict=True))
        differing.append([j for j in joints if translation[group_of[1][j]] != group_of[0][j]])
    return min(differing, key=len)


def describe_source(motions):
    """The number of segments, the groups and how they differ from the preset."""
    skeleton = motions[0].skeleton
    is_human = anatomy(skeleton).human
    try:
        expected = mg.JointGroups.preset(PRESET, skeleton).resolve(skeleton) if is_human else None
    except ValueError as error:
        return "-", "-", f"no preset: {error}"
    n_groups = len(expected) if is_human else N_ANIMAL_GROUPS
    library = mg.Library.build(motions, "lower_upper") if is_human else None
    n_segments = "-" if library is None else len(library.segments)
    try:
        groups = mg.JointGroups.discover(motions, n_groups)
    except ValueError as error:
        return n_segments, "-", str(error)
    found = groups.resolve(skeleton)
    shown = "; ".join(f"{name} {len(joints)}" for name, joints in found.items())
    if not is_human:
        return n_segments, shown, members_text(skeleton, found)
    differing = differing_joints(skeleton, found, expected)
    names = [skeleton.names[joint] for joint in differing]
    return n_segments, shown, f"differs: {', '.join(names)}" if names else "equal"


def members_text(skeleton, found):
    """The joints of all groups except the base."""
    return "; ".join(
        f"{name}: {' '.join(skeleton.names[joint] for joint in joints)}"
        for name, joints in list(found.items())[1:]
    )


def print_table(sources):
    print("| source | clips | segments | groups and joints | beside the preset |")
    print("|---|---|---|---|---|")
    equal = humans = 0
    for name, motions in sources.items():
        n_segments, shown, difference = describe_source(motions)
        humans += difference == "equal" or difference.startswith("differs")
        equal += difference == "equal"
        print(f"| {name} | {len(motions)} | {n_segments} | {shown} | {difference} |", flush=True)
    print(f"\nequal to {PRESET}: {equal} of {humans} humans")


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=DATA)
    parser.add_argument("--only", choices=PARTS)
    return run(parser, report, argv)


def report(options):
    sources = {"dancer": [tiny_motion()]} if options.tiny else read_sources(options.folder)
    if options.only in (None, "table"):
        print_table(sources)


if __name__ == "__main__":
    sys.exit(main())
