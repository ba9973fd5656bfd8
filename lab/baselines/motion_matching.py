"""Motion matching, a baseline: the upper body of the frames whose legs move most similarly.

The features are those of Clavet ("Motion Matching and the Road to Next-Gen Animation", GDC 2016)
for the kept joints: positions and velocities of the feet, velocity of the hips, and the path of
the root over the next 20 frames. Gaps are closed by a decaying offset.
"""

from dataclasses import dataclass, replace

import numpy as np

from mograft import rotations
from mograft.body.contacts import Ground, find_legs
from mograft.body.support_polygon import horizontal_axes
from mograft.evaluation.body_tracks import BodyTracks, bone_ends, derivative

SEARCH_FRAMES = 10  # between two searches
DECAY_FRAMES = 6  # time constant of the offset at a change of frames
FUTURE = (7, 13, 20)  # frames ahead at which the path of the root is compared


@dataclass(frozen=True, eq=False)
class MatchingDatabase:
    """Features of all frames of the clips, each feature with a standard deviation of 1."""

    clips: tuple
    features: np.ndarray  # (n_frames, n_features)
    clip: np.ndarray  # clip of each row
    frame: np.ndarray  # frame of each row
    mean: np.ndarray
    scale: np.ndarray

    @classmethod
    def of(cls, clips):
        rows = [leg_features(clip) for clip in clips]
        features = np.concatenate(rows)
        scale = features.std(axis=0)
        scale = np.where(scale > 0, scale, 1.0)
        mean = features.mean(axis=0)
        return cls(
            clips=tuple(clips),
            features=(features - mean) / scale,
            clip=np.repeat(np.arange(len(clips)), list(map(len, rows))),
            frame=np.concatenate([np.arange(len(row)) for row in rows]),
            mean=mean,
            scale=scale,
        )


def leg_features(motion):
    """Return the features of every frame in the directions of its heading."""
    tracks = BodyTracks.of(motion)
    frames = np.arange(len(tracks))
    toes = [leg.ankle if leg.toe is None else leg.toe for leg in find_legs(motion.skeleton)]
    turned = BodyTracks(
        hips=tracks.hips,
        heading=tracks.heading,
        points=_turn_axes(motion, bone_ends(motion, toes)) - tracks.hips[:, None],
        rate=tracks.rate,
    )
    velocity = derivative(turned.points, turned.rate, 1)
    parts = [turned.points, velocity, turned.root_velocity[:, None, :3]]
    for ahead in FUTURE:
        later = np.minimum(frames + ahead, len(tracks) - 1)
        parts.append((tracks.hips[later] - tracks.hips)[:, None])
    return np.concatenate(
        [turned.facing_forward(part, frames).reshape(len(frames), -1) for part in parts], axis=1
    )


def _turn_axes(motion, points):
    """Return points with the horizontal axes first and the vertical axis last."""
    ground = Ground.of(motion)
    first, second = horizontal_axes(ground.up)
    up = int(np.flatnonzero(ground.up)[0])
    frame = np.zeros((3, 3))
    frame[first, 0] = frame[second, 1] = 1.0
    frame[up, 2] = ground.up[up]
    return points @ frame


def match(base, clip, joints, database, rng, *, radius=30, n_nearest=5):
    """Return `base` with `joints` from the frames whose legs are most similar.

    Frames of the clip `clip` less than `radius` frames away are not used: they are the base itself.
    One of the `n_nearest` nearest frames is drawn at each search, so that results differ.
    """
    queries = (leg_features(base) - database.mean) / database.scale
    n = base.n_frames
    quats = base.rotations.copy()
    offset = None
    last = None
    for start in range(0, n, SEARCH_FRAMES):
        stop = min(start + SEARCH_FRAMES, n)
        row = _search(database, queries[start], clip, start, stop - start, radius, n_nearest, rng)
        donor = database.clips[database.clip[row]].rotations
        first = database.frame[row]
        piece = donor[first : first + stop - start][:, joints]
        if last is not None:
            before = donor[max(first - 1, 0), joints]
            offset = rotations.log(rotations.multiply(last, rotations.inverse(before)))
        if offset is not None:
            fade = np.exp(-np.arange(1, len(piece) + 1) / DECAY_FRAMES)[:, None, None]
            piece = rotations.multiply(rotations.exp(offset * fade), piece)
        quats[start:stop, joints] = piece
        last = piece[-1]
    moved = quats[:, joints]
    quats[:, joints] = moved / np.linalg.norm(moved, axis=-1, keepdims=True)
    return replace(base, rotations=quats, channel_values=None)


def _search(database, query, clip, frame, length, radius, n_nearest, rng):
    lengths = np.array([one.n_frames for one in database.clips])[database.clip]
    is_allowed = database.frame + length <= lengths
    is_own = (database.clip == clip) & (np.abs(database.frame - frame) < radius)
    if (is_allowed & ~is_own).any():
        is_allowed &= ~is_own
    rows = np.flatnonzero(is_allowed)
    distances = ((database.features[rows] - query) ** 2).sum(axis=1)
    nearest = rows[np.argsort(distances, kind="stable")[:n_nearest]]
    return int(rng.choice(nearest))
