"""Motions put together from known pieces, with the frames at which the pieces meet."""

import functools
from dataclasses import fields

import numpy as np

import mograft as mg
from mograft import rotations
from mograft.dancer import LEG_STYLES, dance, perform
from mograft.dancer.plan import Plan
from mograft.dancer.styles import ARM_JITTER, JITTER, LegStyle

N_PIECES = 6
PIECE_SECONDS = (5.0, 8.0)
FADE_SECONDS = 0.5
MIN_CLIP_SECONDS = 3.0
MARGIN = 0.12  # share of a clip at each end, in which people stand before and after an action
RATE = 30.0

STYLES = {
    "walk": (LEG_STYLES["walk"], "swing"),
    "jump": (LegStyle(1.6, width=12, height=76, bounce=10, sway=0, twist=0, roll=0), "flap"),
    "wave": (LegStyle(1.2, width=11, bounce=0.6, sway=1, twist=1, roll=1), "wave"),
}
"""Legs and arms of the dancer who walks, jumps and waves."""
CAPTURED = "skel_animated_drawings"
ANIMATED = ("glb/kaykit_Med_MovementBasic.glb", "glb/kaykit_Med_Simulation.glb")
JUMP_HEIGHT = 11.0  # cm
FLIGHT = 0.38  # share of a jump's cycle; about 0.3 s


@functools.lru_cache(maxsize=1)
def dance_of(seed, strides):
    """A dance of the built-in dancer."""
    return dance(seed, strides=strides)


def dancer_pieces(seed, strides=8):
    """A part of a dance of six combinations, and the frames at which they change."""
    made = dance_of(seed, strides)
    is_change = (made.legs[1:] != made.legs[:-1]) | (made.arms[1:] != made.arms[:-1])
    bounds = np.concatenate([[0], np.flatnonzero(is_change) + 1, [len(made)]])
    first = int(np.random.default_rng(seed).integers(len(bounds) - 1 - N_PIECES))
    start, *changes, stop = bounds[first : first + N_PIECES + 1]
    return made.motion[start:stop], np.array(changes) - start


def other_kind(rng, kinds, last):
    """A random one of `kinds`, other than `last`."""
    return str(rng.choice([kind for kind in kinds if kind != last]))


def dancer_who_jumps(seed, strides=8):
    """The dancer who walks, jumps and waves in turn, and the frames at which this changes."""
    rng = np.random.default_rng(seed)
    order = [""]
    for _ in range(N_PIECES):
        order.append(other_kind(rng, STYLES, order[-1]))
    kinds = np.repeat(order[1:], strides)
    noise = rng.normal(size=(len(fields(LegStyle)) + 1, len(kinds))).clip(-2, 2)
    values = {
        field.name: np.array([getattr(STYLES[kind][0], field.name) for kind in kinds], float)
        * (1 + JITTER.get(field.name, 0.0) * noise[row])
        for row, field in enumerate(fields(LegStyle))
    }
    values["turn"] *= np.where(np.arange(len(kinds)) // 4 % 2, -1, 1)
    values["arms"] = 1 + ARM_JITTER * noise[-1]
    made = perform(Plan(kinds, np.array([STYLES[kind][1] for kind in kinds]), values), RATE)
    # Both legs are stretched at a quarter and at three quarters of a stride.
    offset = ((2 * made.phase) % 1 - 0.5) / (FLIGHT / 2)
    height = np.where(made.legs == "jump", JUMP_HEIGHT * np.maximum(1 - offset**2, 0), 0)
    positions = made.motion.positions.copy()
    positions[:, 0, 1] += height
    motion = mg.Motion(
        made.motion.skeleton, made.motion.frame_time, made.motion.rotations, positions
    )
    return motion, np.flatnonzero(made.legs[1:] != made.legs[:-1]) + 1


def read_clips(paths):
    """The rotations of clips by kind of action, without their ends; and one of the motions."""
    clips, sample = {}, None
    for path in sorted(paths):
        motion = mg.read_bvh(path)
        if motion.duration >= MIN_CLIP_SECONDS:
            kind = path.name.split("_")[1]
            clips.setdefault(kind, []).append(without_ends(motion))
            sample = sample or motion
    return clips, sample


def captured_actions(data):
    """Clips by kind, and one of the motions: one person who walks, jumps and waves (FAIR)."""
    motions = {
        kind: mg.read_bvh(data / CAPTURED / f"{name}.bvh").resample(RATE)
        for kind, name in (("walk", "zombie"), ("jump", "jumping"), ("wave", "wave_hello"))
    }
    clips = {kind: [without_standing(motion)] for kind, motion in motions.items()}
    return {"clips": clips, "sample": motions["walk"]}


def animated_actions(data):
    """Clips by kind, and one of the motions: animations of walks, jumps and waves (KayKit)."""
    motions = {
        motion.name.split("|")[-1]: motion for pack in ANIMATED for motion in mg.read(data / pack)
    }
    clips = {
        kind: [motions[name].rotations for name in names.split()]
        for kind, names in (
            ("walk", "Walking_A Walking_B Walking_C"),
            ("jump", "Jump_Full_Long Jump_Full_Short"),
            ("wave", "Waving Cheering"),
        )
    }
    return {"clips": clips, "sample": motions["Walking_A"]}


def without_standing(motion):
    """The rotations from the first to the last frame in which the person moves.

    In these, the mean angular speed of the joints is at least a quarter of its 95th percentile.
    """
    quats = motion.rotations
    steps = rotations.log(rotations.multiply(rotations.inverse(quats[:-1]), quats[1:]))
    speeds = np.linalg.norm(steps, axis=-1).mean(axis=1)
    frames = np.flatnonzero(speeds >= 0.25 * np.percentile(speeds, 95))
    return quats[frames[0] : frames[-1] + 2]


def without_ends(motion):
    """The rotations of a motion without `MARGIN` at both ends."""
    margin = round(MARGIN * motion.n_frames)
    return motion.rotations[margin:-margin]


def recorded_pieces(seed, clips, sample):
    """A motion of six pieces of clips, and the frames in the middle of the cross-fades.

    A clip that is shorter than its piece is continued backwards in time.
    """
    rng = np.random.default_rng(seed)
    fade = round(FADE_SECONDS * sample.rate)
    joined, changes, kind = None, [], None
    for _ in range(N_PIECES):
        kind = other_kind(rng, clips, kind)
        clip = clips[kind][rng.integers(len(clips[kind]))]
        length = round(rng.uniform(*PIECE_SECONDS) * sample.rate)
        while len(clip) < length:
            clip = np.concatenate([clip, clip[-2::-1]])
        start = rng.integers(len(clip) - length + 1)
        piece = clip[start : start + length]
        if joined is None:
            joined = piece
            continue
        changes.append(len(joined) - fade // 2)
        joined = cross_fade(joined, piece, fade)
    positions = np.repeat(sample.positions[:1], len(joined), axis=0)
    root = sample.locomotion_root()
    positions[:, root] = np.resize(sample.positions[:, root], (len(joined), 3))
    quats = joined / np.linalg.norm(joined, axis=-1, keepdims=True)
    return mg.Motion(sample.skeleton, sample.frame_time, quats, positions), np.array(changes)


def cross_fade(before, after, n_frames):
    """The rotations of two pieces, of which `n_frames` frames overlap."""
    share = np.arange(1, n_frames + 1) / (n_frames + 1)
    share = (3 * share**2 - 2 * share**3)[:, None, None]
    gaps = rotations.multiply(rotations.inverse(before[-n_frames:]), after[:n_frames])
    mixed = rotations.multiply(before[-n_frames:], rotations.exp(rotations.log(gaps) * share))
    return np.concatenate([before[:-n_frames], mixed, after[n_frames:]])


def metronome(seed, interval, rate, seconds=16.0, n_joints=6):
    """A motion from one random pose to the next, one per `interval`, at rest in each pose."""
    rng = np.random.default_rng(seed)
    phase = np.arange(round(seconds * rate)) / rate / interval
    poses = rng.uniform(-0.8, 0.8, size=(int(phase[-1]) + 2, n_joints, 3))
    pose = phase.astype(int)
    share = (phase - pose)[:, None, None]
    share = share**3 * (10 - 15 * share + 6 * share**2)
    offsets = np.arange(3.0 * n_joints).reshape(n_joints, 3)
    skeleton = mg.Skeleton([f"j{i}" for i in range(n_joints)], [-1] + [0] * (n_joints - 1), offsets)
    quats = rotations.exp(poses[pose] * (1 - share) + poses[pose + 1] * share)
    return mg.Motion(skeleton, 1 / rate, quats, np.tile(offsets, (len(quats), 1, 1)))
