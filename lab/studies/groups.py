"""Compare discovered joint groups with those of the presets.

``python -m lab groups [FOLDER]`` reads the recordings in FOLDER (default: ``../shared/data``
beside the checkout) and prints

- ``table``: for each human, the number of segments, the groups that `discover_groups` finds at the
  number of the preset ``lower_torso_arms``, the joints in other groups than there, the dependences
  of trunk and head and of trunk and arms, and the number of groups of ``auto``; for other
  skeletons, four groups;
- ``quality``: the measures of `lab.studies.variety` for grafts with the groups of each preset, and
  with discovered groups. ``--source`` selects other sources by the beginning of their names.

``--only NAME`` prints one of these. Quality needs scikit-learn.
"""

import argparse
from collections import defaultdict
from itertools import permutations
from pathlib import Path

import numpy as np

import mograft as mg
from lab.common import run, tiny_motion
from lab.donors.enrichment import PRESETS
from lab.studies.variety import COLUMNS, RATE, measure
from mograft.body.anatomy import anatomy, feature_joints

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
PRESET = "lower_torso_arms"
N_ANIMAL_GROUPS = 4
SUFFIXES = (".bvh", ".fbx", ".glb", ".npz")
PARTS = ("table", "quality")
QUALITY_SOURCES = ("bandai_ds1", "dance_cmu94")
MAX_CLIPS = 2  # clips of a source for the measures of quality
COUNT = 2  # grafts per clip


def read_sources(folder, beginnings=("",)):
    """The motions of each subfolder and hierarchy, by name; files that cannot be read are left out.

    Only sources whose names begin with one of `beginnings` are returned. Motions of one frame have
    no segments.
    """
    sources = defaultdict(list)
    for file in sorted(path for path in Path(folder).rglob("*") if path.suffix in SUFFIXES):
        subfolder = file.parent.name
        if not any(subfolder.startswith(own) or own.startswith(subfolder) for own in beginnings):
            continue
        try:
            motions = [motion for motion in mg.read(file) if motion.n_frames > 1]
        except (mg.MograftError, ValueError, OSError):
            continue
        for motion in motions:
            key = subfolder, motion.skeleton.names, tuple(motion.skeleton.parents)
            sources[key].append(motion)
    named = {
        f"{subfolder} {Path(motions[0].path or motions[0].name).stem}": motions
        for (subfolder, *_), motions in sources.items()
    }
    return {name: own for name, own in named.items() if name.startswith(tuple(beginnings))}


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


def unit_dependence(discovery, first, second):
    """The dependence of the units with two body parts; "-" if one of them is not a unit."""
    parts = anatomy(discovery.pose.skeleton).parts
    units = [
        next((u for u, own in enumerate(discovery.units[1:], 1) if part in parts_of(parts, own)), 0)
        for part in (first, second)
    ]
    return f"{discovery.dependence[tuple(units)]:.2f}" if all(units) else "-"


def parts_of(parts, joints):
    """The body parts of some joints."""
    return {parts[joint] for joint in joints.tolist()}


def describe_human(motions):
    """The cells of a human in the table, and whether the groups are those of the preset."""
    skeleton = motions[0].skeleton
    expected = mg.JointGroups.preset(PRESET, skeleton).resolve(skeleton)
    discovery = mg.discover_groups(motions, len(expected))
    found = discovery.groups.resolve(skeleton)
    n_by_gap = len(mg.discover_groups(motions).groups.names)
    differing = [skeleton.names[joint] for joint in differing_joints(skeleton, found, expected)]
    pairs = [unit_dependence(discovery, "trunk", part) for part in ("head", "forearm")]
    difference = ", ".join(differing) or "none"
    n_segments = sum(len(mg.segment(motion)) for motion in motions)
    return [str(n_segments), counts_text(found), difference, *pairs, str(n_by_gap)], not differing


def counts_text(found):
    """The names of groups with their numbers of joints."""
    return ", ".join(f"{name} {len(joints)}" for name, joints in found.items())


def describe_animal(motions):
    """The groups of a skeleton that is not human, and the joints of all except the base."""
    skeleton = motions[0].skeleton
    found = mg.discover_groups(motions, N_ANIMAL_GROUPS).groups.resolve(skeleton)
    members = [
        f"{name}: {' '.join(skeleton.names[joint] for joint in joints)}"
        for name, joints in list(found.items())[1:]
    ]
    return f"{counts_text(found)} | {'; '.join(members)}"


def print_table(sources):
    heads = ("segments", "groups and joints", "differing joints", "trunk-head", "trunk-arm", "auto")
    print("| source " + "".join(f"| {head} " for head in heads) + "|")
    print("|---" * (len(heads) + 1) + "|")
    n_equal = n_humans = 0
    others = []
    for name, motions in sources.items():
        if not anatomy(motions[0].skeleton).human:
            others.append((name, motions))
            continue
        try:
            cells, is_equal = describe_human(motions)
            n_equal, n_humans = n_equal + is_equal, n_humans + 1
        except ValueError as error:
            cells = ["-", "none", str(error), "-", "-", "-"]
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)
    print(f"\nequal to {PRESET}: {n_equal} of {n_humans}\n")
    print("| not human | groups and joints | joints of the other groups |\n|---|---|---|")
    for name, motions in others:
        try:
            print(f"| {name} | {describe_animal(motions)} |")
        except ValueError as error:
            print(f"| {name} | none | {error} |")


def distinct_groups(motions):
    """Joint groups by label: those of the presets, and discovered ones that differ from them."""
    skeleton = motions[0].skeleton
    found = {}
    for label in (*PRESETS, "auto:2", "auto:3", "auto:4", "auto"):
        try:
            groups = mg.Library.build(motions[:MAX_CLIPS], label).groups
        except ValueError:
            continue
        parts = frozenset(frozenset(own.tolist()) for own in groups.resolve(skeleton).values())
        labels, _ = found.setdefault(parts, ([], groups))
        labels.append(label)
    return {", ".join(labels): groups for labels, groups in found.values()}


def print_quality(sources):
    """Print the measures of `lab.studies.variety` by source and joint groups."""
    print("| source | groups |" + "".join(f" {title} |" for title in COLUMNS))
    print("|---|---|" + "---|" * len(COLUMNS))
    for name, motions in sources.items():
        for label, groups in distinct_groups(motions).items():
            library = mg.Library.build(motions[:MAX_CLIPS], groups, rate=RATE)
            exchanged, new, between, gap, *areas = measure(library, mg.Config(), COUNT)
            cells = "".join(f" {area:.2f} |" for area in areas)
            print(
                f"| {name} | {label} | {exchanged:.2f} | {new:.2f} | {between:.2f} | {gap:.1f}° |"
                + cells,
                flush=True,
            )


def main(argv=None):
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, default=DATA)
    parser.add_argument("--only", choices=PARTS)
    parser.add_argument("--source", action="append", help="beginning of the names of sources")
    return run(parser, report, argv)


def report(options):
    tiny = {"dancer": [tiny_motion()]} if options.tiny else None
    if options.only in (None, "table"):
        print_table(tiny or read_sources(options.folder))
    if options.only in (None, "quality"):
        print_quality(tiny or read_sources(options.folder, options.source or QUALITY_SOURCES))
