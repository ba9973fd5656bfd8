"""Skeletons for tests: from one line of text, or from the hierarchy of a recording."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st

from mograft import EndSite, Skeleton, read_bvh
from mograft.io.bvh.cursor import open_cursor
from mograft.io.bvh.header import read_header
from mograft.motion import rotations

DATA = Path(__file__).parents[2] / "shared" / "data"
DANCES = (
    "bandai_ds1/dataset-1_dance-short_normal_001",
    "dance_cmu60_salsa/60_01",
    "dance_cmu94_indian_30fps/94_01_1",
)
"""Dance recordings of three sources."""


def recording(name):
    """Return a recording at 60 fps or less, without a leading rest pose."""
    path = DATA / f"{name}.bvh"
    if not path.exists():
        pytest.skip(f"the recording {name} is missing")
    motion = read_bvh(path)
    step = np.abs(np.diff(motion.positions[:3, motion.locomotion_root()], axis=0)).max(axis=-1)
    motion = motion[1:] if step[0] > 5 * max(step[1], 1e-9) else motion
    return motion.resample(30.0) if motion.rate > 60 else motion


def skeleton_from_text(text, offsets=None):
    """Return a skeleton and the notes behind each name.

    ``Hips=pelvis {Spine=trunk > Head=head | LeftLeg=thigh left}``: ``>`` goes down, ``{ | }``
    branches.
    """
    names, parents, notes = [], [], []
    parent, stack = -1, []
    for token in re.findall(r"[{|}>]|[^{|}>]+", text):
        if token == "{":
            stack.append(parent)
        elif token == "|":
            parent = stack[-1]
        elif token == "}":
            parent = stack.pop()
        elif token != ">" and token.strip():
            name, _, note = token.strip().partition("=")
            names.append(name.strip())
            parents.append(parent)
            notes.append(note.split())
            parent = len(names) - 1
    offsets = np.zeros((len(names), 3)) if offsets is None else offsets
    return Skeleton(names, parents, offsets), notes


def with_names(skeleton, name):
    """Return the skeleton with names `name(joint index, old name)`."""
    return replace(skeleton, names=tuple(name(*own) for own in enumerate(skeleton.names)))


def without_names(skeleton):
    """Return the skeleton with names that say nothing."""
    return with_names(skeleton, lambda joint, _: f"j{joint}")


def _under_joint(motion, name, offsets, path):
    """Return the motion below a joint that moves along a path; world positions stay."""
    old = motion.skeleton
    sites = tuple(replace(site, parent=site.parent + 1) for site in old.end_sites)
    below = Skeleton([name, *old.names], [-1, *(old.parents + 1)], offsets, end_sites=sites)
    still = np.tile(rotations.IDENTITY, (motion.n_frames, 1, 1))
    root = motion.positions[:, :1] - path
    quats = np.concatenate([still, motion.rotations], axis=1)
    places = np.concatenate([path, root, motion.positions[:, 1:]], axis=1)
    changes = {"rotations": quats, "positions": places, "channel_values": None}
    return replace(motion, skeleton=below, **changes)


def with_joint_above_root(motion, share):
    """Return a motion whose root has a parent that moves by a share of the root's travel."""
    offsets = np.concatenate([np.zeros((1, 3)), motion.skeleton.offsets])
    travel = share * motion.positions[:, :1] * [1.0, 0.0, 1.0]
    return _under_joint(motion, "World", offsets, travel)


def under_world_root(motion, *, moving_root=False):
    """Return a motion whose root is a child of a helper joint on the floor, as in Bandai's files.

    World positions are those of the motion. With `moving_root`, the helper moves along the floor.
    """
    rest = [np.zeros((1, 3)), motion.positions[0, :1], motion.skeleton.offsets[1:]]
    path = np.zeros((motion.n_frames, 1, 3))
    if moving_root:
        path[:, 0, 0] = np.linspace(-300, 500, motion.n_frames)
    return _under_joint(motion, "joint_Root", np.concatenate(rest), path)


def with_order(skeleton, order):
    """Return the skeleton with another order of joints, parents first."""
    new_index = {old: new for new, old in enumerate(order)}
    parents = [new_index.get(int(skeleton.parents[old]), -1) for old in order]
    sites = tuple(replace(s, parent=new_index[s.parent], before=0) for s in skeleton.end_sites)
    names, channels = ([own[old] for old in order] for own in (skeleton.names, skeleton.channels))
    return Skeleton(names, parents, skeleton.offsets[order], channels, sites)


@st.composite
def orders(draw, skeleton):
    """Orders of the joints in which every parent precedes its children."""
    ready, order = [0], []
    while ready:
        joint = ready.pop(draw(st.integers(0, len(ready) - 1)))
        order.append(joint)
        ready += skeleton.children[joint]
    return order


# One name of each kind, and some unknown names.
WORDS = (
    "Hips Spine Neck Head LeftShoulder LeftArm RightArm LeftHand RightHandThumb1 LeftUpLeg"
    " RightUpLeg LeftLeg LeftHip RightKnee RightFoot LeftToe Tail End L5 T3 Bone j7 x"
)
KNOWN_NAMES = st.sampled_from(tuple(WORDS.split()))


@st.composite
def skeletons(draw, names=KNOWN_NAMES, max_joints=16):
    """Random trees of joints with random names and offsets."""
    n_joints = draw(st.integers(1, max_joints))
    parents = [-1] + [draw(st.integers(0, joint - 1)) for joint in range(1, n_joints)]
    number = st.integers(-20, 20).map(float)
    vector = st.tuples(number, number, number)
    offsets = draw(st.lists(vector, min_size=n_joints, max_size=n_joints))
    sites = draw(st.lists(st.tuples(st.integers(0, n_joints - 1), number), max_size=3))
    joint_names = [draw(names) for _ in range(n_joints)]
    tips = tuple(EndSite(joint, (0, y, 1)) for joint, y in sites)
    return Skeleton(joint_names, parents, offsets, end_sites=tips)


def human():
    """The 18 joints of the Biovision skeleton, 57 degrees of freedom, 170 units high."""
    skeleton, _ = skeleton_from_text(
        "Hips {LeftHip > LeftKnee > LeftAnkle | RightHip > RightKnee > RightAnkle"
        " | Chest {LeftCollar > LeftShoulder > LeftElbow > LeftWrist"
        " | RightCollar > RightShoulder > RightElbow > RightWrist | Neck > Head}}"
    )
    trunk = {"Hips": (0, 0, 0), "Chest": (0, 22, 0), "Neck": (0, 24, 0), "Head": (0, 9, 2)}
    legs = {"Hip": (9, 0, 0), "Knee": (0, -41, 0), "Ankle": (0, -40, -2)}
    arms = {"Collar": (3, 20, 1), "Shoulder": (14, 0, 0), "Elbow": (28, 0, 0), "Wrist": (25, 0, 0)}
    ends = {"Head": (0, 18, 0), "Wrist": (17, 0, 0), "Ankle": (0, -6, 15)}
    offsets, sites = [], []
    for joint, name in enumerate(skeleton.names):
        side, short = (-1 if "Right" in name else 1, 1, 1), re.sub("Left|Right", "", name)
        offsets.append(np.multiply(side, {**trunk, **legs, **arms}[short]))
        if short in ends:
            sites.append(EndSite(joint, np.multiply(side, ends[short])))
    return Skeleton(skeleton.names, skeleton.parents, offsets, end_sites=tuple(sites))


def read_hierarchy(path):
    """Return the skeleton of a BVH file."""
    return read_header(open_cursor(path, strict=False)).skeleton


@cache
def distinct_recordings():
    """Return one file per distinct hierarchy of the recordings; none if they are missing."""
    paths = {}
    for path in sorted(DATA.glob("*/*.bvh")):
        skeleton = read_hierarchy(path)
        paths.setdefault((skeleton.names, tuple(skeleton.parents)), path)
    return sorted(paths.values())


def clip_name(path):
    """Return the folder and the stem of a recording."""
    return f"{path.parent.name}/{path.stem}"


def each_recording():
    """The mark of tests of `path`: one file per distinct hierarchy of the recordings."""
    return pytest.mark.parametrize("path", distinct_recordings(), ids=clip_name)


def mark_repeated_hierarchies(paths):
    """Return test parameters for files; of each hierarchy, all but one need `--thorough`."""
    firsts = set(distinct_recordings())
    thorough = {"marks": pytest.mark.thorough}
    return [pytest.param(path, **{} if path in firsts else thorough) for path in paths]
