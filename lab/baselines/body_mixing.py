"""Random exchange of body parts, and noise: baselines that look at no motion."""

from dataclasses import replace

import numpy as np

from mograft import rotations

BLEND_FRAMES = 8  # over which one random piece is faded into the next
MAX_PIECE_FRAMES = 90
SOFT_JOINTS = 2  # joints next to the kept ones whose rotations are blended


def soft_weights(skeleton, joints):
    """Return the weight of the donor for each of `joints`: 1/3, 2/3 and then 1 from the border."""
    members = set(np.asarray(joints).tolist())
    weights = []
    for joint in joints:
        depth = 1
        for above in skeleton.ancestors(int(joint)):
            if above not in members:
                break
            depth += 1
        weights.append(min(depth / (SOFT_JOINTS + 1), 1.0))
    return np.array(weights)


def blend(first, second, weights):
    """Interpolate spherically from `first` to `second`; weights 0 and 1 return them unchanged."""
    turns = rotations.log(rotations.multiply(rotations.inverse(first), second))
    mixed = rotations.multiply(first, rotations.exp(turns * weights[..., None]))
    mixed = np.where(weights[..., None] == 0, first, mixed)
    return np.where(weights[..., None] == 1, second, mixed)


def random_track(clips, joints, n_frames, rng):
    """Return the rotations of `joints` in random pieces of random clips, one faded into the next.

    A piece has at most 90 frames; the result has shape (n_frames, n_joints, 4).
    """
    track = np.zeros((0, len(joints), 4))
    while len(track) < n_frames:
        clip = clips[rng.integers(len(clips))]
        length = min(MAX_PIECE_FRAMES, clip.n_frames)
        first = int(rng.integers(clip.n_frames - length + 1))
        piece = clip.rotations[first : first + length][:, joints]
        fade = min(BLEND_FRAMES, len(track), len(piece) - 1)
        if fade:
            shares = np.repeat((np.arange(1, fade + 1) / (fade + 1))[:, None], len(joints), axis=1)
            mixed = blend(track[-fade:], piece[:fade], shares)
            track = np.concatenate([track[:-fade], mixed, piece[fade:]])
        else:
            track = np.concatenate([track, piece])
    return track[:n_frames]


def cut_mix(base, clips, joints, rng):
    """Return `base` with the rotations of `joints` from random pieces of `clips`.

    The rotations of joints next to the kept ones are blended spherically with those of the base;
    all other joints keep their rotations. This follows MotionCutMix (Jiang et al., CVPR 2025),
    where body parts of random motions are blended with soft masks, here without its model.
    """
    donor = random_track(clips, joints, base.n_frames, rng)
    weights = np.repeat(soft_weights(base.skeleton, joints)[None], base.n_frames, axis=0)
    quats = base.rotations.copy()
    quats[:, joints] = blend(quats[:, joints], donor, weights)
    return replace(base, rotations=quats, channel_values=None)


def add_noise(motion, degrees, rng, joints=None):
    """Turn the joints in every frame about random axes by normal angles of this deviation.

    This is the rotation noise of pybvh-ml. By default all joints turn.
    """
    joints = np.arange(motion.n_joints) if joints is None else np.asarray(joints)
    shape = (motion.n_frames, len(joints))
    axes = rng.standard_normal((*shape, 3))
    axes /= np.maximum(np.linalg.norm(axes, axis=-1, keepdims=True), 1e-12)
    turns = rotations.exp(axes * rng.normal(0, np.radians(degrees), shape)[..., None])
    quats = motion.rotations.copy()
    turned = rotations.multiply(turns, quats[:, joints])
    quats[:, joints] = turned / np.linalg.norm(turned, axis=-1, keepdims=True)
    return replace(motion, rotations=quats, channel_values=None)
